"""A law of the material from outside the package: mud with a yield stress, a viscosity and a stress of collisions.

Shear stress s = sqrt(J_2) = tau_y + eta rate + C rate^2 while it flows (O'Brien & Julien 1985).
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from runout import Material, parameter, register_law
from runout.physics.elastic import pressure
from runout.physics.plastic import dissipated_energy, gained_volume
from runout.physics.tensors import deviator, isotropic, norm, real, scaled, shifted, trace


@dataclass(frozen=True, kw_only=True)
class QuadraticFlow(Material):
    """Mud that is rigid below a yield stress."""

    law: ClassVar[str] = "quadratic_flow"
    history: ClassVar[str] = "log volume gained without stress and not yet lost again [1]"
    depends_on_rate: ClassVar[bool] = True
    yield_stress: float = parameter(
        "shear stress below which it does not flow", unit="Pa", low=1, high=1e6, typical=2000.0, sampled=True, hint="2 kPa is 2.0e3"
    )
    viscosity: float = parameter("viscosity eta", unit="Pa s", low=0, high=1e5, default=0.0, sampled=True)
    collisions: float = parameter("factor C of the square of the rate", unit="Pa s2", low=0, high=1e5, default=0.0, sampled=True)

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope 0 and intercept sqrt(3) tau_y [Pa]."""
        return 0.0, math.sqrt(3.0) * self.yield_stress


def plastic_shear(excess: Any, mat: Any):
    """Plastic shear x [1] of a step whose trial stress lies ``excess`` [Pa] above tau_y: G x + eta x/dt + C (x/dt)^2 = excess."""
    c = mat.collisions / (mat.time_step * mat.time_step)
    b = mat.shear_modulus + mat.viscosity / mat.time_step
    return real(2.0) * excess / (b + math.sqrt(b * b + real(4.0) * c * excess))


def return_to_flow(h: Any, mat: Any):
    """Hencky strain whose shear stress flows at the rate of its plastic shear, or of no stress at all."""
    if pressure(h, mat) <= real(0.0):
        return isotropic(real(0.0))
    s = math.sqrt(real(2.0)) * mat.shear_modulus * norm(deviator(h))
    excess = s - mat.yield_stress
    if excess <= real(0.0):
        return h
    left = real(1.0) - mat.shear_modulus * plastic_shear(excess, mat) / s
    return shifted(scaled(deviator(h), left), trace(h) * (real(1.0) / real(3.0)))


def update(h: Any, history: Any, mat: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain."""
    closed = shifted(h, history * (real(1.0) / real(3.0)))
    new = return_to_flow(closed, mat)
    return new, gained_volume(closed, new), dissipated_energy(h, new, mat)


register_law(QuadraticFlow, update)
