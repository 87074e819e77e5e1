"""Runs many scenarios in shared launches of a GPU. Each has its own time step, observers and end, as in a separate run."""

import math
import os
import time as clock
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, cast

import numpy as np

from runout.backends.protocol import (
    Backend,
    Counters,
    LedgerRow,
    NodeSums,
    RasterSums,
    SceneBatch,
    Sinking,
    bytes_on_device,
    find_device,
    free_memory,
    get_batch,
)
from runout.backends.state import State
from runout.errors import CapacityError, ConfigError, RunoutError, StabilityError
from runout.forecast.accuracy import chosen_cell_size
from runout.forecast.memory import Extent, MemoryForecast, available_bytes, pore_bytes, with_births
from runout.forecast.step_cost import PARTICLE_SECONDS, STEP_SECONDS
from runout.model.inflow import Inflow
from runout.model.numerics import Numerics
from runout.model.particle_source import CompactParticles, ParticleSource
from runout.model.particles import Particles
from runout.model.release import Release
from runout.model.release_start import require_starts
from runout.model.scene import Scene
from runout.model.structures import Structures
from runout.model.terrain import Terrain
from runout.simulation.entering import Entering
from runout.simulation.erosion import ErodingBed, eroding_bed
from runout.simulation.result import Result
from runout.simulation.run import BATCH, Run, RunControl
from runout.simulation.scenario import build_scene, inflows_of, scene_arguments
from runout.simulation.structure_forces import named_structures
from runout.simulation.waiting_release import WaitingRelease

MOST = 64  # scenarios per launch
ENOUGH = 10_000_000  # particles that keep a device busy; further scenarios would only wait
BUSY = 3_000_000  # particles with which a launch starts if the next scenario is not ready
MEMORY_SHARE = 0.8  # share of the free memory at the start; flows that spread take more
AHEAD = min(2, os.cpu_count() or 1)  # scenarios that are prepared at the same time; more threads wait for each other
LOOK_SECONDS = 3e-3  # [s] between two sequences of steps, measured
WAITING_SECONDS = 3e-11  # [s] time per particle of a run that waits
ELSEWHERE = ("backend", "device", "threads", "checkpoint", "checkpoint_every", "memory_gb", "progress")  # not accepted


def simulate_batch(
    scenarios: Sequence[Mapping[str, Any]],
    *,
    device: str = "auto",
    progress: Callable[[int, float], None] | None = None,
    particles: bool = True,
) -> Iterator[tuple[int, Result | RunoutError]]:
    """Number and result of every scenario in the order in which they end; for a failed one its error instead of the result.

    Scenarios share the launches of one device: as many at a time as its memory holds, until they have :data:`ENOUGH` particles or
    are :data:`MOST`; the next are prepared meanwhile. Each gives what
    :func:`runout.simulate` gives with backend "hash": the same particles in the same order of operations. Where mass enters later
    in any scenario of a launch, sums are added in another order.

    Parameters
    ----------
    scenarios : sequence of mappings
        Arguments of :func:`runout.simulate` by name, without those on device and computation. Scenarios must
        share cell_size, precision and the law of the material.
    device : str
        "cuda:0" and so on, "cpu" (slow), or "auto".
    progress : callable, optional
        Called with the number of a scenario and the fraction of its time that is done, 0 to 1.
    particles : bool
        Whether results hold the particles at the end, in ``state``; else that is empty. Copying them makes the device wait.

    Raises
    ------
    ConfigError
        If scenarios differ in settings that they must share.
    DeviceError
        If the device does not exist.
    """
    with ThreadPoolExecutor(AHEAD) as pool:
        jobs = _PreparedJobs(pool, scenarios, progress)
        yield from _in_launches(jobs, find_device(device), particles)  # the device is initialised meanwhile


def _in_launches(jobs: "_PreparedJobs", place: str, brought: bool) -> Iterator[tuple[int, Result | RunoutError]]:
    """Outcomes of jobs. A launch has as many as keep the device busy, or as its memory holds; it does not wait for the last."""
    launch = _Launch(place)
    for number, future in enumerate(jobs):
        if launch.particles >= BUSY and not future.done():
            yield from launch.outcomes(jobs, brought)
            launch = _Launch(place)
        try:
            job = future.result()
            job.memory.require(launch.free, f"the free memory of {place}")
        except RunoutError as error:
            yield number, error
            continue
        if launch.jobs and not launch.takes(job):
            yield from launch.outcomes(jobs, brought)
            launch = _Launch(place)
        launch.jobs.append(job)
    yield from _launched(launch.jobs, place, brought)


@dataclass
class _Job:
    number: int
    terrain: Terrain
    scene: Scene
    particles: ParticleSource
    control: RunControl
    progress: Callable[[float], None] | None
    seconds: float  # to prepare it
    memory: MemoryForecast  # of the device
    structures: Structures | None
    bed: ErodingBed | None
    entering: Entering | None
    at_start: State = field(default_factory=dict)  # of what waits

    @classmethod
    def of(cls, number: int, arguments: Mapping[str, Any], progress: Callable[[int, float], None] | None) -> "_Job":
        """Scene and particles from arguments of :func:`runout.simulate`."""
        started = clock.perf_counter()
        options = {k: v for k, v in arguments.items() if k not in ELSEWHERE}
        release, waiting = options["release"], list[WaitingRelease]()
        releases = [release] if isinstance(release, Release) else list(release)
        require_starts(releases, options["end_time"])
        _require_no_inflow(inflows_of(options.pop("inflow", ())))
        options["cell_size"] = chosen_cell_size(options.pop("accuracy", None), releases, options.get("cell_size"))
        times = tuple(sorted(options.pop("snapshot_times", ())))
        probes = options.pop("probes", None)
        control = RunControl(
            options.pop("end_time"), options.pop("stop", True), options.pop("arrival_threshold", 0.1), times,
            force_interval=options.pop("force_interval", None), snapshot_particles=options.pop("snapshot_particles", 0),
            probes=probes.on(options["terrain"]) if probes else None, bulking=options.pop("bulking", 1.0),
            joint_conditions=options.pop("joint_conditions", ()),
        )  # fmt: skip
        extents, bed = list[Extent](), options.pop("bed", None)
        if unknown := options.keys() - scene_arguments(options).keys() - Numerics.names():
            raise TypeError(f"a scenario has the argument {min(unknown)!r}, which runout.simulate does not have")
        chosen = scene_arguments(options)
        scene, releases_in_chunks = build_scene(**chosen, accept=extents.append, in_chunks=True, waiting=waiting)
        particles = CompactParticles.of(releases_in_chunks, scene.densities, scene.dtype)
        eroding = eroding_bed(bed, scene, options["terrain"], releases, releases_in_chunks.how.per_axis)
        friction = chosen.get("basal_friction") or chosen["basal_friction_angle"]
        extent = with_births(extents[0], bed, releases, chosen["numerics"], friction)
        tell = (lambda fraction: progress(number, fraction)) if progress else None
        structures = named_structures(options.get("structures"))
        scene, seconds = eroding.scene if eroding else scene, clock.perf_counter() - started
        sources = Entering(waiting) if waiting else None
        memory = _memory(scene, extent)
        return cls(number, options["terrain"], scene, particles, control, tell, seconds, memory, structures, eroding, sources)

    def prepare(self, run: Run) -> None:
        """Prepare a run of this scenario; what waits begins anew where an earlier launch has changed it."""
        run.prepare(self.particles)
        if self.entering:
            self.at_start = self.at_start or _copied(self.entering.state())
            self.entering.restore(_copied(self.at_start))


def _memory(scene: Scene, extent: Extent) -> MemoryForecast:
    """Memory of a scene on the device."""

    def needed(one: Extent) -> float:
        sizes, law = (one.particles, one.nodes_on_device), scene.basal.law
        whole = bytes_on_device(*sizes, scene.precision, scene.structures, law, scene.basal.mixed, scene.substeps)
        return whole + pore_bytes(one, scene.precision)

    return MemoryForecast(0.0, needed(extent), extent=extent, bytes_of=needed)


def _copied(state: State) -> State:
    return {name: np.array(values) for name, values in state.items()}


def _require_no_inflow(inflows: Sequence[Inflow]) -> None:
    """Raise ConfigError for an inflow, which no scene of a launch takes."""
    if inflows:
        alone = 'simulate it alone, with runout.simulate(backend="hash")'
        raise ConfigError(f"inflow {inflows[0].name}: scenarios that share launches have no inflow; {alone}")


class _Launch:
    """Jobs of the next launch on a device."""

    def __init__(self, place: str):
        self.place, self.free = place, _free(place)  # once per launch: the query takes 0.14 s on some machines
        self.jobs: list[_Job] = []

    @property
    def particles(self) -> int:
        return sum(len(job.particles) for job in self.jobs)

    def takes(self, job: _Job) -> bool:
        """Whether one more job finds memory, and the device is not busy enough without it."""
        needed = sum(j.memory.total for j in [*self.jobs, job])
        return len(self.jobs) < MOST and self.particles < ENOUGH and needed <= MEMORY_SHARE * self.free

    def outcomes(self, jobs: "_PreparedJobs", brought: bool) -> Iterator[tuple[int, Result | RunoutError]]:
        """Outcomes of the jobs; as many as keep the device busy are prepared meanwhile."""
        jobs.make(min(MOST, math.ceil(len(self.jobs) * ENOUGH / max(self.particles, 1))))
        yield from _launched(self.jobs, self.place, brought)


class _PreparedJobs:
    """Jobs of scenarios in their order, prepared in advance by threads while the device computes."""

    def __init__(
        self, pool: ThreadPoolExecutor, scenarios: Sequence[Mapping[str, Any]], progress: Callable[[int, float], None] | None
    ):
        self.pool, self.left, self.progress = pool, iter(enumerate(scenarios)), progress
        self.waiting: deque[Future[_Job]] = deque()
        self.make(AHEAD)

    def make(self, count: int) -> None:
        """Start the preparation of further jobs until ``count`` are ready or in preparation, if there are so many scenarios."""
        for number, arguments in islice(self.left, max(0, count - len(self.waiting))):
            self.waiting.append(self.pool.submit(_Job.of, number, arguments, self.progress))

    def __iter__(self) -> "Iterator[Future[_Job]]":
        while self.waiting:
            first = self.waiting.popleft()
            self.make(AHEAD)
            yield first


def _free(place: str) -> float:
    """Free memory of a device [byte]."""
    free = free_memory(place) if place != "cpu" else available_bytes()
    return float("inf") if free is None else free


def _launched(jobs: list[_Job], place: str, brought: bool) -> Iterator[tuple[int, Result | RunoutError]]:
    """Outcomes of jobs in one launch. If the memory is exhausted, the remaining jobs are divided into two launches."""
    left = {job.number: job for job in jobs}
    try:
        for number, outcome in _Together(jobs, place, brought).outcomes() if jobs else ():
            del left[number]
            yield number, outcome
    except CapacityError as error:
        remaining = list(left.values())
        if len(remaining) == 1:
            yield remaining[0].number, error
            return
        yield from _launched(remaining[: len(remaining) // 2], place, brought)
        yield from _launched(remaining[len(remaining) // 2 :], place, brought)


class _View:
    """One scene of a batch with the interface of a backend; it is stepped only with the others.

    Particles that join wait until this scene is read or all are stepped: then those of all scenes join at once.
    """

    def __init__(self, together: "_Together", scene: int):
        self.together, self.scene, self.counters = together, scene, Counters()

    @property
    def batch(self) -> SceneBatch:
        """The batch, with all particles of this scene."""
        if any(scene == self.scene for scene, _ in self.together.joining):
            self.together.join()
        return self.together.batch

    @property
    def max_speed(self) -> float:
        return self.together.batch.max_speed_of(self.scene)

    def stable_step(self) -> float:
        return self.batch.stable_step(self.scene)

    def add(self, particles: Particles) -> None:
        self.together.joining.append((self.scene, particles))

    def lower(self, first: tuple[int, int], depth: np.ndarray, flow: Sinking | None = None) -> None:
        self.batch.lower_of(self.scene, first, depth, flow)

    def particles(self) -> Particles:
        return self.batch.particles_of(self.scene)

    def ledger(self) -> LedgerRow:
        return self.together.rows_of(self.batch)[self.scene]

    def structure_impulses(self) -> np.ndarray:
        return self.batch.structure_impulses_of(self.scene)

    def memory_bytes(self) -> int:
        return self.batch.memory_bytes()

    def columns(self) -> RasterSums:
        return self.batch.columns_of(self.scene)

    def flow_columns(self) -> RasterSums:
        return self.batch.flow_columns_of(self.scene)

    def lattice_columns(self) -> RasterSums:
        return self.batch.lattice_columns_of(self.scene)

    def node_columns(self) -> NodeSums | None:
        return self.batch.node_columns_of(self.scene)

    def plan_masses(self, first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
        return self.batch.plan_masses_of(self.scene, first, shape)


class _Together:
    """Runs that share the steps of a batch; with ``brought``, their results contain the particles."""

    def __init__(self, jobs: list[_Job], place: str, brought: bool):
        self.jobs, self.brought = jobs, brought
        self.rows: list[LedgerRow] = []  # of the present state, filled on first use
        self.joining: list[tuple[int, Particles]] = []  # scene, and particles that wait to join it
        views = [cast(Backend, _View(self, k)) for k in range(len(jobs))]
        self.runs = [
            Run(view, job.scene, job.control, job.progress, None, job.structures, job.bed, job.entering)
            for view, job in zip(views, jobs, strict=True)
        ]
        for run, job in zip(self.runs, jobs, strict=True):
            job.prepare(run)
        self.batch = get_batch([(job.scene, job.particles) for job in jobs], place, sum(run.more for run in self.runs))
        self.todo = [0] * len(jobs)  # steps of each run to its next observation
        self.planned = [0] * len(jobs)
        self.started = clock.perf_counter()

    def rows_of(self, batch: SceneBatch) -> list[LedgerRow]:
        """Rows of the ledger of all scenes of the batch."""
        if not self.rows:
            self.rows = batch.ledgers()
        return self.rows

    def join(self) -> None:
        """Let all particles join that wait."""
        if self.joining:
            self.batch.join(self.joining)
            self.joining, self.rows = [], []

    def outcomes(self) -> Iterator[tuple[int, Result | RunoutError]]:
        """Number and outcome of each run, in the order in which they end."""
        self.batch.look_at(range(len(self.runs)))
        for run in self.runs:
            run.begin()
        running = set(range(len(self.jobs)))
        while running:
            for k in sorted(running):
                outcome = self._outcome(k)
                if outcome is not None:
                    running.discard(k)
                    self.batch.leave([k])
                    yield self.jobs[k].number, outcome
            if running:
                self._advance(running)

    def _advance(self, running: set[int]) -> None:
        """Make a sequence of steps of all runs; a run whose observation is due earlier waits."""
        self.join()
        for k in running:
            if self.todo[k] == 0:
                self.todo[k] = self.planned[k] = self.runs[k].plan(BATCH)
        count = self._stretch(sorted(running))
        transfers = [min(self.todo[k], count) if k in running else 0 for k in range(len(self.jobs))]
        done = [planned - todo for planned, todo in zip(self.planned, self.todo, strict=True)]
        look_steps = {k: [n - done[k] for n in self.runs[k].look_steps if 0 < n - done[k] <= transfers[k]] for k in running}
        going_on = [k for k in running if done[k]]
        dt, look = [run.dt for run in self.runs], lambda k, step, columns: self.runs[k].look(done[k] + step, columns)
        nodes = [k for k in running if transfers[k] == self.todo[k] and self.runs[k].erodes_after(self.planned[k])]
        self.batch.advance(dt, transfers, look_steps, look, going_on, [run.substeps for run in self.runs], nodes)
        self.rows = []
        for k in running:
            self.todo[k] -= transfers[k]
            self.runs[k].engine.counters.add(self.runs[k].substeps, 0, transfers[k])
        for k in sorted(running):
            if self.todo[k] == 0 and not self.batch.failure(k):
                self.runs[k].arrive(self.planned[k])

    def _stretch(self, running: list[int]) -> int:
        """Number of steps with the most work per second; runs whose observation is due earlier wait, and observations cost time."""
        todo = np.array([self.todo[k] for k in running])
        particles = np.array([len(self.jobs[k].particles) for k in running])
        choices = np.unique(todo)
        steps = np.diff(choices, prepend=0)
        moving = np.array([particles[todo >= choice].sum() for choice in choices])  # in these steps
        step = np.maximum(STEP_SECONDS, PARTICLE_SECONDS * moving + WAITING_SECONDS * (particles.sum() - moving))
        return int(choices[np.argmax(np.cumsum(steps * moving) / (LOOK_SECONDS + np.cumsum(steps * step)))])

    def _outcome(self, k: int) -> Result | RunoutError | None:
        """Outcome of run k; None while it continues."""
        run, job = self.runs[k], self.jobs[k]
        if failure := self.batch.failure(k):
            return StabilityError(failure)
        if not run.reason:
            return None
        run.seconds = clock.perf_counter() - self.started
        result = run.result(job.terrain, run.n_particles, job.seconds, brought=self.brought)
        _ = result.state  # before the scene leaves the device
        return result
