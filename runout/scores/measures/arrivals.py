"""Scores of arrival times."""

from math import inf
from operator import attrgetter

from runout.scores.definitions import Definition

SCORES = (
    Definition(
        "arrival_bias", "arrival bias", "s", -inf, inf, 0, "mean difference of the arrival times; positive: too late",
        "no place with an arrival in both", values={"arrival": attrgetter("bias")}, is_headline=True,
    ),
    Definition(
        "arrival_rmse", "arrival RMSE", "s", 0, inf, 0, "root mean square difference of the arrival times",
        "no place with an arrival in both", values={"arrival": attrgetter("rmse")},
    ),
    Definition(
        "missed_arrivals", "missed arrivals", "1", 0, inf, 0, "points with an arrival that the flow does not reach",
        "no observed arrival", values={"arrival": attrgetter("missed")},
    ),
)  # fmt: skip
