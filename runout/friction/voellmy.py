"""Voellmy friction: Coulomb, and drag by the square of the speed.

tau = mu sigma + tau_c + rho u^2 (g / xi + c) (Voellmy 1955, Schweiz. Bauzeitung 73; Salm 1993, Ann. Glaciol. 18:221). The drag,
rho u^2 (g / xi + c), slows the whole column of mass with its mean velocity u, as depth-averaged models mean it. tau_c is the
cohesion of RAMMS, (1 - mu) C (1 - exp(-sigma / C)) (Bartelt et al. 2015, J. Glaciol. 61:837), and the constant minimum shear stress
of AvaFrame's law VoellmyMinShear; c the drag coefficient of forest.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from runout.model.basal_friction import BasalFriction, MassAbove
from runout.model.friction_laws import register_friction
from runout.model.parameters import parameter
from runout.physics.tensors import real


@dataclass(frozen=True, kw_only=True)
class Voellmy(BasalFriction):
    """Friction and turbulent drag, as in RAMMS and AvaFrame: snow and rock-ice avalanches, debris flows."""

    law: ClassVar[str] = "voellmy"
    coefficients: ClassVar[tuple[str, ...]] = ("mu",)
    uses_area: ClassVar[bool] = True
    drags_column: ClassVar[bool] = True
    mu: float = parameter("Coulomb friction coefficient", low=0, high=2, typical=0.2, sampled=True)
    xi: float = parameter("turbulence coefficient", unit="m/s2", low=1, high=1e6, typical=1000.0, sampled=True)
    cohesion: float = parameter("cohesion of RAMMS", unit="Pa", low=0, high=1e6, default=0.0, sampled=True)
    minimum_shear_stress: float = parameter(
        "shear stress of the ground that does not depend on the load", unit="Pa", low=0, high=1e6, default=0.0, sampled=True
    )
    forest_drag: float = parameter("drag coefficient of forest, adds to g / xi", low=0, high=10, default=0.0, sampled=True)

    def numbers(self) -> dict[str, float]:
        """The parameters, but 1 / xi [s2/m]: drag adds up where zones meet."""
        return {
            "mu": self.mu,
            "inverse_xi": 1.0 / self.xi,
            "cohesion": self.cohesion,
            "minimum_shear_stress": self.minimum_shear_stress,
            "forest_drag": self.forest_drag,
        }

    @classmethod
    def acting(cls, numbers: Mapping[str, Any], mass: MassAbove) -> dict[str, Any]:
        """The numbers, with the drag by area and squared speed [kg/m3] in place of its two parts."""
        drag = mass.density * (mass.gravity * numbers["inverse_xi"] + numbers["forest_drag"])
        steady = {name: numbers[name] for name in ("mu", "cohesion", "minimum_shear_stress")}
        return {**steady, "drag": drag, "strength": mass.strength}


def cohesive_impulse(normal: Any, most: Any, mu: Any):
    """Impulse [N s] of the cohesion of RAMMS under a normal impulse; ``most`` is C times area and time step [N s]."""
    if most <= real(0.0):
        return real(0.0)
    return max(real(0.0), real(1.0) - mu) * most * (real(1.0) - math.exp(-normal / most))


def resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """Steady impulse [N s] and drag [kg/m] of Coulomb friction, cohesion, minimum shear stress and turbulence."""
    reach = area * dt
    steady = basal.mu * normal + reach * basal.minimum_shear_stress + cohesive_impulse(normal, reach * basal.cohesion, basal.mu)
    return steady, area * basal.drag


register_friction(Voellmy, resistance)
