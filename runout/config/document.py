"""A YAML file as plain values that remember their lines."""

from collections.abc import Hashable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runout.errors import Problem

Location = tuple[Hashable, ...]  # keys and list positions from the top of the file down

DEEPEST = 20  # nesting beyond this is a mistake, or an alias that holds itself


@dataclass
class Document:
    """Content of a YAML file.

    Attributes
    ----------
    name : str
        Name of the file, for messages.
    values : Any
        Plain dicts, lists, numbers and text.
    lines : dict
        Line (from 1) of every key and list item, by its location.
    problems : list of Problem
        What is wrong with the file as YAML: syntax, duplicate keys.
    """

    name: str
    values: Any = None
    lines: dict[Location, int] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def line(self, location: Location) -> int:
        """Line of a location, or of the nearest one above it that the file has."""
        while location and location not in self.lines:
            location = location[:-1]
        return self.lines.get(location, 1)

    def value(self, location: Location) -> Any:
        """The value at a location; None where the file has none."""
        found = self.values
        for part in location:
            try:
                found = found[part]
            except (KeyError, IndexError, TypeError):
                return None
        return found

    def problem(self, location: Location, message: str, fix: str = "") -> Problem:
        """A problem at a location."""
        return Problem(self.name, self.line(location), dotted(location), message, fix)


def dotted(location: Location) -> str:
    """A location as text: ``release[0].thickness``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def read_document(path: Path) -> Document:
    """Content of a YAML file with its lines; what is not YAML is listed in ``problems``."""
    document = Document(path.name)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        line = path.read_bytes()[: error.start].count(b"\n") + 1
        document.problems.append(Problem(path.name, line, "", "this is not UTF-8 text", "save the file with the encoding UTF-8"))
        return document
    _Reader(document).read(text)
    return document


class _Reader:
    """Turns the nodes of a YAML text into plain values, noting lines and repeated keys."""

    def __init__(self, document: Document) -> None:
        from ruamel.yaml import YAML

        self.document = document
        self.yaml = YAML(typ="safe", pure=True)

    def read(self, text: str) -> None:
        from ruamel.yaml.error import MarkedYAMLError
        from ruamel.yaml.reader import ReaderError

        try:
            node = self.yaml.compose(text)
            self.document.values = None if node is None else self._value(node, ())
        except MarkedYAMLError as error:
            self.document.problems.append(_syntax_problem(self.document.name, error))
        except ReaderError as error:
            line = text[: error.position].count("\n") + 1
            fix = "remove it; it may have come with a copied text"
            self.document.problems.append(Problem(self.document.name, line, "", "a control character stands here", fix))

    def _value(self, node: Any, location: Location) -> Any:
        if len(location) > DEEPEST:
            self.document.problems.append(self.document.problem(location[:3], "nested too deeply, or an alias that holds itself"))
            return None
        if node.id == "mapping":
            return self._mapping(node, location)
        if node.id == "sequence":
            return [self._item(child, (*location, i)) for i, child in enumerate(node.value)]
        return self._scalar(node, location)

    def _item(self, node: Any, location: Location) -> Any:
        self.document.lines[location] = node.start_mark.line + 1
        return self._value(node, location)

    def _mapping(self, node: Any, location: Location) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key_node, child in node.value:
            line = key_node.start_mark.line + 1
            if key_node.id != "scalar":
                problem = Problem(self.document.name, line, dotted(location), "a key must be a word", "write `key: value`")
                self.document.problems.append(problem)
                continue
            key = str(key_node.value)
            place = (*location, key)
            if key in values:
                self._repeated(place, line)
                continue
            self.document.lines[place] = line
            values[key] = self._value(child, place)
        return values

    def _repeated(self, place: Location, line: int) -> None:
        first = self.document.lines[place]
        message = f"this key was already given on line {first}"
        self.document.problems.append(Problem(self.document.name, line, dotted(place), message, "keep one of the two"))

    def _scalar(self, node: Any, location: Location) -> Any:
        try:
            return self.yaml.constructor.construct_object(node)
        except ValueError:  # a date such as 2021-13-45
            return str(node.value)


def _syntax_problem(name: str, error: Any) -> Problem:
    mark = error.problem_mark or error.context_mark
    what = " ".join(str(part) for part in (error.context, error.problem) if part)
    fix = "check the indentation (spaces, the same in one block), the colons and the quotes here and on the line before"
    if "\\t" in what:
        fix = "indent with spaces, not with tabs"
    return Problem(name, mark.line + 1 if mark else None, "", f"not valid YAML, {what}", fix)
