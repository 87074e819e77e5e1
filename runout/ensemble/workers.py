"""Distributes members to this process or to worker processes (:mod:`runout.ensemble.worker`).

Also the cores and the memory that this process may use, of the machine or of its container, and workers that start before their
work is known: they import what members need while this process reads its inputs.
"""

import logging
import os
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import Self

import psutil

from runout.backends.protocol import devices_of
from runout.ensemble.dispatch import Died, Outcome, feed, outcomes
from runout.ensemble.worker import END_SECONDS, Done, Group, Progress, Ready, Task, Worker, done, packed, start_worker
from runout.errors import ConfigError, DeviceError

CGROUP = Path("/sys/fs/cgroup")  # control groups: version 2 has cpu.max and memory.max here, version 1 a folder for each controller
LOGGER = logging.getLogger(__name__)
MEMORY_SHARE = 0.9  # share of the memory of the machine for all workers together
MEMORY_END = 0.95  # fraction of its share above which a worker is terminated
LOOK_SECONDS = 0.2  # [s] between two checks of the memory of the workers
START = threading.Lock()  # processes are started one after the other, since they inherit the environment
THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
MOST = 8  # processes that wait; memory may not hold as many members as there are cores
IMPORTED = ("runout.simulation.single", "runout.backends.scan.backend", "xarray", "netCDF4")  # by every member on the CPU


def core_count() -> int:
    """Number of cores that this process may use, at least 1."""
    process = psutil.Process()
    cores = len(process.cpu_affinity()) if hasattr(process, "cpu_affinity") else os.cpu_count() or 1
    share = _numbers("cpu.max") or _numbers("cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us")
    if len(share) == 2 and share[0] > 0 and share[1] > 0:
        cores = min(cores, max(1, round(share[0] / share[1])))
    return max(1, cores)


def memory_bytes() -> int:
    """Memory [byte] that all processes on this machine or in this container may use together."""
    total = int(psutil.virtual_memory().total)
    limit = _numbers("memory.max") or _numbers("memory/memory.limit_in_bytes")
    return min(total, int(limit[0])) if limit and limit[0] > 0 else total


def resident_bytes(process: int) -> int:
    """Memory [byte] that a process holds now; 0 if it has ended."""
    try:
        return int(psutil.Process(process).memory_info().rss)
    except psutil.NoSuchProcess:
        return 0


def _numbers(*files: str) -> list[float]:
    """Numbers in files of the control group; empty if a file or a limit is missing."""
    try:
        words = [word for name in files for word in (CGROUP / name).read_text(encoding="ascii").split()]
        return [float(word) for word in words]
    except (OSError, ValueError):  # no such controller, or "max": no limit
        return []


@dataclass(frozen=True)
class Capacity:
    """What a machine offers to members."""

    cores: int
    memory: int  # memory for all members together [byte]
    devices: tuple[str, ...] = ()  # GPUs; empty on the CPU

    @classmethod
    def here(cls, device: str) -> "Capacity":
        """Capacity of this machine, or of its container, for the device of a site."""
        return cls(core_count(), memory_bytes(), devices_of(device))

    def holds(self, member_bytes: float) -> int:
        """How many members of that memory [byte] fit at the same time."""
        return int(MEMORY_SHARE * self.memory // max(member_bytes, 1.0))


def worker_count(workers: int | None, threads_per_worker: int, cores: int | None = None) -> int:
    """Number of workers: ``workers``, or fewer if the cores, by default those of this machine, do not suffice.

    Raises ConfigError if a number is below 1.
    """
    for name, number in (("workers", workers), ("threads_per_worker", threads_per_worker)):
        if number is not None and number < 1:
            raise ConfigError(f"{name} is {number}; at least 1 is needed")
    cores = cores or core_count()
    most = max(1, cores // threads_per_worker)
    if workers is not None and workers > most:
        text = "%d workers of %d threads need more than the %d cores; %d are used"
        LOGGER.warning(text, workers, threads_per_worker, cores, most)
    return most if workers is None else min(workers, most)


@dataclass(frozen=True)
class Share:
    """How members share a machine."""

    workers: int  # members at the same time
    threads: int  # threads of each member
    devices: tuple[str, ...] = ()  # GPUs that the workers share; empty on the CPU
    in_process: bool = False  # whether members run in this process, one after the other

    def __str__(self) -> str:
        threads = f", {self.threads} threads each" if self.threads > 1 and not self.devices else ""
        return f"{self.workers} at a time{threads}"


def share_of(device: str, members: int, workers: int | None = None, threads: int | None = None) -> Share:
    """How ``members`` share this machine, for the device of a site; see :func:`pack`."""
    return pack(Capacity.here(device), members, workers, threads)


def pack(
    capacity: Capacity, members: int, workers: int | None = None, threads: int | None = None, member_bytes: float = 0.0
) -> Share:
    """How ``members`` share the cores and the memory of a machine, or its GPUs.

    Parameters
    ----------
    capacity : Capacity
        Of the machine.
    members : int
        Members to simulate, at least 1.
    workers : int, optional
        Members at the same time. Default: one per GPU on GPUs, else one per core.
    threads : int, optional
        Threads of each member. Default: the cores divided by the members at the same time. Results do not depend on it.
    member_bytes : float
        Memory of the largest member [byte]; no more members run at the same time than fit.

    Raises
    ------
    ConfigError
        If a number is below 1.
    """
    threads = _within(capacity.cores, threads)
    allowed = worker_count(workers or len(capacity.devices) or None, threads or 1, capacity.cores)
    number = max(1, min(allowed, members, capacity.holds(member_bytes)))
    return Share(number, threads or max(1, capacity.cores // number), capacity.devices, in_process=allowed == 1)


def _within(cores: int, threads: int | None) -> int | None:
    """Threads of each member, at most the cores."""
    if threads is None or threads <= cores:
        return threads
    LOGGER.warning("%d threads of each member are more than the %d cores; %d are used", threads, cores, cores)
    return cores


def in_process(
    task: Task, groups: Sequence[Group], advance: Callable[[int, float], None], devices: Sequence[str] = ()
) -> Generator[Outcome, None, None]:
    """Outcomes of ``task`` for every member, run in this process. ``advance`` is called with member number and fraction."""
    device = devices[0] if devices else None
    for group in groups:
        yield from outcomes(group, done(task, group, advance, device))


def in_workers(
    task: Task,
    groups: Sequence[Group],
    workers: int,
    threads: int,
    advance: Callable[[int, float], None],
    devices: Sequence[str] = (),
    standby: "Standby | None" = None,
) -> Generator[Outcome, None, None]:
    """Run ``task`` for every member in worker processes; yield the outcomes in the order in which they finish.

    ``advance`` is called in this thread with the number of a running member and its fraction. Each worker uses one of ``devices``.
    Processes that have started already are taken from ``standby``.

    Raises DeviceError if no worker process can be started.
    """
    workers = min(workers, len(groups))
    memory = int(MEMORY_SHARE * memory_bytes() / workers)
    with Workforce(task, workers, threads, tuple(devices), memory, standby) as force:
        yield from feed(force, groups, advance)


class Workforce:
    """Context of worker processes of this machine. A worker that dies is replaced; all end with the context.

    Parameters
    ----------
    task : Task
        What they compute.
    workers, threads : int
        Number of workers, and threads of each.
    devices : tuple of str
        GPUs that the workers share; empty on the CPU.
    memory : int
        Memory [byte] of each worker; one that takes more is terminated.
    standby : Standby, optional
        Processes that have started already.
    """

    def __init__(
        self, task: Task, workers: int, threads: int, devices: tuple[str, ...], memory: int, standby: "Standby | None" = None
    ):
        self.task, self.devices, self.memory = packed(task), devices, memory
        self.threads, self.standby = threads, standby
        self.number, self.workers = workers, list[Worker]()

    def __enter__(self) -> "Workforce":
        try:
            self.workers += map(self._start, range(self.number))
            if self.standby:
                self.standby.dismiss()
            for worker in self.workers:  # all of them start meanwhile
                worker.assign(self.task)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self.workers:
            worker.dismiss()  # start all processes before waiting for any
        for worker in self.workers:
            worker.end()

    def _start(self, number: int) -> Worker:
        waiting = self.standby.take(number, self.threads) if self.standby else None
        return waiting or started(number, self.devices[number % len(self.devices)] if self.devices else None, self.threads)

    @property
    def busy(self) -> bool:
        """Whether a worker computes a group."""
        return any(worker.group for worker in self.workers)

    def give(self, group: Group) -> bool:
        """Start a group on a free worker; returns whether there was one."""
        idle = next((worker for worker in self.workers if not worker.group), None)
        if idle:
            idle.give(group)
        return idle is not None

    def heard(self) -> Iterator[tuple[Group, Progress | Done | Died]]:
        """Messages of workers with the groups that they compute, after a short wait. A worker that died is replaced."""
        for worker in self.speaking():
            said, group = worker.hear(), worker.group
            if isinstance(said, Ready):
                worker.ready = True
            elif isinstance(said, Progress):
                yield group, said
            elif isinstance(said, Done):
                worker.group = ()
                yield group, said
            else:
                self.replace(worker)
                yield group, Died(_death(self.memory))

    def replace(self, worker: Worker) -> None:
        """Replace a dead worker; DeviceError if it died before it had started."""
        worker.process.join(END_SECONDS)  # it has closed its connection
        worker.end()
        if not worker.ready:
            raise DeviceError(
                f"a worker process ended with exit code {worker.process.exitcode} while it started; run again with --workers 1 "
                '(a Python script that runs an ensemble needs `if __name__ == "__main__":`)'
            )
        self.workers[worker.number] = self._start(worker.number)
        self.workers[worker.number].assign(self.task)

    def speaking(self) -> list[Worker]:
        """Workers with a message or that have died, after a short wait. Workers that use too much memory are terminated."""
        closed = [worker for worker in self.workers if worker.pipe.closed]
        by_pipe = {worker.pipe: worker for worker in self.workers if not worker.pipe.closed}
        heard = wait(list(by_pipe), 0.0 if closed else LOOK_SECONDS)
        for worker in self.workers:
            if worker.group and resident_bytes(worker.process.pid or 0) > MEMORY_END * self.memory:
                worker.process.kill()
        return closed + [worker for pipe, worker in by_pipe.items() if pipe in heard]


def started(number: int, device: str | None, threads: int, imports: Sequence[str] = ()) -> Worker:
    """A new worker process with so many threads; see :func:`runout.ensemble.worker.start_worker`."""
    with START, _environment(dict.fromkeys(THREAD_VARIABLES, str(threads))):
        return start_worker(number, device, imports)


def _death(memory: int) -> str:
    return (
        f"most often because memory ran out (each worker may use {memory / 2**30:.1f} GiB); "
        "use fewer workers, a larger cell_size or fewer particles_per_cell"
    )


@contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Context that sets environment variables for new processes and restores them at the end."""
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)


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
