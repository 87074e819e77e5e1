"""What a registered law is, of the material or of basal friction: a class that declares parameters, and a function."""

from dataclasses import MISSING, Field, dataclass, fields
from functools import cached_property
from types import FunctionType
from typing import Any, ClassVar, Generic, TypeVar

from runout.errors import InputError
from runout.model.law_source import fingerprint
from runout.model.parameters import Parameter, parameters_of
from runout.model.registry import Registry

Declaration = TypeVar("Declaration")
AnyLaw = TypeVar("AnyLaw", bound="RegisteredLaw[Any]")


@dataclass(frozen=True)
class RegisteredLaw(Generic[Declaration]):
    """A registered law.

    Attributes
    ----------
    name : str
        Name in site.yaml.
    declaration : type
        The class that declares its parameters.
    """

    name: str
    declaration: type[Declaration]
    package: ClassVar[str]

    @property
    def function(self) -> FunctionType | None:
        """Its formula; None for a material that never yields."""
        raise NotImplementedError

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters."""
        return parameters_of(self.declaration)

    @property
    def is_of_runout(self) -> bool:
        """Whether it belongs to runout, not to another package."""
        return self.declaration.__module__.startswith(f"{self.package}.")

    @cached_property
    def example(self) -> Declaration:
        """The law with default and typical parameters."""
        return self.declaration(**{p.name: p.typical for p in self.parameters})

    @cached_property
    def fingerprint(self) -> str:
        """Checksum of the sources: compiled code and results of a law of another package depend on it."""
        return fingerprint(self.declaration, self.function)

    @property
    def source(self) -> str:
        """What results depend on beside the version of runout: :attr:`fingerprint` of a law of another package, else nothing."""
        return "" if self.is_of_runout else self.fingerprint


def calling(function: Any, name: str | None = None, **called: Any) -> FunctionType:
    """Copy of a function of :mod:`runout.physics`, with a ``name``, in which some names mean others, such as that of a law."""
    own = FunctionType(function.__code__, {**function.__globals__, **called}, name or function.__name__)
    own.__annotations__, own.__module__, own.__doc__ = dict(function.__annotations__), function.__module__, function.__doc__
    return own


def law_followed(registry: Registry[AnyLaw], declared: Any, register: str) -> AnyLaw:
    """The law that a material or a basal friction follows.

    Parameters
    ----------
    registry : Registry
        Of these laws.
    declared : object
        The material or the basal friction.
    register : str
        Name of the function that registers such laws, for the message.

    Raises
    ------
    InputError
        That of the registry, if the class is not registered.
    """
    law = registry.find(declared.law)
    if not isinstance(declared, law.declaration):
        raise registry.error(f"{type(declared).__name__} is not the registered law {declared.law}; register it with {register}")
    return law


def require_declared(law: RegisteredLaw[Any], kind: str, base: type, error: type[InputError], *, ranges: bool = False) -> None:
    """Raise an error unless the class of a law declares all that is derived from it.

    Parameters
    ----------
    law : RegisteredLaw
    kind : str
        What messages call it.
    base : type
        The public class of runout that the class must derive from.
    error : type of InputError
    ranges : bool
        Whether each parameter needs a range.
    """
    said = f"{kind} {law.name or law.declaration.__qualname__}"
    undecorated = any(isinstance(value, Field) for value in vars(law.declaration).values())
    if undecorated or not (issubclass(law.declaration, base) and law.name.isidentifier()):
        raise error(f"{said}: write a frozen dataclass that derives from runout.{base.__name__}, with `law` as its name")
    declaration: Any = law.declaration
    declared = {p.name for p in law.parameters if p.valid is not None or not ranges}
    for field in fields(declaration):
        if field.name not in declared:
            raise error(f"{said}: {field.name} is not declared; write {field.name}: float = parameter(...)")
    for p in law.parameters:
        if p.typical is MISSING:
            raise error(f"{said}: {p.name} has neither default= nor typical=; tests and tables need one")
