"""Scores of two maps as lists, with their numerical error bars."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from runout.scores.definitions import DEFINITIONS, Score
from runout.scores.energy_line import ReleasePoint, energy_line_angle
from runout.scores.error_bars import ErrorBars
from runout.scores.field_errors import FieldErrors
from runout.scores.thalweg import Thalweg, ThalwegErrors

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
