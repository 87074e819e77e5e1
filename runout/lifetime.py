"""Processes that runout starts end when the process that started them ends, however it ends."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

LOOK_SECONDS = 0.25  # between two looks at the parent
END_SECONDS = 2.0  # for a killed process to end


def end_with_parent(parent: int) -> None:
    """End this process soon after the process ``parent``, which started it, has ended."""
    if os.name == "posix":  # elsewhere the number of the parent stays
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK_SECONDS)
    os._exit(1)


def end_workers() -> None:
    """End the worker processes of this process, which is about to end at once."""
    for child in multiprocessing.active_children():
        child.kill()
        child.join(END_SECONDS)


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Processes started in this block do not hear Ctrl-C, which a terminal sends to all: their parent ends them.

    An interrupt of this process during the block takes effect at its end.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # a process of multiprocessing; who starts it lets signals through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
