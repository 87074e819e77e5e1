"""Temporary folders for files that are being written; those that a killed process left are recognised and removed.

A folder ``.name.*.part`` is locked as long as its process lives; the system ends the lock with the process, however that ends.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from runout.processes.interrupt import at_end

try:
    import fcntl
except ImportError:  # Windows does not remove a folder with an open file
    fcntl = None  # type: ignore[assignment]

PATTERN = ".*.part"


@contextmanager
def part_folder(path: Path) -> Iterator[Path]:
    """Context with a new folder beside ``path`` that only this process uses; it is removed at the end.

    Raises OSError if it cannot be made.
    """
    folder, lock = _new(path)
    remove = partial(shutil.rmtree, folder, ignore_errors=True)
    try:
        with at_end(remove):
            yield folder
    finally:
        remove()
        if lock is not None:
            os.close(lock)


def remove_stale(folder: str | os.PathLike[str]) -> int:
    """Remove folders of killed processes from ``folder`` and its subfolders; returns their number."""
    return sum(_remove(part) for part in Path(folder).rglob(PATTERN) if part.is_dir() and not part.is_symlink())


def _new(path: Path) -> tuple[Path, int | None]:
    """A new folder and the descriptor of its lock. Retries if another process removed the folder before it was locked."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=PATTERN[2:], dir=path.parent))
        lock = lock_folder(folder, wait=True)
        if folder.is_dir():
            return folder, lock
        if lock is not None:
            os.close(lock)


def lock_folder(folder: Path, *, wait: bool) -> int | None:
    """Descriptor of the lock of a folder; None if the folder is gone or the file system has no locks.

    Raises BlockingIOError if its process lives and ``wait`` is false.
    """
    if fcntl is None:
        return None
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _remove(part: Path) -> bool:
    """Remove a folder if its process has ended; returns whether it was removed."""
    try:
        lock = lock_folder(part, wait=False)
    except BlockingIOError:
        return False
    if lock is None and fcntl is not None:
        return False  # already removed, or the state of its process is unknown
    shutil.rmtree(part, ignore_errors=True)
    if lock is not None:
        os.close(lock)
    return not part.exists()
