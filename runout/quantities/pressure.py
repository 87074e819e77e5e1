"""Dynamic pressure of the flow.

Its classes are those of snow avalanches; none are established for landslides. Windows, doors and wooden houses: Perla & Martinelli
1976, *Avalanche Handbook*; McClung & Schaerer 2006, *The Avalanche Handbook*; both from memory. 3 and 30 kPa are limits of the
zones of danger in Switzerland, 10 kPa is the one in Austria (secondary sources, as in the schemes of these names).
"""

from typing import Any

from runout.quantities import MapQuantity


def dynamic_pressure(depth: Any, speed: Any, density: Any):
    """Pressure rho v^2 [Pa] of a column of ``density`` [kg/m3]: its mass over its volume."""
    return density * speed * speed


DAMAGE = (
    "windows break",
    "doors and light walls give way",
    "masonry is damaged",
    "wooden houses are destroyed",
    "only strong concrete stands",
)
QUANTITY = MapQuantity(
    "pressure", "Pa", "dynamic pressure", "dynamic pressure (density times speed squared)", dynamic_pressure, (3e3, 3e4),
    symbol="pressure \u03c1v²", colours="inferno_r", classes=(1e3, 3e3, 1e4, 3e4, 1e5), meanings=DAMAGE,
    least_threshold=100.0, hint="3 kPa is 3.0e3", place=2,
    remark="It is the pressure of the undisturbed flow, not the load on an obstacle.",
)  # fmt: skip
