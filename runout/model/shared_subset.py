"""The subset of Python that numba, warp and plain Python read alike: formulas of physics and of laws keep to it.

Formulas without branches also take arrays of NumPy in place of numbers (:func:`for_arrays`).
"""

import ast
from collections.abc import Iterator
from types import FunctionType
from typing import Any, TypeGuard

import numpy as np

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
