"""Scores of the values of a map."""

from math import inf
from operator import attrgetter

from runout.scores.definitions import Definition

SCORES = (
    Definition(
        "volume_bias", "volume bias", "1", 0, inf, 1, "modelled over observed volume", "no observed volume",
        values={"volume": attrgetter("volume_bias")}, is_headline=True,
    ),
    Definition(
        "bias", "bias", "", -inf, inf, 0, "mean difference on the cells that either reaches", "nothing to score in both",
        "Wilks 2011, sec. 8.3",
        values={"field": attrgetter("bias"), "points": attrgetter("bias"), "change": attrgetter("change.bias")},
    ),
    Definition(
        "rmse", "RMSE", "", 0, inf, 0, "root mean square difference on the same cells", "nothing to score in both",
        "Wilks 2011, sec. 8.3",
        values={"field": attrgetter("rmse"), "points": attrgetter("rmse"), "change": attrgetter("change.rmse")},
        is_headline=True,
    ),
    Definition(
        "relative_l1", "relative L1", "1", 0, inf, 0, "sum of absolute differences over sum of the observed values",
        "all observed values are 0 or unknown", values={"field": attrgetter("relative_l1")},
    ),
)  # fmt: skip
