"""The order of one step on the CPU, and the arrays it works on."""

import math
import os
import time
from typing import Any

import numpy as np

from runout.backends import footprints
from runout.backends.protocol import Counters, LedgerRow, RasterSums
from runout.backends.scan import checkpoint, grid, grid_to_particles, index, observe, raster_sums, sleep
from runout.backends.scan.arenas import Arenas
from runout.backends.scan.domain import Domain
from runout.backends.scan.gradient_transfer import GradientTransfer, uses_gradient_transfer
from runout.backends.scan.kernels import kernels_for
from runout.backends.scan.schedule import Schedule
from runout.backends.scan.state import PADDING, SELDOM, Store, capacity, reserve
from runout.backends.scan.waiting import wait_briefly
from runout.backends.state import State
from runout.errors import CapacityError, ConfigError, StabilityError
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics import moments

MARGIN = 3  # cells that a particle may move before the index is rebuilt
PARTICLES_PER_THREAD = 10_000  # below, waiting for each other costs more than threads gain
MOST_IN_A_BLOCK = 2**18
LONGEST_LIST = 1024  # of holes between the slots of blocks
INDEXES = ("sparse", "dense")


def create(threads: int | None = None, index: str = "sparse") -> "ScanBackend":
    """A backend that uses ``threads`` threads, by default all that are allowed."""
    return ScanBackend(threads, index)


class ScanBackend:
    """Sparse block-scan backend (see :class:`runout.backends.protocol.Backend`).

    Parameters
    ----------
    threads : int, optional
        Threads, at most those that the process may use; all by default. Results do not depend on it.
    index : str
        "sparse", or "dense" for every block in the box around the particles: what the sparse index is measured against.
    """

    def __init__(self, threads: int | None = None, index: str = "sparse"):
        import numba

        if index not in INDEXES:
            raise ConfigError(f"index is {index!r}; choose one of {', '.join(INDEXES)}")
        wait_briefly()
        settings: Any = numba.config
        available = min(settings.NUMBA_NUM_THREADS, len(os.sched_getaffinity(0)))
        self.allowed = min(threads or available, available)
        self.threads, self.counters = 1, Counters()
        self.dense = index == "dense"
        self.period = (0, 0, 0)  # [cells] after which the grid, not the ground, repeats; may be set where the index is dense
        self.buffers: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

    def load(self, scene: Scene, particles: Particles) -> None:
        """Take over a scene and its particles."""
        if not np.isfinite(particles.velocity).all() or not np.isfinite(particles.offset).all():
            raise StabilityError("positions or velocities of the particles are not finite; check the input")
        if not (particles.mass > 0).all():
            raise StabilityError("a particle has no mass; every particle needs a positive mass")
        self.scene, self.n = scene, len(particles)
        self.cursors = np.zeros((self.allowed, 8), np.int64)
        self.holes, self.n_holes = np.zeros((LONGEST_LIST, 2), np.int64), 0
        self.surge, self.closed_at, self.closed_end = 0, 0, self.n  # fresh slots of a step of late; step and end of closed gaps
        self.k = kernels_for(scene)
        self.no_rates = (np.zeros((0, 16), scene.dtype), scene.dtype(0), np.zeros((0, 16), scene.dtype), scene.dtype(0))
        self.gradient_transfer = GradientTransfer(scene) if uses_gradient_transfer(scene) else None
        self.counters = Counters()
        self.threads = max(1, min(self.allowed, self.n // PARTICLES_PER_THREAD))
        self.packed_dt, self.moved = 0.0, False
        self.escaped_mass = self.escaped_energy = self.basal_dissipation = self.plastic_dissipation = 0.0
        self.basal_impulse = np.zeros(3)
        self.contact_particles = self.sleepers = 0
        self.sleeping_mass = 0.0
        self._tabulate(particles)
        self._place(particles)

    def _tabulate(self, particles: Particles) -> None:
        """Constants of the run as kernels take them."""
        scene, real = self.scene, self.scene.dtype
        self.spacing = np.array(scene.spacing)
        self.h = self.spacing.astype(real)
        self.mats = scene.law.table(scene.materials, real)
        self.friction, zones = np.array(scene.acting_friction, real), scene.friction_zones
        self.zones: tuple[np.ndarray, ...] = ()
        if zones:  # contacts hold the number of their release until take_zones puts a friction in its place
            self.friction = np.arange(len(self.friction)).astype(real)
            masses = np.column_stack([scene.friction, scene.strengths])
            self.zones = (
                *(a.astype(real) for a in (zones.factor, zones.coefficient)),
                np.array(zones.cell_size),
                masses.astype(real),
            )
        self.particle_volume = footprints.mean_volume(scene, particles)
        self.density = np.array([m.density for m in scene.materials], np.float64)
        self.gravity, self.dv = np.array(scene.gravity, np.float64), np.zeros(16, real)
        self.corner = particles.node.min(0).astype(np.int64) if self.n else np.zeros(3, np.int64)
        self.domain = Domain.of(scene, self.corner)
        self.largest_radius = float(particles.radius.max(initial=0.0))
        self.of_one_size = bool(len(particles) and (particles.radius == particles.radius[0]).all())
        self.max_speed = float(np.sqrt((particles.velocity**2).sum(1).max(initial=0.0)))

    def _place(self, particles: Particles) -> None:
        """Give every particle a slot, by block and cell. Blocks are counted from the lowest node in use.

        So a scene that is moved by whole cells gives the same bits.
        """
        node = particles.node - self.corner
        particles.require_index_range(self.scene.spacing, self.corner)
        sequence, found = index.Index.of_nodes(node)
        if found.nown and found.held.max() > MOST_IN_A_BLOCK:
            most = found.held.max()
            raise CapacityError(f"a block of 64 cells holds {most} particles, at most {MOST_IN_A_BLOCK} fit; use smaller cells")
        before = found.first.copy()
        self.end = int(self.k.give_slots(found.held, found.first, found.capacity, found.nown))
        slot = np.arange(self.n) + np.repeat(found.first - before, found.held)
        self.store = Store.of(capacity(self.end), slot, particles.take(sequence), self.scene)
        self._index_anew(found)
        self.k.mark_slots(self.index.starts, self.index.first, self.index.nown, self.store.cell, self.store.order)

    def _index_anew(self, old: index.Index, arenas: Arenas | None = None) -> None:
        """Find the blocks anew; the particles keep their slots, and those of ``arenas`` that sleep go on to."""
        self.index, numbers = old.rebuilt(self.k, MARGIN, self.dense)
        i = self.index
        self.k.hand_over_slots(numbers, old.starts, old.first, old.capacity, old.nown, i.starts, i.first, i.capacity, i.held)
        if any(self.period):
            i.join_ends(self.period)
        self._allocate_blocks(arenas)
        if arenas is not None and self.scene.sleep_speed:
            sleep.carry_over(self, arenas, old.held, numbers)

    def _make_slots(self) -> None:
        """Close the gaps that blocks have left behind, once few slots remain; more slots if they do not gain much."""
        i, s, k = self.index, self.store, self.k
        often = SELDOM * (self.end - self.closed_end) // max(self.counters.steps - self.closed_at, 1)
        self.closed_at, self.n_holes = self.counters.steps, 0
        packed, spare = k.packed_end(i.held, i.nown), max(4 * reserve(self.n), 2 * self.surge, min(often, self.n // 5))
        if packed + spare > s.slots:
            s.grow(max(packed + spare, capacity(packed)))
        by_slot = (used := np.flatnonzero(i.held))[np.argsort(i.first[used])]
        slots = s.rec, s.state, s.particle_index, s.cell, s.order, i.starts, by_slot, i.first, i.capacity, i.held
        self.closed_end = self.end = k.pack_slots(*slots, *(buffer[0] for buffer in self.buffers[:3]))

    def _allocate_blocks(self, former: Arenas | None = None) -> None:
        """Arrays by block, after a rebuild; with room for as many shares as the ``former`` had, or the next step runs twice."""
        i, k, ground = self.index, self.k, self.scene.ground
        self.schedule = Schedule.of(i, self.threads, not self.gradient_transfer)
        sleeps, sharers = self.scene.sleep_speed > 0, len(former.shares) if former else 0
        self.arenas = a = Arenas.of(i, self.schedule, self.scene.dtype, self.domain, sleeps, sharers)
        self.reaches_rim = bool(a.rim.any())
        self._fit_buffers(k.total_held(i.held, i.nown)[1])
        if ground is not None:
            surface = ground.surface
            k.cut_tiles(
                surface.coefficients, *surface.origin, *surface.spacing, ground.change, ground.first,
                i.bxyz, i.around, i.nown, self.corner, self.spacing, a.tiles, a.planes, a.bounds,
            )  # fmt: skip

    def _fit_buffers(self, fullest: int) -> None:
        """Buffers for each thread that hold the fullest block, with some room where they are made."""
        shape, real = (self.threads, int(1.25 * fullest) + 2 * PADDING), self.scene.dtype
        self.buffers = (
            np.empty((*shape, 16), real),
            np.empty((*shape, 8), real),
            np.empty(shape, np.int32),
            np.empty(shape, np.uint8),
        )

    def stable_step(self) -> float:
        """Largest admissible time step [s]."""
        return self.scene.stable_step(self.max_speed)

    def step(self, dt: float) -> None:
        """One explicit step of ``dt`` [s]."""
        import numba

        self.scene.require_stable(dt, self.max_speed, self.counters.steps + 1)
        numba.set_num_threads(self.threads)
        self.counters.steps += 1
        self.counters.particle_steps += self.n
        if self.n == 0:
            return
        clock = _Clock(self.counters.seconds)
        if self.index.travelled + 1 > MARGIN:
            self.counters.rebuilds += 1
            self._index_anew(self.index, self.arenas)
        if self.end + max(reserve(self.n), self.surge) > self.store.slots:
            self._make_slots()
        clock("index")
        self._to_grid(dt)
        clock("p2g")
        self._contact()
        clock("contact")
        self._to_particles(dt)
        clock("g2p")
        self._sort()
        if self.scene.sleep_speed:
            sleep.after_step(self, dt)
        clock("sort")

    def _change_step(self, dt: float) -> None:
        """Constants of steps of ``dt`` [s]; the records are packed anew."""
        i, s, real = self.index, self.store, self.scene.dtype
        self.scene.law.set_step(self.mats, dt)
        if self.scene.packed:
            ddt, self.packed_dt = real(dt - self.packed_dt), dt
            self.k.change_step(s.rec, s.state, s.particle_index, s.label, s.order, i.first, i.held, i.nown, self.mats, ddt, self.h)
        self.dt = real(dt)
        for k in range(16):
            self.dv[k] = dt * self.scene.gravity[k % 4 - 1] if k % 4 else 0.0
        self.slopes = tuple(real(moments.moment_slope(dt, h)) if self.scene.packed else real(0) for h in self.scene.spacing)
        self.cells = tuple(real(dt / h) for h in self.scene.spacing)

    def _to_grid(self, dt: float) -> None:
        if dt != self.packed_dt:
            self._change_step(dt)
        if self.scene.surface is None:
            grid.fill(self)
        else:
            grid.fill_over_ground(self, dt)

    def _contact(self) -> None:
        i, s, a = self.index, self.store, self.arenas
        if self.contact_particles == 0:
            return
        if self.zones:
            where = i.bxyz, self.corner, self.spacing
            self.k.take_zones(s.rec, s.measured, a.place, s.listed, s.cell, i.first, i.nown, a.touching, *where, *self.zones)
        grid.push(self)
        self.basal_dissipation -= float(a.total[0])
        self.basal_impulse += a.total[1:4]

    def _to_particles(self, dt: float) -> None:
        i, s, a = self.index, self.store, self.arenas
        more = self.gradient_transfer.take_rates(self) if self.gradient_transfer else self.no_rates
        speed2, step, lost, refused, self.moved = self.k.grid_to_particles(
            s.rec, s.state, s.cell, s.particle_index, s.label, s.order, i.starts, i.first, a.moving, a.reached, i.nown,
            self.schedule.cuts, a.grid, i.up, i.bxyz, a.rim, self.domain.limits, self.domain.unknown, self.mats, self.slopes,
            self.cells, *more, *self.buffers, s.listed, a.leaving, a.shifted, a.changed, a.motion,
        )  # fmt: skip
        if refused > 0:
            raise StabilityError(
                f"a particle moved {step:.3g} cells in step {self.counters.steps} of {dt:.3g} s at {math.sqrt(speed2):.3g} m/s; "
                "use a smaller cfl, or check material and terrain there"
            )
        self.max_speed = math.sqrt(speed2)
        i.travelled += step
        self.plastic_dissipation += lost

    def _sort(self) -> None:
        """Hand particles over to the blocks that they enter; those that left the domain are booked and go."""
        if not self.moved:
            return
        i, s, a, k = self.index, self.store, self.arenas, self.k
        if self.reaches_rim:
            self._book_escaped()
        while True:
            end, moves = self.end, (i.around, i.first, i.nown, s.listed, a.leaving, i.held, i.capacity, a.before, a.arrivals)
            needed, self.end, self.n_holes = k.make_way(*moves, end, s.slots, self.holes, self.n_holes)
            if end + needed <= s.slots:
                break
            s.grow(end + needed)
        self.surge = max(needed, self.surge - self.surge // 8)
        there, fullest = k.settle(
            s.rec, s.state, s.particle_index, s.cell, s.order, i.starts, i.first, i.held, a.before, i.around, i.nown,
            self.schedule.cuts, s.listed, a.leaving, a.shifted, a.changed, a.arrivals,
        )  # fmt: skip
        if fullest + PADDING > self.buffers[0].shape[1]:
            self._fit_buffers(fullest)
        if there != self.n:
            raise StabilityError(f"{self.n - there} particles left the index in step {self.counters.steps}; please report this")

    def _book_escaped(self) -> None:
        i, s, leaving = self.index, self.store, self.arenas.leaving
        self._sum(self.k.sum_escaped, s.listed, leaving, i.first)
        sums = self.arenas.total
        self.escaped_mass += float(sums[observe.MASS])
        self.escaped_energy += float(sums[observe.KINETIC] + sums[observe.POTENTIAL] + sums[observe.ELASTIC])
        self.n -= self.k.total_escaped(s.listed, leaving, i.first, i.nown, grid_to_particles.OUTSIDE)

    def _sum(self, kernel: Any, *which: np.ndarray) -> None:
        """Sums of a kernel over all blocks (see :mod:`runout.backends.scan.observe`), in ``room.total``."""
        i, s, a = self.index, self.store, self.arenas
        dt = self.scene.dtype(self.packed_dt)
        kernel(
            s.rec, s.state, s.particle_index, s.label, *which, i.nown, i.bxyz, self.corner, self.mats, dt, self.spacing,
            self.gravity, a.sums,
        )  # fmt: skip
        self.k.total_rows(a.sums, i.capacity, i.nown, a.total)

    def checkpoint(self) -> State:
        """The state between two steps; its arrays change with the next one."""
        return checkpoint.save(self)

    def restore(self, scene: Scene, state: State) -> None:
        """Go on from a state of the same scene."""
        checkpoint.restore_state(self, scene, state)

    def memory(self) -> dict[str, int]:
        """Bytes by array: those of the particles, of the index and of the blocks; the scene's own do not count."""
        named = {**vars(self.index), **vars(self.schedule), **vars(self), **{f"buffer_{k}": a for k, a in enumerate(self.buffers)}}
        own = {name: int(a.nbytes) for name, a in named.items() if isinstance(a, np.ndarray)}
        more = self.gradient_transfer.memory() if self.gradient_transfer else {}
        return {**self.store.memory(), **self.arenas.memory(), **own, **more}

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""
        i = self.index
        self._sum(self.k.sum_blocks, self.store.cell, self.store.order, i.first, i.held)
        sums = self.arenas.total
        return LedgerRow(
            mass=float(sums[observe.MASS]), escaped_mass=self.escaped_mass,
            momentum=sums[observe.MOMENTUM : observe.KINETIC].copy(), kinetic_energy=float(sums[observe.KINETIC]),
            potential_energy=float(sums[observe.POTENTIAL]), elastic_energy=float(sums[observe.ELASTIC]),
            basal_dissipation=self.basal_dissipation, plastic_dissipation=self.plastic_dissipation,
            escaped_energy=self.escaped_energy, basal_impulse=self.basal_impulse.copy(), max_speed=self.max_speed,
            active_blocks=int((i.held > 0).sum()), contact_particles=self.contact_particles,
        )  # fmt: skip

    def particles(self) -> Particles:
        """The particles as they are, in the order of their identity."""
        i, s, n = self.index, self.store, self.n
        node, affine = np.empty((n, 3), np.int32), np.empty((n, 3, 3))
        place = np.cumsum(i.held) - i.held
        dt = self.scene.dtype(self.packed_dt)
        self.k.unpack(
            s.rec, s.state, s.particle_index, s.label, s.order, i.starts, i.first, i.nown, i.bxyz, self.corner, self.mats, dt,
            self.spacing, place, node, affine,
        )  # fmt: skip
        slot = s.order[np.repeat(i.first - place, i.held) + np.arange(n)]
        rec, state, particle_index = s.rec[slot].astype(np.float64), s.state[slot].astype(np.float64), s.particle_index[slot]
        m = rec[:, 0]
        middle, *slopes = np.moveaxis(rec.reshape(-1, 4, 4)[:, :, 1:], 0, 2)
        momentum = moments.momentum_at(middle, slopes[0], slopes[1], slopes[2], rec[:, 4::4].T - 1.0)
        p = Particles(
            node, rec[:, 4::4], np.column_stack(momentum) / m[:, None], affine, state[:, :6], state[:, 6], m, state[:, 7],
            s.radius[particle_index].astype(np.float64), s.ground_force(particle_index, self.counters.steps),
            s.label[particle_index, 0], s.label[particle_index, 1].astype(np.int64),
        )  # fmt: skip
        return p.take(np.argsort(p.identity))

    def columns(self) -> RasterSums:
        """Sums over the columns of the raster's cells."""
        return raster_sums.whole(self)

    def flow_columns(self) -> RasterSums:
        """The same over a window of cells that holds all mass."""
        return raster_sums.around_flow(self)


class _Clock:
    """Adds the seconds since the last call to a stage."""

    def __init__(self, seconds: dict[str, float]):
        self.seconds, self.last = seconds, time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self.last
        self.last = now
