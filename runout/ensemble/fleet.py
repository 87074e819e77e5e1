"""Computes members on the workers of a dask cluster, each packed by its cores, memory and GPUs."""

import logging
import math
import os
import platform
import queue
import time
import uuid
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout import __version__
from runout.ensemble import cluster_worker
from runout.ensemble.cluster import Cluster
from runout.ensemble.cluster_worker import Needs, Offer
from runout.ensemble.dispatch import Died, Outcome, feed
from runout.ensemble.member import members_folder
from runout.ensemble.work import Work
from runout.ensemble.worker import Done, Group, Progress
from runout.ensemble.workers import Capacity, Share, pack
from runout.errors import ClusterError
from runout.io import source_code
from runout.io.part import part_folder

if TYPE_CHECKING:
    from distributed import Client, Future

LOGGER = logging.getLogger(__name__)
LOOK_SECONDS = 1.0  # [s] between two looks at the list of workers
RESULT_SECONDS = 30.0  # [s] to fetch the message on the end of a group
ARRIVAL_SECONDS = 60.0  # [s] until a file of another machine is seen here, at most
MOST_REASONS = 5  # that an error lists
GIGABYTE = 1e9


@dataclass(frozen=True)
class Order:
    """Members to compute, and how each worker of the cluster shares its machine among them."""

    work: Work
    # workers, threads: members at the same time on each worker of the cluster, and threads of each member, as of :func:`pack`
    workers: int | None = None
    threads: int | None = None
    member_bytes: float = 0.0  # memory of the largest member [byte]; 0 if unknown


def on_cluster(cluster: Cluster, order: Order, advance: Callable[[int, float], None]) -> Generator[Outcome, None, None]:
    """Outcomes of the members of an order, in the order in which they finish.

    Raises ClusterError if the cluster cannot be reached, no worker fits, or the connection is lost.
    """
    work = order.work
    with part_folder(work.results / "cluster") as mark, cluster.connect(mark) as (client, replace):
        inputs = {path: path.stat().st_size for path in map(Path, work.site.inputs()) if path.is_file()}
        needs = Needs(work.device, members_folder(work.results), mark, inputs)
        with closing(Fleet(client, order, needs, replace)) as fleet:
            for outcome in feed(fleet, work.groups(), advance):
                member, seconds = outcome.member, outcome.seconds
                yield outcome if outcome.error else Outcome(member, _unseen(member.file(work.results)), seconds)


def _unseen(path: Path) -> ClusterError | None:
    """Error if a file that another machine has written does not appear here."""
    end = time.monotonic() + ARRIVAL_SECONDS
    while not path.is_file():
        if time.monotonic() > end:
            return ClusterError(f"{path}: a worker has written this file, but this machine does not see it; is the folder shared?")
        os.listdir(path.parent)  # lets a network file system look again
        time.sleep(0.1)
    return None


def _disconnected() -> ClusterError:
    return ClusterError("the connection to the scheduler was lost; finished members are kept, run again")


@dataclass
class Berth:
    """A worker of the cluster: its share, and how many members it computes."""

    share: Share
    gpus: tuple[str, ...] = ()
    running: int = 0

    @property
    def free(self) -> int:
        """Number of members that it can take."""
        return self.share.workers - self.running


@dataclass
class Fleet:
    """Workers of a cluster that compute members of one run; see :class:`runout.ensemble.dispatch.Crew`.

    Workers may come and go. A group belongs to one worker, so that dask never moves or repeats it.
    """

    client: "Client"
    order: Order
    needs: Needs
    replace: Callable[[], object]
    run: str = field(default_factory=lambda: uuid.uuid4().hex)
    berths: dict[str, Berth] = field(default_factory=dict)
    unfit: dict[str, str] = field(default_factory=dict)
    computing: "dict[Future, tuple[str, Group]]" = field(default_factory=dict)
    messages: "queue.SimpleQueue[Any]" = field(default_factory=queue.SimpleQueue)
    lost: int = 0
    looked: float = -LOOK_SECONDS

    def __post_init__(self) -> None:
        self.client.subscribe_topic(cluster_worker.topic(self.run), self._progressed)
        self._look()
        if not self.berths and not self.unfit:
            LOGGER.info("waiting for the first worker of the cluster")

    def _progressed(self, event: tuple[float, list[list[float]]]) -> None:
        self.messages.put(Progress({int(number): fraction for number, fraction in event[1]}))

    @property
    def busy(self) -> bool:
        """Whether a worker computes a group."""
        return bool(self.computing) or not self.messages.empty()

    def give(self, group: Group) -> bool:
        """Start a group on the worker with the most free places; returns whether there was one."""
        address = max(self.berths, key=lambda one: self.berths[one].free, default=None)
        if address is None or self.berths[address].free < 1:
            return False
        self.berths[address].running += 1
        future = self.client.submit(cluster_worker.compute, self.run, group, workers=[address], pure=False, retries=0)
        self.computing[future] = (address, group)
        future.add_done_callback(self.messages.put)
        return True

    def heard(self) -> Iterator[tuple[Group, Progress | Done | Died]]:
        """Messages of workers with the groups that they compute, after a short wait."""
        with suppress(queue.Empty):
            said = self.messages.get(timeout=LOOK_SECONDS)
            if isinstance(said, Progress):
                yield (), said
            elif said in self.computing:
                yield self._ended(said)
        if time.monotonic() - self.looked > LOOK_SECONDS:
            yield from self._look()

    def _ended(self, future: "Future") -> tuple[Group, Done | Died]:
        address, group = self.computing.pop(future)
        if address in self.berths:
            self.berths[address].running -= 1
        if future.cancelled():
            raise _disconnected()
        with suppress(OSError, TimeoutError):
            error = future.exception(timeout=RESULT_SECONDS)
            if error is None:
                return group, future.result(timeout=RESULT_SECONDS)
            self.berths.pop(address, None)  # it is looked at again, as one that dask started anew
            return group, Died(f"the last one, {address}, could not compute it ({type(error).__name__}: {error})")
        return group, Died(f"the last one, {address}, did not answer")

    def _look(self) -> list[tuple[Group, Died]]:
        """Take note of new and lost workers; returns the groups of the lost ones."""
        try:
            present = set(self.client.nthreads())
        except (OSError, TimeoutError) as cause:
            raise ClusterError(
                f"the connection to the scheduler was lost ({cause}); finished members are kept, run again"
            ) from cause
        lost = set(self.berths) - present
        gone = [(future, place) for future, place in self.computing.items() if place[0] in lost]
        for future, _ in gone:
            del self.computing[future]
            future.cancel()
        for address in lost:
            del self.berths[address]
        self.unfit = {address: reason for address, reason in self.unfit.items() if address in present}
        self._admit(sorted(present - set(self.berths) - set(self.unfit)))
        if lost:
            LOGGER.warning("lost %d workers of the cluster, %d are left", len(lost), len(self.berths))
        self.lost += len(lost)
        if self.lost:
            self.replace()  # again and again, since dask waits until it considers a job as lost
        self.looked = time.monotonic()
        return [(group, Died(f"the last one, {address}, was lost; see its log")) for _, (address, group) in gone]

    def _admit(self, addresses: list[str]) -> None:
        """Take workers that can compute members into the fleet.

        Raises ClusterError if the cluster has workers, but none that can.
        """
        if not addresses:
            return
        offers = self.client.run(cluster_worker.state_offer, self.needs, workers=addresses, on_error="return")
        for address in addresses:
            reason = self._reason(offers.get(address)) or self._open(address, offers[address], len(addresses))
            if reason:
                self.unfit[address] = reason
                LOGGER.warning("worker %s of the cluster is not used: it %s", address, reason)
        if not self.berths:
            reasons = [f"{address} {reason}" for address, reason in self.unfit.items()]
            more = [f"and {len(reasons) - MOST_REASONS} more"] if len(reasons) > MOST_REASONS else []
            raise ClusterError("no worker of the cluster can compute members: " + "; ".join(reasons[:MOST_REASONS] + more))

    def _reason(self, offer: Any) -> str | None:
        """Why a worker cannot take part; None if it can."""
        if not isinstance(offer, Offer):
            return f"cannot run runout {__version__}; install it there ({type(offer).__name__}: {offer})"
        python = platform.python_version_tuple()[:2]
        if offer.runout != __version__:
            return f"has runout {offer.runout}, here it is {__version__}; install the same version"
        if offer.sources != source_code.checksums().members:
            return f"has other sources of runout {__version__} than this machine; install the same state of it"
        if tuple(offer.python.split(".")[:2]) != python:
            return f"has Python {offer.python}, here it is {'.'.join(python)}; use the same version"
        if offer.capacity.holds(self.order.member_bytes) < 1:
            needed = self.order.member_bytes / GIGABYTE
            return f"has {offer.capacity.memory / GIGABYTE:.3g} GB of memory, a member needs about {needed:.3g} GB"
        return offer.fault

    def _open(self, address: str, offer: Offer, newcomers: int) -> str | None:
        """Give a worker its share, with the GPUs that no other worker of its host has; returns why it cannot take part."""
        taken = {gpu for berth in self.berths.values() for gpu in berth.gpus}
        free = {gpu: device for gpu, device in zip(offer.gpus, offer.capacity.devices, strict=True) if gpu not in taken}
        if self.needs.device.startswith("cuda") and not free:
            return "has no GPU, or others use it"
        capacity = Capacity(offer.capacity.cores, offer.capacity.memory, tuple(free.values()))
        each = math.ceil(len(self.order.work.members) / max(1, len(self.berths) + newcomers))
        share = pack(capacity, each, self.order.workers, self.order.threads, self.order.member_bytes)
        opened = self.run, self.order.work.task(share), share, capacity.memory
        answer = self.client.run(cluster_worker.open_pool, *opened, workers=[address], on_error="return").get(address)
        if answer is not None:
            return f"did not start ({answer})"
        self.berths[address] = Berth(share, tuple(free))
        LOGGER.info("worker %s of the cluster: %s", address, share)
        return None

    def close(self) -> None:
        """End what the workers still compute."""
        with suppress(OSError, TimeoutError):
            self.client.cancel(list(self.computing))
            self.client.run(cluster_worker.close_pool, self.run, workers=list(self.berths), on_error="ignore")
