"""Erosion at a fixed rate down to a depth that the shear stress sets.

E = rate while d < (dd/dtau) (tau - tau_c), with the eroded depth d, both normal to the ground (Frank et al. 2015, Nat. Hazards
Earth Syst. Sci. 15:2569; Frank et al. 2017, Nat. Hazards Earth Syst. Sci. 17:801). tau = rho g H sin(slope) is the driving stress,
as in the measurements at the Illgraben behind it (Schuerch et al. 2011, Geology 39:495).
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from runout.model.erosion_laws import Erosion, register_erosion
from runout.model.parameters import parameter
from runout.physics.tensors import real


@dataclass(frozen=True, kw_only=True)
class RammsErosion(Erosion):
    """Fixed rate down to a depth that follows from the shear stress, as in RAMMS: debris flows on channel beds. The default."""

    law: ClassVar[str] = "ramms"
    rate: float = parameter("erosion rate, normal to the ground", unit="m/s", low=0, high=10, default=0.025, sampled=True)
    critical_stress: float = parameter(
        "shear stress below which nothing is eroded", unit="Pa", low=0, high=1e6, default=1000.0, sampled=True
    )
    depth_per_stress: float = parameter(
        "eroded depth per shear stress beyond that", unit="m/Pa", low=0, high=1, default=1e-4, sampled=True,
        hint="0.1 m per kPa is 1.0e-4",
    )  # fmt: skip


def erosion_rate(H: Any, u: Any, sigma: Any, tau: Any, pore_ratio: Any, eroded: Any, bed: Any):
    """Erosion rate E [m/s]: constant until the depth that tau allows is reached."""
    if eroded >= bed.depth_per_stress * (tau - bed.critical_stress):
        return real(0.0)
    return bed.rate


register_erosion(RammsErosion, erosion_rate)
