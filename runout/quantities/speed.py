"""Speed of the flow: of its columns as a whole, not of single particles."""

from typing import Any

from runout.quantities import MapQuantity


def flow_speed(depth: Any, speed: Any, density: Any):
    """Speed v [m/s]."""
    return speed


QUANTITY = MapQuantity("speed", "m s-1", "flow speed", "speed of the flow", flow_speed, (1.0, 5.0), symbol="speed", place=1)
