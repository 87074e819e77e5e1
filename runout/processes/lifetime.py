"""Ends child processes when their parent process ends, also after a kill."""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

from runout.safe_start import SAFE_PATH

LOOK_SECONDS = 0.25  # [s] between two checks of the parent
END_SECONDS = 2.0  # [s] that a killed process has to end


def import_path() -> str:
    """The places from which this process imports, as ``PYTHONPATH`` of another one."""
    return os.pathsep.join(place or os.getcwd() for place in sys.path)


def end_with_parent(parent: int) -> None:
    """End this process soon after its parent process ``parent`` has ended."""
    if os.name == "posix":  # on other systems the number of the parent does not change
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK_SECONDS)
    os._exit(1)


def end_workers() -> None:
    """End the worker processes of this process, before it ends itself."""
    for child in multiprocessing.active_children():
        child.kill()
        child.join(END_SECONDS)


def python_command(code: str, *arguments: str) -> list[str]:
    """Command of a Python process that runs ``code``; it takes no code and no settings from the working directory."""
    return [sys.executable, "-P", "-c", f"from runout.safe_start import ignore_settings; ignore_settings(); {code}", *arguments]


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Context whose child processes do not receive Ctrl-C from the terminal; their parent ends them.

    An interrupt of this process during the block takes effect at its end.
    """
    with _safe_path():
        if not hasattr(signal, "pthread_sigmask"):
            yield
            return
        resource_tracker.ensure_running()  # a process of multiprocessing; its starter unblocks signals again
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _safe_path() -> Iterator[None]:
    """Context whose child processes do not import from the working directory, also those that multiprocessing starts."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(SAFE_PATH, None)  # another thread may have removed it
        else:
            os.environ[SAFE_PATH] = before


@contextmanager
def children_allowed() -> Iterator[None]:
    """Context in which a daemon process of multiprocessing, such as a worker of dask, may start processes.

    Daemons may not, since they could leave them behind; those of runout end with their parent (:func:`end_with_parent`).
    """
    settings = multiprocessing.current_process()._config  # type: ignore[attr-defined]
    daemon = settings.pop("daemon", None)
    try:
        yield
    finally:
        if daemon is not None:
            settings["daemon"] = daemon
