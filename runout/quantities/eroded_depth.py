"""Depth of an erodible bed that the flow took up: it has no formula, since it is that at the end of the run."""

from runout.quantities import MapQuantity

QUANTITY = MapQuantity(
    "eroded_depth", "m", "eroded depth", "depth of the bed that the flow took up, vertical", None, (0.5, 1.0),
    symbol="eroded depth, vertical", colours="viridis_r", has_mean=True, place=101, of_bed=True,
)  # fmt: skip
