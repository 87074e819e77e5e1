"""Reads a YAML file into plain values and records the line of each.

Values that the command line sets in place of those of site.yaml, ``--set KEY=VALUE``, are written into the document before it is
checked, so that a key, a value or a contradiction is refused as in site.yaml. A problem of such a key names the option in the
place of file and line.
"""

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runout.config.wording import choice_fix
from runout.errors import Problem

Location = tuple[Hashable, ...]  # keys and list positions from the top of the file down

LARGEST_FILE = 256 * 1024  # [bytes]
DEEPEST = 20  # levels of nesting
MOST_NODES = 50_000  # values of a file; an alias counts with all values that it stands for
LARGEST_WHOLE = 2**63 - 1  # no quantity of a site is a larger whole number
SHOWN = 400  # characters; longer messages are shortened
OPTION = "--set"
FORM = "write KEY=VALUE, such as simulation.cell_size=20, release.scar.thickness=4 or release[0].thickness=4"
SAMPLED = ("ensemble", "parameters")
PREFIXES: dict[Location, str] = {
    (): "",
    ("material",): "",
    ("basal_friction",): "basal_",
}  # of sampled parameters, by the block that states them


@dataclass
class Document:
    """Content of a YAML file."""

    name: str  # name of the file, for messages
    values: Any = None  # plain dicts, lists, numbers and text
    lines: dict[Location, int] = field(default_factory=dict)  # line (from 1) of every key and list item, by its location
    problems: list[Problem] = field(default_factory=list)  # what is wrong with the file as YAML: syntax, duplicate keys
    options: set[Location] = field(default_factory=set)  # locations that the command line set (:mod:`runout.config.document`)

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


class _Refused(Exception):
    """Message and remedy of a key that cannot be set."""


def set_values(document: Document, settings: Iterable[str]) -> None:
    """Write each ``KEY=VALUE`` into a document; what cannot be written is added to its problems.

    A key is dotted; an entry of a list is named by its ``name`` or by its number from 0. A value is YAML. An empty one removes the
    key. A parameter that the ensemble samples is refused, since the sampled values take its place in every member.
    """
    settings = list(settings)
    if not settings:
        return
    if document.values is None:
        document.values = {}
    for setting in settings if isinstance(document.values, dict) else ():
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            document.problems.append(Problem(OPTION, None, "", f"{setting!r} is no setting", FORM))
            continue
        try:
            _set(document, key.strip(), text)
        except _Refused as refusal:
            document.problems.append(Problem(OPTION, None, key.strip(), *refusal.args))
    for place in document.options:
        if (name := _sampled_name(document, place)) is not None:
            fix = f"add --set {dotted((*SAMPLED, name))}= to give all members this value"
            document.problems.append(document.problem(place, "the ensemble samples it, so that this value changes no member", fix))


def _set(document: Document, key: str, text: str) -> None:
    content = read_text(text, OPTION)
    if content.problems:
        raise _Refused(content.problems[0].message, content.problems[0].fix)
    location: Location = ()
    new: Location = ()
    block = document.values
    *parents, last = _parts(document, key)
    for part in parents:
        part = _entry(block, location, part)
        inner = block.get(part) if isinstance(block, dict) else block[part]
        location = (*location, part)
        if inner is None and isinstance(block, dict):
            inner = block[part] = {}
            new = new or location
        block = inner
    last = _entry(block, location, last)
    place = (*location, last)
    if place in document.options:
        raise _Refused("is set twice", "keep one of the two")
    if content.values is None:
        if not isinstance(block, dict) or last not in block:
            raise _Refused("site.yaml does not state this key, so that it cannot be removed", "write a value after the =")
        del block[last]
    else:
        block[last] = content.values
    document.options.add(place)
    if new:
        document.options.add(new)


def _parts(document: Document, key: str) -> list[str]:
    """Parts of a dotted key. RELEASE.PARAMETER is one key of the sampled parameters."""
    parts = key.replace("[", ".").replace("]", "").split(".")
    lists = {key: document.value((key,)) for key in ("release", "inflow")}
    names = [e.get("name", k) for k, entries in lists.items() if isinstance(entries, list) for e in entries if isinstance(e, dict)]
    if tuple(parts[:2]) == SAMPLED and len(parts) > 3 and parts[2] in names:
        parts[2:4] = [".".join(parts[2:4])]
    return parts


def _entry(block: Any, location: Location, part: str) -> Any:
    """Key of a block, or position in a list of the entry with a name or number."""
    if isinstance(block, dict):
        return part
    if not isinstance(block, list):
        raise _Refused(f"{dotted(location)} is {block!r}, which holds no keys", f"set {dotted(location)} as a whole")
    usual = str(location[-1]) if location else ""
    names = [str(entry.get("name", usual)) if isinstance(entry, dict) else "" for entry in block]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(block):
        return int(part)
    known = [name for name in names if name] + list(map(str, range(len(block))))
    raise _Refused(f"{dotted(location)} has no entry {part!r}", choice_fix(part, known))


def _sampled_name(document: Document, place: Location) -> str | None:
    """Key of the sampled parameter that takes the place of a setting; None if there is none."""
    sampled = document.value(SAMPLED)
    if place[:-1] not in PREFIXES or not isinstance(sampled, dict):
        return None
    name = f"{PREFIXES[place[:-1]]}{place[-1]}"
    return name if name in sampled and document.value(place) is not None else None
