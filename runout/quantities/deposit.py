"""Thickness of the deposit: it has no formula, since it is the thickness at the end of the run."""

from runout.quantities import MapQuantity

QUANTITY = MapQuantity(
    "deposit", "m", "deposit thickness", "thickness of the deposit at the end of the run, vertical", None, (0.5, 1.0),
    stem="deposit_thickness", symbol="vertical thickness", colours="viridis_r", has_mean=True, place=100,
)  # fmt: skip
