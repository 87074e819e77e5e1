"""The friction law samosAT of AvaFrame, for the comparison with its own runs.

tau = mu sigma (1 + R_s0 / (R_s0 + R_s)) + rho u^2 / (B + ln(h / R) / kappa)^2 with R_s = rho u^2 / sigma (Sampl & Granig 2009,
Proc. Int. Snow Science Workshop Davos; AvaFrame documentation, theory of com1DFA). The thickness normal to the slope is taken from
the load, h = sigma / (rho g cos(slope)), with the slope as a parameter; the logarithm hardly depends on it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import register_friction
from runout.model.parameters import parameter
from runout.physics.tensors import real


@dataclass(frozen=True, kw_only=True)
class SamosAt(BasalFriction):
    """Friction of AvaFrame's samosAT: Coulomb friction that doubles at rest, and drag with a logarithmic profile."""

    law: ClassVar[str] = "samosat"
    coefficients: ClassVar[tuple[str, ...]] = ("mu",)
    uses_area: ClassVar[bool] = True
    drags_column: ClassVar[bool] = True  # as com1DFA means it
    mu: float = parameter("Coulomb friction coefficient", low=0, high=2, typical=0.155)
    fluidization: float = parameter("fluidization factor R_s0", low=0, high=10, default=0.222)
    kappa: float = parameter("constant of the logarithmic profile", low=0.01, high=1, default=0.43)
    offset: float = parameter("constant B of the logarithmic profile", low=0, high=100, default=4.13)
    roughness: float = parameter("roughness R of the logarithmic profile", unit="m", low=1e-6, high=10, default=0.05)
    weight: float = parameter("density times gravity times cosine of the slope", unit="N/m3", low=1, high=1e6, typical=1600.0)

    def numbers(self) -> dict[str, float]:
        """The parameters."""
        return {name: getattr(self, name) for name in ("mu", "fluidization", "kappa", "offset", "roughness", "weight")}

    @classmethod
    def acting(cls, numbers: Mapping[str, Any], mass: Any) -> dict[str, Any]:
        """The numbers, with the density and the strength of the mass."""
        return {**numbers, "density": mass.density, "strength": mass.strength}


def resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """Steady impulse [N s] and drag [kg/m]."""
    load = max(normal / (area * dt), real(1e-3))  # [Pa]
    fluid = basal.density * slip * slip / load
    rising = real(1.0) + basal.fluidization / max(basal.fluidization + fluid, real(1e-12))
    profile = basal.offset + math.log(max(load / (basal.weight * basal.roughness), real(1.0))) / basal.kappa
    return basal.mu * normal * rising, area * basal.density / (profile * profile)


register_friction(SamosAt, resistance)
