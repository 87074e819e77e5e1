"""Rate-dependent friction mu(I) of dense granular flow on Hencky strain, without dilation.

Shear stress s = sqrt(J_2) = mu(I) p with mu(I) = mu_s + (mu_2 - mu_s)/(1 + I_0/I) and I = rate d sqrt(rho/p) (Jop, Forterre &
Pouliquen 2006, Nature 441:727, eq. 1 to 3; rho is the bulk density here and that of the grains there, so that I_0 differs by the
root of the volume fraction, about 0.77). The return is implicit in the rate and solved exactly (Dunatunga & Kamrin 2015,
J. Fluid Mech. 779:483, sec. 3.4). What comes apart carries no stress until it has closed up again.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from runout.errors import MaterialError
from runout.model.laws import register_law
from runout.model.materials import Material
from runout.model.parameters import parameter
from runout.physics.elastic import pressure
from runout.physics.plastic import dissipated_energy, gained_volume
from runout.physics.tensors import deviator, isotropic, norm, real, scaled, shifted, trace


@dataclass(frozen=True, kw_only=True)
class GranularFlow(Material):
    """Dry grains whose friction rises with the rate of shear, mu(I): thick dense flows.

    The inertial number is grain_size times shear rate times sqrt(density/pressure), with the bulk density. Most papers use the
    density of the grains. Multiply their inertial_constant by the square root of the volume fraction, about 0.77.
    """

    law: ClassVar[str] = "granular_flow"
    history: ClassVar[str] = "log volume gained without stress and not yet lost again [1]"
    depends_on_rate: ClassVar[bool] = True
    static_friction: float = parameter(
        "friction coefficient of slow flow, the tangent of the angle of repose", low=0, high=2, typical=0.38, sampled=True
    )
    dynamic_friction: float = parameter(
        "friction coefficient of fast flow, above static_friction", low=0, high=2, open_low=True, typical=0.64, sampled=True
    )
    inertial_constant: float = parameter(
        "inertial number, with the bulk density, half way between the two",
        low=0,
        high=1000,
        open_low=True,
        default=0.3,
        sampled=True,
    )
    grain_size: float = parameter("diameter of the grains", unit="m", low=0, high=100, open_low=True, typical=0.02, sampled=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dynamic_friction <= self.static_friction:
            raise MaterialError(
                f"dynamic_friction is {self.dynamic_friction:g}, not above static_friction {self.static_friction:g}; "
                "friction rises with the rate, take a larger one"
            )

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope M [1] and intercept [Pa] of creeping flow: sqrt(J_2) = mu_s p."""
        return math.sqrt(3.0) * self.static_friction, 0.0

    @property
    def internal_friction(self) -> float:
        """Shear over normal stress of creeping flow [1]."""
        return self.static_friction

    def shear_strength(self, pressure: float) -> float:
        """mu_2 [1], the limit for fast shear."""
        return self.dynamic_friction

    def record(self) -> dict[str, float]:
        """Lame parameters [Pa], flow curve [1], d sqrt(rho) [kg^0.5 m^-0.5] and time step [s]."""
        return {
            "lame_lambda": self.lame_lambda,
            "shear_modulus": self.shear_modulus,
            "static_friction": self.static_friction,
            "friction_rise": self.dynamic_friction - self.static_friction,
            "inertial_constant": self.inertial_constant,
            "grain_inertia": self.grain_size * math.sqrt(self.density),
            "time_step": 0.0,
        }


def friction(I: Any, mat: Any):
    """mu(I) [1] at an inertial number."""
    return mat.static_friction + mat.friction_rise * I / (mat.inertial_constant + I)


def plastic_shear(excess: Any, p: Any, mat: Any):
    """Plastic shear [1] of a step whose trial stress lies ``excess`` [Pa] above mu_s p: root of a quadratic equation.

    excess - G x = p (mu_2 - mu_s) k x / (I_0 + k x), k = d sqrt(rho/p)/dt.
    """
    k = mat.grain_inertia / (math.sqrt(p) * mat.time_step)
    b = k * (excess - p * mat.friction_rise) - mat.shear_modulus * mat.inertial_constant
    root = math.sqrt(b * b + real(4.0) * mat.shear_modulus * k * excess * mat.inertial_constant)
    if b > real(0.0):
        return (b + root) / (real(2.0) * mat.shear_modulus * k)
    return real(2.0) * excess * mat.inertial_constant / (root - b)


def return_to_flow(h: Any, mat: Any, effective: Any):
    """Hencky strain [1] after the return: on the flow curve of what grains carry, or without stress in tension."""
    p = effective * pressure(h, mat)
    if p <= real(0.0):
        return isotropic(real(0.0))
    s = math.sqrt(real(2.0)) * mat.shear_modulus * norm(deviator(h))
    excess = s - mat.static_friction * p
    if excess <= real(0.0):
        return h
    left = real(1.0) - mat.shear_modulus * plastic_shear(excess, p, mat) / s
    return shifted(scaled(deviator(h), left), trace(h) * (real(1.0) / real(3.0)))


def update(h: Any, history: Any, mat: Any, effective: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain.

    ``history`` is the log volume gained without stress and not yet lost again [1]. Friction acts on the share ``effective`` [1] of
    the mean stress, which grains carry.
    """
    pressed = shifted(h, history * (real(1.0) / real(3.0)))
    new = return_to_flow(pressed, mat, effective)
    return new, gained_volume(pressed, new), dissipated_energy(h, new, mat)


register_law(GranularFlow, update)
