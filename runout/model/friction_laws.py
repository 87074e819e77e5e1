"""Registry of laws of basal friction: each file of :mod:`runout.friction` registers one, which is found by name."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from types import FunctionType, SimpleNamespace
from typing import Any

from runout.errors import ConfigError
from runout.model.basal_friction import BasalFriction, MassAbove
from runout.model.registered_law import RegisteredLaw, calling, functions_of_law, law_followed, register
from runout.model.registry import Registry
from runout.physics import bed, contact

PACKAGE = "runout.friction"
DEFAULT_FRICTION = "coulomb"
ARGUMENTS = 5  # of ``resistance``: normal impulse, slip speed, ground area, length of the step, record of numbers
STRENGTH = "strength"  # of a record: what limits the resistance in every contact


@dataclass(frozen=True)
class FrictionLaw(RegisteredLaw[BasalFriction]):
    """A registered law of basal friction."""

    resistance: FunctionType  # steady impulse and drag of a contact, see :func:`register_friction`
    package = PACKAGE

    @property
    def friction(self) -> type[BasalFriction]:
        """The class that declares its parameters."""
        return self.declaration

    @property
    def function(self) -> FunctionType:
        """Its resistance."""
        return self.resistance

    @property
    def uses_area(self) -> bool:
        """Whether its resistance uses the ground area of a contact."""
        return self.friction.uses_area

    @property
    def starts_differ(self) -> bool:
        """Whether contacts of some masses only start from the force of the step before at any speed, see :attr:`uses_area`."""
        return len({law.uses_area for law in self.laws}) > 1

    @property
    def drags_column(self) -> bool:
        """Whether its drag slows the whole column above a contact."""
        return self.friction.drags_column

    @cached_property
    def drags(self) -> bool:
        """Whether its resistance has a part that grows with the square of the speed."""
        record = self.friction.acting(self.example.numbers(), MassAbove(1.0, 1.0, 1.0))
        return bool(self.resistance(1.0, 1.0, 1.0, 1.0, SimpleNamespace(**record))[1] > 0.0)

    @cached_property
    def numbers(self) -> tuple[str, ...]:
        """Names of the numbers that zones change, in the order of the parameters."""
        return tuple(self.example.numbers())

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """Names of the numbers of a record, which ``resistance`` reads."""
        return tuple(self.friction.acting(self.example.numbers(), MassAbove(1.0, 1.0, 1.0)))

    @property
    def laws(self) -> "tuple[FrictionLaw, ...]":
        """The law itself; of several in one run (:mod:`runout.model.law_mixtures`) all of them."""
        return (self,)

    @cached_property
    def own_functions(self) -> tuple[FunctionType, ...]:
        """Its resistance and the functions that this calls, callees first."""
        return tuple(functions_of_law(self.resistance))

    @cached_property
    def on_column(self) -> FunctionType:
        """Its resistance where that slows whole columns."""
        return self.resistance

    @cached_property
    def limited(self) -> FunctionType:
        """``resistance``, limited to what the mass passes on, unless the record holds no strength."""
        if STRENGTH not in self.fields:
            return self.resistance
        return calling(contact.limited_resistance, law_resistance=self.resistance)

    @cached_property
    def at_base(self) -> FunctionType:
        """:attr:`limited` as contact takes it: without drag where that acts on the column."""
        limited: FunctionType = self.limited  # type: ignore[assignment]
        return calling(contact.steady_resistance, law_resistance=limited) if self.drags_column else limited

    @cached_property
    def impulse(self) -> FunctionType:
        """:func:`runout.physics.contact.impulse` with the resistance of this law, in plain Python."""
        return calling(contact.impulse, effective_impulse=self.effective_impulse)  # type: ignore[arg-type]

    @cached_property
    def effective_impulse(self) -> FunctionType:
        """:func:`runout.physics.contact.effective_impulse` with the resistance of this law, in plain Python."""
        return calling(contact.effective_impulse, law_resistance=self.at_base)  # type: ignore[arg-type]

    @cached_property
    def stress(self) -> FunctionType:
        """:func:`runout.physics.bed.friction_stress` with the resistance of this law, in plain Python."""
        return calling(bed.friction_stress, law_resistance=self.limited)  # type: ignore[arg-type]

    @cached_property
    def column_drag(self) -> FunctionType:
        """:func:`runout.physics.contact.column_drag` with the resistance of this law, in plain Python."""
        return calling(contact.column_drag, law_resistance=self.on_column)

    @cached_property
    def free_column_drag(self) -> FunctionType:
        """:func:`runout.physics.contact.free_column_drag` with the resistance of this law, in plain Python."""
        return calling(contact.free_column_drag, law_resistance=self.on_column)


FRICTIONS: Registry[FrictionLaw] = Registry("friction law", PACKAGE, "runout.friction", ConfigError)


def register_friction(friction: type[BasalFriction], resistance: Callable[..., Any]) -> None:
    """Register a law of basal friction under the name ``friction.law``.

    Parameters
    ----------
    friction : type of BasalFriction
        Frozen dataclass of keyword-only parameters, each made by :func:`runout.model.parameters.parameter`.
    resistance : function
        ``resistance(normal, slip, area, dt, basal) -> (steady, drag)``: impulse [N s] that resists sliding at any speed, and drag
        [kg/m], force over the square of the speed that is left. ``normal`` is the normal impulse [N s] of a contact in a step of
        ``dt`` [s], ``slip`` the speed [m/s] along the ground with the impulse of the step before, ``area`` the ground area of the
        contact [m2] (0 unless ``friction.uses_area``), ``basal`` the record of ``friction.acting(...)``. Plain scalar Python of the
        shared subset (:mod:`runout.model.registered_law`).

    Raises
    ------
    ConfigError
        If the declaration is incomplete or inconsistent, or another law has the name.
    """
    if not isinstance(resistance, FunctionType) or len(inspect.signature(resistance).parameters) != ARGUMENTS:
        wanted = "a plain function of (normal, slip, area, dt, basal)"
        raise ConfigError(f"friction law {friction.law}: resistance must be {wanted}, not {resistance!r}")
    law = FrictionLaw(friction.law, friction, resistance)
    register(FRICTIONS, law, BasalFriction, ConfigError, _require_numbers, ranges=True)


def _require_numbers(law: FrictionLaw) -> None:
    """Raise an error unless zones can change each parameter of a law."""
    subject = f"friction law {law.name}"
    if len(law.numbers) != len(law.parameters):
        raise ConfigError(f"{subject}: numbers() gives {len(law.numbers)} for {len(law.parameters)} parameters; give one for each")
    if not law.friction.coefficients or not set(law.friction.coefficients) <= set(law.numbers):
        names = ", ".join(law.numbers)
        raise ConfigError(f"{subject}: coefficients must name friction coefficients among {names}, that at rest first")


def friction_law_of(friction: BasalFriction) -> FrictionLaw:
    """The law that a basal friction follows. Raises ConfigError if its class is not registered."""
    return law_followed(FRICTIONS, friction, "register_friction")


def numbers_of(friction: BasalFriction | float) -> tuple[FrictionLaw, tuple[float, ...]]:
    """The law of a basal friction and its numbers; a number alone is the coefficient [1] of the default law, which has no other."""
    if isinstance(friction, BasalFriction):
        law = friction_law_of(friction)
        return law, tuple(friction.numbers()[name] for name in law.numbers)
    return FRICTIONS.find(DEFAULT_FRICTION), (float(friction),)
