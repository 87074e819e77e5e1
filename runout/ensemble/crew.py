"""Who runs the members: this process, or the worker processes of a local dask cluster."""

import logging
import os
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Protocol

from runout.backends.protocol import devices_of
from runout.ensemble.member import Member
from runout.errors import CapacityError, ConfigError, DeviceError

if TYPE_CHECKING:
    from distributed import Client, Future

LOGGER = logging.getLogger(__name__)
MEMORY_SHARE = 0.9  # of the machine, for all workers together
TICK_SECONDS = 0.5  # between two words of a worker on the members that run
TOPIC = "runout-progress"
RESTART_SECONDS = 60  # to wait for a new worker in place of a dead one
THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
CLUSTER_SETTINGS = {
    "distributed.worker.multiprocessing-method": "spawn",  # a fork after numba has started its threads kills the child
    "distributed.scheduler.allowed-failures": 0,  # the retry is ours: dask would also blame members that waited nearby
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # a paused worker would wait for ever: a member frees nothing before its end
    "distributed.worker.memory.terminate": 0.95,
    "distributed.worker.profile.enabled": False,  # a look at every frame a hundred times a second takes the steps' interpreter
    "distributed.nanny.pre-spawn-environ": {},  # dask's makes malloc give back every array, and the next one fault in anew
}


@dataclass(frozen=True)
class Outcome:
    """A member that is finished, with its error if it failed."""

    member: Member
    error: BaseException | None = None


class WorkerDeathError(CapacityError):
    """A member whose worker process died, most often because memory ran out."""


def worker_count(workers: int | None, threads_per_worker: int) -> int:
    """Number of workers that the cores allow, at most ``workers``.

    Raises
    ------
    ConfigError
        If a number is below 1.
    """
    from dask.system import CPU_COUNT

    for name, number in (("workers", workers), ("threads_per_worker", threads_per_worker)):
        if number is not None and number < 1:
            raise ConfigError(f"{name} is {number}; at least 1 is needed")
    most = max(1, CPU_COUNT // threads_per_worker)
    if workers is not None and workers > most:
        text = "%d workers of %d threads need more than the %d cores; %d are used"
        LOGGER.warning(text, workers, threads_per_worker, CPU_COUNT, most)
    return most if workers is None else min(workers, most)


def crew_for(device: str, workers: int | None, threads_per_worker: int) -> tuple[int, tuple[str, ...]]:
    """Number of workers for members on a ``device``, one per GPU if nothing else is asked for, and the GPUs that they share.

    Raises
    ------
    ConfigError, DeviceError
        If a number is below 1, or the device is not there.
    """
    devices = devices_of(device)
    return worker_count(workers or len(devices) or None, threads_per_worker), devices


Group = tuple[Member, ...]  # members that are computed together: one, or many in the launches of a GPU


class Task(Protocol):
    """What is done with a group of members; returns the errors of those that failed, by number.

    ``progress`` is to be called with the number of a member and the fraction of it that is done, 0 to 1; ``device`` is one of the
    GPUs that the members share, None where they do not.
    """

    def __call__(
        self, group: Group, /, *, progress: Callable[[int, float], None], device: str | None
    ) -> Mapping[int, BaseException]: ...


def in_process(
    task: Task, groups: Sequence[Group], advance: Callable[[int, float], None], devices: Sequence[str] = ()
) -> Generator[Outcome, None, None]:
    """Outcomes of ``task`` for every member, run here group by group; ``advance`` hears a member's number and fraction."""
    device = devices[0] if devices else None
    from dask.local import synchronous_executor

    for group in groups:
        future = synchronous_executor.submit(task, group, progress=advance, device=device)
        error = future.exception()
        if error is not None and not isinstance(error, Exception):
            raise error  # an interrupt ends the run, a failed member does not
        yield from _outcomes(group, error, {} if error else future.result())


def _outcomes(group: Group, error: BaseException | None, errors: Mapping[int, BaseException]) -> Iterator[Outcome]:
    """Outcomes of members whose group ended with an error, or with errors of its own of some of them."""
    for member in group:
        yield Outcome(member, error or errors.get(member.number))


def in_cluster(
    task: Task,
    groups: Sequence[Group],
    workers: int,
    threads: int,
    advance: Callable[[int, float], None],
    devices: Sequence[str] = (),
) -> Generator[Outcome, None, None]:
    """Outcomes of ``task`` for every member as they come, run in worker processes of ``threads`` threads each.

    ``advance`` is called in this thread with the number of a member that runs and its fraction. The workers share the GPUs
    ``devices``, each keeping to one.
    """
    import dask
    from distributed import Client, LocalCluster
    from distributed.system import MEMORY_LIMIT

    workers = min(workers, len(groups))
    memory = int(MEMORY_SHARE * MEMORY_LIMIT / workers)
    with (
        _environment(dict.fromkeys(THREAD_VARIABLES, str(threads))),
        dask.config.set(CLUSTER_SETTINGS),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=memory,
            dashboard_address="127.0.0.1:0",  # any free port: with None dask warns when its usual port is taken
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        heard: dict[int, float] = {}
        client.subscribe_topic(TOPIC, lambda event: heard.update(event[1]))
        yield from _feed(client, partial(_silent, task, tuple(devices)), groups, workers, memory, lambda: _pass_on(heard, advance))


def _feed(
    client: "Client",
    task: Callable[[Group], Mapping[int, BaseException]],
    groups: Sequence[Group],
    workers: int,
    memory: int,
    tick: Callable[[], None],
) -> Generator[Outcome, None, None]:
    """Outcomes of members, never more groups under way than workers alive; a member whose worker dies is tried once more, alone.

    ``tick`` is called now and then meanwhile.
    """
    from distributed import KilledWorker

    waiting, died, running = deque(groups), set[int](), dict["Future", Group]()
    while waiting or running:
        while waiting and len(running) < workers:
            group = waiting.popleft()
            running[client.submit(task, group, pure=False)] = group
        for future in _first_done(list(running), tick):
            group, error = running.pop(future), future.exception()
            if not isinstance(error, KilledWorker):
                whole = error and error.with_traceback(future.traceback())
                yield from _outcomes(group, whole, {} if error else future.result())
                continue
            workers = _workers_again(client, workers)
            LOGGER.warning("the worker of %s died", ", ".join(f"member {member.number}" for member in group))
            yield from (Outcome(member, _death(memory)) for member in group if member.number in died)
            again = [member for member in group if member.number not in died]
            died.update(member.number for member in again)
            waiting.extend((member,) for member in again)


def _first_done(futures: "list[Future]", tick: Callable[[], None]) -> "set[Future]":
    """The futures that are done, as soon as there is one."""
    from distributed import wait

    while True:
        try:
            return wait(futures, timeout=TICK_SECONDS, return_when="FIRST_COMPLETED").done  # type: ignore[no-any-return]
        except TimeoutError:
            tick()


def _pass_on(heard: dict[int, float], advance: Callable[[int, float], None]) -> None:
    """Tell what has been heard from the workers since the last time."""
    while heard:
        advance(*heard.popitem())


def _silent(task: Task, devices: Sequence[str], group: Group) -> Mapping[int, BaseException]:
    """Run a task in a worker without its messages: the process that started it has said what the inputs have to say."""
    from distributed import get_worker

    worker, fractions, told = get_worker(), dict[int, float](), time.monotonic()

    def tell(number: int, fraction: float) -> None:
        nonlocal told
        fractions[number] = fraction
        if time.monotonic() - told >= TICK_SECONDS:  # one word for the whole group: members that share a launch are many
            told = time.monotonic()
            worker.log_event(TOPIC, list(fractions.items()))
            fractions.clear()

    logging.getLogger("runout").addHandler(logging.NullHandler())
    device = devices[int(worker.name) % len(devices)] if devices else None  # a local cluster numbers its workers
    return task(group, progress=tell, device=device)


def _workers_again(client: "Client", workers: int) -> int:
    """Number of workers alive after waiting for a new one in place of a dead one."""
    try:
        client.wait_for_workers(workers, timeout=RESTART_SECONDS)
    except TimeoutError:
        workers = len(client.nthreads())
    if workers == 0:
        raise DeviceError("no worker process could be started again after the last one died; run again with fewer workers")
    return workers


def _death(memory: int) -> WorkerDeathError:
    return WorkerDeathError(
        f"its process died twice, most often because memory ran out (each worker may use {memory / 2**30:.1f} GiB); "
        "use fewer workers, a larger cell_size or fewer particles_per_cell"
    )


@contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Set environment variables that new processes see when they start; dask adds some of its own. All are undone."""
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)
