"""Reads a YAML file into plain values and records the line of each."""

import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runout.errors import Problem

Location = tuple[Hashable, ...]  # keys and list positions from the top of the file down

LARGEST_FILE = 256 * 1024  # [bytes]
DEEPEST = 20  # levels of nesting
MOST_NODES = 50_000  # values of a file; an alias counts with all values that it stands for
LARGEST_WHOLE = 2**63 - 1  # no quantity of a site is a larger whole number
SHOWN = 400  # characters; longer messages are shortened


@dataclass
class Document:
    """Content of a YAML file."""

    name: str  # name of the file, for messages
    values: Any = None  # plain dicts, lists, numbers and text
    lines: dict[Location, int] = field(default_factory=dict)  # line (from 1) of every key and list item, by its location
    problems: list[Problem] = field(default_factory=list)  # what is wrong with the file as YAML: syntax, duplicate keys
    options: set[Location] = field(default_factory=set)  # locations that the command line set (:mod:`runout.config.set_values`)

    def line(self, location: Location) -> int:
        """Line of a location; if the file does not contain it, the line of the innermost block that it contains."""
        while location and location not in self.lines:
            location = location[:-1]
        return self.lines.get(location, 1)

    def value(self, location: Location) -> Any:
        """The value at a location; None if the file has no such location."""
        value = self.values
        for part in location:
            try:
                value = value[part]
            except (KeyError, IndexError, TypeError):
                return None
        return value

    def problem(self, location: Location, message: str, fix: str = "") -> Problem:
        """A problem at a location; of one that the command line set it names the option in the place of file and line."""
        is_set = any(location[:n] in self.options for n in range(1, len(location) + 1))
        file, line = ("--set", None) if is_set else (self.name, self.line(location))
        return Problem(file, line, shortened(dotted(location)), shortened(message), shortened(fix))


def dotted(location: Location) -> str:
    """A location as text: ``release[0].thickness``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def shortened(text: str) -> str:
    """Printable text of limited length: the middle of a long text is left out."""
    text = "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)
    return text if len(text) <= SHOWN else f"{text[: SHOWN // 2]} ... {text[-SHOWN // 4 :]}"


def read_document(path: Path) -> Document:
    """Content of a YAML file with line numbers; ``problems`` lists the errors of YAML syntax."""
    document = Document(path.name)
    size = path.stat().st_size
    if size > LARGEST_FILE:
        fix = "a site.yaml is short; is this another file?"
        document.problems.append(Problem(path.name, None, "", f"{size} bytes, more than {LARGEST_FILE}", fix))
        return document
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        line = path.read_bytes()[: error.start].count(b"\n") + 1
        document.problems.append(Problem(path.name, line, "", "this is not UTF-8 text", "save the file with the encoding UTF-8"))
        return document
    _Reader(document).read(text)
    return document


def read_text(text: str, name: str) -> Document:
    """Content of a YAML text; ``name`` stands for the file in messages."""
    document = Document(name)
    _Reader(document).read(text)
    return document


class _Reader:
    """Converts the nodes of a YAML text into plain values; records line numbers and repeated keys."""

    def __init__(self, document: Document) -> None:
        from ruamel.yaml import YAML

        self.document = document
        self.yaml = YAML(typ="safe", pure=True)

    def read(self, text: str) -> None:
        from ruamel.yaml.error import MarkedYAMLError
        from ruamel.yaml.reader import ReaderError

        try:
            if not self._surveyed(text):
                return
            node = self.yaml.compose(text)
            self.document.values = None if node is None else self._value(node, ())
        except MarkedYAMLError as error:
            self.document.problems.append(_syntax_problem(self.document.name, error))
        except ReaderError as error:
            line = text[: error.position].count("\n") + 1
            fix = "remove it; it may have come with a copied text"
            self.document.problems.append(Problem(self.document.name, line, "", "a control character stands here", fix))

    def _surveyed(self, text: str) -> bool:
        """Whether nesting depth and size, with all aliases expanded, are within the limits of a site.yaml."""
        from ruamel.yaml import YAML

        survey = _Survey()
        if all(survey.accepts(event) for event in YAML(typ="safe", pure=True).parse(text)):
            return True
        assert survey.refused is not None
        line, message, fix = survey.refused
        self.document.problems.append(Problem(self.document.name, line, "", message, fix))
        return False

    def _value(self, node: Any, location: Location) -> Any:
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
            if key == "<<" or key.startswith("<"):
                self._refused((*location, key), line, "keys that begin with < and merges are not read", "write the keys out")
                continue
            place = (*location, key)
            if key in values:
                self._repeated(place, line)
                continue
            self.document.lines[place] = line
            values[key] = self._value(child, place)
        return values

    def _repeated(self, place: Location, line: int) -> None:
        first = self.document.lines[place]
        self._refused(place, line, f"this key was already given on line {first}", "keep one of the two")

    def _refused(self, place: Location, line: int, message: str, fix: str) -> None:
        self.document.problems.append(Problem(self.document.name, line, shortened(dotted(place)), message, fix))

    def _scalar(self, node: Any, location: Location) -> Any:
        line = node.start_mark.line + 1
        try:
            value = self.yaml.constructor.construct_object(node)
        except (ValueError, OverflowError):  # a date such as 2021-13-45, a number of thousands of digits
            value = str(node.value)
        digits = len(str(node.value))
        if (isinstance(value, int) and abs(value) > LARGEST_WHOLE) or (str(node.tag).endswith(":int") and isinstance(value, str)):
            fix = "write it as a float such as 1.0e+6, in the unit asked for"
            self._refused(location, line, f"a whole number of {digits} digits", fix)
            return math.inf  # still a number; the range checks refuse it
        if isinstance(value, str) and not _is_text(value):
            self._refused(location, line, "holds a character that is no text", "remove it; it may have come with a copied text")
            return "?"
        return value


@dataclass
class _Open:
    """A block or list whose end has not been read."""

    anchor: str | None
    size: int = 1


@dataclass
class _Survey:
    """Checks the events of a YAML text one by one, without recursion and without constructing values."""

    refused: tuple[int, str, str] | None = None  # line (from 1), message and remedy of the first violation
    open: list[_Open] = field(default_factory=list)
    sizes: dict[str, int] = field(default_factory=dict)
    total: int = 0

    def accepts(self, event: Any) -> bool:
        """Whether an event is within the limits; if not, ``refused`` holds the reason."""
        kind = type(event).__name__
        if kind == "AliasEvent":
            self._alias(event)
        elif kind in ("ScalarEvent", "SequenceStartEvent", "MappingStartEvent"):
            self._node(event, kind == "ScalarEvent")
        elif kind in ("SequenceEndEvent", "MappingEndEvent"):
            self._add(self.open.pop())
        if self.total + sum(part.size for part in self.open) > MOST_NODES:
            self._refuse(event, f"more than {MOST_NODES} values, those behind aliases (*name) written out", "shorten the file")
        return self.refused is None

    def _node(self, event: Any, is_scalar: bool) -> None:
        if event.tag is not None:
            tag = str(event.tag).replace("tag:yaml.org,2002:", "!!")
            self._refuse(event, f"the tag {tag} is not read", "remove it; text is written in quotes, a number without")
        self.open.append(_Open(event.anchor))
        if is_scalar:
            self._add(self.open.pop())
        elif len(self.open) > DEEPEST:
            self._refuse(event, f"nested more than {DEEPEST} levels deep", "close the brackets, or indent less")

    def _alias(self, event: Any) -> None:
        if any(part.anchor == event.anchor for part in self.open):
            self._refuse(event, f"nested too deeply, or an alias that holds itself (*{event.anchor})", "write the values out")
        elif self.open:
            self.open[-1].size += self.sizes.get(event.anchor, 0)

    def _add(self, ended: _Open) -> None:
        if ended.anchor:
            self.sizes[ended.anchor] = ended.size
        if self.open:
            self.open[-1].size += ended.size
        else:
            self.total += ended.size

    def _refuse(self, event: Any, message: str, fix: str) -> None:
        self.refused = self.refused or (event.start_mark.line + 1, message, fix)


def _is_text(value: str) -> bool:
    """Whether a text holds no control characters, apart from tabs and new lines, and no unpaired surrogates."""
    return all(c in "\t\n" or not (ord(c) < 32 or 0x7F <= ord(c) < 0xA0 or 0xD800 <= ord(c) < 0xE000) for c in value)


def _syntax_problem(name: str, error: Any) -> Problem:
    mark = error.problem_mark or error.context_mark
    what = " ".join(str(part) for part in (error.context, error.problem) if part)
    fix = "check the indentation (spaces, the same in one block), the colons and the quotes here and on the line before"
    if "\\t" in what:
        fix = "indent with spaces, not with tabs"
    return Problem(name, mark.line + 1 if mark else None, "", f"not valid YAML, {what}", fix)
