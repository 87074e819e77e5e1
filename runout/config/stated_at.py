"""Messages of the readers of input files: all problems of several files at once, each with its place in site.yaml."""

import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from runout.config.document import dotted, read_document
from runout.errors import ConfigError, InputError, StructureError

T = TypeVar("T")
NO_UNIT = r"(?!\w{1,3}(?![\w/-]|\.\w))"  # `m2/s` and `kg/m3` are no files of sites that are called m2 and kg


@dataclass(frozen=True)
class Reading(Generic[T]):
    """What could be read of several files, and the problems of the others."""

    content: T
    problems: tuple[InputError, ...] = ()

    def require(self) -> T:
        """The content; the first problem is raised if there is any."""
        for problem in self.problems:
            raise problem
        return self.content


def read_each(readers: Iterable[Callable[[], T]]) -> Reading[list[T]]:
    """What each of some readers returns, and the problems of those that fail."""
    content, problems = [], []
    for read in readers:
        try:
            content.append(read())
        except InputError as error:
            problems.append(error)
    return Reading(content, tuple(problems))


@contextmanager
def stated_at(file: Path, *place: str | int | Callable[[], int]) -> Iterator[None]:
    """Context that puts line and key of site.yaml before the message of an input that cannot be used.

    ``file``: the site.yaml. ``*place``: keys and list positions of the setting that names the input; functions that find a
    position are called for a message only.
    """
    try:
        yield
    except (ConfigError, StructureError):  # their problems state their places
        raise
    except InputError as error:
        if str(error).startswith(f"{file.name}:"):  # it is placed already, more closely
            raise
        location = tuple(part() if callable(part) else part for part in place)
        error.args = (f"{stated_place(file, *location)}: {within_site(str(error), file.parent)}",)
        raise


def entry_number(file: Path, block: str, name: str) -> int:
    """Position of the entry of a name in a list of site.yaml, of which settings may hold a part; 0 if it is not there."""
    listed = read_document(file).value((block,)) if file.is_file() else None
    names = [entry.get("name", block) if isinstance(entry, dict) else None for entry in listed or []]
    return names.index(name) if name in names else 0


def within_site(text: str, folder: Path) -> str:
    """A message whose paths in the folder of a site are relative to it, as site.yaml states them."""
    text = without_folder(text, os.path.abspath(folder))
    return without_folder(text, str(folder), NO_UNIT) if folder.name not in ("", "..") else text


def without_folder(text: str, folder: str, prefix: str = "") -> str:
    """A message whose paths that begin with a folder lack it; ``prefix`` matches what goes with it. Parts of longer paths stay."""
    return re.sub(rf"(?<![\w./~-]){re.escape(folder)}/{prefix}", "", text)


def stated_place(file: Path, *place: str | int) -> str:
    """``site.yaml:4: terrain.dem``; without the line if the file is gone."""
    line = f":{read_document(file).line(place)}" if file.is_file() else ""
    return f"{file.name}{line}: {dotted(place)}"
