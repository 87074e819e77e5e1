"""Materials: what a user states, checked once; angles in degrees at this edge."""

import math
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import ClassVar

from runout.errors import MaterialError
from runout.model.limits import LIMITS, checked
from runout.physics import drucker_prager, elastic, geostatic

LARGEST_COMPRESSION = 0.3  # elastic strain of a column under its own weight
UNYIELDING = 1e6  # slope of a yield cone that nothing reaches [1]


class Cone(StrEnum):
    """How the Drucker-Prager cone meets the Mohr-Coulomb surface."""

    TRIAXIAL_COMPRESSION = "triaxial_compression"
    TRIAXIAL_EXTENSION = "triaxial_extension"
    PLANE_STRAIN = "plane_strain"
    PLANE_STRAIN_ASSOCIATED = "plane_strain_associated"


@dataclass(frozen=True, kw_only=True)
class Material:
    """Linear Hencky elasticity, the base of every law.

    Parameters
    ----------
    density : float
        Bulk density [kg m-3], 100 to 5000.
    youngs_modulus : float
        Young's modulus [Pa], 1e3 to 1e12.
    poisson_ratio : float
        Poisson's ratio [1], 0 to 0.495.

    Raises
    ------
    MaterialError
        Names the parameter, its value and its range.
    """

    law: ClassVar[str] = "elastic"
    density: float
    youngs_modulus: float
    poisson_ratio: float = 0.3

    def __post_init__(self) -> None:
        for f in fields(self):
            if f.name in LIMITS:
                checked(f.name, getattr(self, f.name), error=MaterialError)

    @property
    def lame_lambda(self) -> float:
        """First Lame parameter [Pa]."""
        return elastic.lame_lambda(self.youngs_modulus, self.poisson_ratio)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus [Pa]."""
        return elastic.shear_modulus(self.youngs_modulus, self.poisson_ratio)

    @property
    def wave_speed(self) -> float:
        """Speed of pressure waves [m/s]."""
        return elastic.wave_speed(self.lame_lambda, self.shear_modulus, self.density)

    def require_carries(self, thickness: float, gravity: float) -> None:
        """Nothing, if the material can carry ``thickness`` [m] of itself under ``gravity`` [m/s2].

        Raises
        ------
        MaterialError
            If it would be compressed by more than three tenths: such a mass collapses into its lowest cells, and waves in it are
            slower than its fall. Names the strain and the modulus that is needed.
        """
        strain = self.density * gravity * thickness / (self.lame_lambda + 2 * self.shear_modulus)
        if strain > LARGEST_COMPRESSION:
            needed = 1.01 * self.youngs_modulus * strain / LARGEST_COMPRESSION
            raise MaterialError(
                f"youngs_modulus is {self.youngs_modulus:g} Pa; the weight of {thickness:.4g} m of this material would strain it "
                f"by {strain:.3g}, at most {LARGEST_COMPRESSION:g} can be carried; take {needed:.3g} Pa or more"
            )

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope M [1] and intercept q_c [Pa] of q <= M p + q_c for slow shear; :data:`UNYIELDING` for what never yields."""
        return UNYIELDING, 0.0

    @property
    def internal_friction(self) -> float:
        """Shear over normal stress at which it yields in slow simple shear, cohesion aside [1]; infinite for what never does."""
        return self.shear_strength(math.inf)

    def shear_strength(self, pressure: float) -> float:
        """Largest shear stress over normal stress [1] that steady shear passes on under a normal stress of ``pressure`` [Pa].

        Cohesion counts; infinite for what never yields.
        """
        return math.inf

    @property
    def rest_ratio(self) -> float:
        """Horizontal over vertical stress at rest [1]: of elastic material that was not strained sideways."""
        return self.poisson_ratio / (1.0 - self.poisson_ratio)

    def record(self) -> dict[str, float]:
        """Parameters of the law by name, SI and radians."""
        return {"lame_lambda": self.lame_lambda, "shear_modulus": self.shear_modulus}


@dataclass(frozen=True, kw_only=True)
class Elastic(Material):
    """Hencky elasticity without failure."""


@dataclass(frozen=True, kw_only=True)
class DruckerPrager(Material):
    """Hencky elasticity with a non-dilatant Drucker-Prager cone.

    Parameters
    ----------
    friction_angle : float
        Internal friction angle of Mohr-Coulomb [deg], 0 to 60; what looks like radians is refused.
    cohesion : float
        Cohesion of Mohr-Coulomb [Pa], 0 to 1e9.
    cone : Cone
        How the cone is matched to Mohr-Coulomb.
    volume_correction : bool
        Material that expanded at the apex must recompress before it carries load (Tampubolon et al. 2017, sec. 4.3.4).
    """

    law: ClassVar[str] = "drucker_prager"
    friction_angle: float
    cohesion: float = 0.0
    cone: Cone = Cone.PLANE_STRAIN
    volume_correction: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.friction_angle == 0 and self.cohesion == 0:
            raise MaterialError("friction_angle and cohesion are both 0; such a material has no strength, set one of them")
        try:
            object.__setattr__(self, "cone", Cone(self.cone))
        except ValueError:
            raise MaterialError(f"cone is {self.cone!r}; choose one of {', '.join(Cone)}") from None

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope M [1] and intercept q_c [Pa] of the cone."""
        cone = getattr(drucker_prager, f"cone_{self.cone}")
        return cone(math.radians(self.friction_angle), self.cohesion)  # type: ignore[no-any-return]

    def shear_strength(self, pressure: float) -> float:
        """(M + q_c/pressure)/sqrt(3) [1]: with the cone of plane strain the sine of the friction angle, and cohesion."""
        slope, intercept = self.yield_cone
        return geostatic.shear_strength(slope, intercept / pressure)

    @property
    def rest_ratio(self) -> float:
        """Horizontal over vertical stress at rest [1], of Jaky."""
        return geostatic.at_rest(math.radians(self.friction_angle))

    def record(self) -> dict[str, float]:
        """Parameters of the law by name, SI and radians."""
        slope, intercept = self.yield_cone
        return {
            **super().record(),
            "cone_slope": slope,
            "cone_intercept": intercept,
            "volume_correction": float(self.volume_correction),
        }


@dataclass(frozen=True, kw_only=True)
class GranularFlow(Material):
    """Hencky elasticity with the friction mu(I) of dense granular flow.

    Parameters
    ----------
    static_friction, dynamic_friction : float
        Friction coefficients mu_s of creeping and mu_2 of fast flow [1], 0 <= mu_s < mu_2 <= 2.
    inertial_constant : float
        Inertial number I_0 half way between them [1], > 0, for the inertial number with the bulk ``density``.
    grain_size : float
        Diameter d of the grains [m], > 0. The inertial number is d times shear rate times sqrt(density/pressure) with the bulk
        ``density``; an I_0 of the literature that is defined with the density of the grains, which is 1/(volume fraction) times
        that of the bulk, is to be multiplied by the square root of the volume fraction, about 0.77.
    """

    law: ClassVar[str] = "granular_flow"
    static_friction: float
    dynamic_friction: float
    grain_size: float
    inertial_constant: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dynamic_friction <= self.static_friction:
            raise MaterialError(
                f"dynamic_friction is {self.dynamic_friction:g}; it must be above static_friction, {self.static_friction:g}"
            )

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope M [1] and intercept [Pa], that of creeping flow: sqrt(J_2) = mu_s p."""
        return math.sqrt(3.0) * self.static_friction, 0.0

    @property
    def internal_friction(self) -> float:
        """That of creeping flow [1]."""
        return self.static_friction

    def shear_strength(self, pressure: float) -> float:
        """mu_2 [1], which fast shear comes near to."""
        return self.dynamic_friction

    @property
    def rest_ratio(self) -> float:
        """Horizontal over vertical stress at rest [1], of Jaky, with an angle of repose of atan(mu_s)."""
        return geostatic.at_rest(math.atan(self.static_friction))

    def record(self) -> dict[str, float]:
        """Parameters of the law by name, SI and radians; the backend puts in the length of its step."""
        return {
            **super().record(),
            "static_friction": self.static_friction,
            "friction_rise": self.dynamic_friction - self.static_friction,
            "inertial_constant": self.inertial_constant,
            "grain_inertia": self.grain_size * math.sqrt(self.density),
            "time_step": 0.0,
        }
