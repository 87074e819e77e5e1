"""Records finished stages of a study, with a key of everything that each depends on, to find those that are up to date."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runout.io import source_code
from runout.io.atomic import read_json, write_json
from runout.io.fingerprint import Fingerprint, fingerprints
from runout.io.lock import locked_folder
from runout.io.provenance import checksum, sha256

RECORD = "stages.json"


@dataclass(frozen=True)
class Stage:
    """One stage: name, description, and the sections of site.yaml that it depends on."""

    name: str
    purpose: str
    sections: tuple[str, ...]


def digest_files(paths: Iterable[Path]) -> str:
    """Checksum of the contents of files in their order; paths do not matter."""
    return checksum([[(path.name, sha256(path)) for path in paths]])


def stage_key(stage: Stage, resolved: Mapping[str, Any], inputs: str, state: Any = None) -> str:
    """Key of a stage: checksum of the sources of runout, inputs, its sections of the configuration, and its initial state."""
    sections = {name: resolved.get(name) for name in stage.sections}
    return checksum([source_code.checksums().products, stage.name, inputs, sections, state])


class StageRecord:
    """Keys and files of the finished stages of a results folder, in ``stages.json``.

    A stage is removed from the record before its files are replaced, so that a run that is killed meanwhile leaves a stage
    that is not done. A record that cannot be read, or an entry of it, counts as absent.

    Parameters
    ----------
    results : Path
        The results folder; need not exist.
    """

    def __init__(self, results: Path):
        self.results = results
        self.path = results / RECORD

    def why_stale(self, stage: str, key: str) -> str | None:
        """Reason why a stage has to be run; None if it is up to date and its files are unchanged."""
        entry = self._entries().get(stage)
        if entry is None:
            return "not done yet"
        if entry.key is None:
            return "it was interrupted"
        if entry.key != key:
            return "inputs, configuration or sources of runout changed"
        faults = (f"{name} {fault}" for name, file in entry.files.items() if (fault := file.fault(self.results / name)))
        return next(faults, None)

    def checksums(self, stage: str) -> dict[str, str]:
        """Checksums of the files of a stage, by name; empty if it is not finished."""
        entry = self._entries().get(stage)
        return {name: file.sha256 for name, file in entry.files.items()} if entry else {}

    def withdraw(self, stage: str) -> None:
        """Remove a stage from the record, before its files are replaced."""
        self._replace(stage, Entry())

    def finished(self, stage: str, key: str, files: Iterable[Path]) -> None:
        """Record a finished stage with the fingerprints of its files."""
        made = {path.relative_to(self.results).as_posix(): file for path, file in fingerprints(files).items()}
        self._replace(stage, Entry(key, dict(sorted(made.items()))))

    def _replace(self, stage: str, entry: "Entry") -> None:
        self.results.mkdir(parents=True, exist_ok=True)
        with locked_folder(self.results):  # another process may make another stage
            write_json({name: one.stored() for name, one in {**self._entries(), stage: entry}.items()}, self.path)

    def _entries(self) -> "dict[str, Entry]":
        found = {name: Entry.read(one) for name, one in read_json(self.path).items()}
        return {name: entry for name, entry in found.items() if entry is not None}


@dataclass(frozen=True)
class Entry:
    """Entry of a stage in the record: its key, None while it runs, and its files."""

    key: str | None = None
    files: dict[str, Fingerprint] = field(default_factory=dict)

    @classmethod
    def read(cls, stored: Any) -> "Entry | None":
        """Entry from the JSON record; None if it is not valid."""
        if not isinstance(stored, dict) or not isinstance(stored.get("files"), dict):
            return None
        key, files = stored.get("key"), {name: Fingerprint.read(one) for name, one in stored["files"].items()}
        sound = {name: file for name, file in files.items() if file is not None}
        return cls(key, sound) if (key is None or isinstance(key, str)) and len(sound) == len(files) else None

    def stored(self) -> dict[str, Any]:
        """The entry as values for JSON."""
        return {"key": self.key, "files": {name: file.stored() for name, file in self.files.items()}}
