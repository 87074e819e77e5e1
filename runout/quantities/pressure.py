"""Dynamic pressure of the flow."""

from typing import Any

from runout.quantities import MapQuantity


def dynamic_pressure(depth: Any, speed: Any, density: Any):
    """Pressure rho v^2 [Pa] of a column of ``density`` [kg/m3]: its mass over its volume."""
    return density * speed * speed


QUANTITY = MapQuantity(
    "pressure", "Pa", "dynamic pressure", "dynamic pressure (density times speed squared)", dynamic_pressure, (3e3, 3e4),
    symbol="pressure \u03c1v²", colours="inferno_r", logarithmic=True, least_threshold=100.0, hint="3 kPa is 3.0e3",
    remark="It is the pressure of the undisturbed flow, not the load on an obstacle.", place=2,
)  # fmt: skip
