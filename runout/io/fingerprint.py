"""Fingerprints of files: checksum, size and times, to find out whether a file has changed, and a record of them between runs.

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
from runout.io.atomic import read_json, write_json
from runout.io.provenance import checksum, sha256

SECOND = 1_000_000_000  # [ns]
STEP, COARSE_STEP = SECOND // 25, 2 * SECOND  # [ns] of the clocks of file systems that count parts of a second, and of others


@dataclass(frozen=True)
class Fingerprint:
    """Checksum, size and times of a file."""

    sha256: str  # checksum of the content
    size: int  # size of the file [byte]
    # inode, modified, changed: inode number, and the times [ns] of the last change of content and of status
    inode: int
    modified: int
    changed: int
    noted: int  # time [ns] at which the fingerprint was taken

    @classmethod
    def of(cls, path: Path) -> "Fingerprint":
        """Fingerprint of a file; OSError if it cannot be read."""
        noted, status = time.time_ns(), os.stat(path)  # later changes of the file have a later time
        return cls(sha256(path), status.st_size, status.st_ino, status.st_mtime_ns, status.st_ctime_ns, noted)

    @classmethod
    def read(cls, stored: Any) -> "Fingerprint | None":
        """Fingerprint from a JSON record; None if the record is not valid."""
        types = {field.name: str if field.name == "sha256" else int for field in fields(cls)}
        if not isinstance(stored, Mapping) or set(stored) != set(types):
            return None
        return cls(**stored) if all(type(stored[name]) is kind for name, kind in types.items()) else None

    def stored(self) -> dict[str, Any]:
        """The fingerprint as values for JSON."""
        return asdict(self)

    def fault(self, path: Path) -> str | None:
        """How the file differs from the fingerprint; None if its content is unchanged."""
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
    """Fingerprints of files that were just written, taken after a tick of the file system's clock."""
    listed = list(paths)
    wait = max((_settled(os.stat(path)) for path in listed), default=0) - time.time_ns()
    if 0 <= wait <= STEP:
        time.sleep((wait + SECOND // 1000) / SECOND)
    return {path: Fingerprint.of(path) for path in listed}


def _settled(status: os.stat_result) -> int:
    """Time [ns] after which a change of a file changes its times."""
    whole_seconds = status.st_mtime_ns % SECOND == status.st_ctime_ns % SECOND == 0
    return max(status.st_mtime_ns, status.st_ctime_ns) + (COARSE_STEP if whole_seconds else STEP)


class Unchanged:
    """Guards files that must not change while they are used.

    ``paths``: the files. Create this object before reading them.
    """

    def __init__(self, paths: Iterable[Path]):
        self.seen = {path: _glance(path) for path in paths}

    def holds(self) -> bool:
        """Whether none of them was written since."""
        return all(_glance(path) == before for path, before in self.seen.items())

    def require(self) -> None:
        """Raise InputError if one of the files has changed."""
        for path, before in self.seen.items():
            if _glance(path) != before:
                raise InputError(f"{path}: this input was changed during the run; what was made of it since is not used, run again")


def _glance(path: Path) -> tuple[int, int, int] | None:
    """Size, inode and time of content of a file; None if it does not exist."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_size, status.st_ino, status.st_mtime_ns


class KnownFiles:
    """Checksums of input files, and values that were computed from them, kept in a JSON file between runs.

    A file is read again when its size, inode or times differ from those of the record.
    A record that cannot be read counts as empty.

    ``path``: the record; without one nothing is kept between runs.
    """

    def __init__(self, path: Path | None = None):
        self.path = path
        stored = read_json(path) if path else {}
        files, values = stored.get("files"), stored.get("values")
        entries = {name: Fingerprint.read(entry) for name, entry in files.items()} if isinstance(files, Mapping) else {}
        self._files = {name: entry for name, entry in entries.items() if entry is not None}
        self._values: dict[str, Any] = dict(values) if isinstance(values, Mapping) else {}
        self._stored = (dict(self._files), dict(self._values))

    def recorded_in(self, path: Path) -> "KnownFiles":
        """What a record holds, with the checksums that this process has computed."""
        known = KnownFiles(path)
        known._files |= self._files
        return known

    def sha256(self, path: Path) -> str:
        """Checksum of the content of a file; OSError if it cannot be read."""
        name = checksum(str(path.absolute()))  # the record tells nothing of the machine
        known = self._files.get(name)
        if known is None or known.fault(path):
            known = self._files[name] = Fingerprint.of(path)
        return known.sha256

    def value(self, name: str, key: str) -> Any:
        """The value noted under a name for the same key; None if there is none."""
        noted = self._values.get(name)
        return noted.get("value") if isinstance(noted, Mapping) and noted.get("key") == key else None

    def note(self, name: str, key: str, value: Any) -> None:
        """Note a value of plain types that was computed from what the key stands for."""
        self._values[name] = {"key": key, "value": value}

    def save(self) -> None:
        """Write the record, if it has changed."""
        if self.path and self._stored != (self._files, self._values):
            write_json({"files": {name: one.stored() for name, one in self._files.items()}, "values": self._values}, self.path)
            self._stored = (dict(self._files), dict(self._values))
