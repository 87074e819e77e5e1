"""Checks that files are regular: inputs with their side files, and files of runout's own folders.

A link in an own folder would lead reading and writing elsewhere; a pipe or a device would block.
"""

import errno
import os
import stat
from pathlib import Path
from typing import Any

from runout.errors import InputError

KINDS = {
    stat.S_IFLNK: "a link",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
NOT_REGULAR = errno.ELOOP  # error number of what is no regular file; that of the system for a link
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)  # O_NONBLOCK: for pipes
SITE_FILE = "site.yaml"
LARGEST_TEXT = 64 * 1024 * 1024  # largest input that is parsed as a whole [bytes]


def open_regular(path: str | os.PathLike[str], flags: int) -> int:
    """Descriptor of a regular file, opened with flags of :func:`os.open`; a link is not followed, and a pipe is not waited for.

    Raises OSError if it cannot be opened. The number is :data:`NOT_REGULAR` where there is a link, a pipe, a device or a socket.
    """
    if os.name != "posix" and os.path.islink(path):
        raise OSError(NOT_REGULAR, os.strerror(NOT_REGULAR), str(path))
    try:
        descriptor = os.open(path, flags | _NO_LINK, 0o666)
    except OSError as cause:
        if cause.errno in (errno.ENXIO, errno.EMLINK):  # a pipe that nobody reads, or a socket; a link on BSD
            raise OSError(NOT_REGULAR, os.strerror(NOT_REGULAR), str(path)) from cause
        raise
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return descriptor
    os.close(descriptor)
    raise OSError(NOT_REGULAR, os.strerror(NOT_REGULAR), str(path))


def read_regular(path: str | os.PathLike[str]) -> bytes:
    """Content of a regular file; OSError as of :func:`open_regular`."""
    with open(open_regular(path, os.O_RDONLY), "rb") as file:
        return file.read()


def irregular(folder: Path) -> list[tuple[Path, str]]:
    """Links, pipes, devices and sockets in a folder and its subfolders, sorted, each with its kind; links are not followed."""
    special_files, waiting = [], [os.fspath(folder)]
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
                    elif not entry.is_file(follow_symlinks=False):
                        special_files.append((Path(entry.path), kind_of(Path(entry.path), follow_links=False) or "no regular file"))
        except OSError:  # it cannot be read, or was removed meanwhile; the first access reports it
            continue
    return sorted(special_files)


def kind_of(path: Path, *, follow_links: bool = True) -> str | None:
    """Kind of a special file, such as a named pipe, or of a link; None for regular files, folders and missing files."""
    try:
        return KINDS.get(stat.S_IFMT(path.stat(follow_symlinks=follow_links).st_mode))
    except (OSError, ValueError):
        return None


def require_regular(path: Path, error: type[InputError]) -> Path:
    """Absolute path of a non-empty regular file whose side files are regular files as well.

    The file is not opened, since a pipe would block. Side files share the name up to a dot; libraries open them on their own.
    Raises InputError of the kind ``error`` with the remedy.
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
