"""Processes that draw pictures of a report while this one draws others. They import what they need as soon as they start."""

import logging
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from subprocess import PIPE
from typing import Any, Self, TypeVar

from runout.lifetime import end_with_parent, interrupts_kept

LOGGER = logging.getLogger(__name__)
MOST = 3  # processes; each renders the ground of the maps anew
COMMAND = f"from {__name__} import serve; serve()"
IMPORTED = ("pandas", "matplotlib.figure", "matplotlib.backends.backend_agg", "runout.report.html")
Result = TypeVar("Result")
Job = Callable[[], Result]


class Helpers:
    """Context of processes, each of which does the jobs of one call of :meth:`do`. Without any, the caller does them.

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

    def do(self, jobs: Sequence[Job[Result]]) -> Callable[[], list[Result]]:
        """Start jobs, functions that can be pickled; a call of what is returned waits for their results.

        A free process does them. Without one, or where it fails, they are done in that call.
        """
        said = self.pool.submit(_asked, self.free.pop(), jobs) if self.free else None
        return lambda: _results(said, jobs)


def _results(said: "Future[list[Result] | None] | None", jobs: Sequence[Job[Result]]) -> list[Result]:
    """What another process made, or else what this one makes."""
    found = said.result() if said else None
    return [job() for job in jobs] if found is None else found


def _started() -> "subprocess.Popen[bytes] | None":
    """A new process; None if the system starts none."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
    try:
        with interrupts_kept():
            return subprocess.Popen([sys.executable, "-P", "-c", COMMAND], env=environment, stdin=PIPE, stdout=PIPE, stderr=PIPE)
    except OSError as cause:
        LOGGER.debug("no process that draws can be started: %s", cause)
        return None


def _asked(process: "subprocess.Popen[bytes]", jobs: Sequence[Job[Result]]) -> list[Result] | None:
    """Results of jobs that another process does; None if it fails."""
    made, errors = process.communicate(pickle.dumps(list(jobs)))
    if process.returncode:
        LOGGER.debug("a process that draws ended with %d: %s", process.returncode, errors.decode(errors="replace")[-500:])
        return None
    results: list[Result] = pickle.loads(made)
    return results


def serve() -> None:
    """Main function of a process: import, read jobs from the standard input, write their results to the standard output."""
    end_with_parent(os.getppid())
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is not a result
    for name in IMPORTED:
        import_module(name)
    jobs: Sequence[Job[Any]] = pickle.load(sys.stdin.buffer)
    with results:
        pickle.dump([job() for job in jobs], results)
