"""Scenes on a device, stepped together: the order of one step, and the look of the host at it once in many.

Scenes of a batch share the grid's spacing, the law and the number type. Each has its own domain, a stretch of blocks from south to
north that no other reaches, so that one index serves all of them; and its own terrain, materials, friction, time step and end.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from runout.backends import footprints
from runout.backends.hash import clock, gradient_transfer, readback, sort
from runout.backends.hash.device_status import DeviceStatus
from runout.backends.hash.graphs import Graphs
from runout.backends.hash.grid import NodeArrays
from runout.backends.hash.ground import Ground
from runout.backends.hash.index import GAP, Index
from runout.backends.hash.kernels import compiled_kernels
from runout.backends.hash.layout import (
    CELL_LANES,
    CLOCK,
    FAILED,
    PENDING,
    STEPS,
    UNSTABLE,
    WARP,
    bytes_of,
    run,
    run_blocks,
    run_each,
)
from runout.backends.hash.state import Store
from runout.backends.hash.unknown import UnknownCells
from runout.backends.hash.validation import LARGEST_BLOCK, extent, fastest, require_alike, require_finite
from runout.backends.hash.zones import Zones
from runout.backends.protocol import Counters, LedgerRow, RasterSums
from runout.errors import CapacityError, StabilityError
from runout.model.particles import Particles
from runout.model.scene import Scene

STEPS_PER_SORT = 64  # the particles come back into the order of their cells in memory after so many steps
SORTS_BEFORE = 2  # for either place of the rows, before a sort is recorded as a graph
FEWEST = 4  # but not before so many, unless a particle leaves the index
FARTHEST = 1.75  # cells that a particle moves in a step at most, in any direction, before the run is called unstable


@dataclass
class Account:
    """What the host knows of a scene."""

    particles: int
    mass: float  # [kg]
    max_speed: float
    particle_volume: float = 0.0  # mean [m3]
    packed_dt: float = 0.0  # time step for which the records hold the stress [s]
    contact_particles: int = 0
    failure: str = ""


def _account(scene: tuple[Scene, Particles]) -> Account:
    """That of a scene whose particles a step can move."""
    s, p = scene
    require_finite(p, s)
    return Account(len(p), float(p.mass.sum()), fastest(p), footprints.mean_volume(s, p))


class Batch:
    """Scenes and their particles on one device.

    Parameters
    ----------
    scenes : sequence of (Scene, Particles)
        All of one spacing, law, gravity, precision and contact band.
    device : str
        "cpu" or "cuda:N".
    deterministic : bool
        Results on a GPU repeat bit by bit, and those of a scene equal those of its own run.

    Raises
    ------
    ConfigError
        If scenes differ in what they must share.
    CapacityError
        If they need more memory or more blocks than there are.
    """

    def __init__(self, scenes: Sequence[tuple[Scene, Particles]], device: str = "cpu", deterministic: bool = False):
        self.device, self.deterministic = wp.get_device(device), deterministic
        self.graphs = self.device.is_cuda  # record steps as a graph
        self.scenes, self.counters = [s for s, _ in scenes], Counters()
        self.scene = self.scenes[0]
        require_alike(self.scenes)
        with ThreadPoolExecutor() as pool:
            self.accounts = list(pool.map(_account, scenes))
        also = any(x.friction_zones for x in self.scenes), gradient_transfer.uses_gradient_transfer(self.scene)
        self.k = compiled_kernels(self.scene.law, self.scene.precision, deterministic, *also)
        self.since_sort, self.sorting = 0, False
        self.cached_ledger: np.ndarray | None = None  # sums of the present state, once somebody has asked
        self.cached_columns: dict[int, RasterSums] = {}  # the same by column
        self.recorded = Graphs(self.device, self.k.modules)  # steps and sorts, for either place of the rows
        self.present = np.ones(len(scenes), bool)
        self.identity = np.concatenate([p.identity for _, p in scenes])
        self.first_number = np.cumsum([0, *(len(p) for _, p in scenes)])
        with self._on_device():
            self._load_scenes()
            self._load_particles([p for _, p in scenes])

    @contextmanager
    def _on_device(self) -> Iterator[None]:
        """Scope of the device; a device without memory left is a CapacityError with numbers."""
        try:
            with wp.ScopedDevice(self.device):
                yield
        except RuntimeError as error:
            if "allocate" not in str(error):
                raise
            raise CapacityError(
                f"{self.device.alias} has no memory left ({error}) for {len(self.identity)} particles; "
                f"this run holds {self.bytes_used() / 2**30:.2f} GiB so far; use larger cells or fewer particles per cell"
            ) from error

    def _load_scenes(self) -> None:
        s, n = self.scene, len(self.scenes)
        self.real = wp.float32 if s.precision == "float32" else wp.float64
        self.h = wp.types.vector(length=3, dtype=self.real)(*s.spacing)
        materials = [m for scene in self.scenes for m in scene.materials]
        self.table = s.law.table(tuple(materials), s.dtype)
        self.mats = wp.array(self.table, dtype=self.k.record)
        self.first_release = np.cumsum([0, *(len(scene.materials) for scene in self.scenes)])
        self.density = wp.array(np.array([m.density for m in materials]), dtype=wp.float64)
        limits = np.array([extent(scene) for scene in self.scenes])
        self.limits, self.unknown = wp.array(limits, dtype=wp.float64), UnknownCells(self.scenes)
        self.rows = 2**20 if n == 1 else int(limits[:, 1].max()) // 4 + 1 + GAP
        if n > 1 and n * self.rows >= LARGEST_BLOCK:
            raise CapacityError(f"{n} scenes of {self.rows} blocks from south to north pass the {LARGEST_BLOCK} of the index")
        self.shifts = 4 * self.rows * np.arange(n)
        self.shift = wp.array(self.shifts.astype(np.int32), dtype=wp.int32)
        self.device_status = DeviceStatus(n, self.real)
        self.flags, self.contacts, self.peaks = self.device_status.flags, self.device_status.contacts, self.device_status.peaks
        self.peaks.assign(np.array([*(a.max_speed**2 for a in self.accounts), 0.0], s.dtype))
        self.left, self.step_counts = (wp.zeros(n, dtype=wp.int32) for _ in range(2))
        self.report = readback.Report(n, self.device.is_cuda)
        self.steps_of, self.packed = (wp.zeros(n, dtype=self.real) for _ in range(2))
        self.clock = wp.zeros((n, CLOCK), dtype=self.real)
        self.band = self.real(s.contact_band * min(s.spacing))

    def _load_particles(self, given: list[Particles]) -> None:
        """Find the blocks of the particles, and bring their arrays to the device in the order of the cells."""
        self.largest = max((float(p.radius.max(initial=0.0)) for p in given), default=0.0)
        self._load_ground()
        self.store = s = Store(len(self.identity), self.real, not self.scene.packed)
        self.index = Index(self.k, self.device_status, s.size, self.deterministic, len(self.scenes), self.rows)
        self.nodes = self.node_arrays()
        if not s.size:
            return
        sizes, shifts, firsts = [len(p) for p in given], self.shifts.astype(np.int32), self.first_release[:-1]
        s.fill(given, np.concatenate([p.release for p in given]) + np.repeat(firsts, sizes), self.scene.spacing, self.scene.dtype)
        nodes = np.concatenate([p.node for p in given])
        nodes[:, 1] += np.repeat(shifts, sizes)
        works = sort.given(self, nodes)
        sort.enqueue(self, *works)
        s.turn_over()
        sort.settle(self, lambda: works)

    def _load_ground(self) -> None:
        """The surfaces, and how far from them particles of the largest radius may be to touch them."""
        reach = self.largest + float(self.band) + FARTHEST * max(self.scene.spacing)
        surfaces = [s.ground for s in self.scenes if s.ground is not None]
        self.zones, self.ground = Zones(self.scenes, self.real), Ground(surfaces, self.scene.spacing, reach) if surfaces else None

    def node_arrays(self) -> NodeArrays:
        """New arrays by block for the present index."""
        kept, averaged = any(s.keeps for s in self.scenes), self.scene.f_bar
        return NodeArrays(self.index.capacity, self.store.size, self.real, self.deterministic, kept, averaged)

    def _rebuild(self) -> None:
        """Find the blocks anew and bring the particles back into the order of their cells in memory; the host does not wait."""
        if self.sorting:
            self._settle()
        self.counters.rebuilds += 1
        self.since_sort, self.sorting = 0, True
        self._launch((self.store.turn, -1), lambda: sort.enqueue_again(self), SORTS_BEFORE)
        self.store.turn_over()

    def _settle(self) -> dict[str, np.ndarray]:
        """What the host knows of the device once a sort is done."""
        self.sorting = False
        return sort.settle(self, lambda: sort.present(self))

    def bytes_used(self) -> int:
        """Memory of the device arrays of the run [byte]."""
        return bytes_of(*(part for part in map(vars(self).get, ("store", "index", "nodes", "ground")) if part is not None))

    def stable_step(self, scene: int = 0) -> float:
        """Largest admissible time step [s] of a scene."""
        return self.scenes[scene].stable_step(self.accounts[scene].max_speed)

    def advance(self, dt: Sequence[float], count: Sequence[int]) -> None:
        """``count[s]`` explicit steps of ``dt[s]`` [s] of scene s; the host looks in only when particles are sorted."""
        started = time.perf_counter()
        self.cached_ledger, self.cached_columns = None, {}
        self._require_stable(dt, count)
        left = np.where(self.present, np.asarray(count, np.int64), 0)
        with self._on_device():
            clock.set_steps(self, np.asarray(dt, float), left)
            given = np.zeros_like(left)
            while left.max() > 0 and self.store.n > 0:
                if self.since_sort >= self._steps_per_sort(left):
                    self._rebuild()
                if not np.array_equal(left, given):  # the device counts for itself
                    self.left.assign(left.astype(np.int32))
                done = self._batch(min(int(left.max()), self._steps_per_sort(left) - self.since_sort), left)
                given = np.maximum(left - done, 0)
                left = np.where(self.present, given, 0)
        self.counters.steps += int(left.max())
        seconds = self.counters.seconds
        seconds["steps"] = seconds.get("steps", 0.0) + time.perf_counter() - started

    def _require_stable(self, dt: Sequence[float], count: Sequence[int]) -> None:
        """A scene whose step is too long ends the run if it is the only one; one of several leaves."""
        for s in map(int, np.flatnonzero(self.present & (np.asarray(count) > 0))):
            try:
                self.scenes[s].require_stable(float(dt[s]), self.accounts[s].max_speed, self.counters.steps + 1)
            except StabilityError as error:
                self._break(s, str(error))

    def _steps_per_sort(self, left: np.ndarray) -> int:
        """Steps from one sort to the next: as many as the fastest particle takes to come one cell further."""
        moves = [a.packed_dt * a.max_speed for a, n in zip(self.accounts, left, strict=True) if n > 0]
        cells = max(moves) / min(self.scene.spacing)
        return STEPS_PER_SORT if cells * STEPS_PER_SORT <= 1 else max(FEWEST, int(1 / cells))

    def _batch(self, count: int, left: np.ndarray) -> int:
        """Up to ``count`` steps without a look at the device; returns how many were done."""
        if not self.sorting:
            self.flags.zero_()
        for _ in range(count):
            self._launch((self.store.turn, self.index.launched), self._enqueue, int(count == 1))
        device_status = self._settle() if self.sorting else self.device_status.read()
        flags, peaks, contacts = device_status["flags"], device_status["peaks"].astype(float), device_status["contacts"]
        done = int(flags[STEPS])
        self.counters.steps += done
        held = [self.store.n] if len(self.scenes) == 1 else [a.particles for a in self.accounts]
        self.counters.particle_steps += int(np.minimum(done, left) @ np.array(held))
        self.since_sort += done
        for account, peak, touching in zip(self.accounts, peaks, contacts, strict=False):
            account.max_speed, account.contact_particles = float(np.sqrt(peak)), int(touching)
        broken = self.present & ~np.isfinite(peaks[:-1])
        if flags[PENDING] >= UNSTABLE:
            broken[flags[FAILED]] = True
        for s in np.flatnonzero(broken):
            a = self.accounts[s]
            moved = f"a particle moved {peaks[-1]:.3g} cells in step {self.counters.steps} of {a.packed_dt:.3g} s"
            self._break(int(s), f"{moved} at {a.max_speed:.3g} m/s; use a smaller cfl, or check material and terrain there")
        if flags[PENDING] or broken.any():
            self._rebuild()
            self._settle()
        return done

    def _break(self, scene: int, reason: str) -> None:
        """A scene has become unstable: the only one ends the run, one of several leaves."""
        if len(self.scenes) == 1:
            raise StabilityError(reason)
        self.accounts[scene].failure = reason
        self.leave([scene])

    def failure(self, scene: int) -> str:
        """Why a scene has left before its end; empty if it has not."""
        return self.accounts[scene].failure

    def leave(self, scenes: Sequence[int]) -> None:
        """Scenes that have come to their end leave the device at the next sort; look at them before."""
        self.cached_ledger = None
        self.present[list(scenes)] = False
        peaks = self.peaks.numpy()
        peaks[list(scenes)] = 0.0
        with self._on_device():
            self.peaks.assign(peaks)
            gone = wp.array((~self.present).astype(np.int32), dtype=wp.int32)
            run(self.k.leave, self.store.n, self.store.key, self.index.member, gone)

    def _launch(self, name: tuple[int, int], enqueue: Callable[[], None], before: int) -> None:
        """Launches, on a GPU as a graph once they have come ``before`` times."""
        if self.graphs:
            self.recorded.launch(name, (self.index.generation, self.nodes.generation), enqueue, before)
        else:
            enqueue()

    def _enqueue(self) -> None:
        """Launches of one step."""
        self._begin()
        self._to_grid()
        gradient_transfer.push(self)
        self._move_nodes()
        gradient_transfer.average(self)
        self._to_particles()
        self.unknown.let_escape(self)
        self._list_cells()

    def _begin(self) -> None:
        run(
            self.k.begin_step, len(self.scenes), self.flags, self.index.tally, self.left, self.steps_of, self.real(self.largest),
            self.band, self.clock, self.peaks, self.contacts, self.step_counts,
        )  # fmt: skip

    def _list_cells(self) -> None:
        """The particles of each cell, after they have moved."""
        i, k, s = self.index, self.k, self.store
        i.list_cells(self.flags, self.nodes)
        s.place(k, i)
        if self.deterministic:
            run(k.sort_cells, i.capacity * CELL_LANES, self.flags, i.tally, i.active, s.number, i.cstart, s.order)

    def _to_grid(self) -> None:
        i, k, s, n = self.index, self.k, self.store, self.nodes
        run_blocks(
            k.particles_to_grid, i.launched, CELL_LANES, s.rec, s.order, i.cstart, i.up, self.flags, i.tally, i.active, i.member,
            self.clock, n.grid, n.arenas,
        )  # fmt: skip
        if self.deterministic:
            run(k.note_held, i.capacity, i.cstart, n.held)
            run(k.sum_nodes, i.capacity * 64, self.flags, n.arenas, n.held, i.down, n.grid)

    def _move_nodes(self) -> None:
        """Velocities of the nodes, after the impulses of the ground."""
        i, n = self.index, self.nodes
        if self.ground is not None:
            self._find_contacts()
            self._push()
        given = self.flags, i.tally, i.member, self.clock, n.grounded, n.shares, n.ground_slopes, n.approach_speeds, i.ends, n.grid
        run(self.k.update_nodes, i.capacity * 64, *given)

    def _pressed(self) -> tuple[Any, Any]:
        """Arrays for the list of the particles in contact by cell, and its starts: those of all, unless these are needed yet."""
        n = self.nodes
        return (n.pressed, n.pressed_start) if self.scene.f_bar else (self.store.order, self.index.cstart)

    def _find_contacts(self) -> None:
        i, k, s, n = self.index, self.k, self.store, self.nodes
        run_each(
            k.find_contacts, n.places, WARP, s.rec, s.radius, s.order, i.cstart, self.flags, i.tally, n.standing, i.member,
            self.clock, n.tiles, n.bounds, self.h, self.band, self.real(self.largest), i.around, n.approach_speeds, i.touching,
            i.touched, self.contacts, n.near_up, n.shares, n.arenas, *self._pressed(), s.number, s.forces, i.up, self.step_counts,
            n.grid,
        )  # fmt: skip
        if self.deterministic:
            run(k.sum_contacts, i.capacity * 64, self.flags, n.arenas, i.touching, i.down, n.grounded, 0, n.shares, n.grid)

    def _push(self) -> None:
        i, k, s, n = self.index, self.k, self.store, self.nodes
        run_each(
            k.solve_contacts, n.places, WARP, s.rec, s.radius, s.release, *self._pressed(), i.up, self.flags, i.tally, i.touched,
            i.member, self.clock, n.tiles, self.h, self.zones.friction, s.only, *self.zones.tables, self.shift, i.coordinates,
            n.near_up, n.grid, n.shares, n.arenas, n.booked, s.number, s.forces, self.step_counts,
        )  # fmt: skip
        if self.deterministic:
            run(k.sum_contacts, i.capacity * 64, self.flags, n.arenas, i.touching, i.down, n.grounded, 1, n.shares, n.grid)

    def _to_particles(self) -> None:
        i, s, n = self.index, self.store, self.nodes
        run_blocks(
            self.k.grid_to_particles, i.launched, CELL_LANES, s.rec, s.release, s.key, i.homes, i.home, i.ends, i.around, i.up,
            i.coordinates, self.flags, i.tally, i.member, self.clock, n.grid, self.mats, self.h, self.shift,
            self.limits, self.peaks, n.booked,
        )  # fmt: skip

    def ledgers(self) -> list[LedgerRow]:
        """Sums of the present state, a row a scene."""
        with self._on_device():
            return readback.ledgers(self)

    def particles_of(self, scene: int) -> Particles:
        """The particles of a scene as they are, in the order of their identity."""
        with self._on_device():
            return readback.particles(self, scene)

    def columns_of(self, scene: int) -> RasterSums:
        """Sums over the columns of the cells of a scene's raster."""
        with self._on_device():
            return readback.whole(self, scene)

    def flow_columns_of(self, scene: int) -> RasterSums:
        """The same over a window of cells that holds all mass."""
        if scene not in self.cached_columns:
            self.look_at([scene])
        return self.cached_columns[scene]

    def look_at(self, scenes: Sequence[int]) -> None:
        """Bring the columns over windows of some scenes at once, for :meth:`flow_columns_of`; the host waits once for all."""
        with self._on_device():
            self.cached_columns |= readback.around_flow(self, scenes)
