"""Basal friction: what every law of friction at the ground answers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from runout.errors import ConfigError
from runout.model.parameters import parameters_of

USUAL_ANGLE = 20.0  # [deg] of a run that states no friction
FRICTION_REMEDY = "give a law of friction, for example runout.Coulomb(friction_angle=20.0) in degrees"


class MassAbove(NamedTuple):
    """What a law of friction may know of the mass above the ground; numbers, or arrays of them."""

    strength: Any  # float: largest friction coefficient that the mass passes on to the ground [1]
    density: Any  # float [kg/m3]
    gravity: Any  # float: magnitude of gravity [m/s2]


@dataclass(frozen=True, kw_only=True)
class BasalFriction:
    """Base of every law of friction between a mass and the ground.

    A law adds its parameters as fields (:mod:`runout.model.parameters`), names its friction coefficients and is registered with its
    resistance by :func:`runout.register_friction`. A value out of its range is a ConfigError.
    """

    law: ClassVar[str] = ""  # name in site.yaml
    coefficients: ClassVar[tuple[str, ...]] = ()  # those of `numbers` that are friction coefficients [1], that at rest first
    uses_area: ClassVar[bool] = False  # whether `resistance` uses the ground area of a contact; backends compute it only then

    drags_column: ClassVar[bool] = False  # whether drag slows the whole column above a contact, not its base; uses the area too

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.uses_area = cls.uses_area or cls.drags_column

    def __post_init__(self) -> None:
        for p in parameters_of(type(self)):
            object.__setattr__(self, p.name, p.checked(getattr(self, p.name), ConfigError))

    def numbers(self) -> dict[str, float]:
        """What zones change, by name: one number for each parameter, in their order; by default in SI units and radians."""
        return {p.name: p.si(getattr(self, p.name)) for p in parameters_of(type(self))}

    @classmethod
    def acting(cls, numbers: Mapping[str, Any], mass: MassAbove) -> dict[str, Any]:
        """What ``resistance`` reads, by name, from :meth:`numbers` as zones change them; numbers or arrays of them.

        By default these and ``strength`` [1], the most that the mass passes on to the ground; contact limits the steady part of
        the resistance to it.
        """
        import numpy as np  # the command starts without it

        return {**numbers, "strength": np.asarray(mass.strength)}

    @property
    def at_rest(self) -> float:
        """Friction coefficient at rest [1]."""
        return self.numbers()[self.coefficients[0]]

    @property
    def least(self) -> float:
        """Smallest friction coefficient at any speed [1]."""
        return min(self.numbers()[name] for name in self.coefficients)
