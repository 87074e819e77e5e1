"""Dynamic pressure of the flow.

Its classes are those of snow avalanches; none are established for landslides. Windows, doors and wooden houses: Perla & Martinelli
1976, *Avalanche Handbook*; McClung & Schaerer 2006, *The Avalanche Handbook*; both from memory. 3 and 30 kPa are limits of the
zones of danger in Switzerland, 10 kPa is the one in Austria (secondary sources, as in the schemes of these names).
"""

from typing import Any

from runout.physics.tensors import real
from runout.quantities import MapQuantity


def dynamic_pressure(depth: Any, speed: Any, density: Any):
    """Pressure rho v^2 [Pa] of a column of ``density`` [kg/m3]: its mass over its volume."""
    return density * speed * speed


def share_of_house_strength(pressure: Any, depth: Any, force: Any, height: Any):
    """Pressure [Pa] over the strength F / (H (h - H)) [Pa] of a house: 1 and more where the flow breaks it.

    H [m] is the thickness ``depth`` of the flow, ``force`` is F [N], ``height`` is h [m]. The strength is least at H = h / 2, which
    holds above it: H (h - H) = h^2 / 4 - d^2 with d = h / 2 - H, or 0 where that is negative. The rule is that of Japan
    (``runout/schemes/japan_house.yaml``).
    """
    below = real(0.5) * height - depth
    d = real(0.5) * (below + abs(below))
    return pressure * (real(0.25) * height * height - d * d) / force


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
