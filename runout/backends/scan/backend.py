"""The order of one step on the CPU, and the arrays it works on."""

import os
import time
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends.compile import numba_binding
from runout.backends.lanes import memory, shuffles, vectors
from runout.backends.protocol import Columns, Counters, LedgerRow
from runout.backends.scan import contact, ground, index, motion, observe, order, stencil, transfer
from runout.backends.scan.store import PADDING, Store
from runout.errors import CapacityError, ConfigError, StabilityError
from runout.model.laws import Law
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics import timestep

MARGIN = 3  # cells that a particle may move before the index is rebuilt
LARGEST_BLOCK = 2**20
PARTICLES_PER_THREAD = 10_000  # below, waiting for each other costs more than threads gain
MOST_IN_A_BLOCK = 2**18
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
        settings: Any = numba.config
        available = min(settings.NUMBA_NUM_THREADS, len(os.sched_getaffinity(0)))
        self.allowed = min(threads or available, available)
        self.threads = 1
        self.dense = index == "dense"
        self.counters = Counters()

    def load(self, scene: Scene, particles: Particles) -> None:
        """Take over a scene and its particles."""
        if not np.isfinite(particles.velocity).all() or not np.isfinite(particles.offset).all():
            raise StabilityError("positions or velocities of the particles are not finite; check the input")
        if not (particles.mass > 0).all():
            raise StabilityError("a particle has no mass; every particle needs a positive mass")
        self.scene, self.n = scene, len(particles)
        self.k = _kernels(scene.dtype, scene.law, len(scene.materials) == 1)
        self.counters = Counters()
        self.threads = max(1, min(self.allowed, self.n // PARTICLES_PER_THREAD))
        self.packed_dt = 0.0
        self.escaped_mass = self.escaped_energy = self.basal_dissipation = self.plastic_dissipation = 0.0
        self.basal_impulse = np.zeros(3)
        self.contact_particles = 0
        self._tabulate(particles)
        self._place(particles)

    def _tabulate(self, particles: Particles) -> None:
        """Constants of the run as kernels take them."""
        scene, real = self.scene, self.scene.dtype
        self.spacing = np.array(scene.spacing)
        self.h = self.spacing.astype(real)
        self.mats = scene.law.table(scene.materials, real)
        self.friction = np.array(scene.friction, real)
        self.density = np.array([m.density for m in scene.materials], np.float64)
        self.gravity = np.array(scene.gravity, np.float64)
        self.corner = particles.node.min(0).astype(np.int64) if self.n else np.zeros(3, np.int64)
        size = np.array([scene.raster.columns, scene.raster.rows]) * np.array(scene.raster.cell_size) / self.spacing[:2]
        self.domain = np.stack([-self.corner[:2], size - self.corner[:2]], axis=1).ravel().astype(np.float64)
        self.largest_radius = float(particles.radius.max(initial=0.0))
        self.max_speed = float(np.sqrt((particles.velocity**2).sum(1).max(initial=0.0)))

    def _place(self, particles: Particles) -> None:
        """Give every particle a slot, by block and cell. Blocks are counted from the lowest node in use.

        So a scene that is moved by whole cells gives the same bits.
        """
        node = particles.node - self.corner
        if self.n and node.max() >= 4 * LARGEST_BLOCK - 8:
            reach = 4 * LARGEST_BLOCK * min(self.scene.spacing)
            raise CapacityError(f"the particles span more than the index range of {reach:g} m; use larger cells")
        sequence, found = index.Index.of_nodes(node)
        if found.nown and found.held.max() > MOST_IN_A_BLOCK:
            most = found.held.max()
            raise CapacityError(f"a block of 64 cells holds {most} particles, at most {MOST_IN_A_BLOCK} fit; use smaller cells")
        self.index, numbers = found.rebuilt(self.k, MARGIN, self.dense)
        self.end = self._plan(found, numbers)
        block = np.repeat(numbers, found.held)
        slot = self.index.first[block] + np.arange(self.n) - np.repeat(found.first, found.held)
        self.store = Store.of(_capacity(self.end), slot, particles.take(sequence), self.scene)
        self._occupy()

    def _plan(self, old: index.Index, numbers: np.ndarray) -> int:
        """Slots for the blocks of the new index; returns their number."""
        i = self.index
        return int(self.k.plan_slots(numbers, old.starts, old.nown, i.starts, i.first, i.room, i.held, i.nown))

    def _occupy(self) -> None:
        """Note which slots are in use, and make room for what belongs to blocks."""
        i, s = self.index, self.store
        self.k.mark_slots(i.starts, i.first, i.nown, s.cell, s.order)
        self._allocate_blocks()

    def _rebuild(self) -> None:
        """Find the blocks anew, and bring the particles into the order of their cells."""
        self.counters.rebuilds += 1
        old, s, k = self.index, self.store, self.k
        self.index, numbers = old.rebuilt(k, MARGIN, self.dense)
        self.end = self._plan(old, numbers)
        if self.end > s.slots:
            s.grow(_capacity(self.end))
        i = self.index
        where = (s.order, old.starts, old.first, old.nown, numbers, i.first)
        k.gather_rows(s.rec, *where, s.spare)
        s.rec, s.spare = s.spare, s.rec
        for values in (s.state, s.who.reshape(-1, 1)):
            room = s.spare.reshape(-1).view(values.dtype)[: values.size].reshape(values.shape)
            k.gather_rows(values, *where, room)
            k.copy_rows(room, i.first, i.held, i.nown, values)
        self._occupy()

    def _allocate_blocks(self) -> None:
        """Arrays by block, after a rebuild."""
        i, real = self.index, self.scene.dtype
        n, edge = i.nown, 4 * i.bxyz[: i.nown, :2]
        low, high = self.domain[::2], self.domain[1::2]
        self.rim = ((edge - 2 < low) | (edge + 8 > high)).any(axis=1)
        self.arenas, self.grid = np.empty((n, stencil.ARENA), real), np.empty((i.nall, 256), real)
        self.inverse_mass = np.empty((i.nall, 64), real)
        self.tiles, self.planes, self.bounds = (np.empty((n, width), real) for width in (36, 48, 2))
        self.touching, self.candidates, self.leaving, self.arrivals = (np.zeros(n, np.int64) for _ in range(4))
        self.before, self.changed = np.zeros(n, np.int64), np.zeros(n, np.bool_)
        self.sums, self.ground = np.zeros((n, 4)), np.zeros((n, 4))
        self._allocate_buffers()
        s = self.scene.surface
        if s is not None:
            self.k.cut_tiles(
                s.coefficients, *s.origin, *s.spacing, i.bxyz, n, self.corner, self.spacing, self.tiles, self.planes, self.bounds
            )

    def _allocate_buffers(self) -> None:
        """Room for the fullest block and some, for each thread."""
        n, real = int(1.25 * self.index.held.max(initial=0)) + 2 * PADDING, self.scene.dtype
        rec, state = np.empty((self.threads, n, 16), real), np.empty((self.threads, n, 8), real)
        self.buffers = rec, state, np.empty((self.threads, n), np.int32)

    def stable_step(self) -> float:
        """Largest admissible time step [s]."""
        h = min(self.scene.spacing)
        limit = timestep.acoustic_limit(self.scene.cfl, h, self.scene.wave_speed, self.max_speed)
        return min(limit, timestep.particle_limit(h, self.max_speed)) if self.max_speed > 0 else limit

    def step(self, dt: float) -> None:
        """One explicit step of ``dt`` [s]."""
        import numba

        numba.set_num_threads(self.threads)
        self.counters.steps += 1
        self.counters.particle_steps += self.n
        if self.n == 0:
            return
        clock = _Clock(self.counters.seconds)
        if self.index.travelled + 1 > MARGIN:
            self._rebuild()
        clock("index")
        self._to_grid(dt)
        clock("p2g")
        self._contact(dt)
        clock("contact")
        self._to_particles(dt)
        clock("g2p")
        self._sort()
        clock("sort")

    def _to_grid(self, dt: float) -> None:
        i, s, real = self.index, self.store, self.scene.dtype
        if dt != self.packed_dt:
            self.k.change_step(
                s.rec, s.state, s.who, s.label, s.order, i.first, i.held, i.nown, self.mats, real(dt - self.packed_dt), self.h
            )
            self.packed_dt = dt
        if self.scene.surface is None:
            self.k.particles_to_arenas(s.rec, s.order, i.starts, i.first, i.nown, self.arenas)
        else:
            band = self.scene.contact_band * min(self.scene.spacing)
            reach = self.largest_radius + band + dt * self.max_speed * 1.001
            self.k.particles_to_arenas_and_contacts(
                s.rec, s.who, s.radius, s.label, s.order, i.starts, i.first, i.nown, self.tiles, self.planes, self.bounds,
                self.friction, real(reach), real(dt), self.h, real(band), self.arenas, s.spare, s.listed, self.candidates,
                self.touching,
            )  # fmt: skip
        dv = np.tile([0.0, *(self.gravity * dt)], 4).astype(real)
        self.k.update_nodes(self.arenas, i.held, i.down, i.nall, self.grid, dv)

    def _contact(self, dt: float) -> None:
        i, s, k = self.index, self.store, self.k
        self.contact_particles = int(self.touching.sum())
        if self.contact_particles == 0:
            return
        k.spread_weights(s.spare, s.listed, s.cell, i.first, i.nown, self.candidates, self.arenas)
        k.share_contacts(self.arenas, self.touching, i.down, i.nall, self.grid, self.inverse_mass)
        k.solve_contacts(
            s.spare, s.listed, s.cell, i.first, i.nown, self.grid, i.up, self.scene.dtype(dt), self.arenas, self.candidates,
            self.ground,
        )  # fmt: skip
        k.apply_impulses(self.arenas, self.touching, i.down, i.nall, self.grid, self.inverse_mass)
        booked = self.ground[self.touching > 0].sum(0)
        self.basal_dissipation -= float(booked[0])
        self.basal_impulse += booked[1:]

    def _to_particles(self, dt: float) -> None:
        i, s, real = self.index, self.store, self.scene.dtype
        if i.held.max() > self.buffers[0].shape[1] - PADDING:
            self._allocate_buffers()
        slopes, cells = (4 * dt / self.spacing).astype(real), (dt / self.spacing).astype(real)
        self.k.grid_to_particles(
            s.rec, s.state, s.cell, s.who, s.label, s.order, i.starts, i.first, i.nown, self.grid, i.up, i.bxyz, self.rim,
            self.domain, self.mats, tuple(slopes), tuple(cells), *self.buffers, s.listed, self.leaving, self.changed, self.sums,
        )  # fmt: skip
        speed2, step = self.sums[:, 0].max(), self.sums[:, 1].max()
        if not (np.isfinite(speed2) and self.sums[:, 3].sum() == 0):
            raise StabilityError(
                f"a particle moved {step:.3g} cells in step {self.counters.steps} of {dt:.3g} s at {np.sqrt(speed2):.3g} m/s; "
                "use a smaller cfl, or check material and terrain there"
            )
        self.max_speed = float(np.sqrt(speed2))
        i.travelled += float(step)
        self.plastic_dissipation += float(self.sums[:, 2].sum())

    def _sort(self) -> None:
        """Hand particles over to the blocks that they enter; those that left the domain are booked and go."""
        if not self.changed.any():
            return
        i, s, k = self.index, self.store, self.k
        if self.rim.any():
            self._book_escaped()
        needed = int(
            k.count_arrivals(i.around, i.first, i.nown, s.listed, self.leaving, i.held, i.room, self.before, self.arrivals)
        )
        if self.end + needed > s.slots:
            s.grow(_capacity(self.end + needed))
        if needed:
            self.end = int(k.make_room(i.nown, i.held, self.arrivals, i.first, i.room, self.end))
        k.settle(
            s.rec, s.state, s.who, s.cell, s.order, i.starts, i.first, i.held, self.before, i.around, i.nown, s.listed,
            self.leaving, self.changed, self.arrivals,
        )  # fmt: skip
        if i.held.sum() != self.n:
            missing = self.n - int(i.held.sum())
            raise StabilityError(f"{missing} particles left the index in step {self.counters.steps}; please report this")

    def _book_escaped(self) -> None:
        i, s = self.index, self.store
        sums = self._sums(self.k.sum_escaped, s.listed, self.leaving, i.first)
        self.escaped_mass += float(sums[observe.MASS])
        self.escaped_energy += float(sums[observe.KINETIC :].sum())
        gone = sum(int(((s.listed[f : f + m] >> 6) & motion.OUTSIDE > 0).sum()) for f, m in zip(i.first, self.leaving, strict=True))
        self.n -= gone

    def _sums(self, kernel: Any, *which: np.ndarray) -> np.ndarray:
        """Sums of a kernel over all blocks (see :mod:`runout.backends.scan.observe`)."""
        i, s = self.index, self.store
        by_block = np.empty((i.nown, 7))
        dt = self.scene.dtype(self.packed_dt)
        kernel(
            s.rec, s.state, s.who, s.label, *which, i.nown, i.bxyz, self.corner, self.mats, dt, self.spacing, self.gravity, by_block
        )
        return by_block.sum(0)  # type: ignore[no-any-return]

    def memory(self) -> dict[str, int]:
        """Bytes by array: those of the particles, of the index and of the blocks; the scene's own do not count."""
        sizes = self.store.memory()
        for owner in (self.index, self):
            sizes |= {name: int(a.nbytes) for name, a in vars(owner).items() if isinstance(a, np.ndarray)}
        return sizes

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""
        i = self.index
        sums = self._sums(self.k.sum_blocks, self.store.order, i.starts, i.first)
        return LedgerRow(
            mass=float(sums[observe.MASS]),
            escaped_mass=self.escaped_mass,
            momentum=sums[observe.MOMENTUM : observe.KINETIC].copy(),
            kinetic_energy=float(sums[observe.KINETIC]),
            potential_energy=float(sums[observe.POTENTIAL]),
            elastic_energy=float(sums[observe.ELASTIC]),
            basal_dissipation=self.basal_dissipation,
            plastic_dissipation=self.plastic_dissipation,
            escaped_energy=self.escaped_energy,
            basal_impulse=self.basal_impulse.copy(),
            max_speed=self.max_speed,
            active_blocks=int((i.held > 0).sum()),
            contact_particles=self.contact_particles,
        )

    def particles(self) -> Particles:
        """The particles as they are, in the order of their identity."""
        i, s, n = self.index, self.store, self.n
        node, affine = np.empty((n, 3), np.int32), np.empty((n, 3, 3))
        place = np.cumsum(i.held) - i.held
        dt = self.scene.dtype(self.packed_dt)
        self.k.unpack(
            s.rec, s.state, s.who, s.label, s.order, i.starts, i.first, i.nown, i.bxyz, self.corner, self.mats, dt,
            self.spacing, place, node, affine,
        )  # fmt: skip
        slot = s.order[np.repeat(i.first - place, i.held) + np.arange(n)]
        rec, state, who = s.rec[slot].astype(np.float64), s.state[slot].astype(np.float64), s.who[slot]
        m = rec[:, 0]
        p = Particles(
            node, rec[:, 4::4], rec[:, 1:4] / m[:, None], affine, state[:, :6], state[:, 6], m, state[:, 7],
            s.radius[who].astype(np.float64), s.label[who, 0], s.label[who, 1].astype(np.int64),
        )  # fmt: skip
        return p.take(np.argsort(p.identity))

    def columns(self) -> Columns:
        """Sums over the columns of the raster's cells."""
        i, s, r = self.index, self.store, self.scene.raster
        sums = np.zeros((r.rows, r.columns, 5))
        cell = np.array(r.cell_size)
        self.k.add_columns(
            s.rec, s.who, s.label, s.order, i.starts, i.first, i.nown, i.bxyz, self.corner, self.density, self.spacing, cell, sums
        )
        return Columns(sums[..., 0], sums[..., 1], sums[..., 2:])


class _Clock:
    """Adds the seconds since the last call to a stage."""

    def __init__(self, seconds: dict[str, float]):
        self.seconds, self.last = seconds, time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self.last
        self.last = now


def _capacity(slots: int) -> int:
    """Slots to allocate: some for blocks that grow."""
    return slots + slots // 32 + 4096


@cache
def _kernels(real: Any, law: Law, one_material: bool) -> SimpleNamespace:
    """Kernels for a number type and a law, made once a process; those that know no law are compiled for all."""
    binding = numba_binding(real)
    lanes = (vectors, shuffles, memory)
    common = binding.kernels(stencil, ground, index, transfer, contact, order, observe, sources=(*lanes, motion))
    physics = getattr(binding, law.module.__name__.rsplit(".", 1)[-1])
    own = binding.kernels(
        stencil,
        motion,
        sources=lanes,
        law_update=physics.update,
        law_update_small=physics.update_small,
        ONE_MATERIAL=one_material,
    )
    return SimpleNamespace(**(vars(common) | vars(own)))
