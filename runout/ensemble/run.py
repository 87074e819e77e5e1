"""Runs an ensemble. Finished members are kept, unchanged ones are not run again, and a failed member does not end the run."""

import logging
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from runout.ensemble.cluster import Cluster
from runout.ensemble.design import Design
from runout.ensemble.dispatch import Outcome
from runout.ensemble.fleet import Order, on_cluster
from runout.ensemble.member import Member, members_folder, plan_members, stored_key
from runout.ensemble.status import LASTING, Failure, State, member_state
from runout.ensemble.work import Work
from runout.ensemble.work_log import log_work_of_file
from runout.ensemble.workers import Share, in_process, in_workers, share_of
from runout.ensemble.written import Written
from runout.errors import DiskFullError, InputError, RunoutError
from runout.io.fingerprint import Unchanged
from runout.io.lock import exclusive, shared
from runout.io.part import remove_stale
from runout.io.places import require_own_results
from runout.model.facts import as_html, as_text

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.ensemble.workers import Standby
    from runout.simulation.result import Result

LOGGER = logging.getLogger(__name__)
MOST_REASONS = 10  # of failed members, in the representation of a report
LEAST_WORK = 0.25  # members that must be finished before the remaining time is estimated


@dataclass(frozen=True)
class EnsembleReport:
    """Result of a run of an ensemble.

    Attributes
    ----------
    done : tuple of int
        Members simulated in this run.
    skipped : tuple of int
        Members with an earlier result.
    failed : dict of int to str
        Members without a result, with the reason.
    growth : str
        What an ensemble with a tolerance was asked for and reached, and why it stopped; empty for others.
    """

    done: tuple[int, ...] = ()
    skipped: tuple[int, ...] = ()
    failed: dict[int, str] = field(default_factory=dict)
    growth: str = ""

    @property
    def members(self) -> int:
        """Number of members that have run."""
        return len(self.done) + len(self.skipped) + len(self.failed)

    @property
    def valid(self) -> tuple[int, ...]:
        """All members with a result."""
        return tuple(sorted(self.done + self.skipped))

    def joined(self, other: "EnsembleReport") -> "EnsembleReport":
        """Report of this run and that of other members."""
        return EnsembleReport(self.done + other.done, self.skipped + other.skipped, {**self.failed, **other.failed})

    def __str__(self) -> str:
        return f"{self.members} members: {len(self.done)} simulated, {len(self.skipped)} already there, {len(self.failed)} failed"

    def _facts(self) -> dict[str, str]:
        numbers = (self.members, len(self.done), len(self.skipped), len(self.failed))
        counts = dict(zip(("members", "simulated", "already there", "failed"), numbers, strict=True))
        shown = list(self.failed.items())[:MOST_REASONS]
        facts = {name: str(count) for name, count in counts.items()} | {f"member {n} failed": why for n, why in shown}
        return facts | ({"growth": self.growth} if self.growth else {})

    def __repr__(self) -> str:
        return as_text("EnsembleReport", self._facts())

    def _repr_html_(self) -> str:
        return as_html("EnsembleReport", self._facts())


@dataclass(frozen=True)
class EnsembleProgress:
    """Progress of a run."""

    # finished, of: finished members, including failed and skipped ones, and all members
    finished: int
    of: int
    failed: int  # members that failed so far
    seconds: float  # time since the start [s]
    remaining: float | None  # remaining time at the present rate [s]; None while it is unknown
    under_way: float = 0.0  # sum of the fractions of the members that are running

    @property
    def fraction(self) -> float:
        """Finished fraction, 0 to 1, including the fractions of running members."""
        return (self.finished + self.under_way) / self.of

    def show(self, update: Callable[..., None]) -> None:
        """State the progress by a function of :func:`runout.log.progress`."""
        update(self.fraction, f"{self.finished} of {self.of} members", self.remaining)


def run_ensemble(
    site: "Site",
    results: Path,
    *,
    workers: int | None = None,
    threads: int | None = None,
    progress: Callable[[EnsembleProgress], None] | None = None,
    retry_failed: bool = False,
    simulate: "Callable[..., Result] | None" = None,
    part: range | None = None,
    cluster: Cluster | None = None,
    member_bytes: float = 0.0,
    standby: "Standby | None" = None,
    design: Design | None = None,
) -> EnsembleReport:
    """Run all members that have no valid result; returns a report.

    :func:`runout.workflow.growth.grow` runs as many as ``ensemble.tolerance`` needs.

    Results go to ``results/members/``, to files named by all that a member depends on: those of other settings stay valid.
    Reasons of failure go to ``*.failed.json`` beside them. The run can be killed at any time and called again. With more than
    one worker, members run in other processes, and the calling script needs ``if __name__ == "__main__":``.

    Parameters
    ----------
    site : Site
    results : Path
        Folder of the results; created if missing.
    workers : int, optional
        Members at the same time, at most one per core. Default: one per GPU on GPUs, else as many as the cores allow. 1 runs
        in this process.
    threads : int, optional
        Threads of each simulation. Default: the cores divided by the members at the same time.
    progress : callable, optional
        Called in this process at the start, after every member, and periodically while members run.
    retry_failed : bool
        Also repeat members whose failure is permanent.
    simulate : callable, optional
        Replaces :func:`runout.simulate`. It must be importable by name, since it is pickled for other processes.
    part : range, optional
        Numbers of the members to run; all if None. Several processes, also on several machines, may run parts in one folder at
        the same time.
    cluster : Cluster, optional
        Dask cluster that computes the members. Its workers see the folders under the same absolute paths.
    member_bytes : float
        Memory of the largest member [byte]; each worker of a cluster takes as many members as fit.
    standby : Standby, optional
        Worker processes of this machine that have started already.
    design : Design, optional
        Parameters and seeds of other members than those of site.yaml.

    Raises
    ------
    ClusterError
        If no worker of the cluster can compute members.
    StorageError
        If the folder cannot be written or another run works in it.
    ConfigError
        If something else lies in the place of the folder, of one of its files or folders (see :mod:`runout.io.places`).
    InputError
        If an input of the site cannot be read, or the ensemble has no member.
    """
    results = Path(results).absolute() if cluster else Path(results)
    require_own_results(results)
    inputs = Unchanged(site.inputs())
    members, folder = plan_members(site, design), members_folder(results)
    if part is not None:
        members = [member for member in members if member.number in part]
    with exclusive(folder) if part is None else shared(folder):
        if part is None:
            remove_stale(folder)
        tally = _Tally(members, results, retry_failed, progress, inputs)
        if tally.waiting:
            work = Work(site, tuple(tally.waiting), results, simulate)
            if cluster:
                LOGGER.info("%d of %d members to simulate, on a cluster", len(work.members), tally.of)
                run = on_cluster(cluster, Order(work, workers, threads, member_bytes), tally.advance)
            else:
                run = _on_this_machine(work, share_of(work.device, len(work.members), workers, threads), tally, standby)
            try:
                with closing(run) as outcomes:
                    tally.collect(outcomes)
            finally:
                if part is None:
                    remove_stale(folder)  # temporary folders of workers that were killed
        tally.written.save()
    LOGGER.info("%s", tally.report())
    return tally.report()


def _on_this_machine(work: Work, share: Share, tally: "_Tally", standby: "Standby | None") -> Generator[Outcome, None, None]:
    """Outcomes of members that this process or worker processes compute."""
    task, groups = work.task(share), work.groups(share)
    LOGGER.info("%d of %d members to simulate, %s", len(work.members), tally.of, share)
    tally.elsewhere = not share.in_process
    if share.in_process:
        return in_process(task, groups, tally.advance, share.devices)
    return in_workers(task, groups, share.workers, share.threads, tally.advance, share.devices, standby)


class _Tally:
    """Counts finished members and reports the progress of the run."""

    def __init__(
        self,
        members: list[Member],
        results: Path,
        retry_failed: bool,
        progress: Callable[[EnsembleProgress], None] | None,
        inputs: Unchanged,
    ):
        self.inputs, self.written = inputs, Written(results)
        self.results, self.progress, self.of = results, progress, len(members)
        self.start, self.finished_now = time.perf_counter(), 0
        self.done: list[int] = []
        self.skipped: list[int] = []
        self.failed: dict[int, str] = {}
        self.waiting: list[Member] = []
        self.under_way: dict[int, float] = {}
        self.elsewhere = True  # whether members run in other processes
        self.leftovers = _leftovers(members_folder(results))
        for member in members:
            self._sort(member, retry_failed)
        self.written.withdraw(member.file(results) for member in self.waiting)
        self._tell()

    def _sort(self, member: Member, retry_failed: bool) -> None:
        file = member.file(self.results)
        found = self.written.look(file)
        if found.fault and file.exists():
            LOGGER.warning("member %d: its file %s; it is simulated again", member.number, found.fault)
        if found.fault:
            self.written.forget(file)
        elif found.key and not found.noted:
            self.written.note(file, found.key)
        state, reason = member_state(member, self.results, self.written)
        failure = Failure.read(member.failure_file(self.results)) if state is State.FAILED else None
        if state is State.DONE:
            self.skipped.append(member.number)
            if _stem(file) in self.leftovers:  # a run was killed between writing the result and removing the failure
                self._clear(member)
        elif failure and failure.lasting and not retry_failed:
            self.failed[member.number] = reason
        else:
            self.waiting.append(member)

    def collect(self, outcomes: Iterator[Outcome]) -> None:
        """Record every outcome as it arrives.

        Raises DiskFullError if the disk is full for a member; the next one could not be written either. Raises InputError if an
        input has changed during the run.
        """
        try:
            for outcome in outcomes:
                self.finished_now += 1
                self.under_way.pop(outcome.member.number, None)
                if isinstance(outcome.error, DiskFullError):
                    raise outcome.error
                if outcome.error is None or self._made_elsewhere(outcome.member):
                    self._book(outcome.member)
                    self._say_done(outcome)
                else:
                    self._book_failure(outcome.member, _failure(outcome.member, outcome.error))
                self._tell()
        finally:
            self.written.save()

    def _made_elsewhere(self, member: Member) -> bool:
        """Whether another job has finished a member that failed here."""
        return stored_key(member.file(self.results)) == member.key

    def _book(self, member: Member) -> None:
        file = member.file(self.results)
        try:
            self.inputs.require()
        except InputError:
            self.written.forget(file)
            raise
        self.written.note(file, member.key)
        self.done.append(member.number)
        if self.elsewhere:  # else the member has logged it; this process opens no file between two that it writes
            log_work_of_file(member.number, file)
        self._clear(member)

    def _say_done(self, outcome: Outcome) -> None:
        """Log the end of a member as a detail; the line of progress counts it."""
        member, seconds = outcome.member, outcome.seconds
        took = "" if seconds is None else f" in {seconds:.1f} s"
        finished = self.of - len(self.waiting) + self.finished_now
        told = (member.number, member.name, took, finished, self.of)
        LOGGER.debug("member %d (%s) done%s, %d of %d", *told, extra={"member": member.number})

    def _book_failure(self, member: Member, failure: Failure) -> None:
        self.failed[member.number] = failure.reason
        failure.write(member.failure_file(self.results))
        if failure.lasting:
            member.checkpoint_file(self.results).unlink(missing_ok=True)
        LOGGER.warning("member %d failed: %s", member.number, failure.reason)

    def advance(self, member: int, fraction: float) -> None:
        """Record the fraction, 0 to 1, of a running member."""
        if fraction != self.under_way.get(member):
            self.under_way[member] = fraction
            self._tell()

    def _clear(self, member: Member) -> None:
        """Remove files of earlier attempts at a finished member."""
        member.failure_file(self.results).unlink(missing_ok=True)
        member.checkpoint_file(self.results).unlink(missing_ok=True)

    def _tell(self) -> None:
        if self.progress is None:
            return
        seconds = time.perf_counter() - self.start
        left, under_way = len(self.waiting) - self.finished_now, sum(self.under_way.values())
        work = self.finished_now + under_way
        remaining = seconds / work * (left - under_way) if work > LEAST_WORK else (None if left else 0.0)
        self.progress(EnsembleProgress(self.of - left, self.of, len(self.failed), seconds, remaining, under_way))

    def report(self) -> EnsembleReport:
        """Report of the run."""
        return EnsembleReport(tuple(sorted(self.done)), tuple(self.skipped), dict(sorted(self.failed.items())))


def _leftovers(folder: Path) -> set[str]:
    """Stems of the files of failures and checkpoints, found in one look at the folder: a look per member would take long."""
    return {_stem(path) for path in folder.iterdir() if path.suffix != ".nc"}


def _stem(path: Path) -> str:
    return path.name.partition(".")[0]


def _failure(member: Member, error: BaseException) -> Failure:
    """Failure of a member. The text of a RunoutError is for users; any other error is a bug and keeps its traceback."""
    known = isinstance(error, RunoutError)
    reason = str(error) if known else f"{type(error).__name__}: {error} (an error inside runout; please report it)"
    return Failure(
        member=member.number,
        reason=reason,
        type=type(error).__name__,
        key=member.key,
        lasting=isinstance(error, LASTING),
        parameters=member.parameters,
        seed=member.seed,
        traceback="" if known else "".join(traceback.format_exception(error)),
    )
