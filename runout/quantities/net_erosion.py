"""Net erosion: by how much the ground is lower after the run than before the failure."""

from runout.quantities import CHANGE, MapQuantity

QUANTITY = MapQuantity(
    "net_erosion", "m", "net erosion", "lowering of the ground from before the failure to after the runout", None, (0.5, 1.0),
    symbol="lowering of the ground", colours="viridis_r", place=102, of_bed=True, part_of=CHANGE, sign=-1,
)  # fmt: skip
