"""Thickness and speed at one time: what criteria such as "h > 1 m and v > 1 m/s" ask for."""

from typing import Any

from runout.quantities import MapQuantity


def thickness_and_speed(depth: Any, speed: Any, density: Any):
    """Smaller number of thickness [m] and speed [m/s]: it reaches x where the flow is x m thick and x m/s fast at one time."""
    return min(depth, speed)


QUANTITY = MapQuantity(
    "thickness_and_speed", "1", "thickness and speed at one time", "smaller number of thickness in m and speed in m/s at one time",
    thickness_and_speed, (), symbol="thickness [m] and speed [m/s]", colours="plasma_r",
    remark="A value x says that the flow was at least x m thick and x m/s fast at one time.", place=5,
)  # fmt: skip
