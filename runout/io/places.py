"""Checks, before any work, that a file or folder that an option names can be written."""

import os
import tempfile
from pathlib import Path

from runout.errors import ConfigError
from runout.io.boundary import exists, kind_of

ELSEWHERE = "name another place"


def require_place(option: str, path: Path, *, folder: bool) -> None:
    """Raise ConfigError, which names the option, unless a file or ``folder`` can be made or replaced at ``path``.

    Folders that are missing on the way will be made; nothing is left behind by the check.
    """
    fault = _fault(path, folder)
    if fault:
        raise ConfigError(f"{option} {path}: {fault}")


def _fault(path: Path, folder: bool) -> str:
    """What keeps a path from being written, with the remedy; empty if nothing does."""
    absolute = Path(os.path.abspath(path))
    if said := _no_name(absolute):
        return said
    if kind := kind_of(absolute):
        return f"is {kind}; {ELSEWHERE}"
    if absolute.is_dir() and not folder:
        return "is a folder; name a file in it"
    if exists(absolute) and not absolute.is_dir() and folder:
        return "is a file; name a folder"
    there = absolute if absolute.is_dir() else absolute.parent
    while not exists(there):
        there = there.parent
    if not there.is_dir():
        return f"{there} is a file, not a folder; {ELSEWHERE}"
    return _refused(there)


def _refused(folder: Path) -> str:
    """Why nothing can be written to a folder that exists."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as cause:
        return f"nothing can be written in {folder} ({cause.strerror}); change its permissions, or {ELSEWHERE}"


def _no_name(path: Path) -> str:
    """Why the system takes a path for no name."""
    if "\0" in str(path):
        return f"no name holds a null character; {ELSEWHERE}"
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return ""
    except OSError as cause:
        return f"{cause.strerror}; {ELSEWHERE}"
    return ""
