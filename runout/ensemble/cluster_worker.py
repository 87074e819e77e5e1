"""What runs on a worker of a dask cluster: it states what its machine offers, and computes members in processes of its own.

The client calls these functions by name. A worker needs the same version of runout and of Python, and the folder of the site under
the same path.
"""

import os
import platform
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from runout import __version__
from runout.ensemble.dispatch import Died
from runout.ensemble.worker import Done, Group, Progress, Task
from runout.ensemble.workers import MEMORY_SHARE, Capacity, Share, Workforce
from runout.errors import ClusterError, DeviceError
from runout.io import source_code

RUNS: "dict[str, Pool]" = {}  # processes of each run that uses this worker
IDLE_SECONDS = 60.0  # [s] after which the processes of a run without members end; the run may have been killed


@dataclass(frozen=True)
class Needs:
    """What a run needs from a worker."""

    device: str  # device of the site
    folder: Path  # folder of the members' files
    mark: Path  # folder that exists as long as the run does
    inputs: Mapping[Path, int]  # sizes of the input files [byte]


@dataclass(frozen=True)
class Offer:
    """What a worker states about itself."""

    # runout, python: versions
    runout: str
    python: str
    fault: str | None  # why it cannot take part; None if it can
    capacity: Capacity  # cores and memory that dask gives to the worker, and GPUs
    gpus: tuple[str, ...] = ()  # the GPUs by host and number, as workers of one host may share them
    # checksum of the sources of runout where the offer is made
    sources: str = field(default_factory=lambda: source_code.checksums().members)


def state_offer(needs: Needs, dask_worker: Any = None) -> Offer:
    """What this worker offers to a run. Dask fills in ``dask_worker``."""
    here = Capacity.here(needs.device)
    memory = dask_worker.memory_manager.memory_limit or here.memory
    cores = min(here.cores, dask_worker.state.nthreads)
    gpus = tuple(f"{socket.gethostname()}/{host_number(device)}" for device in here.devices)
    capacity = Capacity(cores, min(here.memory, memory), here.devices)
    return Offer(__version__, platform.python_version(), _fault(needs), capacity, gpus)


def host_number(device: str) -> str:
    """Number of a GPU on its host; devices are numbered among those that the worker may see."""
    seen = os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",")
    number = int(device.rpartition(":")[2] or 0)
    return seen[number] if number < len(seen) and seen[number] else str(number)


def _fault(needs: Needs) -> str | None:
    """Why this worker cannot read the inputs and write the results; None if it can."""
    if not needs.mark.is_dir():
        return f"does not see {needs.folder}; the folder must be shared under the same path"
    for path, size in needs.inputs.items():
        if not path.is_file() or path.stat().st_size != size:
            return f"does not see the input {path}; the folder must be shared under the same path"
    try:
        with tempfile.TemporaryFile(dir=needs.folder):
            return None
    except OSError as error:
        return f"cannot write to {needs.folder} ({error.strerror})"


class Pool:
    """Processes of one run on this worker, one for each member at the same time, started when first needed.

    ``share``: how members share the worker. ``memory``: memory of the worker [byte].
    """

    def __init__(self, task: Task, share: Share, memory: int):
        self.task, self.share, self.closed, self.idled = task, share, False, False
        self.memory = int(MEMORY_SHARE * memory / share.workers)
        self.forces: dict[int, Workforce] = {}
        self.free: SimpleQueue[int] = SimpleQueue()
        self.guard = threading.Lock()
        self.running, self.timer = 0, threading.Timer(IDLE_SECONDS, self._end_idle)
        for place in range(share.workers):
            self.free.put(place)

    def compute(self, group: Group, tell: Callable[[Progress], None], wanted: Callable[[], bool]) -> Done | Died:
        """Compute a group in a free process. It is terminated when the group is no longer ``wanted``."""
        with self._used() as place:
            try:
                force = self._force(place)
                force.give(group)
                while wanted() and not self.closed:
                    for _, said in force.heard():
                        if not isinstance(said, Progress):
                            return said
                        tell(said)
                ended = Died("it was no longer wanted")
            except DeviceError as error:  # no process can be started
                ended = Died(str(error))
            self._end(place)
            return ended

    @contextmanager
    def _used(self) -> Iterator[int]:
        """Context with a free place. Some time after the last one ends, all processes end."""
        with self.guard:
            self.running += 1
            self.timer.cancel()
        place = self.free.get()
        try:
            yield place
        finally:
            self.free.put(place)
            with self.guard:
                self.running -= 1
                self.timer = threading.Timer(IDLE_SECONDS, self._end_idle)
                self.timer.daemon = True
                if not self.running:
                    self.timer.start()

    def _end_idle(self) -> None:
        with self.guard:
            if self.running:
                return
            ended, self.forces, self.idled = self.forces, {}, True
        for force in ended.values():
            force.__exit__()

    def _force(self, place: int) -> Workforce:
        """Process of a place; after an error of the start there is none."""
        if place not in self.forces:
            devices = self.share.devices[place % len(self.share.devices) :][:1] if self.share.devices else ()
            force = Workforce(self.task, 1, self.share.threads, devices, self.memory)
            self.forces[place] = force.__enter__()
        return self.forces[place]

    def _end(self, place: int) -> None:
        with self.guard:
            force = self.forces.pop(place, None)
        if force:
            force.__exit__()

    def close(self) -> None:
        """End all processes."""
        self.closed = True
        self.timer.cancel()
        for place in list(self.forces):
            self._end(place)


def open_pool(run: str, task: Task, share: Share, memory: int) -> None:
    """Let this worker compute members of a run. Runs that were killed are forgotten."""
    for other in [name for name, pool in RUNS.items() if pool.idled and not pool.running]:
        del RUNS[other]
    RUNS[run] = Pool(task, share, memory)


def close_pool(run: str) -> None:
    """End the processes of a run on this worker."""
    pool = RUNS.pop(run, None)
    if pool:
        threading.Thread(target=pool.close).start()  # dask waits for this function


def compute(run: str, group: Group) -> Done | Died:
    """Compute a group of members of a run: the task of dask.

    Raises ClusterError if this worker does not know the run, since dask has started it anew.
    """
    from distributed import get_worker

    pool = RUNS.get(run)
    if pool is None:
        raise ClusterError("the worker was started anew")
    worker = get_worker()
    state = worker.state.tasks.get(worker.get_current_task())
    tell = partial(_tell, worker, run)
    return pool.compute(group, tell, lambda: getattr(state, "state", "") not in ("cancelled", "released", "forgotten"))


def _tell(worker: Any, run: str, said: Progress) -> None:
    worker.log_event(topic(run), [[number, float(fraction)] for number, fraction in said.fractions.items()])


def topic(run: str) -> str:
    """Name under which the progress of members of a run is told."""
    return f"runout-{run}"
