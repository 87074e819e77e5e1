"""Folders for files that are being written: they are told from those that a killed process left, and the latter removed.

A folder ``.name.*.part`` is locked as long as its process lives; the system ends the lock with the process, however that ends.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from runout.interrupt import at_end

try:
    import fcntl
except ImportError:  # Windows, which does not remove a folder with an open file
    fcntl = None  # type: ignore[assignment]

PATTERN = ".*.part"


@contextmanager
def part_folder(path: Path) -> Iterator[Path]:
    """New folder beside ``path``, of this process alone; it goes with the block.

    Raises
    ------
    OSError
        If it cannot be made.
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
    """Number of folders of killed processes removed from ``folder`` and those in it; those of live processes stay."""
    return sum(_remove(part) for part in Path(folder).rglob(PATTERN) if part.is_dir())


def _new(path: Path) -> tuple[Path, int | None]:
    """A new folder and what keeps its lock; another process may have taken it for stale before it was locked."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=PATTERN[2:], dir=path.parent))
        lock = lock_folder(folder, wait=True)
        if folder.is_dir():
            return folder, lock
        if lock is not None:
            os.close(lock)


def lock_folder(folder: Path, *, wait: bool) -> int | None:
    """Descriptor that keeps the lock of a folder; None where it has gone, or the file system has no locks.

    Raises
    ------
    BlockingIOError
        If its process lives and ``wait`` is false.
    """
    if fcntl is None:
        return None
    try:
        descriptor = os.open(folder, os.O_RDONLY)
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
    """Whether a folder was removed, its process being dead."""
    try:
        lock = lock_folder(part, wait=False)
    except BlockingIOError:
        return False
    if lock is None and fcntl is not None:
        return False  # gone already, or nothing tells whether its process lives
    shutil.rmtree(part, ignore_errors=True)
    if lock is not None:
        os.close(lock)
    return not part.exists()
