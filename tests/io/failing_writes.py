"""Counts the writes of files and lets one of them fail: no folder to write in, no rename, or the end of the process before it."""

import errno
import os
import signal
import tempfile
from collections.abc import Callable
from unittest import mock

FULL, DENIED, KILLED, NOT_REACHED = "disk full", "permission denied", "killed", "not so many writes"
FAULTS = {FULL: errno.ENOSPC, DENIED: errno.EACCES}


class Writes:
    """Replaces the two steps of each whole file, its new folder and its rename, for the block of a ``with`` statement.

    Parameters
    ----------
    failing : int
        Number of the step that fails, from 1; 0: none.
    fault : str
        ``FULL``, ``DENIED`` or ``KILLED``.
    """

    def __init__(self, failing: int = 0, fault: str = FULL):
        self.failing, self.fault, self.count = failing, fault, 0

    def __enter__(self) -> "Writes":
        self.patches = [
            mock.patch.object(os, "replace", self._counted(os.replace)),
            mock.patch.object(tempfile, "mkdtemp", self._counted(tempfile.mkdtemp)),
        ]
        for patch in self.patches:
            patch.start()
        return self

    def __exit__(self, *_: object) -> None:
        for patch in self.patches:
            patch.stop()

    def _counted(self, step: Callable[..., object]) -> Callable[..., object]:
        def write(*arguments: object, **named: object) -> object:
            self.count += 1
            if self.count == self.failing:
                if self.fault == KILLED:
                    os.kill(os.getpid(), signal.SIGKILL)
                raise OSError(FAULTS[self.fault], os.strerror(FAULTS[self.fault]))
            return step(*arguments, **named)

        return write


def number_of_writes(act: Callable[[], object]) -> int:
    """How many steps ``act`` takes in a copy of this process."""
    read, write = os.pipe()
    if os.fork() == 0:
        try:
            with Writes() as writes:
                act()
            os.write(write, str(writes.count).encode())
        finally:
            os._exit(0)
    os.close(write)
    with open(read) as pipe:
        said = pipe.read()
    os.wait()
    return int(said)


def fails(act: Callable[[], object], failing: int, fault: str, expected: type[BaseException]) -> str:
    """Text of the error with which ``act`` ends where one of its steps fails; a copy of this process is killed instead.

    The number of steps may vary by one or two, since records are saved now and then.
    """
    if fault != KILLED:
        writes = Writes(failing, fault)
        try:
            with writes:
                act()
        except expected as error:
            return str(error)
        return "" if writes.count >= failing else NOT_REACHED
    process = os.fork()
    if process == 0:
        try:
            with Writes(failing, fault):
                act()
            os._exit(0)
        finally:
            os._exit(1)
    status = os.waitpid(process, 0)[1]
    assert status == 0 or os.WTERMSIG(status) == signal.SIGKILL
    return KILLED if status else NOT_REACHED
