"""Scores of the probability of an ensemble."""

from runout.scores.definitions import Definition

SCORES = (
    Definition(
        "brier", "Brier", "1", 0, 1, 0,
        "mean square difference of probability and reached share of the cells where either is above 0",
        "neither reaches a known cell", "Wilks 2011, sec. 8.4.2",
    ),
)  # fmt: skip
