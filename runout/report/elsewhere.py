"""Processes that draw pictures of a report while this one draws others. They import what they need as soon as they start."""

import logging
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from subprocess import PIPE
from typing import Self, TypeVar

from runout.processes.lifetime import end_with_parent, import_path, interrupts_kept, python_command

LOGGER = logging.getLogger(__name__)
MOST = 3  # processes; each renders the ground of the maps anew
COMMAND = f"from {__name__} import serve; serve()"
IMPORTED = ("pandas", "matplotlib.figure", "matplotlib.backends.backend_agg", "runout.report.html")
Result = TypeVar("Result")
Job = Callable[[], Result]


class Helpers:
    """Context of processes, each of which does one job of :meth:`do`. Without any, the caller does it.

    Parameters
    ----------
    count : int
        Number of processes, of which at most :data:`MOST` are started.
    """

    def __init__(self, count: int = 0):
        self.free = [process for process in (_started() for _ in range(min(max(count, 0), MOST))) if process]
        self.pool = ThreadPoolExecutor(MOST)  # of threads that wait for them

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.free:
            process.kill()
            process.communicate()
        self.pool.shutdown()

    def do(self, job: Job[Result]) -> Job[Result]:
        """Start a job, a function that can be pickled; a call of what is returned waits for its result.

        A free process does it. Without one, or where it fails, it is done in that call.
        """
        said = self.pool.submit(_asked, self.free.pop(), job) if self.free else None
        return lambda: _result(said, job)


def _result(said: "Future[list[Result]] | None", job: Job[Result]) -> Result:
    """What another process made, or else what this one makes."""
    made = said.result() if said else []
    return made[0] if made else job()


def _started() -> "subprocess.Popen[bytes] | None":
    """A new process; None if the system starts none."""
    environment = {**os.environ, "PYTHONPATH": import_path()}
    try:
        with interrupts_kept():
            return subprocess.Popen(python_command(COMMAND), env=environment, stdin=PIPE, stdout=PIPE, stderr=PIPE)
    except OSError as cause:
        LOGGER.debug("no process that draws can be started: %s", cause)
        return None


def _asked(process: "subprocess.Popen[bytes]", job: Job[Result]) -> list[Result]:
    """The result of a job that another process does, alone in a list; empty if it fails."""
    made, errors = process.communicate(pickle.dumps(job))
    if process.returncode:
        LOGGER.debug("a process that draws ended with %d: %s", process.returncode, errors.decode(errors="replace")[-500:])
        return []
    return [pickle.loads(made)]


def serve() -> None:
    """Main function of a process: import, read a job from the standard input, write its result to the standard output."""
    end_with_parent(os.getppid())
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is not a result
    for name in IMPORTED:
        import_module(name)
    job: Job[object] = pickle.load(sys.stdin.buffer)
    with out:
        pickle.dump(job(), out)
