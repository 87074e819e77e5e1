"""Checksums of the sources of runout, which keys of members and stages hold: other code may give other results.

The version alone does not tell two states of a checkout apart. The contents count, not times and paths, so that the machines of a
cluster agree. Reading 600 files takes 50 ms; the checksums are noted in the cache folder with the stamps of all files and are read
from there in 3 ms, as long as no file has changed.
"""

import hashlib
import os
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

from runout.errors import StorageError
from runout.io.atomic import read_json, write_json
from runout.processes.caches import compiled_code

PACKAGE = Path(__file__).parents[1]
# what draws, prints, aggregates or starts: no value in the file of a member depends on it
NOT_OF_MEMBERS = (
    *("commands", "hazard", "report", "scores", "slopes", "studies", "view", "workflow"),
    *("processes", "__main__.py", "cli.py", "log.py", "safe_start.py"),
)


class Checksums(NamedTuple):
    """Checksums of the sources that members depend on, and of all, on which products depend."""

    members: str
    products: str


@cache
def checksums() -> Checksums:
    """Checksums of the sources of this package, computed once in a process."""
    files = _files(PACKAGE)
    stamps = _of_stamps(files)
    note = compiled_code().folder / "notes" / f"sources-{hashlib.sha256(os.fsencode(PACKAGE)).hexdigest()[:16]}.json"
    noted = read_json(note)
    if noted.get("stamps") == stamps and all(isinstance(noted.get(name), str) for name in Checksums._fields):
        return Checksums(noted["members"], noted["products"])
    made = checksums_of(PACKAGE, files)
    with suppress(StorageError, OSError):  # nothing is kept where the cache cannot be written
        if _of_stamps(_files(PACKAGE)) == stamps:  # else a file has changed meanwhile
            write_json({"stamps": stamps, **made._asdict()}, note)
    return made


def checksums_of(package: Path, files: Iterable[os.DirEntry[str]] | None = None) -> Checksums:
    """Checksums of the sources in the folder of a package."""
    members, products = hashlib.sha256(), hashlib.sha256()
    for file in _files(package) if files is None else files:
        name, content = Path(file.path).relative_to(package).as_posix(), Path(file.path).read_bytes()
        line = f"{name} {hashlib.sha256(content).hexdigest()}\n".encode()
        products.update(line)
        if name.split("/")[0] not in NOT_OF_MEMBERS:
            members.update(line)
    return Checksums(members.hexdigest(), products.hexdigest())


def _files(folder: Path) -> list[os.DirEntry[str]]:
    """Python files of a package, sorted by path."""
    found, waiting = list[os.DirEntry[str]](), [os.fspath(folder)]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in entries:
                if entry.is_dir() and entry.name != "__pycache__":
                    waiting.append(entry.path)
                elif entry.name.endswith(".py"):
                    found.append(entry)
    return sorted(found, key=lambda entry: entry.path)


def _of_stamps(files: Iterable[os.DirEntry[str]]) -> str:
    """Checksum of path, size, inode and times of files; no program can set the time of status, so every change changes it."""
    digest = hashlib.sha256()
    for file in files:
        status = file.stat()
        stamp = (file.path, status.st_size, status.st_ino, status.st_mtime_ns, status.st_ctime_ns)
        digest.update(repr(stamp).encode())
    return digest.hexdigest()
