"""Mud with a yield stress that flows as a Herschel-Bulkley fluid, or a Bingham fluid if the exponent is 1, on Hencky strain.

Shear stress s = sqrt(J_2) = tau_y + K rate^n while it flows, elastic below tau_y (Herschel & Bulkley 1926, Kolloid-Z. 39:291).
The return keeps the volume and is implicit in the rate: the viscous stress w left of a trial stress above tau_y solves
w + G dt (w/K)^(1/n) = s_trial - tau_y. So s is never larger than s_trial, and viscosity sets no limit to the time step. What comes
apart carries no stress until it has closed up again.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from runout.model.laws import register_law
from runout.model.materials import Material
from runout.model.parameters import parameter
from runout.physics.elastic import pressure
from runout.physics.plastic import dissipated_energy, gained_volume
from runout.physics.tensors import deviator, isotropic, norm, real, scaled, shifted, trace


@dataclass(frozen=True, kw_only=True)
class HerschelBulkley(Material):
    """Mud and fine-grained debris: rigid below a yield stress, viscous above it.

    A layer on a slope stops where it is thinner than yield_stress over density, gravity and the sine of the slope. On ground that
    holds it, a layer of 20 cells is 8 % too slow with exponent 1 and 14 % with 0.5; the error grows in proportion to the cell.
    """

    law: ClassVar[str] = "herschel_bulkley"
    history: ClassVar[str] = "log volume gained without stress and not yet lost again [1]"
    depends_on_rate: ClassVar[bool] = True
    yield_stress: float = parameter(
        "shear stress below which it does not flow", unit="Pa", low=1, high=1e6, typical=2000.0, sampled=True, hint="2 kPa is 2.0e3"
    )
    consistency: float = parameter(
        "factor K of the viscous stress, the viscosity [Pa s] if flow_index is 1",
        unit="Pa s^n", low=0, high=1e6, open_low=True, typical=500.0, sampled=True,
    )  # fmt: skip
    flow_index: float = parameter("exponent n of the rate of shear; 1 for Bingham", low=0.2, high=1, default=1.0, sampled=True)

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope 0 and intercept sqrt(3) tau_y [Pa] in creep: the yield stress does not grow with the pressure."""
        return 0.0, math.sqrt(3.0) * self.yield_stress

    def shear_strength(self, pressure: float) -> float:
        """Infinite: in fast shear viscosity passes on any stress."""
        return math.inf

    def resting_strength(self, pressure: float) -> float:
        """Yield stress over the normal stress [1]."""
        return self.yield_stress / pressure


def viscous_stress(excess: Any, mat: Any):
    """Viscous stress w [Pa] of a step whose trial stress lies ``excess`` [Pa] above the yield stress.

    Root of w + G dt (w/K)^(1/n) = excess. Three steps of Halley's method from an upper bound of the root are exact to rounding in
    double precision: the bound is at most a factor of two too large, and the error falls to its cube in each step.
    """
    m = real(1.0) / mat.flow_index
    stiffness = mat.shear_modulus * mat.time_step
    w = min(excess, mat.consistency * math.exp(math.log(excess / stiffness) / m))
    for _step in range(3):
        flow = stiffness * math.exp(m * math.log(w / mat.consistency)) / w
        slope = real(1.0) + m * flow
        left = real(1.0) + flow - excess / w
        w = w - w * left / (slope - real(0.5) * left * m * (m - real(1.0)) * flow / slope)
    return w


def return_to_flow(h: Any, mat: Any):
    """Hencky strain whose shear stress is that of the rate of its plastic shear, or without stress in tension."""
    if pressure(h, mat) <= real(0.0):
        return isotropic(real(0.0))
    s = math.sqrt(real(2.0)) * mat.shear_modulus * norm(deviator(h))
    excess = s - mat.yield_stress
    if excess <= real(0.0):
        return h
    left = (mat.yield_stress + viscous_stress(excess, mat)) / s
    return shifted(scaled(deviator(h), left), trace(h) * (real(1.0) / real(3.0)))


def update(h: Any, history: Any, mat: Any, effective: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain.

    ``history`` is the log volume gained without stress and not yet lost again [1]. The share ``effective`` [1] of the mean stress
    that grains carry changes nothing: stress does not depend on it.
    """
    pressed = shifted(h, history * (real(1.0) / real(3.0)))
    new = return_to_flow(pressed, mat)
    return new, gained_volume(pressed, new), dissipated_energy(h, new, mat)


register_law(HerschelBulkley, update)
