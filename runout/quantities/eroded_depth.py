"""Depth of the bed that the flow took up. It has no formula: the run books it."""

from runout.quantities import MapQuantity

QUANTITY = MapQuantity(
    "eroded_depth", "m", "eroded depth", "depth by which the flow lowered the ground, vertical", None, (0.1, 0.5, 1.0),
    symbol="eroded depth", colours="YlOrBr", has_mean=True, of_bed=True, place=110,
)  # fmt: skip
