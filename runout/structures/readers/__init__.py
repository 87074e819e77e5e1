"""Formats of structures: each file of this folder reads one, and no other file lists them.

A file has ``READER``, a :class:`StructureReader`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import PurePath
from typing import TYPE_CHECKING

from runout.model.registry import parts_of

if TYPE_CHECKING:
    from runout.model.terrain import Terrain
    from runout.structures.source import Read, StructureSource


@dataclass(frozen=True)
class StructureReader:
    """How files of one format become structures."""

    kind: str  # what messages call the content of a file: "a mesh"
    suffixes: tuple[str, ...]  # endings of the names of the files, in lower case; empty for what reads all others
    # keys of `structures` in site.yaml that have a meaning with these files, beside `file`, `name`, `clearance`,
    # `friction_angle_deg` and `protects`, which all have
    keys: tuple[str, ...]
    # bodies of a file on a terrain, problems and changes; raises nothing for what is wrong in the file
    read: "Callable[[StructureSource, Terrain], Read]"
    # raises InputError if a file cannot be read, wherever its structures stand
    require_readable: "Callable[[StructureSource], object]"
    has_units: bool = False  # whether `units` must be stated
    has_attributes: bool = False  # whether `clearance` may name an attribute
    is_refused: bool = False  # whether the format is known and not read; a reader of the same ending takes its place

    def foreign_keys(self) -> Iterator[str]:
        """Keys of other formats that have no meaning with these files."""
        keys = () if self.is_refused else (key for other in readers() for key in other.keys if key not in self.keys)
        yield from dict.fromkeys(keys)


@cache
def readers() -> tuple[StructureReader, ...]:
    """Readers of all formats, those that refuse last."""
    return tuple(sorted((part.READER for part in parts_of(__name__)), key=lambda reader: reader.is_refused))


def reader_of(path: PurePath | str) -> StructureReader:
    """The reader of a file, by the ending of its name."""
    suffix = PurePath(path).suffix.lower()
    named = [reader for reader in readers() if suffix in reader.suffixes]
    return named[0] if named else next(reader for reader in readers() if not reader.suffixes)
