"""Scores of a change of elevation, by its parts."""

from math import inf
from operator import attrgetter

from runout.scores.definitions import WILKS, Definition

SCORES = (
    Definition(
        "erosion_volume_bias", "erosion volume bias", "1", 0, inf, 1, "modelled over observed volume of lowering",
        "no observed lowering", values={"change": attrgetter("erosion.volume_bias")}, is_headline=True,
    ),
    Definition(
        "deposition_volume_bias", "deposition volume bias", "1", 0, inf, 1, "modelled over observed volume of rise",
        "no observed rise", values={"change": attrgetter("deposition.volume_bias")}, is_headline=True,
    ),
    Definition(
        "erosion_csi", "erosion CSI", "1", 0, 1, 1, "CSI of the area that is lowered", "no lowering in either", WILKS,
        values={"change": attrgetter("erosion_area.critical_success_index")},
    ),
    Definition(
        "deposition_csi", "deposition CSI", "1", 0, 1, 1, "CSI of the area that is raised", "no rise in either", WILKS,
        values={"change": attrgetter("deposition_area.critical_success_index")}, is_headline=True,
    ),
    Definition(
        "change_csi", "change CSI", "1", 0, 1, 1, "CSI of the area that is lowered or raised", "no change in either", WILKS,
        values={"change": attrgetter("changed_area.critical_success_index")},
    ),
)  # fmt: skip
