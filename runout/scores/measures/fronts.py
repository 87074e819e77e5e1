"""Scores along and across a thalweg."""

from math import inf
from operator import attrgetter

from runout.scores.definitions import Definition

SCORES = (
    Definition(
        "front_error", "front error", "m", -inf, inf, 0,
        "difference of the farthest reach along the thalweg; positive: too far",
        "one of the two reaches no cell near the thalweg", "Fischer 2013", values={"thalweg": attrgetter("front_error")},
        is_headline=True,
    ),
    Definition(
        "lateral_error", "lateral error", "m", 0, inf, 0, "mean absolute difference of both edges",
        "no stretch of the thalweg is reached by both", "Fischer 2013", values={"thalweg": attrgetter("lateral_error")},
    ),
    Definition(
        "lateral_shift", "lateral shift", "m", -inf, inf, 0, "displacement of the middle of the flow; positive: left",
        "no stretch of the thalweg is reached by both", values={"thalweg": attrgetter("lateral_shift")},
    ),
    Definition(
        "width_bias", "width bias", "1", 0, inf, 1, "modelled over observed mean width",
        "no stretch of the thalweg is reached by both", values={"thalweg": attrgetter("width_bias")},
    ),
    Definition(
        "energy_line_error_deg", "energy line error", "degree", -inf, inf, 0,
        "difference of the angles from the release to the front",
        "a front is missing, has no elevation, or is not beyond the release", "Heim 1932",
    ),
)  # fmt: skip
