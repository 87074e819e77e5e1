"""What an earlier run found out about the input files, so that files that nobody changed are not read again."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from runout.io.atomic import read_json, write_json
from runout.io.fingerprint import Fingerprint
from runout.io.provenance import checksum


class KnownFiles:
    """Checksums of input files, and values that were computed from them, kept in a JSON file between runs.

    A file is read again when its size, inode or times differ from those of the record (see :mod:`runout.io.fingerprint`).
    A record that cannot be read counts as empty.

    Parameters
    ----------
    path : Path, optional
        The record; without one nothing is kept between runs.
    """

    def __init__(self, path: Path | None = None):
        self.path = path
        stored = read_json(path) if path else {}
        files, values = stored.get("files"), stored.get("values")
        found = {name: Fingerprint.read(one) for name, one in files.items()} if isinstance(files, Mapping) else {}
        self._files = {name: one for name, one in found.items() if one is not None}
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
