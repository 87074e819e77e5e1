"""Kinds of files, and files of runout's own folders: they are regular files and no links, so that all is read and written there."""

import errno
import os
import stat
from pathlib import Path

KINDS = {
    stat.S_IFLNK: "a link",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
NOT_REGULAR = errno.ELOOP  # error number of what is no regular file; that of the system for a link
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)  # O_NONBLOCK: for pipes


def open_regular(path: str | os.PathLike[str], flags: int) -> int:
    """Descriptor of a regular file, opened with flags of :func:`os.open`; a link is not followed, and a pipe is not waited for.

    Raises
    ------
    OSError
        If it cannot be opened. The number is :data:`NOT_REGULAR` where there is a link, a pipe, a device or a socket.
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
