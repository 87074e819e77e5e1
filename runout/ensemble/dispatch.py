"""Gives groups of members to workers, wherever these run, and repeats members whose worker died."""

import logging
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from runout.ensemble.member import Member
from runout.ensemble.worker import Done, Group, Progress
from runout.errors import CapacityError

LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome:
    """A finished member, with its error if it failed, and the seconds that it took; None for one of several together."""

    member: Member
    error: BaseException | None = None
    seconds: float | None = None


class WorkerDeathError(CapacityError):
    """A member whose worker died, most often because memory ran out."""


@dataclass(frozen=True)
class Died:
    """The worker of a group has died; ``reason`` says what is known about it, and what to do."""

    reason: str


class Crew(Protocol):
    """Workers that compute groups of members: processes of this machine, or workers of a cluster."""

    @property
    def busy(self) -> bool:
        """Whether a worker computes a group."""

    def give(self, group: Group) -> bool:
        """Start a group on a free worker; returns whether there was one."""

    def heard(self) -> Iterable[tuple[Group, Progress | Done | Died]]:
        """Messages of workers with the groups that they compute, after a short wait. A worker that died is replaced."""


def feed(crew: Crew, groups: Sequence[Group], advance: Callable[[int, float], None]) -> Generator[Outcome, None, None]:
    """Outcomes of members in the order in which they finish. A member whose worker dies is repeated once, alone.

    ``advance`` is called in this thread with the number of a running member and its fraction.
    """
    waiting, died = deque(groups), set[int]()
    while waiting or crew.busy:
        while waiting and crew.give(waiting[0]):
            waiting.popleft()
        for group, said in crew.heard():
            if isinstance(said, Progress):
                for number, fraction in said.fractions.items():
                    advance(number, fraction)
            elif isinstance(said, Done):
                for warning in said.said:
                    warning.repeat()
                yield from outcomes(group, said)
            else:
                LOGGER.warning("the worker of %s died", ", ".join(f"member {member.number}" for member in group))
                yield from (Outcome(member, _death(said)) for member in group if member.number in died)
                again = [member for member in group if member.number not in died]
                died.update(member.number for member in again)
                waiting.extend((member,) for member in again)


def outcomes(group: Group, ended: Done) -> Iterator[Outcome]:
    """Outcomes of the members of a group that ended with an error of the group or with errors of members."""
    for member in group:
        yield Outcome(member, ended.error or ended.errors.get(member.number), ended.seconds if len(group) == 1 else None)


def _death(said: Died) -> WorkerDeathError:
    return WorkerDeathError(f"its process died twice, {said.reason}")
