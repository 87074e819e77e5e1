"""Score of the volumes by reach along a thalweg."""

from math import inf
from operator import attrgetter

from runout.scores.definitions import Definition

SCORES = (
    Definition(
        "reach_error", "reach error", "m3", 0, inf, 0,
        "sum over the reaches of the absolute difference of modelled and observed net volume", "no reach",
        values={"reaches": attrgetter("error")}, is_headline=True,
    ),
)  # fmt: skip
