"""Forecasts particles, steps, time, memory and disk of a run from a short calibration on this machine."""

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import log
from runout.backends.protocol import Backend, get_backend
from runout.errors import BudgetError, CapacityError
from runout.memory import GIGABYTE, MemoryForecast, available_bytes, expected_memory

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.ensemble.member import Member
    from runout.model.particles import Particles
    from runout.model.scene import Scene

LOGGER = logging.getLogger(__name__)
UNTIMED_STEPS = 3  # steps without timing, which compile kernels or load them from the cache
TIMED_STEPS = 60
COARSE_SECONDS = 2.0  # longest time of the coarse run [s]
FINEST, COARSEST = 1.5, 4.0  # coarse over fine cell size; the cost falls with its fourth power
START_SECONDS = 8.0  # start of a worker process [s]: imports, compiled code from the cache
CROWDING = 1.2  # time on a core while the others are busy, relative to an idle machine
MEMBER_MAPS = 5
CHECKPOINT_BYTES = {"float32": 130, "float64": 240}  # of disk per particle, while its member runs


@dataclass(frozen=True)
class Forecast:
    """Forecast of a run for the remaining members.

    Attributes
    ----------
    members : int
        Members to simulate.
    workers : int
        Members that run at the same time.
    particles, steps : int
        Of the member with the largest volume factor.
    member_seconds : float
        Time of that member on one core [s].
    seconds : float
        Time of all members [s].
    memory, disk : float
        Of all workers together, and of all results [bytes].
    """

    members: int
    workers: int
    particles: int
    steps: int
    member_seconds: float
    seconds: float
    memory: float
    disk: float

    def lines(self) -> list[str]:
        """The forecast in sentences."""
        if self.members == 0:
            return ["no member is left to simulate"]
        return [
            f"members   {self.members} to simulate, {self.workers} at a time",
            f"particles {self.particles} in the member with the largest volume, about {self.steps} steps",
            f"time      about {duration(self.seconds)} ({duration(self.member_seconds)} for that member on one core)",
            f"memory    about {self.memory / GIGABYTE:.2g} GB, disk at most {self.disk / GIGABYTE:.2g} GB",
        ]

    def over_budget(self, budget: Any) -> list[str]:
        """A sentence with both numbers for each exceeded limit of ``budget`` (hours, memory_gb, disk_gb; None: no limit)."""
        needs = {"hours": self.seconds / 3600, "memory_gb": self.memory / GIGABYTE, "disk_gb": self.disk / GIGABYTE}
        limits = {name: getattr(budget, name, None) for name in needs}
        return [_over(name, limit, needs[name]) for name, limit in limits.items() if limit is not None and needs[name] > limit]


def forecast(
    site: "Site", left: Sequence[int], *, workers: int | None = None, progress: Callable[[float], None] | None = None
) -> Forecast:
    """Forecast for the members ``left``. Simulates the member with the largest volume on a coarse grid, and its first steps.

    Parameters
    ----------
    site : Site
    left : sequence of int
        Numbers of the members to simulate.
    workers : int, optional
        Members at the same time; one per core if None.
    progress : callable, optional
        Called with the finished fraction of the calibration, 0 to 1.

    Raises
    ------
    BudgetError, CapacityError
        If members that run at the same time exceed the memory of the budget or of the machine. Checked before large allocations.
    """
    if not left:
        return Forecast(0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0)
    members, largest, together = _planned(site, left, workers)
    memory: list[float] = []  # one number, known before the particles are made
    particles, steps, seconds = _calibrated(site, largest, progress, lambda needed: memory.append(_fitting(site, needed, together)))
    work = seconds * float(_relative_work(site, members, largest).sum())
    disk = 2.0 * len(members) * MEMBER_MAPS * 4 * site.terrain().elevation.size  # members/*.nc and members.nc, before compression
    disk += together * particles * CHECKPOINT_BYTES[site.settings.simulation.precision]
    total = work if together == 1 else START_SECONDS + CROWDING * max(work / together, seconds)
    return Forecast(len(members), together, particles, steps, seconds, total, memory[0], disk)


def require_budget(site: "Site", left: Sequence[int], *, workers: int | None = None) -> None:
    """Raise BudgetError if the members ``left`` exceed the budget of the site. Sites without a budget are not calibrated.

    Raises
    ------
    BudgetError, CapacityError
        CapacityError if members that run at the same time exceed the memory of the machine, with or without a budget.
    """
    budget = site.settings.budget
    if not left:
        return
    if budget is None:
        return _require_memory(site, left, workers)
    with log.progress("calibration") as bar:
        expected = forecast(site, left, workers=workers, progress=bar)
    for line in expected.lines():
        LOGGER.info("forecast: %s", line)
    over = expected.over_budget(budget)
    if over:
        raise BudgetError("\n".join(over))


class _Fits(Exception):
    """Signal that the memory of a member has been checked; raised before large allocations."""


def _require_memory(site: "Site", left: Sequence[int], workers: int | None) -> None:
    """Raise CapacityError if members that run at the same time exceed the memory of the machine."""
    largest, together = _planned(site, left, workers)[1:]
    needed = _member_memory(site, largest)
    if needed:
        _fitting(site, needed, together)


def member_bytes(site: "Site", left: Sequence[int]) -> float:
    """Memory of the largest of the members ``left`` on its machine [byte]; 0 if there is none."""
    needed = _member_memory(site, _planned(site, left, None)[1]) if left else None
    return needed.total if needed else 0.0


def _member_memory(site: "Site", member: "Member") -> MemoryForecast | None:
    """Memory of a member, known before its particles are made."""
    found: list[MemoryForecast] = []

    def accept(needed: MemoryForecast) -> None:
        found.append(needed)
        raise _Fits

    with suppress(_Fits):
        _scene({**site.member_arguments(member.parameters), "seed": member.seed}, accept)
    return found[0] if found else None


def _planned(site: "Site", left: Sequence[int], workers: int | None) -> "tuple[list[Member], Member, int]":
    """Members ``left``, the largest of them, and how many run at the same time."""
    from runout.ensemble.member import plan_members
    from runout.ensemble.workers import share_of

    wanted = set(left)
    members = [member for member in plan_members(site) if member.number in wanted]
    return members, _largest(members), share_of(site.settings.simulation.device, len(members), workers).workers


def duration(seconds: float) -> str:
    """Duration as text: 40 s, 3 min 20 s, 2 h 5 min."""
    if seconds < 100:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes_left = divmod(minutes, 60)
    return f"{hours} h {minutes_left} min" if hours else f"{minutes} min {rest} s"


def _largest(members: "Sequence[Member]") -> "Member":
    """Member with the median basal friction among those with the largest volume."""
    largest = max(m.parameters.get("release_volume_factor", 1.0) for m in members)
    among = [m for m in members if m.parameters.get("release_volume_factor", 1.0) == largest]
    return sorted(among, key=_friction_of)[len(among) // 2]


def _friction_of(member: "Member") -> list[float]:
    """Sampled parameters of the basal friction of a member."""
    from runout.config.friction import PREFIX

    return [value for name, value in sorted(member.parameters.items()) if name.startswith(PREFIX)]


def _relative_work(site: "Site", members: "Sequence[Member]", reference: "Member") -> np.ndarray:
    """Particle-steps (members,) relative to those of the reference: ratio of volume times wave speed."""
    from runout.workflow.check_stiffness import VOLUME, member_stiffness

    if len(members) == 1 and members[0] == reference:
        return np.ones(1)
    data, samples = site.data(), [member.parameters for member in (*members, reference)]
    waves = np.array([s.wave_speed for s in member_stiffness(site, data.releases, data.friction_zones, samples)])
    volumes = np.array([sample.get(VOLUME, 1.0) for sample in samples])
    work: np.ndarray = volumes * waves
    return work[:-1] / work[-1]


def _calibrated(
    site: "Site", member: "Member", progress: Callable[[float], None] | None, accept: Callable[[MemoryForecast], None]
) -> tuple[int, int, float]:
    """Particles, steps and seconds of one member on one core.

    A run with coarse cells measures the duration of the flow, the cost of observers, and by how much the cost of a step grows
    as the mass spreads. Time steps are proportional to the cell size. The first steps with fine cells measure the initial cost
    of a step. Processor time is used, so that other work on the machine does not count. ``accept`` is called with the memory
    before it is allocated.
    """
    from runout.simulation import simulate

    started = time.process_time()
    arguments = {**site.member_arguments(member.parameters), "seed": member.seed, "threads": 1}
    scene, particles = _scene(arguments, accept)
    setup_seconds = time.process_time() - started
    step, step_seconds = _timed_steps(scene, particles, arguments)
    longest = step_seconds * arguments["end_time"] / step
    smallest = math.sqrt(min(release.area for release in arguments["release"]))
    room = max(1.0, smallest / (2 * max(scene.spacing)))  # coarser cells would not resolve the release
    coarsening = min(room, float(np.clip((longest / COARSE_SECONDS) ** 0.25, FINEST, COARSEST)))
    arguments["cell_size"] = tuple(coarsening * h for h in scene.spacing)
    _, first_seconds = _timed_steps(*_scene(arguments), arguments)
    started = time.process_time()
    coarse = simulate(**arguments, progress=progress)
    share = (time.process_time() - started) / coarse.timing["total"]  # processor time over wall time
    observers = share * coarse.timing["observers"]
    stepping = share * (coarse.timing["total"] - coarse.timing["setup"]) - observers
    growth = max(1.0, stepping / coarse.steps / first_seconds)
    steps = math.ceil(coarsening * coarse.steps)
    return len(particles), steps, setup_seconds + steps * step_seconds * growth + observers


def _scene(
    arguments: Mapping[str, Any], accept: Callable[[MemoryForecast], None] = lambda needed: None
) -> "tuple[Scene, Particles]":
    from runout.model.basal_friction import USUAL_ANGLE
    from runout.scenario import build_scene

    engine = _engine(arguments)
    cells = arguments["terrain"].elevation.size
    precision = arguments.get("precision", "float32")
    stated = {name: value for name, value in arguments.items() if name in signature(build_scene).parameters}
    given = {"basal_friction_angle": USUAL_ANGLE, **stated}
    chosen = arguments.get("transfer", "mls"), arguments.get("f_bar", False)
    return build_scene(**given, accept=lambda extent: accept(expected_memory(extent, cells, precision, engine, *chosen)))


def _engine(arguments: Mapping[str, Any]) -> Backend:
    return get_backend(arguments.get("backend", "scan"), arguments.get("device", "cpu"), 1)


def _timed_steps(scene: "Scene", particles: "Particles", arguments: Mapping[str, Any]) -> tuple[float, float]:
    """Length of the first step [s] and the processor time of a step [s]."""
    engine = _engine(arguments)
    engine.load(scene, particles)
    first = engine.stable_step()
    for step in range(UNTIMED_STEPS + TIMED_STEPS):
        if step == UNTIMED_STEPS:
            started = time.process_time()
        engine.step(engine.stable_step())
    return first, (time.process_time() - started) / TIMED_STEPS


def _fitting(site: "Site", needed: MemoryForecast, together: int) -> float:
    """Memory of ``together`` members [byte]; an error if it exceeds budget or machine."""
    total, budget = together * needed.total, getattr(site.settings, "budget", None)
    limit = getattr(budget, "memory_gb", None)
    if limit is not None and total > limit * GIGABYTE:
        raise BudgetError(_over("memory_gb", limit, total / GIGABYTE))
    free = available_bytes()
    if free is not None and total > free:
        raise CapacityError(
            f"{together} members at a time need about {total / GIGABYTE:.2g} GB of memory, {free / GIGABYTE:.2g} GB are available; "
            "use fewer workers, larger cells or fewer particles per cell"
        )
    return total


def _over(name: str, limit: float, needed: float) -> str:
    return f"budget.{name} is {limit:g}, the run needs about {needed:.2g}; raise it, or use larger cells or fewer members"
