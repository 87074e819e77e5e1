"""Erosion in proportion to the flux: the volume grows exponentially with the path.

E = E_s H u (McDougall & Hungr 2005, Can. Geotech. J. 42:1437). A mass that grows from V_0 to V_f over a length L of its path has
E_s = ln(V_f / V_0) / L.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from runout.model.erosion_laws import Erosion, register_erosion
from runout.model.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class GrowthErosion(Erosion):
    """Volume that grows exponentially with the path, as in DAN3D: events with a mapped volume before and after."""

    law: ClassVar[str] = "growth"
    growth_rate: float = parameter(
        "growth of the volume per length of the path", unit="1/m", low=0, high=1, typical=1e-3, sampled=True
    )


def erosion_rate(H: Any, u: Any, sigma: Any, tau: Any, pore_ratio: Any, eroded: Any, bed: Any):
    """Erosion rate E [m/s]."""
    return bed.growth_rate * H * u


register_erosion(GrowthErosion, erosion_rate)
