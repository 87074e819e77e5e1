"""Worker processes that start before their work is known: they import what members need while this process reads its inputs."""

from contextlib import suppress
from typing import Self

from runout.ensemble.worker import Worker
from runout.ensemble.workers import started
from runout.errors import DeviceError

MOST = 8  # processes that wait; memory may not hold as many members as there are cores
IMPORTED = ("runout.simulation.single", "runout.backends.scan.backend", "xarray", "netCDF4")  # by every member on the CPU


class Standby:
    """Context of worker processes for members on the CPU, which :meth:`take` gives away.

    ``number``, ``threads``: number of workers, of which at most :data:`MOST` start ahead, and threads of each.
    """

    def __init__(self, number: int, threads: int):
        self.threads, self.workers = threads, list[Worker]()
        self.number = number

    def __enter__(self) -> Self:
        with suppress(DeviceError):  # the run says that no process can be started, if that is still so when it needs one
            for number in range(min(self.number, MOST)):
                self.workers.append(started(number, None, self.threads, IMPORTED))
        return self

    def __exit__(self, *_: object) -> None:
        self.dismiss()

    def dismiss(self) -> None:
        """End the processes that nobody has taken."""
        while self.workers:
            self.workers.pop().end()

    def take(self, number: int, threads: int) -> Worker | None:
        """A process for the worker of this number, with so many threads; None if there is none."""
        if threads != self.threads or not self.workers:
            return None
        worker = self.workers.pop()
        worker.number = number
        return worker
