"""Provenance of a result: inputs with checksums, configuration, versions, machine and command."""

import hashlib
import json
import os
import platform
import sys
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from runout import __version__
from runout.errors import StorageError

_PACKAGES = ("numpy", "numba", "warp-lang", "scipy", "xarray", "netCDF4", "rasterio", "pyproj", "geopandas", "shapely")


def provenance(
    *,
    name: str,
    folder: str | os.PathLike[str],
    inputs: Iterable[str | os.PathLike[str]],
    configuration: Mapping[str, Any],
    seed: int | None,
    device: str,
    command: Iterable[str] | None = None,
    changes: Iterable[str] = (),
    sha256: Callable[[Path], str] | None = None,
) -> dict[str, Any]:
    """Provenance of a result as ``run.json`` stores it, ready for JSON.

    Parameters
    ----------
    name : str
        Name of the site.
    folder : path
        Folder of the site; inputs inside it are named relative to it, others by their file name alone.
    inputs : iterable of path
        Every file that the result depends on.
    configuration : mapping
        The resolved configuration.
    seed : int or None
        Seed of the ensemble.
    device : str
        Device of the simulations, such as "cpu".
    command : iterable of str, optional
        The command; by default that of this process.
    changes : iterable of str
        Settings that the command line set, each ``KEY=VALUE``.
    sha256 : callable, optional
        Checksum of an input; by default it is computed.

    Raises
    ------
    StorageError
        If an input cannot be read.
    """
    return {
        "site": name,
        "runout": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": " ".join(command if command is not None else [Path(sys.argv[0]).name, *sys.argv[1:]]),
        "seed": seed,
        "device": device,
        "machine": {"system": platform.system(), "architecture": platform.machine(), "cores": os.cpu_count()},
        "versions": {"python": platform.python_version()} | installed_versions(),
        "inputs": [input_record(Path(path), Path(folder), sha256) for path in inputs],
        "configuration_sha256": configuration_checksum(configuration),
        "configuration": plain(configuration),
    } | ({"set_by_command": list(changes)} if changes else {})


def file_record(path: Path, folder: Path, known: Callable[[Path], str] | None = None) -> dict[str, Any]:
    """Name, size [bytes] and SHA-256 of a file, perhaps known; the name is relative to ``folder`` where the file lies in it."""
    inside = path.resolve().is_relative_to(folder.resolve())
    name = path.resolve().relative_to(folder.resolve()).as_posix() if inside else path.name
    return {"name": name, "size": path.stat().st_size, "sha256": (known or sha256)(path)}


def input_record(path: Path, folder: Path, known: Callable[[Path], str] | None = None) -> dict[str, Any]:
    """:func:`file_record` of an input; StorageError if it cannot be read."""
    try:
        return file_record(path, folder, known)
    except OSError as cause:
        raise StorageError(f"{path}: this input cannot be read ({cause.strerror}); restore it and run again") from cause


def sha256(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's content, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def configuration_checksum(configuration: Mapping[str, Any]) -> str:
    """SHA-256 of a configuration; the order of its keys does not matter."""
    return checksum(plain(configuration))


def checksum(content: Any) -> str:
    """SHA-256 of plain values, in hexadecimal; the order of keys does not matter."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def plain(value: Any) -> Any:
    """The value converted to types of JSON: mappings, lists, text, numbers, None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    if hasattr(value, "tolist"):  # NumPy's numbers and arrays
        return value.tolist()
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def installed_versions() -> dict[str, str]:
    """Versions of the installed packages that can change a result."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return versions
