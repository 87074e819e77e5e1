"""The members that are left to simulate: their task, and the groups in which workers compute them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from runout.ensemble.member import Member, simulate_alone, simulate_together
from runout.ensemble.worker import Group, Task
from runout.ensemble.workers import Share

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.simulation.result import Result

MOST_TOGETHER = 32  # members that share the launches of a GPU of a cluster; the others go to workers that come later


@dataclass(frozen=True)
class Work:
    """Members to simulate."""

    site: "Site"
    members: tuple[Member, ...]
    results: Path
    simulate: "Callable[..., Result] | None" = None  # replaces :func:`runout.simulate`

    @property
    def device(self) -> str:
        """Device of the site."""
        return str(self.site.settings.simulation.device)

    @property
    def together(self) -> bool:
        """Whether the members of a group share kernel launches (backend hash); those with an inflow run alone."""
        if self.simulate is not None:
            return False
        hashed = self.device.startswith("cuda") or self.site.settings.simulation.backend == "hash"
        return hashed and not self.site.settings.inflow

    def task(self, share: Share) -> Task:
        """What a worker of a share does with a group."""
        if self.together:
            return partial(simulate_together, self.site, results=self.results)
        return partial(simulate_alone, self.site, results=self.results, simulate=self.simulate, threads=share.threads)

    def groups(self, share: Share | None = None) -> list[Group]:
        """Groups of members for a share of this machine: one per worker if they run together. None: for a cluster."""
        members = list(self.members)
        if self.together:
            return dealt(members, share.workers if share else math.ceil(len(members) / MOST_TOGETHER))
        return [(member,) for member in (members if share and share.in_process else longest_first(members))]


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
