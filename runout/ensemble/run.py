"""Runs an ensemble. Finished members are kept, unchanged ones are not run again, and a failed member does not end the run."""

import logging
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from runout.ensemble.dispatch import Outcome
from runout.ensemble.member import Member, members_folder, plan_members, simulate_alone, simulate_together, stored_key
from runout.ensemble.status import LASTING, Failure, State, member_state
from runout.ensemble.worker import Group, Task
from runout.ensemble.workers import Share, in_process, in_workers, share_of
from runout.ensemble.written import Written
from runout.errors import DiskFullError, InputError, RunoutError
from runout.io.fingerprint import Unchanged
from runout.io.lock import exclusive, shared
from runout.io.part import remove_stale

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.result import Result

LOGGER = logging.getLogger(__name__)
LEAST_WORK = 0.01  # members that must be finished before the remaining time is estimated


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
    """

    done: tuple[int, ...] = ()
    skipped: tuple[int, ...] = ()
    failed: dict[int, str] = field(default_factory=dict)

    @property
    def valid(self) -> tuple[int, ...]:
        """All members with a result."""
        return tuple(sorted(self.done + self.skipped))

    def __str__(self) -> str:
        total = len(self.valid) + len(self.failed)
        return f"{total} members: {len(self.done)} simulated, {len(self.skipped)} already there, {len(self.failed)} failed"


@dataclass(frozen=True)
class EnsembleProgress:
    """Progress of a run.

    Attributes
    ----------
    finished, of : int
        Finished members, including failed and skipped ones, and all members.
    failed : int
        Members that failed so far.
    seconds : float
        Time since the start [s].
    remaining : float or None
        Remaining time at the present rate [s]; None while it is unknown.
    under_way : float
        Sum of the fractions of the members that are running.
    """

    finished: int
    of: int
    failed: int
    seconds: float
    remaining: float | None
    under_way: float = 0.0

    @property
    def fraction(self) -> float:
        """Finished fraction, 0 to 1, including the fractions of running members."""
        return (self.finished + self.under_way) / self.of


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
) -> EnsembleReport:
    """Run all members that have no valid result; returns a report.

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

    Raises
    ------
    StorageError
        If the folder cannot be written or another run works in it.
    InputError
        If an input of the site cannot be read, or the ensemble has no member.
    """
    results = Path(results)
    inputs = Unchanged(site.inputs())
    members, folder = plan_members(site, results), members_folder(results)
    if part is not None:
        members = [member for member in members if member.number in part]
    with exclusive(folder) if part is None else shared(folder):
        if part is None:
            remove_stale(folder)
        tally = _Tally(members, results, retry_failed, progress, inputs)
        if tally.waiting:
            share = share_of(site.settings.simulation.device, len(tally.waiting), workers, threads)
            task, groups = _work(site, tally.waiting, results, simulate, share)
            LOGGER.info("%d of %d members to simulate, %s", len(tally.waiting), len(members), share)
            if share.in_process:
                run = in_process(task, groups, tally.advance, share.devices)
            else:
                run = in_workers(task, groups, share.workers, share.threads, tally.advance, share.devices)
            try:
                with closing(run) as outcomes:
                    tally.collect(outcomes)
            finally:
                if part is None:
                    remove_stale(folder)  # temporary folders of workers that were killed
        tally.written.save()
    LOGGER.info("%s", tally.report())
    return tally.report()


def _work(
    site: "Site",
    waiting: list[Member],
    results: Path,
    simulate: "Callable[..., Result] | None",
    share: Share,
) -> tuple[Task, list[Group]]:
    """Task for the members, and groups of members. On hash, the members of a group share kernel launches; one group per worker."""
    if simulate is None and (share.devices or site.settings.simulation.backend == "hash"):
        return partial(simulate_together, site, results=results), dealt(waiting, share.workers)
    task = partial(simulate_alone, site, results=results, simulate=simulate, threads=share.threads)
    return task, [(member,) for member in (waiting if share.in_process else longest_first(waiting))]


def longest_first(members: list[Member]) -> list[Member]:
    """Members in the order in which they are started: the largest volume first, of those the least friction.

    A long member that starts last would leave the other cores idle.
    """
    return sorted(members, key=lambda m: (-_volume_factor(m), m.parameters.get("basal_friction_angle_deg", 0.0), m.number))


def dealt(members: list[Member], workers: int) -> list[Group]:
    """Members in at most ``workers`` groups of similar work, estimated from the released volume.

    Members are assigned in descending order of volume, each to the group with the least work. Members of equal volume are
    ordered by their other parameters, which spreads members with long runs over the groups. Groups are sorted by number.
    """
    groups: list[list[Member]] = [[] for _ in range(min(workers, len(members)))]
    work = [0.0] * len(groups)
    for member in sorted(members, key=lambda m: (-_volume_factor(m), *(m.parameters[name] for name in sorted(m.parameters)))):
        least = work.index(min(work))
        groups[least].append(member)
        work[least] += _volume_factor(member)
    return [tuple(sorted(group, key=lambda member: member.number)) for group in groups]


def _volume_factor(member: Member) -> float:
    """Released volume of a member relative to a volume factor of 1."""
    return member.parameters.get("release_volume_factor", 1.0)


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
            self._clear(member)  # a run was killed between writing the result and removing the failure
        elif failure and failure.lasting and not retry_failed:
            self.failed[member.number] = reason
        else:
            self.waiting.append(member)

    def collect(self, outcomes: Iterator[Outcome]) -> None:
        """Record every outcome as it arrives.

        Raises
        ------
        DiskFullError
            If the disk is full for a member; the next one could not be written either.
        InputError
            If an input has changed during the run.
        """
        try:
            for outcome in outcomes:
                self.finished_now += 1
                self.under_way.pop(outcome.member.number, None)
                if isinstance(outcome.error, DiskFullError):
                    raise outcome.error
                if outcome.error is None or self._made_elsewhere(outcome.member):
                    self._book(outcome.member)
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
        self._clear(member)

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
