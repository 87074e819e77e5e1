"""Limits of a YAML text, checked before it is loaded: nesting depth, size with expanded aliases, refused tags."""

from dataclasses import dataclass, field
from typing import Any

DEEPEST = 20  # levels of nesting
MOST_NODES = 50_000  # values of a file; an alias counts with all values that it stands for


@dataclass
class _Open:
    """A block or list whose end has not been read."""

    anchor: str | None
    size: int = 1


@dataclass
class Survey:
    """Checks the events of a YAML text one by one, without recursion and without constructing values.

    Attributes
    ----------
    refused : tuple or None
        Line (from 1), message and remedy of the first violation.
    """

    refused: tuple[int, str, str] | None = None
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
