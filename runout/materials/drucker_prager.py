"""Non-dilatant Drucker-Prager plasticity on Hencky strain.

Yield: q <= M p + q_c with p = -tr(tau)/3 (compression positive) and q = sqrt(3/2) |dev tau|. The return keeps the
volume on the cone and goes to the apex in tension (Klar et al. 2016, ACM TOG 35:103, sec. 7.3). The volume gained at
the apex is stored and must be lost again before the material carries load (Tampubolon et al. 2017, ACM TOG 36:105,
sec. 4.3.4).
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar

from runout.errors import MaterialError
from runout.model.laws import register_law
from runout.model.materials import Material
from runout.model.parameters import choice, parameter, switch
from runout.physics import geostatic
from runout.physics.elastic import deviatoric_stress, pressure
from runout.physics.plastic import dissipated_energy, gained_volume
from runout.physics.tensors import deviator, isotropic, real, scaled, shifted, trace


class Cone(StrEnum):
    """How the Drucker-Prager cone meets the Mohr-Coulomb surface."""

    TRIAXIAL_COMPRESSION = "triaxial_compression"
    TRIAXIAL_EXTENSION = "triaxial_extension"
    PLANE_STRAIN = "plane_strain"
    PLANE_STRAIN_ASSOCIATED = "plane_strain_associated"


@dataclass(frozen=True, kw_only=True)
class DruckerPrager(Material):
    """Soil, rock fragments, debris: elastic up to a friction cone, without dilation."""

    law: ClassVar[str] = "drucker_prager"
    history: ClassVar[str] = "log volume gained at the apex and not yet lost again [1]"
    friction_angle: float = parameter(
        "internal friction angle of Mohr-Coulomb", unit="deg", low=0, high=60, typical=30.0, degrees=True, sampled=True
    )
    cohesion: float = parameter(
        "cohesion of Mohr-Coulomb", unit="Pa", low=0, high=1e9, default=0.0, sampled=True, hint="1 kPa is 1.0e3"
    )
    cone: Cone = choice("how the Drucker-Prager cone meets Mohr-Coulomb", Cone, Cone.PLANE_STRAIN)
    volume_correction: bool = switch("material that came apart must close up before it carries load again", True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.friction_angle == 0 and self.cohesion == 0:
            raise MaterialError("friction_angle and cohesion are both 0; such a material has no strength, set one of them")

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope M [1] and intercept q_c [Pa] of the cone."""
        return CONES[self.cone](math.radians(self.friction_angle), self.cohesion)  # type: ignore[no-any-return]

    @property
    def rest_ratio(self) -> float:
        """Horizontal over vertical stress at rest [1], of Jaky with the angle of Mohr-Coulomb."""
        return geostatic.at_rest(math.radians(self.friction_angle))

    def record(self) -> dict[str, float]:
        """Lame parameters [Pa], slope [1] and intercept [Pa] of the cone, and whether volume is corrected (1 or 0)."""
        slope, intercept = self.yield_cone
        return {
            "lame_lambda": self.lame_lambda,
            "shear_modulus": self.shear_modulus,
            "cone_slope": slope,
            "cone_intercept": intercept,
            "volume_correction": float(self.volume_correction),
        }


def cone_triaxial_compression(phi: Any, c: Any):
    """Slope M [1] and intercept q_c [Pa] of the cone through the compression corners of Mohr-Coulomb."""
    s = math.sin(phi)
    d = real(3.0) - s
    return real(6.0) * s / d, real(6.0) * c * math.cos(phi) / d


def cone_triaxial_extension(phi: Any, c: Any):
    """Slope M [1] and intercept q_c [Pa] of the cone through the extension corners of Mohr-Coulomb."""
    s = math.sin(phi)
    d = real(3.0) + s
    return real(6.0) * s / d, real(6.0) * c * math.cos(phi) / d


def cone_plane_strain(phi: Any, c: Any):
    """Slope M [1] and intercept q_c [Pa] that match Mohr-Coulomb in plane strain for isochoric flow."""
    r = math.sqrt(real(3.0))
    return r * math.sin(phi), r * c * math.cos(phi)


def cone_plane_strain_associated(phi: Any, c: Any):
    """Slope M [1] and intercept q_c [Pa] of Drucker & Prager 1952 (associated flow, plane strain)."""
    t = math.tan(phi)
    d = math.sqrt(real(9.0) + real(12.0) * t * t)
    r = real(3.0) * math.sqrt(real(3.0))
    return r * t / d, r * c / d


CONES = {
    Cone.TRIAXIAL_COMPRESSION: cone_triaxial_compression,
    Cone.TRIAXIAL_EXTENSION: cone_triaxial_extension,
    Cone.PLANE_STRAIN: cone_plane_strain,
    Cone.PLANE_STRAIN_ASSOCIATED: cone_plane_strain_associated,
}


def apex(intercept: Any, slope: Any, mat: Any):
    """Hencky strain of the apex of a cone."""
    bulk = mat.lame_lambda + real(2.0) * mat.shear_modulus / real(3.0)
    return isotropic(intercept / (real(3.0) * bulk * slope))


def return_to_cone(h: Any, slope: Any, mat: Any):
    """Hencky strain of the admissible stress nearest along the deviator, or of the apex, of a cone with a ``slope`` [1]."""
    p = pressure(h, mat)
    q = deviatoric_stress(h, mat)
    limit = slope * p + mat.cone_intercept
    if limit <= real(0.0):
        return apex(mat.cone_intercept, slope, mat)
    if q <= limit:
        return h
    return shifted(scaled(deviator(h), limit / q), trace(h) * (real(1.0) / real(3.0)))


def update(h: Any, history: Any, mat: Any, effective: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain.

    ``history`` is the log volume gained at the apex and not yet lost again [1]. Where grains carry the share ``effective`` [1]
    of the mean stress, the cone is flatter by that share.
    """
    gained = history * mat.volume_correction
    pressed = shifted(h, gained * (real(1.0) / real(3.0)))
    new = return_to_cone(pressed, effective * mat.cone_slope, mat)
    return new, gained_volume(pressed, new), dissipated_energy(h, new, mat)


register_law(DruckerPrager, update)
