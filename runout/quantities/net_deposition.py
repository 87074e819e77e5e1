"""Net deposition: by how much the ground is higher after the run than before the failure."""

from runout.quantities import CHANGE, MapQuantity

QUANTITY = MapQuantity(
    "net_deposition", "m", "net deposition", "raising of the ground from before the failure to after the runout", None, (0.5, 1.0),
    symbol="raising of the ground", colours="viridis_r", place=103, of_bed=True, part_of=CHANGE,
)  # fmt: skip
