"""Ctrl-C and SIGTERM end a command at once with one line, also while it imports, compiles, waits or writes.

An exception would be lost, or printed with its traceback, where libraries catch it or call back from C. Ending at once loses
nothing: files are whole or absent, and the same command goes on from there.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from runout.processes.ending import AT_END, MESSAGE, end, end_at_once

__all__ = ["MESSAGE", "at_end", "end_at_once", "ended_at_once"]


@contextmanager
def ended_at_once() -> Iterator[None]:
    """Context in which Ctrl-C ends this process, unless a handler has been set."""
    alone = signal.getsignal(signal.SIGINT) is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    if alone:
        signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        if alone:
            signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def at_end(act: Callable[[], object]) -> Iterator[None]:
    """Context in which a signal calls ``act`` before the process ends."""
    AT_END.append(act)
    try:
        yield
    finally:
        AT_END.remove(act)
