"""What a registered law is: a class that declares parameters, and a function that all compilers can read.

The checksum of its sources is part of the keys of compiled code and results.
"""

import ast
import hashlib
import inspect
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, dataclass, fields
from functools import cached_property
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, ClassVar, Generic, TypeVar

from runout.errors import InputError, MaterialError
from runout.model.parameters import Parameter, numpydoc, parameters_of
from runout.model.registry import Registry, classes_in
from runout.model.shared_subset import violations_in

PHYSICS = "runout.physics."
USABLE_MODULES = ("math",)
Declaration = TypeVar("Declaration")
AnyLaw = TypeVar("AnyLaw", bound="RegisteredLaw[Any]")


def functions_of_law(update: Callable[..., object]) -> list[FunctionType]:
    """``update`` and the functions that it calls, without those of :mod:`runout.physics`; callees come before their callers."""
    functions: list[FunctionType] = []
    _collect(update, functions, [])  # type: ignore[arg-type]
    return functions


def _collect(function: FunctionType, functions: list[FunctionType], above: list[FunctionType]) -> None:
    if function in above:
        raise MaterialError(f"{_place(function)}: {function.__name__} calls itself; a kernel cannot")
    for _, value in _globals_of(function):
        if isinstance(value, FunctionType) and not value.__module__.startswith(PHYSICS) and value not in functions:
            _collect(value, functions, [*above, function])
    functions.append(function)


def _globals_of(function: FunctionType) -> Iterator[tuple[str, object]]:
    """Name and value of each global that a function uses."""
    for name in function.__code__.co_names:
        if name in function.__globals__:
            yield name, function.__globals__[name]


def require_shared_subset(function: FunctionType) -> None:
    """Raise an error unless a function keeps to the subset of Python that numba, warp and Python share.

    Raises MaterialError with file, line and remedy of each construct outside the subset.
    """
    modules = [n for n, v in _globals_of(function) if isinstance(v, ModuleType) and v.__name__ not in USABLE_MODULES]
    tree = ast.parse(textwrap.dedent(_source(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    first = function.__code__.co_firstlineno - 1
    violations = [f"line {first + line}: {message}" for line, message in violations_in(tree)]
    violations += [f"line {first + 1}: {name} is a module; import the names that are used from it" for name in modules]
    if function.__closure__:
        violations.append(
            f"line {first + 1}: {function.__name__} uses names of the function around it; put it at the top of its module"
        )
    if violations:
        raise MaterialError(f"{function.__code__.co_filename}: {function.__name__} cannot be compiled: {'; '.join(violations)}")


def fingerprint(material: type, update: Callable[..., object] | None) -> str:
    """Checksum of the modules of a law; if a module has no file, of its functions."""
    functions = functions_of_law(update) if update else []
    names = sorted({material.__module__, *(f.__module__ for f in functions)})
    digest = hashlib.sha256(" ".join(names).encode())
    files = {_file_of(material), *map(_file_of, functions)}
    for file in sorted(file for file in files if Path(file).is_file()):
        digest.update(Path(file).read_bytes())
    for function in functions:
        digest.update(_source(function).encode())
    return digest.hexdigest()[:16]


def _file_of(part: type | FunctionType) -> str:
    try:
        return inspect.getsourcefile(part) or ""
    except (TypeError, OSError):  # module of a notebook or of standard input
        return ""


def _source(function: FunctionType) -> str:
    try:
        return inspect.getsource(function)
    except OSError:
        raise MaterialError(f"{_place(function)}: there is no source of {function.__name__}; write the law into a file") from None


def _place(function: FunctionType) -> str:
    return f"{function.__code__.co_filename}:{function.__code__.co_firstlineno}"


@dataclass(frozen=True)
class RegisteredLaw(Generic[Declaration]):
    """A registered law."""

    name: str  # name in site.yaml
    declaration: type[Declaration]  # the class that declares its parameters
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


def register(
    registry: Registry[AnyLaw], law: AnyLaw, base: type, error: type[InputError],
    require: Callable[[AnyLaw], None] = lambda law: None, *, ranges: bool = False,
) -> None:  # fmt: skip
    """Add a law to its registry and write its parameters into the docstring of its class; ``require`` checks what its kind needs.

    Raises the given error if the declaration is incomplete, or the function of a law of another package leaves the shared subset.
    """
    require_declared(law, registry.kind, base, error, ranges=ranges)
    require(law)
    if law.function and not law.is_of_runout:  # the tests of runout check its own
        try:
            for function in functions_of_law(law.function):
                require_shared_subset(function)
        except MaterialError as cause:
            raise error(str(cause)) from None
    law.declaration.__doc__ = numpydoc(law.declaration)
    registry.add(law.name, f"{law.declaration.__module__}.{law.declaration.__qualname__}", law)


def public_names(registry: Registry[AnyLaw]) -> dict[str, str]:
    """Module of each class that a law of runout defines, by its name."""
    return classes_in(law.declaration.__module__ for law in registry.of_runout())


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
    subject = f"{kind} {law.name or law.declaration.__qualname__}"
    undecorated = any(isinstance(value, Field) for value in vars(law.declaration).values())
    if undecorated or not (issubclass(law.declaration, base) and law.name.isidentifier()):
        raise error(f"{subject}: write a frozen dataclass that derives from runout.{base.__name__}, with `law` as its name")
    declaration: Any = law.declaration
    declared = {p.name for p in law.parameters if p.valid is not None or not ranges}
    for field in fields(declaration):
        if field.name not in declared:
            raise error(f"{subject}: {field.name} is not declared; write {field.name}: float = parameter(...)")
    for p in law.parameters:
        if p.typical is MISSING:
            raise error(f"{subject}: {p.name} has neither default= nor typical=; tests and tables need one")
