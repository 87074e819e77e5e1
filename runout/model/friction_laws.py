"""Laws of basal friction: registered by the file that each stands in, found by name."""

import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from functools import cached_property
from types import FunctionType
from typing import Any

from runout.errors import ConfigError, MaterialError
from runout.model.basal_friction import BasalFriction
from runout.model.law_source import fingerprint, functions_of_law, require_shared_subset
from runout.model.parameters import Parameter, numpydoc, parameters_of
from runout.model.registry import Registry, classes_in
from runout.physics import contact

PACKAGE = "runout.friction"
DEFAULT_FRICTION = "coulomb"
ARGUMENTS = 4  # of ``resistance``: normal impulse, slip speed, length of the step, record of numbers
STRENGTH = "strength"  # of a record: what limits the resistance in every contact


@dataclass(frozen=True)
class FrictionLaw:
    """A registered law of basal friction.

    Attributes
    ----------
    name : str
        In site.yaml.
    friction : type of BasalFriction
        Its parameters.
    resistance : function
        See :func:`register_friction`.
    """

    name: str
    friction: type[BasalFriction]
    resistance: FunctionType

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters."""
        return parameters_of(self.friction)

    @property
    def declaration(self) -> type[BasalFriction]:
        """The class that declares its parameters."""
        return self.friction

    @property
    def is_of_runout(self) -> bool:
        """Whether it belongs to runout, not to another package."""
        return self.friction.__module__.startswith(f"{PACKAGE}.")

    @cached_property
    def example(self) -> BasalFriction:
        """Friction with default and typical parameters."""
        return self.friction(**{p.name: p.typical for p in self.parameters})

    @cached_property
    def numbers(self) -> tuple[str, ...]:
        """Names of the numbers that zones change, in the order of the parameters."""
        return tuple(self.example.numbers())

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """Names of the numbers of a record, which ``resistance`` reads."""
        return tuple(self.friction.acting(self.example.numbers(), 1.0))

    @cached_property
    def fingerprint(self) -> str:
        """Checksum of the sources: compiled code and results of a law of another package depend on it."""
        return fingerprint(self.friction, self.resistance)

    @property
    def source(self) -> str:
        """What results depend on beside the version of runout: :attr:`fingerprint` of a law of another package, else nothing."""
        return "" if self.is_of_runout else self.fingerprint

    @cached_property
    def at_base(self) -> FunctionType:
        """``resistance`` as contact takes it: limited to what the mass passes on, unless the record holds no strength."""
        if STRENGTH not in self.fields:
            return self.resistance
        return self._with_law(contact.limited_resistance, self.resistance)

    @cached_property
    def impulse(self) -> FunctionType:
        """:func:`runout.physics.contact.impulse` with the resistance of this law, in plain Python."""
        return self._with_law(contact.impulse, self.at_base)  # type: ignore[arg-type]

    @staticmethod
    def _with_law(function: Any, resistance: FunctionType) -> FunctionType:
        own = FunctionType(function.__code__, {**function.__globals__, "law_resistance": resistance}, function.__name__)
        own.__annotations__, own.__module__, own.__doc__ = dict(function.__annotations__), function.__module__, function.__doc__
        return own


FRICTIONS: Registry[FrictionLaw] = Registry("friction law", PACKAGE, "runout.friction", ConfigError)


def register_friction(friction: type[BasalFriction], resistance: Callable[..., Any]) -> None:
    """Make a law of basal friction known to all parts of runout, by the name ``friction.law``.

    Parameters
    ----------
    friction : type of BasalFriction
        Frozen dataclass of keyword-only parameters, each made by :func:`runout.model.parameters.parameter`.
    resistance : function
        ``resistance(normal, slip, dt, basal) -> (steady, drag)``: impulse [N s] that resists sliding at any speed, and drag
        [kg/m], force over the square of the speed that is left. ``normal`` is the normal impulse [N s] of a contact in a step of
        ``dt`` [s], ``slip`` the speed [m/s] along the ground with the impulse of the step before, ``basal`` the record of
        ``friction.acting(...)``. Plain scalar Python of the shared subset (:mod:`runout.model.law_source`).

    Raises
    ------
    ConfigError
        If the declaration does not hold together, or another law has the name.
    """
    if not isinstance(resistance, FunctionType) or len(inspect.signature(resistance).parameters) != ARGUMENTS:
        wanted = "a plain function of (normal, slip, dt, basal)"
        raise ConfigError(f"friction law {friction.law}: resistance must be {wanted}, not {resistance!r}")
    law = FrictionLaw(friction.law, friction, resistance)
    _require_declared(law)
    if not law.is_of_runout:  # the tests of runout check its own
        try:
            for function in functions_of_law(law.resistance):
                require_shared_subset(function)
        except MaterialError as error:
            raise ConfigError(str(error)) from None
    friction.__doc__ = numpydoc(friction)
    FRICTIONS.add(law.name, f"{friction.__module__}.{friction.__qualname__}", law)


def _require_declared(law: FrictionLaw) -> None:
    """Nothing, if the class of a law says all that is derived from it."""
    said = f"friction law {law.name or law.friction.__qualname__}"
    undecorated = any(isinstance(value, Field) for value in vars(law.friction).values())
    if undecorated or not (issubclass(law.friction, BasalFriction) and law.name.isidentifier()):
        raise ConfigError(f"{said}: write a frozen dataclass that derives from runout.BasalFriction, with `law` as its name")
    declared = {p.name: p for p in law.parameters}
    for field in fields(law.friction):
        if field.name not in declared or declared[field.name].valid is None:
            raise ConfigError(f"{said}: {field.name} is not declared; write {field.name}: float = parameter(...)")
    for p in law.parameters:
        if p.typical is MISSING:
            raise ConfigError(f"{said}: {p.name} has neither default= nor typical=; tests and tables need one")
    if len(law.numbers) != len(law.parameters):
        raise ConfigError(f"{said}: numbers() gives {len(law.numbers)} for {len(law.parameters)} parameters; give one for each")
    if not law.friction.coefficients or not set(law.friction.coefficients) <= set(law.numbers):
        names = ", ".join(law.numbers)
        raise ConfigError(f"{said}: coefficients must name friction coefficients among {names}, that at rest first")


def public_names() -> dict[str, str]:
    """Module of each class that the files of runout's laws of friction define, by its name."""
    return classes_in(law.friction.__module__ for law in FRICTIONS.of_runout())


def friction_law_of(friction: BasalFriction) -> FrictionLaw:
    """The law that a basal friction follows.

    Raises
    ------
    ConfigError
        If its class is not registered.
    """
    law = FRICTIONS.find(friction.law)
    if not isinstance(friction, law.friction):
        raise ConfigError(f"{type(friction).__name__} is not the registered law {friction.law}; register it with register_friction")
    return law


def numbers_of(friction: BasalFriction | float) -> tuple[FrictionLaw, tuple[float, ...]]:
    """The law of a basal friction and its numbers; a number alone is the coefficient [1] of the default law, which has no other."""
    if isinstance(friction, BasalFriction):
        law = friction_law_of(friction)
        return law, tuple(friction.numbers()[name] for name in law.numbers)
    return FRICTIONS.find(DEFAULT_FRICTION), (float(friction),)
