"""Locks between processes. A lock is released when its process ends, also after a kill."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from runout.errors import StorageError
from runout.io.atomic import storage_error
from runout.io.boundary import open_regular
from runout.io.part import fcntl, lock_folder

BUSY = (errno.EACCES, errno.EAGAIN)  # error numbers of a lock that another process holds


@contextmanager
def exclusive(folder: Path, name: str = ".lock", *, wait: bool = False) -> Iterator[None]:
    """Context in which only this process holds the lock file ``name`` of a folder; the folder is created if missing.

    ``wait``: whether to wait for a process that holds it. Raises StorageError if another process holds it, or the folder cannot be
    written.
    """
    import locket

    lock = locket.lock_file(str(folder / name), timeout=None if wait else 0)
    try:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.close(open_regular(folder / name, os.O_WRONLY | os.O_CREAT))
        lock.acquire()
    except locket.LockError:
        raise _occupied(folder) from None
    except OSError as cause:
        raise storage_error(folder, cause) from cause
    try:
        yield
    finally:
        lock.release()


def _occupied(folder: Path) -> StorageError:
    return StorageError(f"{folder}: another run is working there; wait for it, or choose another folder with --out")


@contextmanager
def shared(folder: Path, name: str = ".lock") -> Iterator[None]:
    """Context that several processes, also on several machines, may be in, but none that holds the lock :func:`exclusive`.

    Raises StorageError if a process holds it exclusively, or the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = open(open_regular(folder / name, os.O_WRONLY | os.O_CREAT | os.O_APPEND), "ab")  # noqa: SIM115 - closed below
    except OSError as cause:
        raise storage_error(folder, cause) from cause
    with file:
        try:
            if fcntl is not None:
                fcntl.flock(file.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError as cause:
            raise (_occupied(folder) if cause.errno in BUSY else storage_error(folder, cause)) from cause
        yield


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Context in which only this process changes a record in a folder; waits for other processes. Keep it short."""
    descriptor = lock_folder(folder, wait=True)
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)
