"""Agreement of two areas within the position that a raster can hold: one cell."""

from operator import attrgetter

from runout.scores.definitions import Definition

SCORES = (
    Definition(
        "agreement", "agreement within a cell", "1", 0, 1, 1,
        "area reached in either that has the area of the other in it or in one of the eight cells around it, over area reached in "
        "either",
        "neither reaches a known cell",
        values={
            "area": attrgetter("agreement_within_one_cell"),
            "change": attrgetter("changed_area.agreement_within_one_cell"),
        },
    ),
)  # fmt: skip
