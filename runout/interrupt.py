"""Ctrl-C and SIGTERM end a command at once, with one line, whatever it does: loads libraries, compiles, waits or writes.

An exception would be lost, or printed with its traceback, where libraries catch it or call back from C. Ending at once loses
nothing: files are whole or absent, and the same command goes on from there.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

MESSAGE = "interrupted; what is finished is kept, the same command goes on from there"
CURSOR = b"\r\x1b[2K\x1b[?25h"  # clears a line with a bar and shows the cursor that it hid
_AT_END: list[Callable[[], object]] = []


def end_at_once() -> None:
    """Let signals end this process from now on; one that is ignored, as in the background of a shell, stays ignored."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _end)


@contextmanager
def ended_at_once() -> Iterator[None]:
    """Block in which Ctrl-C ends this process, if nobody has said what else it does."""
    alone = signal.getsignal(signal.SIGINT) is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    if alone:
        signal.signal(signal.SIGINT, _end)
    try:
        yield
    finally:
        if alone:
            signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def at_end(act: Callable[[], object]) -> Iterator[None]:
    """Block that a signal ends with ``act``."""
    _AT_END.append(act)
    try:
        yield
    finally:
        _AT_END.remove(act)


def _end(number: int, frame: FrameType | None) -> None:
    for other in (signal.SIGINT, signal.SIGTERM):
        signal.signal(other, signal.SIG_IGN)
    text = MESSAGE if number == signal.SIGINT else MESSAGE.replace("interrupted", "terminated")
    with suppress(OSError):  # a terminal that was closed
        os.write(2, (CURSOR if os.isatty(2) else b"") + f"error: {text}\n".encode())
    for act in reversed(_AT_END[:]):
        with suppress(OSError):
            act()
    os._exit(128 + number)
