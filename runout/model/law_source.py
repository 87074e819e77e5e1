"""Source of a law: its functions, the check that all compilers can read them, and its checksum."""

import ast
import hashlib
import inspect
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FunctionType, ModuleType

from runout.errors import MaterialError
from runout.model.shared_subset import violations_in

PHYSICS = "runout.physics."
USABLE_MODULES = ("math",)


def functions_of_law(update: Callable[..., object]) -> list[FunctionType]:
    """``update`` and the functions that it calls, without those of :mod:`runout.physics`; callees come before their callers."""
    found: list[FunctionType] = []
    _collect(update, found, [])  # type: ignore[arg-type]
    return found


def _collect(function: FunctionType, found: list[FunctionType], above: list[FunctionType]) -> None:
    if function in above:
        raise MaterialError(f"{_place(function)}: {function.__name__} calls itself; a kernel cannot")
    for _, value in _globals_of(function):
        if isinstance(value, FunctionType) and not value.__module__.startswith(PHYSICS) and value not in found:
            _collect(value, found, [*above, function])
    found.append(function)


def _globals_of(function: FunctionType) -> Iterator[tuple[str, object]]:
    """Name and value of each global that a function uses."""
    for name in function.__code__.co_names:
        if name in function.__globals__:
            yield name, function.__globals__[name]


def require_shared_subset(function: FunctionType) -> None:
    """Raise an error unless a function keeps to the subset of Python that numba, warp and Python share.

    Raises
    ------
    MaterialError
        Lists file, line and remedy of each construct outside the subset.
    """
    modules = [n for n, v in _globals_of(function) if isinstance(v, ModuleType) and v.__name__ not in USABLE_MODULES]
    tree = ast.parse(textwrap.dedent(_source(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    first = function.__code__.co_firstlineno - 1
    found = [f"line {first + line}: {message}" for line, message in violations_in(tree)]
    found += [f"line {first + 1}: {name} is a module; import the names that are used from it" for name in modules]
    if function.__closure__:
        found.append(f"line {first + 1}: {function.__name__} uses names of the function around it; put it at the top of its module")
    if found:
        raise MaterialError(f"{function.__code__.co_filename}: {function.__name__} cannot be compiled: {'; '.join(found)}")


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
