"""What a registered law is: a class that declares parameters, and a function that all compilers can read.

The checksum of its sources is part of the keys of compiled code and results.

Their common language is a subset of Python that numba, warp and plain Python read alike. Formulas without branches also take
arrays of NumPy in place of numbers (:func:`for_arrays`).
"""

import ast
import hashlib
import inspect
import textwrap
from collections.abc import Callable, Iterable, Iterator
from dataclasses import MISSING, Field, dataclass, fields
from functools import cached_property
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, ClassVar, Generic, TypeGuard, TypeVar

import numpy as np

from runout.errors import InputError, MaterialError
from runout.model.parameters import Parameter, numpydoc, parameters_of
from runout.model.registry import Registry, classes_in

FORBIDDEN = (
    ast.AnnAssign,
    ast.Raise,
    ast.Try,
    ast.With,
    ast.Lambda,
    ast.List,
    ast.Dict,
    ast.Set,
    ast.ListComp,
    ast.GeneratorExp,
    ast.DictComp,
    ast.JoinedStr,
    ast.Starred,
    ast.Assert,
    ast.Global,
    ast.Nonlocal,
    ast.Yield,
)
CASTS = {"real", "i64"}
IMPORTS = ("math", "typing", "runout.physics")
WIDEST_INT = 2**31 - 1
OF_ARRAYS = {"math": np, "min": np.minimum, "max": np.maximum, "abs": np.abs}  # what these names of a formula are for arrays
PHYSICS = "runout.physics."
USABLE_MODULES = ("math",)
Declaration = TypeVar("Declaration")
AnyLaw = TypeVar("AnyLaw", bound="RegisteredLaw[Any]")


def for_arrays(formula: Any, **formulas: FunctionType) -> FunctionType:
    """The formula for arrays of NumPy in place of numbers; it must not branch.

    ``formula``: in the shared subset. ``**formulas``: the functions that it calls, for arrays, by their names.
    """
    return FunctionType(formula.__code__, {**formula.__globals__, **OF_ARRAYS, **formulas})


def violations(source: str) -> Iterator[tuple[int, str]]:
    """Line and message of each violation in a module of physics."""
    tree = ast.parse(source)
    yield from _imports(tree)
    for function in (n for n in tree.body if isinstance(n, ast.FunctionDef)):
        yield from violations_in(function)


def violations_in(function: ast.FunctionDef) -> Iterator[tuple[int, str]]:
    """Line and message of each violation in a function."""
    cast = {id(a) for call in ast.walk(function) if _calls(call, CASTS) for arg in call.args for a in _literal(arg)}
    indexed = {s.value.id for s in ast.walk(function) if isinstance(s, ast.Subscript) and isinstance(s.value, ast.Name)}
    floored = {id(c.args[0]) for c in ast.walk(function) if _calls(c, {"int"}) and c.args}
    body = function.body[1:] if ast.get_docstring(function) else function.body
    for node in (n for statement in body for n in ast.walk(statement)):
        message = _operator(node, indexed) or _call(node, floored) or _constant(node, cast)
        if message or isinstance(node, FORBIDDEN):
            yield getattr(node, "lineno", function.lineno), message or f"{type(node).__name__} is not in the shared subset"


def _imports(tree: ast.Module) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        for name in names:
            if not name.startswith(IMPORTS):
                yield getattr(node, "lineno", 0), f"physics imports only {', '.join(IMPORTS)}, not {name}"


def _calls(node: ast.AST, names: set[str]) -> TypeGuard[ast.Call]:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in names


def _literal(argument: ast.AST) -> list[ast.AST]:
    inner = argument.operand if isinstance(argument, ast.UnaryOp) else argument
    return [inner] if isinstance(inner, ast.Constant) else []


def _operator(node: ast.AST, indexed: set[str]) -> str:
    if not isinstance(node, ast.BinOp):
        return ""
    if isinstance(node.op, ast.Mod | ast.FloorDiv):
        return "% and // differ for negative integers: use masks and shifts"
    if isinstance(node.op, ast.Pow):
        return "** with an integer does not compile in warp: multiply"
    if any(isinstance(side, ast.Name) and side.id in indexed for side in (node.left, node.right)):
        return "a tensor is a tuple in numba and a vector in warp: index it, never operate on it"
    return ""


def _call(node: ast.AST, floored: set[int]) -> str:
    if not isinstance(node, ast.Call):
        return ""
    if node.keywords:
        return "keyword arguments do not resolve in warp"
    if _calls(node, {"round", "pow"}):
        return f"{ast.unparse(node.func)} differs between the compilers"
    if _calls(node, {"min", "max"}) and len(node.args) != 2:
        return "min and max take two arguments in warp"
    if _calls(node, {"int"}) and not (isinstance(node.args[0], ast.Call) and ast.unparse(node.args[0].func) == "math.floor"):
        return "int() truncates towards zero: write int(math.floor(x))"
    if isinstance(node.func, ast.Attribute) and node.func.attr in ("hypot", "expm1"):
        return f"math.{node.func.attr} is not in both compilers"
    return ""


def _constant(node: ast.AST, cast: set[int]) -> str:
    if not isinstance(node, ast.Constant) or id(node) in cast:
        return ""
    if isinstance(node.value, float):
        return f"float literal {node.value} needs real(...)"
    if isinstance(node.value, int) and abs(node.value) > WIDEST_INT:
        return f"integer {node.value} passes 31 bits: i64(...)"
    return ""


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


def fingerprint(material: type, formulas: Iterable[Callable[..., object]]) -> str:
    """Checksum of the modules of a law; if a module has no file, of its functions."""
    functions = list(dict.fromkeys(f for formula in formulas for f in functions_of_law(formula)))
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
    def functions(self) -> tuple[FunctionType, ...]:
        """All its formulas."""
        own: Any = self.function
        return (own,) if own else ()

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
        return fingerprint(self.declaration, self.functions)

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
    """The law of a registry that a material or a basal friction follows; ``register`` names the function that registers such laws.

    Raises the error of the registry if the class is not registered.
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
    if not law.is_of_runout:  # the tests of runout check its own
        try:
            for function in (f for formula in law.functions for f in functions_of_law(formula)):
                require_shared_subset(function)
        except MaterialError as cause:
            raise error(str(cause)) from None
    law.declaration.__doc__ = numpydoc(law.declaration)
    registry.add(law.name, f"{law.declaration.__module__}.{law.declaration.__qualname__}", law)


def public_names(registry: Registry[AnyLaw]) -> dict[str, str]:
    """Module of each class that a law of runout defines, by its name."""
    return classes_in(law.declaration.__module__ for law in registry.of_runout())


def require_declared(law: RegisteredLaw[Any], kind: str, base: type, error: type[InputError], *, ranges: bool = False) -> None:
    """Raise an error unless the class of a law derives from ``base`` and declares all that is derived from it.

    Messages call the law ``kind``. With ``ranges`` each parameter needs a range.
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
