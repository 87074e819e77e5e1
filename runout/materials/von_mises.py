"""Cohesion without friction on Hencky strain (von Mises): soft clay that shears faster than it drains.

Shear stress s = sqrt(J_2) is at most the undrained strength s_u, at any pressure. The return scales the deviator and keeps the
volume. What comes apart carries no stress until it has closed up again (Tampubolon et al. 2017, ACM TOG 36:105, sec. 4.3.4).
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
class VonMises(Material):
    """Soft clay in undrained shear: a strength that does not depend on the pressure, and none in tension.

    The strength is that of simple shear. For a strength that falls with the slip, as that of sensitive clay, take
    :class:`CohesionSoftening` with a friction angle of 0.
    """

    law: ClassVar[str] = "von_mises"
    history: ClassVar[str] = "log volume gained without stress and not yet lost again [1]"
    undrained_strength: float = parameter(
        "undrained shear strength s_u", unit="Pa", low=1, high=1e7, typical=2e4, sampled=True, hint="20 kPa is 2.0e4"
    )

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope 0 and intercept sqrt(3) s_u [Pa]: the strength does not grow with the pressure."""
        return 0.0, math.sqrt(3.0) * self.undrained_strength


def shear_stress(h: Any, mat: Any):
    """Shear stress s = sqrt(J_2) [Pa] of a Hencky strain."""
    return math.sqrt(real(2.0)) * mat.shear_modulus * norm(deviator(h))


def return_to_strength(h: Any, mat: Any):
    """Hencky strain whose shear stress is at most s_u, or without stress in tension."""
    if pressure(h, mat) <= real(0.0):
        return isotropic(real(0.0))
    s = shear_stress(h, mat)
    if s <= mat.undrained_strength:
        return h
    return shifted(scaled(deviator(h), mat.undrained_strength / s), trace(h) * (real(1.0) / real(3.0)))


def update(h: Any, history: Any, mat: Any, effective: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain.

    ``history`` is the log volume gained without stress and not yet lost again [1]. The share ``effective`` [1] of the mean stress
    that grains carry changes nothing: the strength does not depend on it.
    """
    pressed = shifted(h, history * (real(1.0) / real(3.0)))
    new = return_to_strength(pressed, mat)
    return new, gained_volume(pressed, new), dissipated_energy(h, new, mat)


register_law(VonMises, update)
