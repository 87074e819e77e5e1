"""Checks that an input and its side files are regular files."""

import os
import stat
from pathlib import Path
from typing import Any

from runout.errors import InputError
from runout.io.regular import KINDS

SITE_FILE = "site.yaml"
LARGEST_TEXT = 64 * 1024 * 1024  # largest input that is parsed as a whole [bytes]


def require_regular(path: Path, error: type[InputError]) -> Path:
    """Absolute path of a non-empty regular file whose side files are regular files as well.

    The file is not opened, since a pipe would block. Side files share the name up to a dot; libraries open them on their own.

    Raises
    ------
    InputError
        Of the kind ``error``, with the remedy.
    """
    absolute = Path(os.path.abspath(path))
    if str(absolute).startswith("/vsi"):
        raise error(f"{path}: is a virtual file name of GDAL; name a file on this machine, unpacked")
    _require_kind(absolute, path, error)
    if not absolute.is_dir() and absolute.stat().st_size == 0:
        raise error(f"{path}: is empty (0 bytes); copy it again")
    for side in side_files(absolute):
        _require_kind(side, side, error)
    return absolute


def side_files(path: Path) -> list[Path]:
    """Files beside ``path`` with the same name up to a dot, in upper or lower case; a library may open them with it."""
    stem, name = path.stem.lower() + ".", path.name.lower() + "."
    try:
        with os.scandir(path if path.is_dir() else path.parent) as entries:
            names = [entry.name for entry in entries]
    except OSError:
        return []
    if path.is_dir():
        return sorted(path / other for other in names)
    return sorted(path.with_name(n) for n in names if n != path.name and n.lower().startswith((stem, name)))


def as_path(path: Any, error: type[InputError]) -> Path:
    """``path`` as a Path; raises ``error`` if it is neither text nor a path."""
    if not isinstance(path, str | os.PathLike) or isinstance(os.fspath(path), bytes):
        raise error(f"{path!r} is a {type(path).__name__}; the path of a file is needed")
    return Path(path)


def exists(path: Path) -> bool:
    """Whether a file or folder exists; False for names that no file can have."""
    try:
        return path.exists()
    except (OSError, ValueError):  # too long, or contains a null character
        return False


def names_in(folder: Path) -> list[str]:
    """Sorted names in a folder; empty if it cannot be read."""
    try:
        return sorted(os.listdir(folder))
    except (OSError, ValueError):
        return []


def root_of(path: Path) -> Path:
    """Folder that must contain the files that ``path`` refers to: the site folder around it, else its own folder."""
    own = path.resolve().parent
    return next((folder for folder in (own, *own.parents) if (folder / SITE_FILE).is_file()), own)


def _require_kind(path: Path, shown: Path, error: type[InputError]) -> None:
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as cause:
        reason = getattr(cause, "strerror", None) or str(cause)
        raise error(f"{shown}: cannot be read ({reason}); check its path and permissions") from cause
    kind = KINDS.get(stat.S_IFMT(mode))
    if kind:
        raise error(f"{shown}: is {kind}, not a file; copy the content to a file and name that")
