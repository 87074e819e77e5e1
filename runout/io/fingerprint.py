"""What files held when they were written, and whether they still do.

The checksum decides. It is computed anew unless the file's size, inode, time of content and time of status are the same, and the
times were older than a step of the file system's clock when the checksum was taken: every later change of the content changes one
of them, and no program can set the time of status. A second run over gigabytes of results that nobody touched reads none of them.
"""

import os
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from runout.errors import InputError
from runout.io.provenance import sha256

SECOND = 1_000_000_000  # [ns]
STEP, COARSE_STEP = SECOND // 25, 2 * SECOND  # [ns] of the clocks of file systems that count parts of a second, and of others


@dataclass(frozen=True)
class Fingerprint:
    """What a file held.

    Attributes
    ----------
    sha256 : str
        Checksum of the content.
    size : int
        Of the file [byte].
    inode, modified, changed : int
        Its number, and the times [ns] of its content and of its status.
    noted : int
        When all this was found [ns].
    """

    sha256: str
    size: int
    inode: int
    modified: int
    changed: int
    noted: int

    @classmethod
    def of(cls, path: Path) -> "Fingerprint":
        """That of a file as it is; OSError if it cannot be read."""
        noted, status = time.time_ns(), os.stat(path)  # a change from here on has a later time
        return cls(sha256(path), status.st_size, status.st_ino, status.st_mtime_ns, status.st_ctime_ns, noted)

    @classmethod
    def read(cls, stored: Any) -> "Fingerprint | None":
        """That of a record; None if it is none."""
        types = {field.name: str if field.name == "sha256" else int for field in fields(cls)}
        if not isinstance(stored, Mapping) or set(stored) != set(types):
            return None
        return cls(**stored) if all(type(stored[name]) is kind for name, kind in types.items()) else None

    def stored(self) -> dict[str, Any]:
        """For a record in JSON."""
        return asdict(self)

    def fault(self, path: Path) -> str | None:
        """What is wrong with the file; None if it holds what it held."""
        try:
            status = os.stat(path)
            if status.st_size != self.size:
                return f"has {status.st_size} bytes where {self.size} were written"
            same = (self.inode, self.modified, self.changed) == (status.st_ino, status.st_mtime_ns, status.st_ctime_ns)
            if same and _settled(status) < self.noted:
                return None
            return None if sha256(path) == self.sha256 else "does not hold what was written"
        except FileNotFoundError:
            return "is missing"
        except OSError as error:
            return f"cannot be read ({error.strerror})"


def fingerprints(paths: Iterable[Path]) -> dict[Path, Fingerprint]:
    """Those of files that were just written, after a step of the clock."""
    listed = list(paths)
    wait = max((_settled(os.stat(path)) for path in listed), default=0) - time.time_ns()
    if 0 <= wait <= STEP:
        time.sleep((wait + SECOND // 1000) / SECOND)
    return {path: Fingerprint.of(path) for path in listed}


def _settled(status: os.stat_result) -> int:
    """Time [ns] from which on a change of a file shows in its times."""
    whole_seconds = status.st_mtime_ns % SECOND == status.st_ctime_ns % SECOND == 0
    return max(status.st_mtime_ns, status.st_ctime_ns) + (COARSE_STEP if whole_seconds else STEP)


class Unchanged:
    """Files that must not change while they are used.

    Parameters
    ----------
    paths : iterable of Path
        The files; made before they are read.
    """

    def __init__(self, paths: Iterable[Path]):
        self.seen = {path: _glance(path) for path in paths}

    def require(self) -> None:
        """InputError if one of them was written since."""
        for path, before in self.seen.items():
            if _glance(path) != before:
                raise InputError(f"{path}: this input was changed during the run; what was made of it since is not used, run again")


def _glance(path: Path) -> tuple[int, int, int] | None:
    """Size, number and time of content of a file; None if there is none."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_size, status.st_ino, status.st_mtime_ns
