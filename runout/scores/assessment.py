"""All scores of a flow against the observations of a site, and of two maps, with their numerical error bars."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from runout.scores.contingency import Contingency, contingency
from runout.scores.definitions import DEFINITIONS, Pair, Score
from runout.scores.elevation_change import change_errors, detected
from runout.scores.energy_line import ReleasePoint, energy_line_angle
from runout.scores.error_bars import ErrorBars
from runout.scores.field_errors import FieldErrors, field_errors
from runout.scores.flow import AT_END, BAR_MAPS, THICKNESSES, UNITS, Flow
from runout.scores.observations import Observations
from runout.scores.points import POINT_UNITS, Gauges, arrival_errors, point_errors, values_at
from runout.scores.reaches import ReachErrors, reach_errors
from runout.scores.thalweg import Thalweg, ThalwegErrors, thalweg_errors

NO_BARS = ErrorBars({})


def scores_of(
    evidence: str, of: str, value_source: Any, units: str = "", bars: Mapping[str, float | None] | None = None
) -> Iterator[Score]:
    """All scores that a kind of evidence gives (:attr:`runout.scores.Definition.values`), with what is known of their errors."""
    for name, one in DEFINITIONS.items():
        if evidence in one.values:
            yield Score(of, name, float(one.values[evidence](value_source)), units, (bars or {}).get(name))


def field_scores(
    of: str, errors: FieldErrors, units: str, volume: bool = False, bars: ErrorBars = NO_BARS, quantity: str = ""
) -> Iterator[Score]:
    """Bias, RMSE and relative L1 of a map in ``units``; ``volume`` adds the volume bias of a map of thickness."""
    half = bars.of_field(errors, quantity)
    if volume:
        yield from scores_of("volume", of, errors, bars=half)
    yield from scores_of("field", of, errors, units, half)


def energy_line_score(
    of: str, errors: ThalwegErrors, start: ReleasePoint, thalweg: Thalweg, ground: "Ground", bars: ErrorBars = NO_BARS
) -> Score:
    """Error of the energy line's angle [degree], from the start to the fronts on the thalweg, with the length along it."""
    angles = [_angle(front, start, thalweg, ground) for front in (errors.modelled_front, errors.observed_front)]
    shift = bars.front()
    moved = None if shift is None else abs(_angle(errors.modelled_front + shift, start, thalweg, ground) - angles[0])
    error = None if moved is None or math.isnan(moved) else math.degrees(moved)
    return Score(of, "energy_line_error_deg", math.degrees(angles[0] - angles[1]), numerical_error=error)


def _angle(s: float, start: ReleasePoint, thalweg: Thalweg, ground: "Ground") -> float:
    if not math.isfinite(s):
        return math.nan
    x, y = (float(v) for v in thalweg.at(s))
    return energy_line_angle(start, ReleasePoint(x, y, ground.at(x, y)), thalweg)


class Ground:
    """Elevation of the ground at a place, from the nearest cell."""

    def __init__(self, easting: np.ndarray, northing: np.ndarray, elevation: np.ndarray):
        self.easting, self.northing, self.elevation = easting, northing, elevation

    def at(self, x: float, y: float) -> float:
        """Elevation [m]; that of the nearest cell of the map outside of it, NaN where that is unknown."""
        row, column = int(np.argmin(np.abs(self.northing - y))), int(np.argmin(np.abs(self.easting - x)))
        return float(self.elevation[row, column])


@dataclass(frozen=True)
class Setting:
    """What scores need besides the two flows."""

    thresholds: Sequence[float]  # thicknesses [m] whose outlines are scored
    bars: ErrorBars = NO_BARS  # numerical errors of the site
    thalweg: Thalweg | None = None
    start: ReleasePoint | None = None  # upper end of the energy line
    elevation: np.ndarray | None = None  # (rows, columns): ground [m] on the grid of the scores, for the energy line
    half_width: float = float("inf")  # largest distance [m] from the thalweg that counts
    # (rows, columns): area [m2] of the cells on the slope, for volumes of thickness normal to it; None where thickness is vertical
    surface: np.ndarray | None = None
    has_volume: bool = True  # whether a deposit has a volume; normal to a slope that is not known it has none


@dataclass
class Assessment:
    """Scores, the areas and numbers of cells or points behind each group of them, and volumes by reach."""

    scores: list[Score] = field(default_factory=list)
    counts: dict[str, dict[str, Any]] = field(default_factory=dict)
    reaches: ReachErrors | None = None

    def add(self, of: str, scores: Iterator[Score], **counts: Any) -> None:
        """Add a group of scores and what it rests on."""
        self.scores += scores
        known = {name: value if np.isfinite(value) else None for name, value in counts.items()}
        self.counts.setdefault(of, {}).update(known)

    def stored(self) -> dict[str, Any]:
        """Values for JSON."""
        stored = {"scores": [score.stored() for score in self.scores], "counts": self.counts}
        return stored if self.reaches is None else {**stored, "reaches": self.reaches.stored()}


def against_observations(
    flow: Flow,
    observed: Observations,
    setting: Setting,
    change: np.ndarray | None = None,
    at_gauges: Mapping[str, np.ndarray] | None = None,
) -> Assessment:
    """Scores of a flow against all that was observed.

    Parameters
    ----------
    flow : Flow
        On the grid of the observations.
    observed : Observations
    setting : Setting
    change : ndarray (rows, columns), optional
        Modelled change of elevation [m].
    at_gauges : mapping of str to ndarray (n,), optional
        Modelled values at the gauges by the names of their quantities; by default those of the maps.
    """
    assessment = Assessment()
    if observed.outline is not None:
        quantity = "deposit" if observed.outline_shows == "deposit" else "thickness"
        for threshold in setting.thresholds:
            of = f"outline, {quantity_name(quantity)} of {threshold:g} m"
            add_areas(assessment, of, flow.grid, flow.area(quantity, threshold), observed.shares, quantity, threshold, setting)
    if observed.deposit is not None:
        add_maps(assessment, flow, Flow(flow.grid, {"deposit": observed.deposit}), "deposit", setting)
    if observed.change is not None and change is not None:
        add_change(assessment, change, observed, setting.bars)
    if observed.gauges is not None:
        modelled = values_at_gauges(flow, observed.gauges) if at_gauges is None else at_gauges
        for name, values in modelled.items():
            add_points(assessment, name, values, observed.gauges.values[name], setting.bars)
    return assessment


def add_change(assessment: Assessment, change: np.ndarray, observed: Observations, bars: ErrorBars = NO_BARS) -> None:
    """Scores of a change of elevation (rows, columns) [m] against the DEM of difference, and its volumes by reach."""
    assert observed.change is not None
    limit, of = observed.detection_limit, "DEM of difference"
    errors = change_errors(change, observed.change, observed.grid.cell_area, limit)
    volumes = {"modelled_net_m3": errors.change.modelled_sum, "observed_net_m3": errors.change.observed_sum}
    for name, part in (("erosion", errors.erosion), ("deposition", errors.deposition)):
        volumes |= {f"modelled_{name}_m3": part.modelled_sum, f"observed_{name}_m3": part.observed_sum}
    scores = scores_of("change", of, errors, "m", bars.of_change(errors, limit))
    assessment.add(of, scores, **volumes, unknown_cells=errors.change.unknown)
    if observed.reaches is not None:
        assessment.reaches = reach_errors(detected(change, limit), detected(observed.change, limit), observed.reaches)
        assessment.add(of, scores_of("reaches", of, assessment.reaches))


def quantity_name(quantity: str) -> str:
    """A quantity in the name of a group of scores."""
    return "flow" if quantity == "thickness" else quantity


def add_areas(
    assessment: Assessment,
    of: str,
    grid: Any,
    modelled: np.ndarray,
    observed: np.ndarray,
    quantity: str,
    threshold: float,
    setting: Setting,
) -> None:
    """Scores of the area in which a quantity reaches a threshold; with a thalweg also those of front, sides and energy line."""
    table = contingency(modelled, observed, grid.cell_area)
    bars = setting.bars.of_contingency(table, BAR_MAPS.get(quantity, ""), threshold)
    assessment.add(of, scores_of("area", of, table, bars=bars), **_areas(table))
    if setting.thalweg is None or quantity not in THICKNESSES:
        return
    errors = thalweg_errors(setting.thalweg, grid.easting, grid.northing, modelled, observed, half_width=setting.half_width)
    fronts = {"modelled_front_m": errors.modelled_front, "observed_front_m": errors.observed_front}
    bars = setting.bars.of_thalweg(errors, table, BAR_MAPS[quantity], threshold)
    assessment.add(of, scores_of("thalweg", of, errors, bars=bars), **fronts, cells_beyond_half_width=errors.outside)
    if setting.start is not None and setting.elevation is not None:
        ground = Ground(grid.easting, grid.northing, setting.elevation)
        of_front = setting.bars if quantity == "thickness" else NO_BARS
        assessment.add(of, iter([energy_line_score(of, errors, setting.start, setting.thalweg, ground, of_front)]))


def add_maps(assessment: Assessment, modelled: Flow, observed: Flow, quantity: str, setting: Setting) -> None:
    """Scores of a map against another one: its areas at all thresholds, and its values.

    The volume is that of a deposit or of an eroded depth: maxima over time and percentiles over members hold none.
    """
    grid, units = modelled.grid, UNITS[quantity]
    for threshold in setting.thresholds:
        of = f"{quantity_name(quantity)} of {threshold:g} {units}"
        areas = modelled.area(quantity, threshold), observed.area(quantity, threshold)
        add_areas(assessment, of, grid, *areas, quantity, threshold, setting)
    volume = quantity in AT_END and setting.has_volume and not (modelled.is_percentile or observed.is_percentile)
    area = setting.surface if volume and setting.surface is not None else grid.cell_area
    errors = field_errors(modelled.maps[quantity], observed.maps[quantity], area)
    counts: dict[str, float] = {"cells": errors.cells, "unknown_cells": errors.unknown}
    if volume:
        counts |= {"modelled_volume_m3": errors.modelled_sum, "observed_volume_m3": errors.observed_sum}
    of = f"{quantity_name(quantity)}, whole map"
    assessment.add(of, field_scores(of, errors, units, volume, setting.bars, BAR_MAPS.get(quantity, "")), **counts)
    assessment.add(of, scores_of("maps", of, Pair(modelled.maps[quantity], observed.maps[quantity], area), units))


def add_arrivals(assessment: Assessment, modelled: Flow, observed: Flow, bars: ErrorBars = NO_BARS) -> None:
    """Scores of a map of arrival times against another one, on the cells that both know."""
    pair = [flow.maps["arrival"].ravel() for flow in (modelled, observed)]
    both = arrival_errors(pair[0], np.where(np.isfinite(pair[1]), pair[1], np.nan))
    counts = {"cells": both.points, "missed_cells": both.missed}
    half = bars.of_arrival(both.points + both.missed)
    assessment.add("arrival, whole map", scores_of("arrival", "arrival, whole map", both, bars=half), **counts)


def values_at_gauges(flow: Flow, gauges: Gauges) -> dict[str, np.ndarray]:
    """Values (n,) of the maps of a flow at gauges, by the names of their quantities."""
    maps = {name: "arrival" if name == "arrival_time" else name for name in gauges.values}
    return {
        name: values_at(flow.grid, flow.maps[quantity], gauges.easting, gauges.northing)
        for name, quantity in maps.items()
        if quantity in flow.maps
    }


def add_points(assessment: Assessment, name: str, modelled: np.ndarray, observed: np.ndarray, bars: ErrorBars = NO_BARS) -> None:
    """Scores of a quantity at gauges."""
    of = f"gauges, {name.replace('_', ' ')}"
    if name == "arrival_time":
        errors = arrival_errors(modelled, observed)
        scores = scores_of("arrival", of, errors, bars=bars.of_arrival(errors.points + errors.missed))
    else:
        errors = point_errors(modelled, observed)
        scores = scores_of("points", of, errors, POINT_UNITS[name], bars.at_points(BAR_MAPS[name]))
    assessment.add(of, scores, points=errors.points, unknown_points=errors.unknown)


def _areas(table: Contingency) -> dict[str, float]:
    return {f"{name}_m2": value for name, value in asdict(table).items() if name not in ("correct_rejections", "near")}
