"""What the files of the members held when they were written, so that a damaged one is found and simulated again.

Files that the present settings do not use are kept for settings that come back, and removed on demand.
"""

import re
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from runout.ensemble.member import Member, members_folder, stored_key
from runout.io.atomic import read_json, write_json
from runout.io.fingerprint import Fingerprint, fingerprints
from runout.io.lock import exclusive
from runout.io.provenance import sha256

RECORD = "checksums.json"
SAVE_SECONDS = 1.0  # at least, between two times that the record is written while members finish
SAVE_SHARE = 20  # the same, relative to the time that writing it takes: many jobs may share a record
OWN_FILE = re.compile(r"([0-9a-f]{16}|\d{4,})\.(nc|failed\.json|([0-9a-f]{16}\.)?checkpoint\.npz)")  # numbers: of earlier versions


@dataclass(frozen=True)
class Found:
    """A member's file as it is now."""

    key: str | None = None  # key of the member that it holds; None without a sound file
    fault: str | None = None  # what is wrong with the file; None if it is sound, or if there is none and none is expected
    noted: bool = False  # whether its checksum is in the record


class Written:
    """Keys and fingerprints of members' files, in ``checksums.json``; one that cannot be read counts as empty.

    Several processes may change the record at the same time: each enters and removes its own files only.

    ``results``: the results folder; need not exist.
    """

    def __init__(self, results: Path):
        self.path = Path(results) / RECORD
        self.entries = self._stored()
        self.new: dict[str, tuple[str, Path]] = {}  # keys and places of files whose checksums are not computed yet
        self.removed = set[str]()  # names whose notes the next save removes
        self.saved, self.pause = time.monotonic(), SAVE_SECONDS

    def _stored(self) -> dict[str, tuple[str, Fingerprint]]:
        """Sound entries of the record as it is now."""
        entries = {}
        for name, entry in read_json(self.path).items():
            found = Fingerprint.read(entry.get("file")) if isinstance(entry, dict) else None
            if found and isinstance(entry.get("key"), str):
                entries[name] = (entry["key"], found)
        return entries

    def look(self, path: Path) -> Found:
        """What a file is now; one without a note, left by a run that was killed, is read as a whole."""
        if path.name in self.new:
            return Found(self.new[path.name][0], noted=True)
        if path.name in self.entries:
            noted, written = self.entries[path.name]
            fault = written.fault(path)
            return Found(None if fault else noted, fault, noted=True)
        if not path.is_file():
            return Found()
        from runout.io.member_maps import broken_seal

        key = stored_key(path)
        fault = "is not the file of a member" if key is None else broken_seal(path)
        return Found(None if fault else key, fault)

    def has(self, path: Path) -> bool:
        """Whether the record holds a file, or there is none to hold."""
        return path.name in self.entries or path.name in self.new or not path.is_file()

    def checksum(self, path: Path) -> str:
        """Checksum of a sound file; empty where there is none."""
        if path.name in self.entries:
            return self.entries[path.name][1].sha256
        return sha256(path) if path.is_file() else ""

    def note(self, path: Path, key: str) -> None:
        """Note a file that was just written, or found sound; the record is saved now and then."""
        self.new[path.name] = (key, path)
        if time.monotonic() - self.saved > self.pause:
            self.save()

    def withdraw(self, paths: Iterable[Path]) -> None:
        """Remove the notes of files that are about to be replaced."""
        self.removed |= {path.name for path in paths} & set(self.entries)
        if self.removed:
            self.save()

    def forget(self, path: Path) -> None:
        """Remove a file, and its note."""
        if self.entries.pop(path.name, None):
            self.removed.add(path.name)
        self.new.pop(path.name, None)
        path.unlink(missing_ok=True)

    def save(self) -> None:
        """Write the record, with what was noted."""
        started = time.monotonic()
        files = fingerprints(path for _, path in self.new.values() if path.is_file())
        noted = {name: (key, files[path]) for name, (key, path) in self.new.items() if path in files}
        with exclusive(self.path.parent, f".locks/{RECORD}", wait=True):
            kept = {name: entry for name, entry in self._stored().items() if name not in self.removed}
            self.entries = kept | noted
            entries = sorted(self.entries.items())
            write_json({name: {"key": key, "file": written.stored()} for name, (key, written) in entries}, self.path)
        self.new.clear()
        self.removed.clear()
        self.saved = time.monotonic()
        self.pause = max(SAVE_SECONDS, SAVE_SHARE * (self.saved - started))


def unused_files(results: Path, members: Iterable[Member]) -> list[Path]:
    """Files of other members than ``members`` in a results folder, in the order of their names; no files of other origin."""
    folder, used = members_folder(results), {member.name for member in members}
    if not folder.is_dir():
        return []
    others = (path for path in folder.iterdir() if path.name.partition(".")[0] not in used)
    return sorted(path for path in others if OWN_FILE.fullmatch(path.name) and path.is_file())


def remove_unused(results: Path, members: Iterable[Member]) -> tuple[int, int]:
    """Remove the files of :func:`unused_files`; returns their number and size [byte].

    Raises StorageError if a run works in the folder, or a file cannot be removed.
    """
    folder = members_folder(results)
    if not folder.is_dir():
        return 0, 0
    with exclusive(folder):
        files, written = unused_files(results, members), Written(results)
        size = sum(path.stat().st_size for path in files)
        for path in files:
            written.forget(path)
        if files:
            written.save()
    return len(files), size
