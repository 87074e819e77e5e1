"""The time loop: step size, steps, observers, stop rule. Physics and array layout belong to the backends."""

import logging
import math
import os
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from runout.accuracy import CFL, choices
from runout.backends.protocol import Backend, BatchBackend, RasterSums, ResumableBackend, WindowBackend, get_backend
from runout.backends.state import State, arrays_of, part, put_arrays
from runout.checkpoint import EVERY, Checkpoint, checkpoint_for, run_key
from runout.errors import ConfigError, ReleaseError
from runout.memory import Extent, expected_extent, expected_memory, require_memory
from runout.model import basal_strength
from runout.model.basal_friction import USUAL_ANGLE, BasalFriction
from runout.model.depth_resolution import FEWEST_CELLS, DepthResolution, flow_depth
from runout.model.friction import FrictionZones
from runout.model.limits import checked, spacing_of
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY, Raster, Scene
from runout.model.terrain import Terrain
from runout.observers import AtRest, Ledger, PeakMaps, flow_fields
from runout.result import Result

LOGGER = logging.getLogger(__name__)
OBSERVATIONS = 200  # least number of observations over the whole time
CROSSING = 0.5  # largest travel between two observations, in raster cells or, if longer, half grid cells
BATCH = 32  # steps of one size before the limit is checked again; gravity adds little to the speed meanwhile
STEP_RATIO = 1.04  # ratio of successive step sizes, so that records are repacked rarely


@dataclass(frozen=True)
class RunControl:
    """Control of a run: its end, its observations, and the work that it may skip.

    Attributes
    ----------
    end_time : float
        Time at which the run ends at the latest [s].
    stop : bool
        Stop at rest.
    arrival_threshold : float
        Thickness [m] above which the flow has arrived in a cell.
    snapshot_times : tuple of float
        Ascending [s].
    crossing : float
        Observe whenever the fastest particle may have crossed so much of a raster cell, or of half a grid cell if that is longer,
        and at least :data:`OBSERVATIONS` times; 0 observes after every step.
    crop : bool
        Observe only the part of the raster where the mass is, with a backend that knows it; the maps are the same bit by bit.
    """

    end_time: float
    stop: bool = True
    arrival_threshold: float = 0.1
    snapshot_times: tuple[float, ...] = ()
    crossing: float = CROSSING
    crop: bool = True

    def __post_init__(self) -> None:
        checked("end_time", self.end_time, error=ConfigError)
        checked("arrival_threshold", self.arrival_threshold, error=ConfigError)


def simulate(
    terrain: Terrain,
    release: Release | Sequence[Release],
    material: Material,
    *,
    basal_friction_angle: float = USUAL_ANGLE,
    basal_friction: BasalFriction | None = None,
    friction_zones: FrictionZones | None = None,
    cell_size: float | tuple[float, float, float] | None = None,
    particles_per_cell: int | tuple[int, int, int] | None = None,
    end_time: float,
    backend: str = "scan",
    device: str = "cpu",
    precision: str = "float32",
    seed: int = 0,
    cfl: float | None = None,
    transfer: str = "mls",
    flip_ratio: float = 0.95,
    f_bar: bool = False,
    sleep_speed: float = 0.0,
    initial_stress: str = "at_rest",
    accuracy: str | None = None,
    threads: int | None = None,
    stop: bool = True,
    arrival_threshold: float = 0.1,
    snapshot_times: Sequence[float] = (),
    progress: Callable[[float], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_every: float = EVERY,
    memory_gb: float | None = None,
) -> Result:
    """Run one scenario.

    Parameters
    ----------
    terrain : Terrain
    release : Release or sequence of Release
        The masses that start to move; several must not overlap.
    material : Material
        Material of every release without a material of its own.
    basal_friction_angle : float
        Coulomb friction angle at the ground [deg], 0 to 60, for every release without an angle of its own.
    basal_friction : BasalFriction, optional
        Law of friction at the ground and its parameters, instead of that angle.
    friction_zones : FrictionZones, optional
        Zones where the ground multiplies or replaces the friction, see :meth:`runout.FrictionZones.from_vector`.
    cell_size : float or (dx, dy, dz)
        Grid spacing [m]; required without ``accuracy``.
    particles_per_cell : int or (nx, ny, nz)
        Particles per cell; 8 is (2, 2, 2). Default: (2, 2, 4), or (3, 3, 1) for a mass at least five cells thick on level
        ground (:mod:`runout.release.arrangement`).
    end_time : float
        Latest time [s].
    backend, device : str
        "scan" (CPU, numba), "hash" (warp: "cuda:0", or "cpu", slow), "auto" (hash if there is a GPU, else scan) or
        "reference" (NumPy, slow).
    precision : str
        "float32" or "float64".
    seed : int
        Seed of the positions of the particles.
    cfl : float
        Courant number; 0.6 by default, which is also the largest. A smaller value is not more accurate, since each step damps.
    transfer : str
        "mls" (fastest), "apic" (stress and strain by the gradients of the weights) or "aflip" (apic that damps less); see
        ``docs/theory``.
    flip_ratio : float
        Fraction, 0 to 1, that a particle keeps of the velocity that the grid does not represent ("aflip"); 0 is "apic".
    f_bar : bool
        Average the volumetric strain of each step over the grid, against locking and checkerboards of pressure.
    sleep_speed : float
        Blocks slower than this [m/s] rest until something moves beside them, on the backend "scan"; 0, the default, switches it
        off. It saves time if much of the mass rests while the rest flows; see ``docs/benchmarks/skip.md``.
    initial_stress : str
        "at_rest": releases start with the stress of their own weight, as on an infinite slope; "none": without stress.
    accuracy : str, optional
        "screening", "standard" or "high": cell_size and cfl that follow from the mean thickness of the release
        (:data:`runout.accuracy.PRESETS`); an explicit value of either overrides the preset.
    threads : int, optional
        Threads of the CPU; all by default. The result does not depend on it.
    stop : bool
        Stop when the flow has come to rest.
    arrival_threshold : float
        Thickness from which a cell counts as reached [m].
    snapshot_times : sequence of float
        Times [s] at which maps of thickness and speed are stored.
    progress : callable, optional
        Called with the fraction of the simulated time, 0 to 1.
    checkpoint : path, optional
        Checkpoint file. If a run was interrupted, the same call continues from it and gives the same bits. Removed at the end.
    checkpoint_every : float
        Wall time between two checkpoints [s].
    memory_gb : float, optional
        Limit of the memory [GB]. A run with a larger forecast is refused, as is one that exceeds the available memory.

    Raises
    ------
    DemError, ReleaseError, MaterialError, ConfigError
        If an input cannot be used; the message names place, value and remedy.
    StabilityError, CapacityError, DeviceError
        If a run cannot continue.
    """
    started = clock.perf_counter()
    control = RunControl(end_time, stop, arrival_threshold, tuple(sorted(snapshot_times)))
    engine = get_backend(backend, device, threads)
    releases = [release] if isinstance(release, Release) else list(release)
    grid = choices(accuracy, releases, {"cell_size": cell_size, "cfl": cfl}) | {"particles_per_cell": particles_per_cell}
    scene, particles = build_scene(
        terrain, releases, material, basal_friction_angle, **grid, seed=seed, precision=precision, transfer=transfer,
        flip_ratio=flip_ratio, f_bar=f_bar, sleep_speed=sleep_speed, friction_zones=friction_zones, initial_stress=initial_stress,
        basal_friction=basal_friction, accept=lambda extent: require_memory(
            expected_memory(extent, terrain.elevation.size, precision, engine, transfer, f_bar), engine, memory_gb
        ),
    )  # fmt: skip
    for sentence in basal_strength.sentences(scene, [r.name for r in releases]):
        LOGGER.warning("%s", sentence)
    keep = checkpoint_for(checkpoint, checkpoint_every, engine, run_key(scene, particles, control, type(engine).__name__))
    run = Run(engine, scene, control, progress, keep)
    n_particles = len(particles)
    run.start(particles)
    del particles
    loaded = clock.perf_counter()
    run.go()
    run.seconds += clock.perf_counter() - loaded
    result = run.result(terrain, n_particles, loaded - started)
    if keep:
        keep.remove()
    if result.depth_resolution.is_coarse:
        LOGGER.warning("%s; use at least %d cells", result.depth_resolution.statement(), FEWEST_CELLS)
    return result


def build_scene(
    terrain: Terrain,
    release: Release | Sequence[Release],
    material: Material,
    basal_friction_angle: float,
    cell_size: float | tuple[float, float, float],
    particles_per_cell: int | tuple[int, int, int] | None = None,
    *,
    seed: int = 0,
    cfl: float = CFL,
    precision: str = "float32",
    transfer: str = "mls",
    flip_ratio: float = 0.95,
    f_bar: bool = False,
    sleep_speed: float = 0.0,
    basal_friction: BasalFriction | None = None,
    friction_zones: FrictionZones | None = None,
    initial_stress: str = "at_rest",
    accept: Callable[[Extent], None] | None = None,
) -> tuple[Scene, Particles]:
    """Scene and particles of a scenario; parameters as in :func:`simulate`.

    ``accept`` is called before the particles are made; it raises an error if the scene is too large.
    """
    from runout import stiffness
    from runout.initial_stress import InitialStress, pressed_by
    from runout.release.arrangement import default_particles
    from runout.release.known import onto_known_ground
    from runout.release.sample import particles_per_axis, sample_particles
    from runout.terrain import open_edge, prepare, sdf
    from runout.terrain.crest_window import Mass

    releases = [release] if isinstance(release, Release) else list(release)
    if not releases:
        raise ReleaseError("no release is given; at least one is needed")
    basal = basal_friction or math.radians(checked("basal_friction_angle", basal_friction_angle, error=ConfigError))
    frictions = basal_strength.frictions_under(releases, basal)
    spacing = spacing_of(cell_size)
    if particles_per_cell is None:
        particles_per_cell = default_particles(releases, material, basal, spacing[2], friction_zones)
    prepare.require_known(terrain, np.sum([r.thickness for r in releases], axis=0) > 0, "the release")
    given = [r.material or material for r in releases]
    strength = basal_strength.strengths(given, spacing[2])
    materials = stiffness.chosen_moduli(given, releases, frictions, strength, friction_zones)
    for r, m in zip(releases, materials, strict=True):
        m.require_carries(float(r.thickness.max()), STANDARD_GRAVITY)
    dug = [r.excavation for r in releases]
    mass = Mass(np.sum([r.thickness for r in releases], axis=0), basal_strength.least_angle(frictions, strength, friction_zones))
    surface = sdf.sliding_surface(terrain, np.sum(dug, axis=0) if np.any(dug) else None, spacing[:2], mass)
    if accept:
        accept(expected_extent(releases, surface.surface, spacing, particles_per_axis(particles_per_cell)))
    friction = tuple(math.tan(f) if isinstance(f, float) else f for f in frictions)
    scene = Scene(
        spacing, surface, Raster(*terrain.shape, terrain.cell_size), materials, friction, cfl=cfl, precision=precision,
        transfer=transfer, flip_ratio=flip_ratio, f_bar=f_bar, sleep_speed=sleep_speed, friction_zones=friction_zones,
        strength=strength, unknown=open_edge.unknown_cells(terrain), initial_stress=InitialStress.of(initial_stress),
    )  # fmt: skip
    press = pressed_by(scene, releases)
    particles = sample_particles(releases, materials, surface, spacing, particles_per_cell, seed, press=press)
    return scene, onto_known_ground(particles, scene)


class Run:
    """One run, from time zero or a checkpoint to its end."""

    def __init__(
        self, engine: Backend, scene: Scene, control: RunControl, progress: Callable[[float], None] | None, keep: Checkpoint | None
    ):
        self.engine, self.scene, self.control, self.progress, self.keep = engine, scene, control, progress, keep
        self.peaks = PeakMaps(scene.raster, control.arrival_threshold)
        self.ledger, self.rest = Ledger(), AtRest()
        self.snapshots: list[tuple[float, np.ndarray, np.ndarray]] = []
        self.pending, self.reason = list(control.snapshot_times), ""
        self.time = self.dt = self.due = self.seconds = self.observing = 0.0

    def start(self, particles: Particles) -> None:
        """Load the backend with the particles, or with the state of a checkpoint of this run."""
        state = self.keep.read() if self.keep else None
        if state is None or not isinstance(self.engine, ResumableBackend):
            self.engine.load(self.scene, particles)
            return
        self.engine.restore(self.scene, part(state, "backend."))
        put_arrays(self, state, "run.")
        put_arrays(self.peaks, state, "peaks.")
        put_arrays(self.rest, state, "rest.")
        self.ledger.restore(part(state, "ledger."))
        frames = (state["frames.time"].tolist(), state["frames.thickness"], state["frames.speed"])
        self.snapshots = list(zip(*frames, strict=True))
        self.pending = self.pending[len(self.snapshots) :]
        LOGGER.info("continues from a checkpoint at %.4g s of %.4g s", self.time, self.control.end_time)

    def _state(self, seconds: float) -> State:
        """State for :meth:`start` to continue from, after ``seconds`` [s] of wall time in this process."""
        assert isinstance(self.engine, ResumableBackend)
        state = {f"backend.{name}": values for name, values in self.engine.checkpoint().items()}
        state |= arrays_of(self, prefix="run.") | arrays_of(self.peaks, prefix="peaks.") | arrays_of(self.rest, prefix="rest.")
        state |= {f"ledger.{name}": values for name, values in self.ledger.state().items()}
        for k, name in enumerate(("time", "thickness", "speed")):
            state[f"frames.{name}"] = np.array([frame[k] for frame in self.snapshots])
        state["run.seconds"] = np.asarray(self.seconds + seconds)
        return state

    def timing(self, setup: float) -> dict[str, float]:
        """Seconds by stage, including the time before a checkpoint."""
        own = {"observers": self.observing, "checkpoints": self.keep.seconds} if self.keep else {"observers": self.observing}
        return {"setup": setup, **self.engine.counters.seconds, **own, "total": setup + self.seconds}

    def result(self, terrain: Terrain, n_particles: int, setup: float, *, brought: bool = True) -> Result:
        """What has been found, after ``setup`` [s] of preparation for so many particles; ``brought``: with these as they are."""
        maps = self.peaks.maps().items()  # only on known ground: the footprint of a particle may extend beyond an edge
        return Result(
            terrain=terrain,
            fields={name: terrain.where_known(m, np.nan if name == "arrival_time" else 0.0) for name, m in maps},
            series={"time": np.array(self.ledger.time), **self.ledger.series()},
            state=self.engine.particles() if brought else Particles.zeros(0),
            spacing=self.scene.spacing,
            steps=self.engine.counters.steps,
            n_particles=n_particles,
            timing=self.timing(setup),
            stop_reason=self.reason,
            depth_resolution=self.depth_resolution(),
            snapshots=self.snapshots,
            start=self.scene.start_attributes(),
        )

    def depth_resolution(self) -> DepthResolution:
        """Resolution of the flow so far, with the mean time step."""
        depth, steps = flow_depth(self.peaks.max_flow_thickness), self.engine.counters.steps
        return DepthResolution.of(depth, self.scene, self.time / max(1, steps))

    def go(self) -> None:
        """Step until the end time or rest."""
        started = clock.perf_counter()
        self.begin()
        while not self.reason:
            if self.keep and self.keep.due():
                self.keep.write(self._state(clock.perf_counter() - started))
            if isinstance(self.engine, BatchBackend):
                count = self.plan(BATCH)
                self.engine.steps(self.dt, count)
            else:
                count = self.plan(1)
                self.engine.step(self.dt)
            self.arrive(count)

    def begin(self) -> None:
        """Observe the start, unless the run continues from a checkpoint."""
        if not self.ledger.time:
            self.due = self._observe()

    def plan(self, most: int) -> int:
        """Set the next time step [s]; returns the number of such steps until the next observation, at most ``most``."""
        self.dt = min(_on_ladder(self.engine.stable_step()), self._next_stop() - self.time)
        span = min(self.due, self._next_stop()) - self.time
        return max(1, min(most, int(span / self.dt)))

    def arrive(self, count: int) -> None:
        """Account for ``count`` finished steps; observe if an observation is due."""
        is_due = self.looks_after(count)
        self.time += self.dt * count
        if is_due:
            self.due = self._observe()

    def looks_after(self, count: int) -> bool:
        """Whether an observation is due after ``count`` steps."""
        return self.time + self.dt * count >= min(self.due, self._next_stop()) - 1e-12 * self.control.end_time

    def _next_stop(self) -> float:
        return min([self.control.end_time, *self.pending[:1]])

    def _observe(self) -> float:
        """Record the present state; returns when the next observation is due [s]."""
        started, engine = clock.perf_counter(), self.engine
        columns = engine.flow_columns() if self.control.crop and isinstance(engine, WindowBackend) else engine.columns()
        row = engine.ledger()
        self.peaks.observe(self.time, columns)
        self.ledger.record(self.time, self.dt, row)
        while self.pending and self.time >= self.pending[0] - 1e-12 * self.control.end_time:
            self.snapshots.append((self.pending.pop(0), *self._frame(columns)))
        if self.control.stop and self.rest.reached(row):
            self.reason = "at rest" if row.mass > 0 else "all mass has left the domain"
        elif self.time >= self.control.end_time * (1 - 1e-12):
            self.reason = "end time"
        if self.progress:
            self.progress(1.0 if self.reason else self.time / self.control.end_time)
        self.observing += clock.perf_counter() - started
        crossing = self.control.crossing * self.scene.observed_length / max(row.max_speed, 1e-3)
        return self.time + min(self.control.end_time / OBSERVATIONS, crossing)

    def _frame(self, columns: RasterSums) -> tuple[np.ndarray, np.ndarray]:
        """Thickness [m] and speed [m/s] on the whole raster."""
        whole = np.zeros((2, self.scene.raster.rows, self.scene.raster.columns))
        whole[:, *columns.window] = flow_fields(columns, self.scene.raster)[:2]
        return whole[0], whole[1]


def _on_ladder(limit: float) -> float:
    """Largest step of a geometric sequence that does not exceed the limit."""
    return float(STEP_RATIO ** math.floor(math.log(limit) / math.log(STEP_RATIO)))
