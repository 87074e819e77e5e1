"""Forecasts particles, steps, time, memory and disk of a run without its particles."""

import logging
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.backends.protocol import bytes_on_host
from runout.config.inflow import FACTOR
from runout.config.member_arguments import failing
from runout.config.scenarios import FAILS
from runout.errors import BudgetError, CapacityError
from runout.forecast import engine_notes
from runout.forecast.memory import GIGABYTE, Extent, MemoryForecast, available_bytes, expected_memory, with_births, with_inflow
from runout.forecast.step_cost import TYPICAL, engine_for, step_cost
from runout.log import duration
from runout.model.friction_laws import FrictionLaw
from runout.model.limits import spacing_of
from runout.model.numerics import Numerics
from runout.quantities import bed_map_names, member_map_names
from runout.simulation.scenario import build_scene, scene_arguments
from runout.simulation.structure_forces import named_structures
from runout.workflow.check_stiffness import VOLUME
from runout.workflow.flow_forecast import masses_of, member_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from runout.config.site import Site
    from runout.ensemble.member import Member
    from runout.forecast.engine_notes import StepCost

    CostOf = Callable[[Mapping[str, Any]], StepCost]

LOGGER = logging.getLogger(__name__)
SETUP_SECONDS = 0.3  # time of a member beside its steps [s]
START_SECONDS = 8.0  # start of a worker process [s]: imports, compiled code from the cache
CROWDING = 1.2  # time on a core while the others are busy, relative to an idle machine
CHECKPOINT_BYTES = {"float32": 130, "float64": 240}  # of disk per particle, while its member runs


@dataclass(frozen=True)
class Forecast:
    """Forecast of a run for the remaining members."""

    members: int  # members to simulate
    workers: int  # members that run at the same time
    # particles, steps: number of particles and of steps of the member with the largest volume factor
    particles: int
    steps: int
    member_seconds: float  # time of that member on one core [s]
    seconds: float  # time of all members [s]
    # memory, disk: memory of all workers together, and disk space of all results [bytes]
    memory: float
    disk: float
    range_of_steps: tuple[int, int] = (0, 0)  # least and most steps of a member
    particle_steps: float = 0.0  # sum over the members of the number of particles times the number of steps
    measured: bool = True  # whether the time of a step was measured on this machine

    def lines(self) -> list[str]:
        """The forecast in sentences."""
        if self.members == 0:
            return ["no member is left to simulate"]
        return [
            f"members   {self.members} to simulate, {self.workers} at a time",
            particle_line(self.particles),
            f"steps     about {self._steps()}, {self.particle_steps:.2g} particle-steps in all",
            f"time      about {self._time()}",
            f"memory    about {self.memory / GIGABYTE:.2g} GB, disk at most {self.disk / GIGABYTE:.2g} GB",
        ]

    def _time(self) -> str:
        own = f"({duration(self.member_seconds)} for that member on one core)"
        if self.measured:
            return f"{duration(self.seconds)} {own}"
        return f"{duration(self.seconds)} on a typical machine {own}; the first run compiles for a minute and measures this one"

    def _steps(self) -> str:
        least, most = self.range_of_steps
        return f"{self.steps}" if least == most else f"{least} to {most} by member"

    def over_budget(self, budget: Any) -> list[str]:
        """A sentence with both numbers for each exceeded limit of ``budget`` (hours, memory_gb, disk_gb; None: no limit)."""
        needs = {"hours": self.seconds / 3600, "memory_gb": self.memory / GIGABYTE, "disk_gb": self.disk / GIGABYTE}
        limits = {name: getattr(budget, name, None) for name in needs}
        return [_over(name, limit, needs[name]) for name, limit in limits.items() if limit is not None and needs[name] > limit]


def forecast(site: "Site", left: Sequence[int], *, workers: int | None = None, cost_of: "CostOf | None" = None) -> Forecast:
    """Forecast for the members ``left``: particles are counted, steps follow from points that slide in place of the mass.

    Only the processor time of a step is measured, on a small layer (:mod:`runout.forecast.step_cost`).

    Parameters
    ----------
    site : Site
    left : sequence of int
        Numbers of the members to simulate.
    workers : int, optional
        Members at the same time; if None one per core, or as many as the memory holds.
    cost_of : callable, optional
        Cost of a step from the arguments of :func:`runout.simulate`; :func:`runout.forecast.step_cost.step_cost` if None.

    Raises
    ------
    BudgetError, CapacityError
        If members that run at the same time exceed the memory of the budget or of the machine.
    """
    if not left:
        return Forecast(0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0)
    members, largest, together = _planned(site, left, workers)
    volumes = np.array([_volume_of(site, member) for member in members])
    together, memory = _packed(site, _member_memory(site, largest), together, workers)
    particles = _count(site, largest)
    own = members.index(largest)
    steps, particle_steps = _work(site, members, volumes / volumes[own], particles)
    arguments = site.member_arguments(largest.parameters)
    cost = (cost_of or step_cost)(arguments)
    seconds = SETUP_SECONDS + cost.step * steps + cost.particle * particle_steps
    names = (*member_map_names(), *(bed_map_names() if site.settings.bed else ()))
    maps = 2.0 * len(members) * len(names)  # of members/*.nc and members.nc, before compression
    maps += 2.0 * len(members) * (site.settings.simulation.snapshots or 0)
    disk = maps * 4 * site.terrain().elevation.size
    disk += together * particles * CHECKPOINT_BYTES[site.settings.simulation.precision]
    work, longest = float(seconds.sum()), float(seconds.max())
    total = work if together == 1 else START_SECONDS + CROWDING * max(work / together, longest)
    return Forecast(
        len(members), together, particles, math.ceil(steps[own]), float(seconds[own]), total, memory, disk,
        (math.ceil(steps.min()), math.ceil(steps.max())), float(particle_steps.sum()), cost is not TYPICAL,
    )  # fmt: skip


def require_budget(site: "Site", left: Sequence[int], *, workers: int | None = None) -> int | None:
    """Raise BudgetError if the members ``left`` exceed the budget of the site. The time is forecast for a budget only.

    Returns
    -------
    int or None
        ``workers``; if that is None and memory does not hold a member per core, how many members it holds.

    Raises
    ------
    BudgetError, CapacityError
        CapacityError if members that run at the same time exceed the memory of the machine, with or without a budget.
    """
    budget = site.settings.budget
    if not left:
        return workers
    if budget is None:
        return _require_memory(site, left, workers)
    expected = forecast(site, left, workers=workers)
    for line in expected.lines():
        LOGGER.info("forecast: %s", line)
    over = expected.over_budget(budget)
    if over:
        raise BudgetError("\n".join(over))
    return _fewer(expected.workers, _planned(site, left, workers)[2], workers)


def _fewer(held: int, wanted: int, workers: int | None) -> int | None:
    """``workers``, or how many members memory holds if these are fewer than wanted."""
    if held >= wanted:
        return workers
    LOGGER.info("memory holds %d members at a time, not %d", held, wanted)
    return held


class _Fits(Exception):
    """Signal that the memory of a member has been checked; raised before large allocations."""


def _require_memory(site: "Site", left: Sequence[int], workers: int | None) -> int | None:
    """Raise CapacityError if members that run at the same time exceed the memory of the machine; see :func:`require_budget`."""
    largest, together = _planned(site, left, workers)[1:]
    return _fewer(_packed(site, _member_memory(site, largest), together, workers)[0], together, workers)


def member_bytes(site: "Site", left: Sequence[int]) -> float:
    """Memory of the largest of the members ``left`` on its machine [byte]; 0 if there is none."""
    return _member_memory(site, _planned(site, left, None)[1]).total if left else 0.0


def _member_memory(site: "Site", member: "Member") -> MemoryForecast:
    """Memory of a member; its particles are not made."""
    found: list[MemoryForecast] = []

    def accept(extent: Extent) -> None:
        cells, numerics = arguments["terrain"].elevation.size, Numerics.of(arguments)
        has = named_structures(arguments.get("structures")), arguments.get("basal_friction")
        engine = None if arguments["device"] == "cpu" else engine_for(arguments)
        basal = has[1] or arguments["basal_friction_angle"]
        extent = with_births(extent, arguments.get("bed"), masses_of(arguments), numerics, basal)
        extent = with_inflow(extent, arguments.get("inflow", ()), numerics, arguments["end_time"])
        record = len(arguments.get("joint_conditions", ()))
        found.append(expected_memory(extent, cells, numerics, engine, *has, host_bytes=_noted_bytes, conditions=record))
        raise _Fits

    arguments = site.member_arguments(member.parameters)
    with suppress(_Fits):
        build_scene(**scene_arguments(arguments), accept=accept)
    return found[0]


def _noted_bytes(*of: Any) -> int:
    """:func:`runout.backends.protocol.bytes_on_host`, from the notes of the day if they hold it; the friction is the last."""
    friction = of[-1]
    plain = *of[:-1], friction.fingerprint if isinstance(friction, FrictionLaw) else engine_notes.friction_fingerprint(friction)
    return int(engine_notes.remembered("memory", plain, lambda: bytes_on_host(*of)))


def _planned(site: "Site", left: Sequence[int], workers: int | None) -> "tuple[list[Member], Member, int]":
    """Members ``left``, the largest of them, and how many run at the same time."""
    from runout.ensemble.member import plan_members
    from runout.ensemble.workers import share_of

    wanted = set(left)
    members = [member for member in plan_members(site) if member.number in wanted]
    return members, _largest(site, members), share_of(site.settings.simulation.device, len(members), workers).workers


def _largest(site: "Site", members: "Sequence[Member]") -> "Member":
    """Member with the median basal friction among those with the largest volume."""
    volumes = [_volume_of(site, member) for member in members]
    among = [m for m, volume in zip(members, volumes, strict=True) if volume == max(volumes)]
    return sorted(among, key=_friction_of)[len(among) // 2]


def _volume_of(site: "Site", member: "Member") -> float:
    """Volume of a member over that of all masses as stated [1]: share of what fails, times the sampled factors."""
    factor = member.parameters.get(VOLUME, 1.0) * member.parameters.get(FACTOR, 1.0)
    if not any(name.endswith(FAILS) for name in member.parameters):
        return factor
    masses = site.data().masses
    return factor * sum(mass.volume for mass in failing(masses, member.parameters)) / sum(mass.volume for mass in masses)


def _friction_of(member: "Member") -> list[float]:
    """Sampled parameters of the basal friction of a member."""
    from runout.config.friction import OF_RELEASE, PREFIX

    return [value for name, value in sorted(member.parameters.items()) if name.rpartition(OF_RELEASE)[2].startswith(PREFIX)]


def particle_line(particles: int) -> str:
    """Number of particles in words."""
    return f"particles {particles} in the member with the largest volume"


def particle_count(site: "Site") -> int:
    """Particles of the member with the largest volume; they are counted, not made."""
    from runout.ensemble.member import plan_members

    return _count(site, _largest(site, plan_members(site)))


def _count(site: "Site", member: "Member") -> int:
    from runout.release.sample import Sampling, count_particles, particles_per_axis

    arguments = site.member_arguments(member.parameters)
    how = Sampling(spacing_of(arguments["cell_size"]), particles_per_axis(arguments["particles_per_cell"]))
    born = with_inflow(Extent(0, 0, 0, 0, 0), arguments.get("inflow", ()), Numerics.of(arguments), arguments["end_time"])
    return count_particles(arguments["release"], how) + born.particles


def _work(site: "Site", members: "Sequence[Member]", volumes: np.ndarray, particles: int) -> tuple[np.ndarray, np.ndarray]:
    """Steps and particle-steps (members,) of members, of which that of the relative volume 1 has so many particles."""
    found = member_steps(site, members)
    steps = np.array([one.steps for one in found])
    return steps, particles * volumes * np.array([one.per_particle for one in found])


def _packed(site: "Site", needed: MemoryForecast, together: int, workers: int | None) -> tuple[int, float]:
    """How many of ``together`` members run at the same time, and their memory [byte]; an error if it exceeds budget or machine.

    A stated number of workers counts as it is; otherwise it is what the memory holds.
    """
    limit, free = getattr(getattr(site.settings, "budget", None), "memory_gb", None), available_bytes()
    limits = [bound for bound in (None if limit is None else limit * GIGABYTE, free) if bound is not None]
    held = together if workers else max(1, min([together, *(int(bound // needed.total) for bound in limits)]))
    total = held * needed.total
    if limit is not None and total > limit * GIGABYTE:
        raise BudgetError(_over("memory_gb", limit, total / GIGABYTE) + needed.because(limit * GIGABYTE / held))
    if free is not None and total > free:
        who, fewer = ("a member needs", "") if held == 1 else (f"{held} members at a time need", "fewer workers, ")
        raise CapacityError(
            f"{who} about {total / GIGABYTE:.2g} GB of memory, {free / GIGABYTE:.2g} GB are available; "
            f"use {fewer}larger cells or fewer particles per cell{needed.because(free / held)}"
        )
    return held, total


def _over(name: str, limit: float, needed: float) -> str:
    return f"budget.{name} is {limit:g}, the run needs about {needed:.2g}; raise it, or use larger cells or fewer members"
