"""Material: the elasticity that all laws share, and the interface to their strength."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from runout.errors import MaterialError
from runout.model.limits import LARGEST_CFL
from runout.model.parameters import AUTO, numpydoc, parameter, parameters_of
from runout.physics import elastic, geostatic, numerical_scales

RULE = ("wave_ratio", "weight_strain")  # parameters by which a modulus is chosen
LARGEST_COMPRESSION = 0.3  # elastic strain of a column under its own weight
MODULUS_DIGITS = 3  # significant digits of a chosen modulus, rounded up; files record all of them
MATERIAL_REMEDY = "give a material, for example runout.DruckerPrager(density=2000.0, friction_angle=30.0) with angles in degrees"
UNYIELDING = 1e6  # slope of the yield cone of a material that never yields [1]


@dataclass(frozen=True, kw_only=True)
class Material:
    """Linear Hencky elasticity, the base of every law.

    A law adds its parameters as fields (:mod:`runout.model.parameters`), says when it yields (:attr:`yield_cone`) and is registered
    with its return mapping by :func:`runout.register_law`. A value out of its range is a MaterialError.
    """

    law: ClassVar[str] = ""  # name in site.yaml
    history: ClassVar[str] = ""  # meaning and unit of the history variable of a particle; it starts at 0
    history_is_volume: ClassVar[bool] = False  # whether it is a log volume where it is above 0, which counts with the trace
    depends_on_rate: ClassVar[bool] = False  # whether the record holds the length of the step [s], ``time_step``
    largest_cfl: ClassVar[float] = LARGEST_CFL  # largest Courant number of its time steps
    density: float = parameter(
        "bulk density", unit="kg m-3", low=100, high=5000, default=2000.0, sampled=True, hint="2 g/cm3 is 2000"
    )
    youngs_modulus: float | Literal["auto"] = parameter(
        "Young's modulus; auto: each run chooses it from the flow, by wave_ratio and weight_strain",
        unit="Pa",
        low=1e3,
        high=1e12,
        default=AUTO,
        typical=1e7,
        sampled=True,
        hint="5 MPa is 5.0e6",
    )
    poisson_ratio: float = parameter("Poisson's ratio", low=0, high=0.495, default=0.3)
    wave_ratio: float = parameter(
        "with youngs_modulus auto: speed of pressure waves over that of the flow, at least",
        low=3,
        high=20,
        default=4.0,
        hint="4 is usual, 5 where dams decide the result; below 3 the flow is compressed",
    )
    weight_strain: float = parameter(
        "with youngs_modulus auto: elastic strain of the release under its own weight, at most",
        low=1e-3,
        high=0.03,
        default=0.02,
        hint="0.02 is 2 %, usual; 0.01 on slopes near equilibrium",
    )

    def __post_init__(self) -> None:
        for p in parameters_of(type(self)):
            object.__setattr__(self, p.name, p.checked(getattr(self, p.name)))
        for p in parameters_of(Material):
            if self.youngs_modulus != AUTO and p.name in RULE and getattr(self, p.name) != p.default:
                values_text = f"{p.name} is {getattr(self, p.name):g} and youngs_modulus {self.youngs_modulus:g} Pa"
                raise MaterialError(f"{values_text}, so that {p.name} sets nothing; remove one of them")

    @property
    def modulus(self) -> float:
        """Young's modulus [Pa] as a number.

        Raises
        ------
        MaterialError
            If it is still to be chosen.
        """
        if isinstance(self.youngs_modulus, str):
            raise MaterialError("youngs_modulus is auto, which a run chooses; state a number, or use Material.chosen")
        return self.youngs_modulus

    def chosen(self, speed: float, thickness: float, gravity: float) -> Self:
        """This material with a number as Young's modulus: that of :func:`runout.physics.numerical_scales.artificial_wave_speed`.

        A stated number stays. A law that overrides this chooses in another way.

        Parameters
        ----------
        speed : float
            Largest speed that the flow may reach [m/s].
        thickness : float
            Largest thickness of the releases [m].
        gravity : float
            [m/s2].
        """
        if self.youngs_modulus != AUTO:
            return self
        c = numerical_scales.artificial_wave_speed(self.wave_ratio, speed, gravity, thickness, self.weight_strain)
        needed = elastic.youngs_modulus(c, self.density, self.poisson_ratio)
        rules = {p.name: p for p in parameters_of(type(self))}
        valid = rules["youngs_modulus"].valid
        assert valid is not None  # it is a number
        modulus = min(max(_rounded_up(needed), valid.low), valid.high)
        return replace(self, youngs_modulus=modulus, **{name: rules[name].default for name in RULE})

    @property
    def lame_lambda(self) -> float:
        """First Lame parameter [Pa]."""
        return elastic.lame_lambda(self.modulus, self.poisson_ratio)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus [Pa]."""
        return elastic.shear_modulus(self.modulus, self.poisson_ratio)

    def weight_strain_of(self, thickness: float, gravity: float) -> float:
        """Elastic strain [1] of ``thickness`` [m] of this material under its own weight in ``gravity`` [m/s2], sides held."""
        return self.density * gravity * thickness / (self.lame_lambda + 2 * self.shear_modulus)

    @property
    def wave_speed(self) -> float:
        """Speed of pressure waves [m/s]."""
        return elastic.wave_speed(self.lame_lambda, self.shear_modulus, self.density)

    def require_carries(self, thickness: float, gravity: float) -> None:
        """Raise an error unless the material can carry a layer of ``thickness`` [m] under ``gravity`` [m/s2].

        Raises
        ------
        MaterialError
            If its weight would compress it by more than 30 %. Such a mass collapses into its lowest cells, and its pressure waves
            are slower than its fall. Names the strain and the modulus that is needed.
        """
        strain = self.weight_strain_of(thickness, gravity)
        if strain > LARGEST_COMPRESSION:
            needed = 1.01 * self.modulus * strain / LARGEST_COMPRESSION
            raise MaterialError(
                f"youngs_modulus is {self.modulus:g} Pa; the weight of {thickness:.4g} m of this material would strain it "
                f"by {strain:.3g}, at most {LARGEST_COMPRESSION:g} can be carried; take {needed:.3g} Pa or more"
            )

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope M [1] and intercept q_c [Pa] of q <= M p + q_c in slow shear; :data:`UNYIELDING` if it never yields."""
        return UNYIELDING, 0.0

    @property
    def internal_friction(self) -> float:
        """Ratio of shear to normal stress at yield in slow simple shear, without cohesion [1]; infinite if it never yields."""
        slope, _ = self.yield_cone
        return math.inf if slope >= UNYIELDING else geostatic.shear_strength(slope, 0.0)

    def shear_strength(self, pressure: float) -> float:
        """Largest shear stress over normal stress [1] that steady shear passes on under a normal stress of ``pressure`` [Pa].

        Includes cohesion; infinite if the material never yields.
        """
        slope, intercept = self.yield_cone
        return math.inf if slope >= UNYIELDING else geostatic.shear_strength(slope, intercept / pressure)

    def resting_strength(self, pressure: float) -> float:
        """Largest shear stress over a normal stress of ``pressure`` [Pa] under which a layer that stands does not flow [1].

        Infinite where :meth:`shear_strength` limits rest and flow alike. A fluid with a yield stress passes on more while it flows.
        """
        return math.inf

    @property
    def rest_ratio(self) -> float:
        """Horizontal over vertical stress at rest [1].

        The ratio of Jaky for the angle of internal friction; without internal friction, that of elastic material without
        lateral strain.
        """
        friction = self.internal_friction
        if 0.0 < friction < math.inf:
            return geostatic.at_rest(math.atan(friction))
        return self.poisson_ratio / (1.0 - self.poisson_ratio)

    def record(self) -> dict[str, float]:
        """What ``update`` reads, by name: Lame parameters [Pa] and, unless a law says otherwise, its parameters in SI and radians.

        With :attr:`depends_on_rate` also ``time_step``, which the backend keeps up to date.
        """
        elasticity = {"lame_lambda": self.lame_lambda, "shear_modulus": self.shear_modulus}
        own = [p for p in parameters_of(type(self)) if p not in parameters_of(Material) and not p.choices]
        rate = {"time_step": 0.0} if self.depends_on_rate else {}
        return elasticity | {p.name: p.si(getattr(self, p.name)) for p in own} | rate


Material.__doc__ = numpydoc(Material)


def _rounded_up(value: float) -> float:
    """The next number of :data:`MODULUS_DIGITS` digits."""
    digits = MODULUS_DIGITS - 1 - math.floor(math.log10(value))
    return float(f"{math.ceil(value * 10.0**digits * (1.0 - 1e-12))}e{-digits}")
