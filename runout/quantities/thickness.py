"""Thickness of the flow. It is the first quantity: the observers decide by it where the others count."""

from typing import Any

from runout.quantities import MapQuantity


def flow_thickness(depth: Any, speed: Any, density: Any):
    """Vertical thickness h [m]."""
    return depth


QUANTITY = MapQuantity(
    "thickness", "m", "flow thickness", "flow thickness, vertical", flow_thickness, (0.1, 0.5, 1.0, 2.0), stem="flow_thickness",
    symbol="vertical thickness", colours="viridis_r", has_mean=True, place=0,
)  # fmt: skip
