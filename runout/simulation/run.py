"""The time loop of one run: step size, steps, observers, stop rule. Physics and array layout belong to the backends."""

import logging
import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from runout.backends import footprints
from runout.backends.protocol import Backend, BatchBackend, Counters, LedgerRow, RasterSums, ResumableBackend, WindowBackend
from runout.backends.state import State, arrays_of, part, put_arrays
from runout.errors import ConfigError
from runout.model.depth_resolution import DepthResolution, flow_depth
from runout.model.joint_conditions import ATTRIBUTE, Condition, attribute_of, checked_conditions
from runout.model.limits import checked
from runout.model.particle_source import ParticleSource
from runout.model.particles import Particles
from runout.model.probes import Probes
from runout.model.scene import Scene
from runout.model.structures import Structures
from runout.model.terrain import Terrain
from runout.quantities import DEPOSIT, QUANTITIES, SHARE, WITHOUT_VALUE
from runout.simulation.checkpoint import Checkpoint
from runout.simulation.entering import Entering
from runout.simulation.erosion import ErodingBed
from runout.simulation.observers import THICKNESS, AtRest, Frame, Ledger, ParticleSample, PeakMaps, StructureImpulses, flow_fields
from runout.simulation.probe_recorder import ProbeRecorder
from runout.simulation.result import Result
from runout.simulation.structure_forces import named_structures

LOGGER = logging.getLogger(__name__)
DEPOSIT_MAP = QUANTITIES[DEPOSIT].member_map
OBSERVATIONS = 200  # least number of observations over the whole time, and that of rows of the ledger
CROSSING = 1.0  # largest travel between two observations, in grid cells or, if longer, raster cells
BATCH = 32  # steps of one size before it is chosen again, at most
STEP_RATIO = 1.04  # ratio of successive step sizes, so that records are repacked rarely
FEWEST_PLACES = 2**14  # for particles that are expected, where few or none are there at the start


@dataclass(frozen=True)
class RunControl:
    """Control of a run: its end, its observations, and the work that it may skip."""

    end_time: float  # time at which the run ends at the latest [s]
    stop: bool = True  # stop at rest
    arrival_threshold: float = 0.1  # thickness [m] above which the flow has arrived in a cell
    # ascending [s]. A snapshot between two steps is interpolated from the states before and after; steps do not depend on it
    snapshot_times: tuple[float, ...] = ()
    # observe whenever the fastest particle may have crossed so much of a grid cell, or of a raster cell if that is longer, and at
    # least :data:`OBSERVATIONS` times; 0 observes after every step
    crossing: float = CROSSING
    # observe only the part of the raster where the mass is, with a backend that knows it; the maps are the same bit by bit
    crop: bool = True
    # least time between two records of the forces on structures [s]; that of the rows of the ledger by default
    force_interval: float | None = None
    snapshot_particles: int = 0  # most particles that are kept at each snapshot
    probes: Probes | None = None  # points and cross-sections, in local coordinates, at which time series are recorded
    bulking: float = 1.0  # volume of the deposit over that of its mass without stress [1]
    # thresholds by the name of the quantity that are recorded where the flow reaches them at one time
    joint_conditions: Sequence[Condition] = ()

    def __post_init__(self) -> None:
        checked("end_time", self.end_time, error=ConfigError)
        object.__setattr__(self, "joint_conditions", checked_conditions(self.joint_conditions))
        checked("bulking", self.bulking, error=ConfigError)
        checked("arrival_threshold", self.arrival_threshold, error=ConfigError)
        if self.force_interval is not None and not 0 <= self.force_interval < math.inf:
            raise ConfigError(f"force_interval is {self.force_interval!r} s; it must be 0 (every step) or more")
        if not all(0 <= time < math.inf for time in self.snapshot_times):
            raise ConfigError(f"snapshot_times are {self.snapshot_times!r} s; each must be 0 or more")
        if self.snapshot_particles < 0:
            raise ConfigError(f"snapshot_particles is {self.snapshot_particles}; it must be 0 or more")


class Run:
    """One run, from time zero or a checkpoint to its end."""

    def __init__(
        self, engine: Backend, scene: Scene, control: RunControl, progress: Callable[[float], None] | None,
        keep: Checkpoint | None, structures: Structures | None = None, bed: ErodingBed | None = None,
        entering: Entering | None = None,
    ):  # fmt: skip
        self.engine, self.control, self.progress, self.keep = engine, control, progress, keep
        self.bed, self.scene, self.entering = bed, bed.scene if bed else scene, entering
        self.windowed = engine if control.crop and isinstance(engine, WindowBackend) else None  # if it looks at the flow alone
        on_lattice = self.windowed is not None and footprints.keep_peaks(scene)
        self.peaks = PeakMaps(scene, control.arrival_threshold, on_lattice, tuple(control.joint_conditions))
        probes = control.probes
        self.probes = ProbeRecorder(scene, probes, control.arrival_threshold, on_lattice) if probes else None
        self.ledger, self.rest = Ledger(bed is not None, entering is not None), AtRest()
        interval = control.end_time / OBSERVATIONS if control.force_interval is None else control.force_interval
        self.forces = StructureImpulses(structures or named_structures(scene.structures), interval)
        self.snapshots: list[tuple[float, np.ndarray, np.ndarray]] = []
        self.sample, self.particle_frames = ParticleSample(), list[np.ndarray]()
        self.pending, self.reason = list(control.snapshot_times), ""
        self.look_steps: list[int] = []
        self.frame_before: Frame | None = None  # the last state before the next snapshot
        self.planned = self.made = self.first_look = 0  # transfers of the series
        self.look_every = self.substeps = 1
        self.time = self.begun = self.dt = self.due = self.ledger_due = self.seconds = self.observing = self.eroding = 0.0
        self.particle_volume = 0.0  # mean [m3]
        self.skipped = 0.0  # [s] without any mass
        self.particles = 0  # at the start

    @property
    def n_particles(self) -> int:
        """Number of particles of all releases and other sources that have entered or wait."""
        return self.particles + (self.entering.reserved + self.entering.entered.particles if self.entering else 0)

    @property
    def more(self) -> int:
        """Particles that are expected beside those at the start, as many as these at most: places are made for them at load."""
        expected = sum(part.expected for part in (self.bed, self.entering) if part)
        return min(expected, max(self.particles, FEWEST_PLACES))

    def count(self, particles: ParticleSource) -> None:
        """Note number and mean volume of the particles."""
        self.particles = len(particles)
        self.sample = ParticleSample.of(self.n_particles, self.control.snapshot_particles)
        volume = particles.sums(self.scene.densities).mean_volume
        self.particle_volume = self.entering.mean_volume(len(particles), volume) if self.entering else volume

    def prepare(self, particles: ParticleSource) -> None:
        """Note the particles at the start, also for a bed and for what enters later."""
        self.count(particles)
        if self.bed:
            self.bed.begin(particles)
            self.bed.particles += self.entering.reserved if self.entering else 0
        if self.entering:
            self.entering.begin(self.scene, self.particles, self.peaks, self._rounding)

    def start(self, particles: ParticleSource) -> None:
        """Load the backend with the particles, or with the state of a checkpoint of this run."""
        self.prepare(particles)
        state = self.keep.read() if self.keep else None
        if state is None or not isinstance(self.engine, ResumableBackend):
            self.engine.load(self.scene, particles, self.more)
            return
        if self.bed:
            self.bed.restore(part(state, "bed."))
        if self.entering:
            self.entering.restore(part(state, "entering."))
        self.engine.restore(self.scene, part(state, "backend."))
        put_arrays(self, state, "run.")
        put_arrays(self.peaks, state, "peaks.")
        put_arrays(self.rest, state, "rest.")
        self.ledger.restore(part(state, "ledger."))
        if self.forces.structures:
            self.forces.restore(part(state, "forces."))
        if self.probes:
            self.probes.restore(part(state, "probes."))
        frames = (state["frames.time"].tolist(), state["frames.thickness"], state["frames.speed"])
        self.snapshots = list(zip(*frames, strict=True))
        self.particle_frames = list(state["frames.particles"])
        self.pending = self.pending[len(self.snapshots) :]
        LOGGER.info("continues from a checkpoint at %.4g s of %.4g s", self.time, self.control.end_time)

    def _state(self, seconds: float) -> State:
        """State for :meth:`start` to continue from, after ``seconds`` [s] of wall time in this process."""
        assert isinstance(self.engine, ResumableBackend)
        state = {f"backend.{name}": values for name, values in self.engine.checkpoint().items()}
        state |= arrays_of(self, prefix="run.") | arrays_of(self.peaks, prefix="peaks.") | arrays_of(self.rest, prefix="rest.")
        state |= {f"ledger.{name}": values for name, values in self.ledger.state().items()}
        if self.forces.structures:
            state |= {f"forces.{name}": values for name, values in self.forces.state().items()}
        state |= {f"probes.{name}": values for name, values in self.probes.state().items()} if self.probes else {}
        state |= {f"bed.{name}": values for name, values in self.bed.state().items()} if self.bed else {}
        state |= {f"entering.{name}": values for name, values in self.entering.state().items()} if self.entering else {}
        for k, name in enumerate(("time", "thickness", "speed")):
            state[f"frames.{name}"] = np.array([frame[k] for frame in self.snapshots])
        state["frames.particles"] = np.array(self.particle_frames)
        state["run.seconds"] = np.asarray(self.seconds + seconds)
        return state

    def timing(self, setup: float) -> dict[str, float]:
        """Seconds by stage, including the time before a checkpoint."""
        own = {"observers": self.observing} | ({"checkpoints": self.keep.seconds} if self.keep else {})
        own |= {"erosion": self.eroding} if self.bed else {}
        return {"setup": setup, **self.counters.seconds, **own, "total": setup + self.seconds}

    def result(self, terrain: Terrain, n_particles: int, setup: float, *, brought: bool = True) -> Result:
        """Result of the run so far, after ``setup`` [s] of preparation; with ``brought`` it has the particles as they are."""
        maps = self.peaks.maps()
        if self.control.bulking != 1.0:
            maps[DEPOSIT_MAP] = self.control.bulking * maps[DEPOSIT_MAP]
        start = self.scene.start_attributes()
        if self.control.joint_conditions:
            start |= {ATTRIBUTE: attribute_of(self.control.joint_conditions)}
        if self.bed:
            there = self.entering.waiting_thickness if self.entering else 0.0  # is not released
            deposit = self.bed.deposit_mass(self.engine.particles())
            maps |= self.bed.maps(maps[DEPOSIT_MAP] + there) | {SHARE: deposit.share}
            start |= {"bed_mass_at_end": float(deposit.of_bed.sum())}
        # only on known ground: the footprint of a particle may extend beyond an edge
        fields = {name: terrain.where_known(m, np.nan if name in WITHOUT_VALUE else 0.0) for name, m in maps.items()}
        return Result(
            terrain=terrain,
            fields=fields,
            series={"time": np.array(self.ledger.time), **self.ledger.series()},
            bring=self.engine.particles if brought else lambda: Particles.zeros(0),
            spacing=self.scene.spacing,
            steps=self.counters.steps,
            n_particles=n_particles,
            timing=self.timing(setup),
            stop_reason=self.reason,
            depth_resolution=self.depth_resolution(),
            snapshots=self.snapshots,
            particle_frames=self.particle_frames,
            start=start | (self.entering.attributes() if self.entering else {}),
            structure_forces=self.forces.result(),
            probes=self.probes.series(self.control.end_time, terrain, fields) if self.probes else None,
        )

    def depth_resolution(self) -> DepthResolution:
        """Resolution of the flow so far, with the mean length of a transfer."""
        depth, transfers = flow_depth(self.peaks.peaks[THICKNESS]), self.counters.transfers
        return DepthResolution.of(depth, self.scene, (self.time - self.skipped) / max(1, transfers), self.particle_volume)

    def go(self) -> None:
        """Step until the end time or rest."""
        started = clock.perf_counter()
        self.begin()
        while not self.reason:
            if self.keep and self.frame_before is None and self.keep.due():
                self.keep.write(self._state(clock.perf_counter() - started))
            count = self.plan(BATCH)
            if isinstance(self.engine, BatchBackend):
                self.engine.steps(self.dt, count, self.look_steps, self.look, self.substeps, self.erodes_after(count))
            else:
                count = self._step_singly(count)
            self.arrive(count)

    def _step_singly(self, count: int) -> int:
        """Make the planned transfers one by one, until one of them would be unstable; returns how many have been made."""
        for step in range(1, count + 1):
            self.engine.step(self.dt, self.substeps)
            if step in self.look_steps:
                started = clock.perf_counter()
                self._note(self._time_after(step), self._columns())
                self.observing += clock.perf_counter() - started
            if self.made + step < self.planned and not self.scene.bears(self.dt, self.engine.max_speed):
                self._end_series(step)
                return step
        return count

    def _end_series(self, steps: int = 0) -> None:
        """End the series ``steps`` transfers from now. The next transfer updates the maps, since planned updates are left out."""
        self.planned, self.due = self.made + steps, self.begun

    def begin(self) -> None:
        """Observe the start, unless the run continues from a checkpoint."""
        if not self.ledger.time:
            if self.forces.structures:
                self.forces.record(self.time, self.engine.structure_impulses())
            self._note(self.time, self._columns())
            self._keep_snapshots()
            self._observe()
            self._go_to_next_mass()

    def plan(self, most: int) -> int:
        """Set the next time step [s] and the number of substeps; returns the transfers until the next record, at most ``most``.

        ``look_steps`` are those after which the maps are updated. Length and number of the transfers of a series follow from the
        flow, the rows of the ledger and the end. Snapshots and forces interrupt a series but do not change it.
        """
        if self.made < self.planned and not self.scene.bears(self.dt, self.engine.max_speed):
            self._end_series()
        if self.made == self.planned:
            self._plan_series(most)
        count = self.planned - self.made
        if self.forces.structures:
            count = min(count, max(1, self._steps_until(self.forces.due) - self.made))
        if self.bed:
            count = min(count, max(1, self._steps_until(self.bed.due) - self.made))
        if self.entering and self.entering.due < math.inf:
            count = min(count, max(1, self._steps_until(self.entering.due) - self.made))
        if self.pending:
            count = min(count, self._steps_before_snapshot())
        planned = range(self.first_look, self.planned + 1, self.look_every)
        self.look_steps = [step - self.made for step in planned if self.made < step <= self.made + count]
        return count

    def _plan_series(self, most: int) -> None:
        """Set length and number of the next transfers, and the looks after them.

        A step is at most twice as long as the one before. The last transfers before the end, and before mass enters at a stated
        time, are equal: where less than one would be left behind the series, the time to there is divided by their number. A much
        shorter transfer would start the next from contact forces that are too large.
        """
        control, longest = self.control, 2.0 * self.dt or math.inf
        left = min(control.end_time, self.entering.stop if self.entering else math.inf) - self.time
        self.begun, self.made = self.time, 0
        self.dt = _on_ladder(min(self.engine.stable_step(), longest))
        self.substeps = self.scene.substep_count(self.dt, self.engine.max_speed)
        count = max(1, min(self._bearable(most), self._steps_until(self.ledger_due)))
        if left < (count + 1) * self.length:
            to_end = max(1, math.ceil(left / self.length - 1e-9))
            self.dt, count = left / (to_end * self.substeps), min(count, to_end)
        self.planned = count
        crossing = control.crossing * self.scene.observed_length / max(self.engine.max_speed, 1e-3)
        wait = min(control.end_time / OBSERVATIONS, crossing)
        self.first_look, self.look_every = max(1, self._steps_until(self.due)), max(1, int(wait / self.length))
        if self.first_look <= count:
            last = count - (count - self.first_look) % self.look_every
            self.due = self.time + self.length * last + wait

    @property
    def length(self) -> float:
        """Length [s] of a transfer."""
        return self.dt * self.substeps

    def _steps_until(self, time: float) -> int:
        """Number of transfers of the series that reach a time [s]."""
        return math.ceil((time - self.begun) / self.length - 1e-9)

    def _time_after(self, steps: int) -> float:
        """Time [s] after ``steps`` more transfers; all bits are the same however often the series is interrupted."""
        return self.begun + self.length * (self.made + steps)

    def _steps_before_snapshot(self) -> int:
        """Number of transfers to the last state before the next snapshot, or, from that state, which is kept, 1."""
        transfers = (self.pending[0] - self.time) / self.length
        if transfers > 1.0 - 1e-9:
            return max(1, int(transfers + 1e-9))
        if self.frame_before is None:
            self.frame_before = self._frame()
        return 1

    def _bearable(self, most: int) -> int:
        """Number of transfers, at most ``most``, that stay stable while gravity speeds up the fastest particle."""
        fall = self.length * float(np.linalg.norm(self.scene.gravity))
        while most > 1 and not self.scene.bears(self.dt, self.engine.max_speed + (most - 1) * fall):
            most = 3 * most // 4
        return most

    def look(self, step: int, columns: RasterSums) -> None:
        """Update the maps with the columns after one of the planned transfers."""
        started, scene = clock.perf_counter(), self.scene
        if not self.peaks.on_lattice:
            columns = footprints.on_raster(columns, scene.raster, footprints.lattice_cell(scene))
        self._note(self._time_after(step), columns)
        self.observing += clock.perf_counter() - started

    def erodes_after(self, count: int) -> bool:
        """Whether the bed is eroded after ``count`` more transfers; at the end maps have been updated, and no particle is born."""
        end = self.control.end_time - self._rounding
        return self.bed is not None and self.bed.due - self._rounding <= self._time_after(count) < end

    def arrive(self, count: int) -> None:
        """Account for ``count`` finished steps; record forces, snapshots and a row of the ledger if they are due."""
        erodes, end = self.erodes_after(count), self.control.end_time - self._rounding
        self.time, self.made = self._time_after(count), self.made + count
        if self.bed and erodes:
            self._erode(self.bed)
        if self.time >= self.forces.due - self._rounding:
            self.forces.record(self.time, self.engine.structure_impulses())
        self._keep_snapshots()
        if self.time >= end:
            self._let_enter()  # what is due at the end is in the last row and in the maps
        if not self.reason and self.time >= min(self.ledger_due - self._rounding, end):
            self._observe()
        self._let_enter()
        self._go_to_next_mass()

    def _let_enter(self) -> None:
        """Let mass enter that is due. With a whole mass, or the first one, maps get the columns before and after its time.

        At the end of the run they get the columns with what enters then.
        """
        entering = self.entering
        if self.reason or entering is None or entering.due > self.time + self._rounding:
            return
        is_first = self.ledger.rows[-1].mass == 0.0
        before = self._columns() if is_first or entering.is_sudden(self.time) else None
        unnumbered = entering.entered.particles
        number = entering.update(self.engine, self.time, self.bed.born if self.bed else 0)
        if self.bed:
            self.bed.particles += entering.entered.particles - unnumbered
        if number and before is not None:
            self._note(self.time, before)
            self._note(self.time, self._columns())
            self.rest = AtRest()
            self._observe()
            self._end_series()
        elif number and self.time >= self.control.end_time - self._rounding:
            self._note(self.time, self._columns())

    def _go_to_next_mass(self) -> None:
        """Without any mass, go to the time at which some enters, or to the end: there is nothing to compute."""
        while self.entering and self.entering.coming and not self.reason and self.ledger.rows[-1].mass == 0.0:
            last, self.dt = self.time, 0.0
            self.time = min(self.entering.next_coming, self.control.end_time)
            self.skipped += self.time - last
            self._end_series()
            self.forces.due = max(self.forces.due, self.time)
            self._keep_snapshots()
            self._let_enter()
            if not self.reason and self.time >= self.control.end_time - self._rounding:
                self._observe()

    def _erode(self, bed: ErodingBed) -> None:
        """Erode the bed up to the present time."""
        started = clock.perf_counter()
        bed.update(self.engine, self.time)
        self.eroding += clock.perf_counter() - started

    @property
    def counters(self) -> Counters:
        """Work since the start of the run."""
        return self.engine.counters

    @property
    def _rounding(self) -> float:
        """Error of a time by rounding [s]."""
        return 1e-12 * self.control.end_time

    def _note(self, time: float, columns: RasterSums) -> None:
        """Update maps and probes with the columns at one time [s]."""
        self.peaks.observe(time, columns)
        if self.probes:
            self.probes.observe(time, columns, self.dt)

    def _keep_snapshots(self) -> None:
        """Keep the snapshots up to the present time: between the states before and after one, both are weighted by time."""
        if not self.pending or self.pending[0] > self.time + self._rounding:
            return
        started, after = clock.perf_counter(), self._frame()
        while self.pending and self.pending[0] <= self.time + self._rounding:
            time = self.pending.pop(0)
            frame = self.frame_before.blend(after, time) if self.frame_before else after
            self.snapshots.append((time, frame.thickness, frame.speed))
            if self.sample.size:
                self.particle_frames.append(frame.particles)
        self.frame_before = None
        self.observing += clock.perf_counter() - started

    def _observe(self) -> None:
        """Record the present state, and update the maps if it is the last."""
        started, control = clock.perf_counter(), self.control
        if self.time >= control.end_time * (1 - 1e-12):
            self.reason = "end time"
        row = self.engine.ledger()
        row = self.bed.ledger(row) if self.bed else row
        self._record(self.entering.ledger(row) if self.entering else row, self.engine.memory_bytes())
        self.ledger_due = self.time + control.end_time / OBSERVATIONS
        if self.reason and self.peaks.time < self.time:
            self._note(self.time, self._columns())
        if self.reason and self.forces.structures and self.forces.times[-1] < self.time:
            self.forces.record(self.time, self.engine.structure_impulses())
        if self.progress:
            self.progress(1.0 if self.reason else self.time / control.end_time)
        self.observing += clock.perf_counter() - started

    def _record(self, row: LedgerRow, memory: int) -> None:
        """Add a row to the ledger; the run ends if the flow rests."""
        self.ledger.record(self.time, self.dt, row, memory)
        coming = self.entering is not None and self.entering.coming
        if self.control.stop and self.rest.reached(row) and not coming:
            self.reason = "at rest" if row.mass > 0 else "all mass has left the domain"

    def _columns(self) -> RasterSums:
        """Columns for the peaks: on the lattice or the raster."""
        return self.windowed.lattice_columns() if self.windowed and self.peaks.on_lattice else self._raster_columns()

    def _raster_columns(self) -> RasterSums:
        return self.windowed.flow_columns() if self.windowed else self.engine.columns()

    def _frame(self) -> Frame:
        """The present state on the whole raster, and that of the sample of particles."""
        columns, raster = self._raster_columns(), self.scene.raster
        whole = np.zeros((2, raster.rows, raster.columns))
        whole[:, *columns.window] = flow_fields(columns, raster)
        empty = np.zeros((0, 4), np.float32)
        particles = self.sample.take(self.engine.particles(), self.scene.spacing) if self.sample.size else empty
        return Frame(self.time, whole[0], whole[1], particles)


def _on_ladder(limit: float) -> float:
    """Largest step of a geometric sequence that does not exceed the limit."""
    return float(STEP_RATIO ** math.floor(math.log(limit) / math.log(STEP_RATIO)))
