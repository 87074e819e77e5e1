"""Work that several processes share: each does the next part that no other process has done or does."""

from collections.abc import Callable, Mapping
from pathlib import Path

Parts = Mapping[str, Callable[[], object]]


def share(parts: Parts, folder: Path) -> None:
    """Do the parts that no process has done or does; the processes have a folder in common."""
    for name, part in parts.items():
        _do(name, part, folder, wait=False)


def complete(parts: Parts, folder: Path) -> None:
    """Wait for parts that other processes do, and do those of a process that has ended before it had done them."""
    for name, part in parts.items():
        _do(name, part, folder, wait=True)


def _do(name: str, part: Callable[[], object], folder: Path, *, wait: bool) -> None:
    import locket

    lock, done = locket.lock_file(str(folder / f"{name}.lock"), timeout=None if wait else 0), folder / name
    try:
        lock.acquire()  # released when the process ends, also after a kill
    except locket.LockError:
        return
    try:
        if not done.exists():
            part()
            done.touch()
    finally:
        lock.release()
