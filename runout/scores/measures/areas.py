"""Scores of the area that a model and an observation say is reached: Wilks 2011, section 8.2."""

from math import inf
from operator import attrgetter

from runout.scores.definitions import WILKS, Definition

SCORES = (
    Definition(
        "csi", "CSI", "1", 0, 1, 1, "critical success index: area reached in both over area reached in either",
        "neither reaches a known cell", WILKS, values={"area": attrgetter("critical_success_index")}, is_headline=True,
    ),
    Definition(
        "pod", "POD", "1", 0, 1, 1, "probability of detection: area reached in both over observed area", "no observed area",
        WILKS, values={"area": attrgetter("probability_of_detection")},
    ),
    Definition(
        "far", "FAR", "1", 0, 1, 0, "false alarm ratio: area reached in the model alone over modelled area", "no modelled area",
        WILKS, values={"area": attrgetter("false_alarm_ratio")},
    ),
    Definition(
        "area_bias", "area bias", "1", 0, inf, 1, "modelled over observed area", "no observed area", WILKS,
        values={"area": attrgetter("area_bias")},
    ),
)  # fmt: skip
