"""Mud and wet debris with a yield stress: Herschel-Bulkley flow, and von Mises plasticity where the consistency is zero.

Shear stress s = sqrt(J_2) = tau_y + K rate^n while it flows (Herschel & Bulkley 1926, Kolloid-Z. 39:291). The return keeps the
volume, is implicit in the rate, and carries no tension: what comes apart is free of stress until it has closed up again.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from runout import Material, parameter, register_law
from runout.physics.elastic import pressure
from runout.physics.plastic import dissipated_energy, gained_volume
from runout.physics.tensors import deviator, isotropic, norm, real, scaled, shifted, trace


@dataclass(frozen=True, kw_only=True)
class HerschelBulkley(Material):
    """Mud and wet debris: rigid below a yield stress, viscous above it."""

    law: ClassVar[str] = "herschel_bulkley"
    history: ClassVar[str] = "log volume gained without stress and not yet lost again [1]"
    depends_on_rate: ClassVar[bool] = True
    yield_stress: float = parameter(
        "shear stress below which it does not flow", unit="Pa", low=1, high=1e6, typical=2000.0, sampled=True, hint="2 kPa is 2.0e3"
    )
    consistency: float = parameter(
        "factor K of the viscous stress; 0 for von Mises plasticity", unit="Pa s^n", low=0, high=1e5, default=0.0, sampled=True
    )
    flow_index: float = parameter("exponent n of the rate of shear", low=0.2, high=1, default=0.5, sampled=True)

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope 0 and intercept sqrt(3) tau_y [Pa]: the yield stress does not grow with the pressure."""
        return 0.0, math.sqrt(3.0) * self.yield_stress

    def shear_strength(self, pressure: float) -> float:
        """tau_y over the pressure [1]; no limit where viscosity adds to it."""
        return math.inf if self.consistency > 0 else super().shear_strength(pressure)


def viscous_stress(excess: Any, mat: Any):
    """Viscous stress w [Pa] of a step whose trial stress lies ``excess`` [Pa] above the yield stress.

    Root of w + G dt (w/K)^(1/n) = excess: a convex function, so that Newton's method falls from an upper bound to the root.
    """
    m = real(1.0) / mat.flow_index
    stiffness = mat.shear_modulus * mat.time_step
    w = min(excess, mat.consistency * math.exp(math.log(excess / stiffness) / m))
    for _step in range(8):
        flow = stiffness * math.exp(m * math.log(w / mat.consistency))
        w = w - (w + flow - excess) / (real(1.0) + m * flow / w)
    return w


def return_to_yield(h: Any, mat: Any):
    """Hencky strain whose shear stress flows at the rate of its plastic shear, or of no stress at all."""
    if pressure(h, mat) <= real(0.0):
        return isotropic(real(0.0))
    s = math.sqrt(real(2.0)) * mat.shear_modulus * norm(deviator(h))
    excess = s - mat.yield_stress
    if excess <= real(0.0):
        return h
    left = mat.yield_stress
    if mat.consistency > real(0.0):
        left = left + viscous_stress(excess, mat)
    return shifted(scaled(deviator(h), left / s), trace(h) * (real(1.0) / real(3.0)))


def update(h: Any, history: Any, mat: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain."""
    closed = shifted(h, history * (real(1.0) / real(3.0)))
    new = return_to_yield(closed, mat)
    return new, gained_volume(closed, new), dissipated_energy(h, new, mat)


register_law(HerschelBulkley, update)
