"""Table of all scores: name -> meaning, unit, range and best value. The report and the documentation print it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from runout.io.provenance import plain

WILKS = "Wilks 2011, sec. 8.2"
ROUNDING = 1e-6  # in the printed unit: of maps in single precision


@dataclass(frozen=True)
class Definition:
    """What a score is.

    Attributes
    ----------
    title : str
        Short name for tables.
    units : str
        UDUNITS unit, "1" for a pure number; "" where it is that of the map.
    low, high, best : float
        Range, and value of a perfect model.
    meaning : str
        One sentence; modelled over, or minus, observed.
    undefined : str
        Why a score has no value, where it has none.
    reference : str
        Paper.
    """

    title: str
    units: str
    low: float
    high: float
    best: float
    meaning: str
    undefined: str
    reference: str = ""

    @property
    def range(self) -> str:
        """The range in words."""
        if math.isinf(self.low):
            return "any"
        return f"{self.low:g} or more" if math.isinf(self.high) else f"{self.low:g} to {self.high:g}"


_INF = math.inf
DEFINITIONS = {
    "csi": Definition(
        "CSI", "1", 0, 1, 1, "critical success index: area reached in both over area reached in either",
        "neither reaches a known cell", WILKS,
    ),
    "pod": Definition(
        "POD", "1", 0, 1, 1, "probability of detection: area reached in both over observed area",
        "no observed area", WILKS,
    ),
    "far": Definition(
        "FAR", "1", 0, 1, 0, "false alarm ratio: area reached in the model alone over modelled area",
        "no modelled area", WILKS,
    ),
    "area_bias": Definition(
        "area bias", "1", 0, _INF, 1, "modelled over observed area",
        "no observed area", WILKS,
    ),
    "brier": Definition(
        "Brier", "1", 0, 1, 0, "mean square difference of probability and reached share of the cells where either is above 0",
        "neither reaches a known cell", "Wilks 2011, sec. 8.4.2",
    ),
    "volume_bias": Definition(
        "volume bias", "1", 0, _INF, 1, "modelled over observed volume",
        "no observed volume",
    ),
    "bias": Definition(
        "bias", "", -_INF, _INF, 0, "mean difference on the cells that either reaches",
        "nothing to score in both", "Wilks 2011, sec. 8.3",
    ),
    "rmse": Definition(
        "RMSE", "", 0, _INF, 0, "root mean square difference on the same cells",
        "nothing to score in both", "Wilks 2011, sec. 8.3",
    ),
    "relative_l1": Definition(
        "relative L1", "1", 0, _INF, 0, "sum of absolute differences over sum of the observed values",
        "all observed values are 0 or unknown",
    ),
    "front_error": Definition(
        "front error", "m", -_INF, _INF, 0, "difference of the farthest reach along the thalweg; positive: too far",
        "one of the two reaches no cell near the thalweg", "Fischer 2013",
    ),
    "lateral_error": Definition(
        "lateral error", "m", 0, _INF, 0, "mean absolute difference of both edges",
        "no stretch of the thalweg is reached by both", "Fischer 2013",
    ),
    "lateral_shift": Definition(
        "lateral shift", "m", -_INF, _INF, 0, "displacement of the middle of the flow; positive: left",
        "no stretch of the thalweg is reached by both",
    ),
    "width_bias": Definition(
        "width bias", "1", 0, _INF, 1, "modelled over observed mean width",
        "no stretch of the thalweg is reached by both",
    ),
    "energy_line_error_deg": Definition(
        "energy line error", "degree", -_INF, _INF, 0, "difference of the angles from the release to the front",
        "a front is missing, has no elevation, or is not beyond the release", "Heim 1932",
    ),
    "arrival_bias": Definition(
        "arrival bias", "s", -_INF, _INF, 0, "mean difference of the arrival times; positive: too late",
        "no place with an arrival in both",
    ),
    "arrival_rmse": Definition(
        "arrival RMSE", "s", 0, _INF, 0, "root mean square difference of the arrival times",
        "no place with an arrival in both",
    ),
    "missed_arrivals": Definition(
        "missed arrivals", "1", 0, _INF, 0, "points with an arrival that the flow does not reach",
        "no observed arrival",
    ),
    "erosion_volume_bias": Definition(
        "erosion volume bias", "1", 0, _INF, 1, "modelled over observed volume of lowering",
        "no observed lowering",
    ),
    "deposition_volume_bias": Definition(
        "deposition volume bias", "1", 0, _INF, 1, "modelled over observed volume of rise",
        "no observed rise",
    ),
    "erosion_csi": Definition(
        "erosion CSI", "1", 0, 1, 1, "CSI of the area that is lowered",
        "no lowering in either", WILKS,
    ),
    "deposition_csi": Definition(
        "deposition CSI", "1", 0, 1, 1, "CSI of the area that is raised",
        "no rise in either", WILKS,
    ),
}  # fmt: skip


def undefined_reasons(scores: Iterable[tuple[str, bool]]) -> str:
    """Titles of scores (name, whether it has a value) without one, grouped by the reason; empty if all have one."""
    titles: dict[str, list[str]] = {}
    for name, has_value in scores:
        if not has_value:
            titles.setdefault(DEFINITIONS[name].undefined, []).append(DEFINITIONS[name].title)
    return "; ".join(f"{', '.join(names)} ({reason})" for reason, names in titles.items())


def printed(value: float) -> float:
    """A value as it is printed: 0 where it is smaller than :data:`ROUNDING`."""
    return 0.0 if abs(value) < ROUNDING else value


@dataclass(frozen=True)
class Score:
    """One score.

    Attributes
    ----------
    of : str
        What is scored, such as "outline" or "thickness 0.5 m".
    name : str
        Key of :data:`DEFINITIONS`.
    value : float
        NaN where it is not defined.
    units : str
        Unit; that of the map where the definition states none.
    numerical_error : float or None
        Half width of the numerical error bar of the value, in its unit; None where it is not known.
    """

    of: str
    name: str
    value: float
    units: str = ""
    numerical_error: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", self.definition.units or self.units)

    @property
    def definition(self) -> Definition:
        """Meaning, range and best value."""
        return DEFINITIONS[self.name]

    def stored(self) -> dict[str, Any]:
        """The score as values for JSON; a value that is not defined is None, and ``undefined`` says why."""
        value = None if math.isnan(self.value) else plain(self.value)
        found: dict[str, Any] = {"of": self.of, "name": self.name, "value": value, "units": self.units}
        if value is None:
            found["undefined"] = self.definition.undefined
        return found if self.numerical_error is None else found | {"numerical_error": float(self.numerical_error)}
