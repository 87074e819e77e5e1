"""Small faults that a test should find: one changed operator, constant, condition, result, call or argument."""

import ast
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

BOUNDARY = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
NEGATED = {ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "=="}
NEGATED |= {ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in"}
ARITHMETIC = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Mod: "*", ast.Pow: "*"}
ARITHMETIC |= {ast.BitAnd: "|", ast.BitOr: "&", ast.LShift: ">>", ast.RShift: "<<"}
SWAPPED = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "floor": "ceil", "ceil": "floor"}
SWAPPED |= {"any": "all", "all": "any", "argmin": "argmax", "argmax": "argmin", "sin": "cos", "cos": "sin"}
UNCHANGED = ("strict", "examples")  # keyword arguments that say nothing to users, or are comments of a new site.yaml
NO_STATEMENT = (ast.Raise, ast.JoinedStr, ast.Assert)  # texts of errors and what only a type checker needs


@dataclass(frozen=True)
class Mutant:
    """One change of a source file: bytes ``start`` to ``stop`` become ``text``."""

    path: str
    line: int
    operator: str
    start: int
    stop: int
    text: str

    def apply(self, source: bytes) -> bytes:
        """The changed source."""
        return source[: self.start] + self.text.encode() + source[self.stop :]


def sample(root: Path, files: list[str], count: int, seed: int) -> list[Mutant]:
    """``count`` mutants of the files, each equally likely; equal seeds give equal mutants."""
    found = [mutant for path in sorted(files) for mutant in mutants(path, (root / path).read_bytes())]
    return random.Random(seed).sample(found, min(count, len(found)))


def mutants(path: str, source: bytes) -> list[Mutant]:
    """All mutants of a source, by their place."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node, operator, text in _changes(ast.parse(source)):
        start = starts[node.lineno - 1] + node.col_offset
        stop = starts[node.end_lineno - 1] + node.end_col_offset
        found.append(Mutant(path, node.lineno, operator, start, stop, text))
    return sorted(found, key=lambda m: (m.start, m.stop, m.operator, m.text))


def _changes(node: ast.AST) -> Iterator[tuple[ast.AST, str, str]]:
    """Changes (node, operator, new text) within a node, without those of texts, annotations, decorators and :data:`UNCHANGED`."""
    if isinstance(node, ast.Raise):
        yield node, "removed raise", "pass"
    if isinstance(node, NO_STATEMENT) or _is_for_type_checkers(node) or (isinstance(node, ast.keyword) and node.arg in UNCHANGED):
        return
    yield from ((node, operator, text) for operator, text in _of_expression(node))
    yield from _of_statement(node)
    for name, field in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in field if isinstance(field, list) else [field]:
            if isinstance(child, ast.AST):
                yield from _changes(child)


def _is_for_type_checkers(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _of_expression(node: ast.AST) -> Iterator[tuple[str, str]]:
    """Changes (operator, new text) of an expression; in brackets, since the new operator may bind less."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for name, table in (("boundary", BOUNDARY), ("comparison", NEGATED)):
            if type(node.ops[0]) in table:
                yield name, f"({_bracketed(node.left)} {table[type(node.ops[0])]} {_bracketed(node.comparators[0])})"
    elif isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
        yield "arithmetic", f"({_bracketed(node.left)} {ARITHMETIC[type(node.op)]} {_bracketed(node.right)})"
    elif isinstance(node, ast.BoolOp):
        other = " or " if isinstance(node.op, ast.And) else " and "
        yield "boolean", f"({other.join(map(_bracketed, node.values))})"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield "boolean" if isinstance(node.op, ast.Not) else "sign", _bracketed(node.operand)
    elif isinstance(node, ast.Constant):
        yield from _of_constant(node.value)
    elif isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in SWAPPED:
            function = ast.unparse(node.func)
            yield "call", f"{function[: -len(name)]}{SWAPPED[name]}{ast.unparse(node)[len(function) :]}"
        for keyword in node.keywords:
            if keyword.arg is not None and keyword.arg not in UNCHANGED:
                others = [other for other in node.keywords if other is not keyword]
                yield "removed argument", ast.unparse(ast.Call(node.func, node.args, others))


def _of_constant(value: object) -> Iterator[tuple[str, str]]:
    if isinstance(value, bool):
        yield "constant", str(not value)
    elif isinstance(value, int):
        yield from (("constant", f"({value + step})") for step in (-1, 1))
    elif isinstance(value, float):
        yield "constant", repr(2.0 * value if value else 1.0)


def _of_statement(node: ast.AST) -> Iterator[tuple[ast.AST, str, str]]:
    if isinstance(node, ast.Return) and node.value is not None and not _is_none(node.value):
        yield node, "return value", "return None"
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield node, "removed call", "pass"
    elif isinstance(node, ast.AugAssign) and type(node.op) in ARITHMETIC:
        yield node, "arithmetic", f"{ast.unparse(node.target)} {ARITHMETIC[type(node.op)]}= {ast.unparse(node.value)}"
    elif isinstance(node, ast.If | ast.IfExp | ast.While) and isinstance(node.test, ast.Name | ast.Attribute | ast.Call):
        yield node.test, "boolean", f"(not {ast.unparse(node.test)})"


def _is_none(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _bracketed(node: ast.AST) -> str:
    text = ast.unparse(node)
    return text if isinstance(node, ast.Name | ast.Attribute | ast.Call | ast.Subscript | ast.Constant) else f"({text})"
