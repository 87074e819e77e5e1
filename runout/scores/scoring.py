"""Scores of two maps as lists, with their numerical error bars."""

import math
from collections.abc import Iterator

import numpy as np

from runout.scores.contingency import Contingency
from runout.scores.definitions import Score
from runout.scores.elevation_change import ChangeErrors
from runout.scores.energy_line import ReleasePoint, energy_line_angle
from runout.scores.error_bars import ErrorBars
from runout.scores.field_errors import FieldErrors
from runout.scores.points import PointErrors
from runout.scores.thalweg import Thalweg, ThalwegErrors

NO_BARS = ErrorBars({})


def area_scores(
    of: str, table: Contingency, bars: ErrorBars = NO_BARS, quantity: str = "", threshold: float = 0.0
) -> Iterator[Score]:
    """CSI, POD, FAR and area bias of a contingency table; ``quantity`` is the map of the error bars."""
    errors = bars.of_contingency(table, quantity, threshold)
    values = {
        "csi": table.critical_success_index,
        "pod": table.probability_of_detection,
        "far": table.false_alarm_ratio,
        "area_bias": table.area_bias,
    }
    for name, value in values.items():
        yield Score(of, name, value, numerical_error=errors[name])


def field_scores(
    of: str, errors: FieldErrors, units: str, volume: bool = False, bars: ErrorBars = NO_BARS, quantity: str = ""
) -> Iterator[Score]:
    """Bias, RMSE and relative L1 of a map in ``units``; ``volume`` adds the volume bias of a map of thickness."""
    half = bars.of_field(errors, quantity)
    if volume:
        yield Score(of, "volume_bias", errors.volume_bias, numerical_error=half["volume_bias"])
    yield Score(of, "bias", errors.bias, units, half["bias"])
    yield Score(of, "rmse", errors.rmse, units, half["rmse"])
    yield Score(of, "relative_l1", errors.relative_l1, numerical_error=half["relative_l1"])


def thalweg_scores(
    of: str,
    errors: ThalwegErrors,
    bars: ErrorBars = NO_BARS,
    table: Contingency | None = None,
    quantity: str = "flow_thickness",
    threshold: float = 0.0,
) -> Iterator[Score]:
    """Errors of the front and of the sides of the area of a table; ``quantity`` is the map of the error bars."""
    half = bars.of_thalweg(errors, table, quantity, threshold)
    for name in ("front_error", "lateral_error", "lateral_shift", "width_bias"):
        yield Score(of, name, getattr(errors, name), numerical_error=half[name])


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


def arrival_scores(of: str, errors: PointErrors, bars: ErrorBars = NO_BARS) -> Iterator[Score]:
    """Errors of the arrival times at points."""
    half = bars.of_arrival(errors.points + errors.missed)
    yield Score(of, "arrival_bias", errors.bias, numerical_error=half["arrival_bias"])
    yield Score(of, "arrival_rmse", errors.rmse, numerical_error=half["arrival_rmse"])
    yield Score(of, "missed_arrivals", float(errors.missed), numerical_error=half["missed_arrivals"])


def point_scores(of: str, errors: PointErrors, units: str, bars: ErrorBars = NO_BARS, quantity: str = "") -> Iterator[Score]:
    """Bias and RMSE of a quantity in ``units`` at points."""
    half = bars.at_points(quantity)
    yield Score(of, "bias", errors.bias, units, half["bias"])
    yield Score(of, "rmse", errors.rmse, units, half["rmse"])


def change_scores(of: str, errors: ChangeErrors, bars: ErrorBars = NO_BARS, limit: float = 0.0) -> Iterator[Score]:
    """Errors of a change of elevation and of its parts, with a detection limit [m]."""
    half = bars.of_change(errors, limit)
    values = {
        "erosion_volume_bias": errors.erosion.volume_bias,
        "deposition_volume_bias": errors.deposition.volume_bias,
        "erosion_csi": errors.erosion_area.critical_success_index,
        "deposition_csi": errors.deposition_area.critical_success_index,
        "bias": errors.change.bias,
        "rmse": errors.change.rmse,
    }
    for name, value in values.items():
        yield Score(of, name, value, "m", half[name])
