"""Writes files completely or not at all."""

import errno
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from runout.errors import DiskFullError, StorageError
from runout.io.boundary import NOT_REGULAR, read_regular
from runout.io.part import part_folder

PROBE = 2**20  # bytes that are written to test whether a disk is full

_FREE = "free some space or choose another folder with --out, then run again (finished work is kept)"
_FULL = (errno.ENOSPC, errno.EDQUOT)
_REMEDY = {
    errno.ENOSPC: f"the disk is full; {_FREE}",
    errno.EDQUOT: f"your disk quota is used up; {_FREE}",
    errno.EFBIG: f"the file is larger than the system allows; {_FREE}",
    errno.EACCES: "no permission to write there; change the permissions of the folder or choose another with --out",
    errno.EPERM: "no permission to write there; change the permissions of the folder or choose another with --out",
    errno.EROFS: "the file system is read-only; choose another folder with --out",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another folder with --out",
    errno.EEXIST: "a part of the path is a file, not a folder; choose another folder with --out",
    NOT_REGULAR: "it is a link, a pipe or a device, not a file; remove it or choose another folder with --out",
    errno.EISDIR: "there is a folder of that name; remove it or choose another folder with --out",
}


def storage_error(path: str | os.PathLike[str], cause: Exception) -> StorageError:
    """Error with remedy for a ``path`` that cannot be written."""
    number = getattr(cause, "errno", None) or 0
    refusal = _refusal(Path(path).parent)  # libraries may report another error number, none, or a missing permission
    if refusal in _FULL or (number not in _REMEDY and refusal in _REMEDY):
        number = refusal
    reason = os.strerror(number) if number > 0 else str(cause)
    remedy = _REMEDY.get(number, f"the disk may be full; {_FREE}")
    kind = DiskFullError if number in _FULL else StorageError
    return kind(f"{path}: cannot be written ({reason}); {remedy}")


def reason(cause: OSError) -> str:
    """Text of a system error, with a remedy if one is known."""
    remedy = _REMEDY.get(cause.errno or 0)
    return (cause.strerror or str(cause)) + (f"; {remedy}" if remedy else "")


def _refusal(folder: Path) -> int:
    """Error number of a test write to a folder; 0 if it succeeds."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(PROBE))
            os.fsync(file.fileno())
    except OSError as error:
        return error.errno or 0
    return 0


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Temporary path to write to; it becomes ``path`` when the block ends, and vanishes when the block fails.

    The temporary file has the final name, in a new folder ``.name.*.part`` beside it: format drivers see the suffix they expect, no
    pattern such as ``*.nc`` finds it, and side files of a driver go with it. Raises StorageError if the folder cannot be made or
    written, or the disk is full. An older file of that name stays as it is.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part_folder(path) as folder, _refused(path):  # storage_error tests the disk with this file still on it
            temporary = folder / path.name
            yield temporary
            os.replace(temporary, path)
    except OSError as cause:
        raise storage_error(path, cause) from cause


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Context that converts system errors into a StorageError of ``path``."""
    try:
        yield
    except OSError as cause:
        raise storage_error(path, cause) from cause


def write_text(text: str, path: str | os.PathLike[str]) -> Path:
    """Write UTF-8 text to a file, completely or not at all; returns the path."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def write_json(content: Mapping[str, Any], path: str | os.PathLike[str]) -> Path:
    """Write a mapping as indented JSON; paths and NumPy numbers become text and numbers. Returns the path."""
    return write_text(json.dumps(content, indent=2, ensure_ascii=False, default=_plain) + "\n", path)


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Mapping of a JSON file; empty if the file is missing, damaged, a link or a pipe, or holds no mapping."""
    try:
        content = json.loads(read_regular(path).decode("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)
