"""Which stages of a study are up to date: each leaves a key of all that it was made from."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runout import __version__
from runout.io.atomic import write_json

RECORD = "stages.json"


@dataclass(frozen=True)
class Stage:
    """One stage: its name, what it does in a sentence, and the sections of site.yaml that it depends on."""

    name: str
    purpose: str
    sections: tuple[str, ...]


def digest(*parts: Any) -> str:
    """Checksum (sha256, hex) of plain values."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def digest_files(paths: Iterable[Path]) -> str:
    """Checksum of the contents of files, whatever their folder is called."""
    found = []
    for path in paths:
        with path.open("rb") as stream:
            found.append((path.name, hashlib.file_digest(stream, "sha256").hexdigest()))
    return digest(sorted(found))


def stage_key(stage: Stage, resolved: Mapping[str, Any], inputs: str, state: Any = None) -> str:
    """Key of a stage: version, contents of the inputs, its part of the configuration, and the state it starts from."""
    sections = {name: resolved.get(name) for name in stage.sections}
    return digest(__version__, stage.name, inputs, sections, state)


class StageRecord:
    """What the finished stages of one results folder were made from, in ``stages.json``.

    Parameters
    ----------
    results : Path
        The results folder; need not exist.
    """

    def __init__(self, results: Path):
        self.results = results
        self.path = results / RECORD

    def why_stale(self, stage: str, key: str) -> str | None:
        """Why the stage has to be done; None when it is up to date."""
        entry = self._entries().get(stage)
        if entry is None:
            return "not done yet"
        if entry["key"] != key:
            return "inputs, configuration or version changed"
        missing = [name for name in entry["files"] if not (self.results / name).exists()]
        return f"{missing[0]} is missing" if missing else None

    def finished(self, stage: str, key: str, files: Iterable[Path]) -> None:
        """Note that a stage is done; the record is replaced as a whole, so a kill leaves the old one."""
        names = sorted(str(path.relative_to(self.results)) for path in files)
        entries = {**self._entries(), stage: {"key": key, "files": names}}
        write_json(entries, self.path)

    def _entries(self) -> dict[str, dict[str, Any]]:
        try:
            return json.loads(self.path.read_text())
        except (FileNotFoundError, json.JSONDecodeError):
            return {}
