"""Locks between processes. A lock is released when its process ends, also after a kill."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from runout.errors import StorageError
from runout.io.atomic import storage_error
from runout.io.part import lock_folder


@contextmanager
def exclusive(folder: Path, name: str = ".lock") -> Iterator[None]:
    """Context in which only this process holds the lock file ``name`` of a folder; the folder is created if missing.

    Raises
    ------
    StorageError
        If another process holds it, or the folder cannot be written.
    """
    import locket

    lock = locket.lock_file(str(folder / name), timeout=0)
    try:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except locket.LockError:
        remedy = "wait for it, or choose another folder with --out"
        raise StorageError(f"{folder}: another run is working there; {remedy}") from None
    except OSError as cause:
        raise storage_error(folder, cause) from cause
    try:
        yield
    finally:
        lock.release()


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Context in which only this process changes a record in a folder; waits for other processes. Keep it short."""
    descriptor = lock_folder(folder, wait=True)
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)
