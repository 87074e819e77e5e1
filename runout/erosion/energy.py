"""Erosion by the work of friction: a fixed energy loosens a unit of mass of the bed.

E = tau u / (e_b rho_b), with the friction tau of the flow on the ground (AvaFrame, com1DFA: entrainment by plowing and erosion,
docs.avaframe.org).
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from runout.model.erosion_laws import Erosion, register_erosion
from runout.model.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class EnergyErosion(Erosion):
    """Fixed energy per eroded mass, as in AvaFrame: snow."""

    law: ClassVar[str] = "energy"
    of_friction: ClassVar[bool] = True
    specific_energy: float = parameter(
        "energy of friction that loosens a kilogram of the bed",
        unit="J/kg",
        low=0,
        high=1e6,
        open_low=True,
        default=5000.0,
        sampled=True,
    )


def erosion_rate(H: Any, u: Any, sigma: Any, tau: Any, pore_ratio: Any, eroded: Any, bed: Any):
    """Erosion rate E [m/s]."""
    return tau * u / (bed.specific_energy * bed.density)


register_erosion(EnergyErosion, erosion_rate)
