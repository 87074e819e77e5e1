"""Scores of a modelled flow against an observed one, or of one product against another.

All functions take arrays of one grid (:func:`resampled` brings maps there). Unknown cells are NaN; they are excluded and counted.
"""

from runout.scores.comparison import Choices, Comparison, compare
from runout.scores.contingency import Contingency, contingency, reached
from runout.scores.definitions import DEFINITIONS, Definition, Score
from runout.scores.elevation_change import ChangeErrors, change_errors, elevation_change
from runout.scores.energy_line import ReleasePoint, Start, energy_line_angle, release_point
from runout.scores.error_bars import ErrorBars
from runout.scores.field_errors import FieldErrors, field_errors
from runout.scores.grid import Grid, outline_shares, resampled
from runout.scores.points import PointErrors, arrival_errors, arrival_or_never, point_errors, values_at
from runout.scores.reaches import ReachErrors, Reaches, reach_errors
from runout.scores.slope_normal import slope_normal_thickness, terrain_slope, vertical_thickness
from runout.scores.thalweg import Thalweg, ThalwegErrors, thalweg_errors

__all__ = [
    "DEFINITIONS",
    "ChangeErrors",
    "Choices",
    "Comparison",
    "Contingency",
    "Definition",
    "ErrorBars",
    "FieldErrors",
    "Grid",
    "PointErrors",
    "ReachErrors",
    "Reaches",
    "ReleasePoint",
    "Score",
    "Start",
    "Thalweg",
    "ThalwegErrors",
    "arrival_errors",
    "arrival_or_never",
    "change_errors",
    "compare",
    "contingency",
    "elevation_change",
    "energy_line_angle",
    "field_errors",
    "outline_shares",
    "point_errors",
    "reach_errors",
    "reached",
    "release_point",
    "resampled",
    "slope_normal_thickness",
    "terrain_slope",
    "thalweg_errors",
    "values_at",
    "vertical_thickness",
]
