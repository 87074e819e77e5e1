"""Numerical error bars of scores, from the convergence study of a site."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from runout.scores.contingency import Contingency
from runout.scores.elevation_change import ChangeErrors
from runout.scores.field_errors import FieldErrors
from runout.scores.thalweg import ThalwegErrors

Bars = dict[str, float | None]
POWERS = {
    **dict.fromkeys(("absolute_sum", "net_sum", "mean", "root_mean_square", "alone"), 1),
    "squared_sum": 2,
}  # of a difference of two maps in what the study states of it


@dataclass(frozen=True)
class ErrorBars:
    """What ``convergence.json`` of a site says of the errors of its maps.

    The study is that of the median scenario (``runout verify SITE --convergence``). A score inherits it to first order. Below, d is
    the difference of a map on the site's grid and on a coarser one, and A = (1 - CSI of both) times the modelled area, each times
    the error of the map over this difference (:mod:`runout.forecast.numerical_error`).

    ==============================  ===========================================================================================
    score                           error bar
    ==============================  ===========================================================================================
    front error, energy line        error of the front of 99 % of the mass
    area bias                       error of the area over the observed area
    POD; FAR; CSI                   A over the observed area; over the modelled area; over the area that either reaches
    lateral error, lateral shift    A over twice the length of the common stretch
    width bias                      A over that length and the observed width
    RMSE, bias                      root of the sum of d^2, sum of d, over the scored area
    relative L1, volume bias        sum of abs(d), sum of d, over the observed sum
    at points                       root mean square of d where either grid has a flow
    arrival                         mean and root mean square of d where both grids have an arrival
    missed arrivals                 share of the cells with an arrival on one grid alone, times the observed arrivals
    ==============================  ===========================================================================================

    A root mean square moves by at most the root mean square of the difference, and a mean of absolute values likewise.

    Attributes
    ----------
    content : mapping
        The file, or empty.
    """

    content: Mapping[str, Any]

    def front(self) -> float | None:
        """Error of the front [m]."""
        quantities = self.content.get("quantities")
        return _number(quantities.get("f99") if isinstance(quantities, Mapping) else None, "error")

    def of_contingency(self, table: Contingency, quantity: str, threshold: float) -> Bars:
        """Errors of the scores of a table by name, for a map of the study such as "flow_thickness" at a threshold [m]."""
        area = None
        if quantity == "flow_thickness" and isinstance(self.content.get("quantities"), Mapping):
            area = _number(self.content["quantities"].get(f"area_above_{threshold:g}_m"), "error")
        changed = self._changed(table, quantity, threshold)
        either = table.hits + table.misses + table.false_alarms
        return {
            "csi": _over(changed, either),
            "pod": _over(changed, table.observed),
            "far": _over(changed, table.modelled),
            "area_bias": _over(area, table.observed),
        }

    def of_thalweg(self, errors: ThalwegErrors, table: Contingency | None, quantity: str, threshold: float) -> Bars:
        """Errors of front and sides, for the area of a table at a threshold [m] of a map."""
        changed = None if table is None else self._changed(table, quantity, threshold)
        side = _over(changed, 2.0 * errors.stretch)
        return {
            "front_error": self.front() if quantity == "flow_thickness" else None,
            "lateral_error": side,
            "lateral_shift": side,
            "width_bias": _over(changed, errors.stretch * errors.observed_width),
        }

    def of_field(self, errors: FieldErrors, quantity: str) -> Bars:
        """Errors of the scores of a map of the study."""
        field = self._field(quantity)
        net = _number(field, "net_sum")
        net = None if net is None else abs(net)
        square = _over(_number(field, "squared_sum"), errors.scored_area)
        return {
            "bias": _over(net, errors.scored_area),
            "rmse": None if square is None else math.sqrt(square),
            "relative_l1": _over(_number(field, "absolute_sum"), errors.observed_absolute_sum),
            "volume_bias": _over(net, abs(errors.observed_sum)),
        }

    def of_change(self, errors: ChangeErrors, limit: float) -> Bars:
        """Errors of the scores of a change of elevation with a detection limit [m]."""
        erosion, deposition = self.of_field(errors.erosion, "erosion"), self.of_field(errors.deposition, "deposition")
        area, parts = errors.change.scored_area, [self._field(name) for name in ("erosion", "deposition")]
        square = _over(_sum(parts, "squared_sum"), area)
        return {
            "erosion_volume_bias": erosion["volume_bias"],
            "deposition_volume_bias": deposition["volume_bias"],
            "erosion_csi": self.of_contingency(errors.erosion_area, "erosion", limit)["csi"],
            "deposition_csi": self.of_contingency(errors.deposition_area, "deposition", limit)["csi"],
            "bias": _over(_sum(parts, "net_sum"), area),
            "rmse": None if square is None else math.sqrt(square),
        }

    def at_points(self, quantity: str) -> Bars:
        """Errors of bias and root mean square of a map at points: both that of the map, since few points share its sign."""
        field = self._field(quantity)
        square = _over(_number(field, "squared_sum"), _number(field, "reached_area") or 0.0)
        root = None if square is None else math.sqrt(square)
        return {"bias": root, "rmse": root}

    def of_arrival(self, observed: int) -> Bars:
        """Errors of the scores of ``observed`` arrival times [s]."""
        mean, root, alone = (_number(self._field("arrival"), name) for name in ("mean", "root_mean_square", "alone"))
        missed = None if alone is None else alone * observed
        return {"arrival_bias": None if mean is None else abs(mean), "arrival_rmse": root, "missed_arrivals": missed}

    def _changed(self, table: Contingency, quantity: str, threshold: float) -> float | None:
        """Error of the modelled area of a table by cells that change sides [m2]."""
        index = self._field(quantity).get("critical_success_index")
        agreement = _number(index, f"{threshold:g}")
        return None if agreement is None else (1.0 - agreement) * table.modelled

    def _field(self, quantity: str) -> Mapping[str, Any]:
        """Differences of a map on two grids, scaled to its error."""
        fields = self.content.get("fields")
        for field in fields if isinstance(fields, list) else ():
            if isinstance(field, Mapping) and field.get("map") == quantity:
                factor = _number(field, "error_over_difference")
                return field if factor is None else {**field, **_scaled(field, factor)}
        return {}


def _scaled(field: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Sums and shares of a difference of two maps that is ``factor`` times as large."""
    scaled_sums: dict[str, Any] = {
        name: value * factor**power for name, power in POWERS.items() if (value := _number(field, name)) is not None
    }
    index = field.get("critical_success_index")
    if isinstance(index, Mapping):
        known = {name: value for name in index if (value := _number(index, name)) is not None}
        scaled_sums["critical_success_index"] = {name: max(0.0, 1.0 - factor * (1.0 - value)) for name, value in known.items()}
    return scaled_sums


def _number(entry: Any, name: str) -> float | None:
    value = entry.get(name) if isinstance(entry, Mapping) else None
    return float(value) if isinstance(value, int | float) else None


def _sum(entries: Sequence[Any], name: str) -> float | None:
    """Sum of the absolute values; None where one is not known."""
    values = [_number(entry, name) for entry in entries]
    return None if None in values else sum(abs(value) for value in values if value is not None)


def _over(error: float | None, whole: float) -> float | None:
    return None if error is None or not math.isfinite(error) or not math.isfinite(whole) or not whole else error / whole
