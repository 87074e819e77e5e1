"""Discharge per width: thickness times speed, the intensity of floods in Swiss guidelines."""

from typing import Any

from runout.quantities import MapQuantity


def unit_discharge(depth: Any, speed: Any, density: Any):
    """Discharge h v [m2/s] through a width of 1 m."""
    return depth * speed


QUANTITY = MapQuantity(
    "unit_discharge", "m2 s-1", "discharge per width", "discharge per width (thickness times speed)", unit_discharge, (),
    symbol="discharge per width hv", colours="inferno_r", logarithmic=True,
    remark="It is the largest product of thickness and speed at one time, not the product of their maxima.", place=4,
)  # fmt: skip
