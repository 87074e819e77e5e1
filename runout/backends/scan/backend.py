"""The order of one step on the CPU, and the arrays it works on."""

import os
import time
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends.compile import numba_binding
from runout.backends.protocol import Columns, Counters, LedgerRow
from runout.backends.scan import grid, index, particles, transfer
from runout.backends.scan.particles import Store
from runout.errors import CapacityError, StabilityError
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics import timestep

MARGIN = 3  # cells that a particle may move before the index is rebuilt
LARGEST_BLOCK = 2**20
PARTICLES_PER_THREAD = 10_000  # below, waiting for each other costs more than threads gain


def create(threads: int | None = None) -> "ScanBackend":
    """A backend that uses ``threads`` threads, by default all that are allowed."""
    return ScanBackend(threads)


class ScanBackend:
    """Sparse block-scan backend (see :class:`runout.backends.protocol.Backend`)."""

    def __init__(self, threads: int | None = None):
        import numba

        settings: Any = numba.config
        available = min(settings.NUMBA_NUM_THREADS, len(os.sched_getaffinity(0)))
        self.allowed = min(threads or available, available)
        self.threads = 1
        self.counters = Counters()

    def load(self, scene: Scene, particles: Particles) -> None:
        """Take over a scene and its particles."""
        if not np.isfinite(particles.velocity).all() or not np.isfinite(particles.offset).all():
            raise StabilityError("positions or velocities of the particles are not finite; check the input")
        if not (particles.mass > 0).all():
            raise StabilityError("a particle has no mass; every particle needs a positive mass")
        self.scene = scene
        self.k = _kernels(scene)
        self.h = np.array(scene.spacing, scene.dtype)
        self.n = len(particles)
        self.counters = Counters()
        self.threads = max(1, min(self.allowed, self.n // PARTICLES_PER_THREAD))
        self.mats = scene.law.table(scene.materials, scene.dtype)
        self.friction = np.array(scene.friction, scene.dtype)
        self.density = np.array([m.density for m in scene.materials], np.float64)
        self.limit = np.array(
            [scene.raster.columns * scene.raster.cell_size[0], scene.raster.rows * scene.raster.cell_size[1]]
        ) / np.array(scene.spacing[:2])
        self.packed_dt = 0.0
        self.escaped_mass = self.escaped_energy = self.basal_dissipation = self.plastic_dissipation = 0.0
        self.basal_impulse = np.zeros(3)
        self.contact_particles = 0
        self._store(particles)

    def _store(self, particles: Particles) -> None:
        """Sort the particles by block and cell, and make the first index from their blocks."""
        n = self.n
        if n and np.abs(particles.node).max() >= 4 * LARGEST_BLOCK - 8:
            reach = 4 * LARGEST_BLOCK * min(self.scene.spacing)
            raise CapacityError(f"a particle lies beyond the index range of +-{reach:g} m; use a local origin or larger cells")
        order, self.index = index.Index.of_nodes(particles.node)
        self.old = Store.of(particles.take(order), self.scene)
        self.new = Store.empty(n, self.scene.dtype)
        self.key, self.movers = np.zeros(n, np.int64), np.zeros(n, np.int64)
        self.contacts = np.zeros((n, 2), np.int64)
        self.max_speed = float(np.sqrt((particles.velocity**2).sum(1).max())) if n else 0.0
        self._rebuild()

    def _rebuild(self) -> None:
        """Find the blocks anew, and make room for them; the particles keep their order."""
        self.counters.rebuilds += 1
        self.index = self.index.rebuilt(self.k, MARGIN)
        self._allocate_blocks()

    def _allocate_blocks(self) -> None:
        """Arrays by block, after a rebuild."""
        i, dtype = self.index, self.scene.dtype
        self.arenas = np.empty((i.nown, transfer.ARENA), dtype)
        self.grid = np.empty((i.nall, 64, 4), dtype)
        self.shares = np.empty((i.nall, 64), dtype)
        self.held = np.diff(i.cstart[::64])
        self.touching = np.zeros(i.nown, np.int64)
        self.tiles = np.empty((i.nown, 36), dtype)
        self.lowest = np.full(i.nown, np.inf, dtype)
        self.sums = np.zeros((i.nown, 4))
        self.ground = np.zeros((i.nown, 4))
        self.nmovers = np.zeros(i.nown, np.int64)
        self.count = np.empty(i.nown * 64, np.int64)
        self.scratch = np.empty((self.threads, transfer.ARENA), dtype)
        s = self.scene.surface
        if s is not None:
            h = np.array(self.scene.spacing)
            self.k.cut_tiles(s.coefficients, *s.origin, *s.spacing, i.bxyz, i.nown, h, self.tiles, self.lowest)

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
        i, s, real = self.index, self.old, self.scene.dtype
        if dt != self.packed_dt:
            self.k.change_step(s.rec, s.state, s.release, self.n, self.mats, real(dt - self.packed_dt), self.h)
            self.packed_dt = dt
        self.k.particles_to_arenas(s.rec, i.cstart, i.nown, self.arenas)
        dv = (np.array(self.scene.gravity) * dt).astype(real)
        self.k.update_nodes(self.arenas, self.held, i.down, i.nall, self.grid, dv)

    def _contact(self, dt: float) -> None:
        if self.scene.surface is None:
            return
        i, s, k, real = self.index, self.old, self.k, self.scene.dtype
        band = real(self.scene.contact_band * min(self.scene.spacing))
        k.find_contacts(
            s.rec, s.radius, i.cstart, i.nown, self.tiles, self.lowest, real(dt), self.h, band,
            self.arenas, self.contacts, self.touching,
        )  # fmt: skip
        self.contact_particles = int(self.touching.sum())
        if self.contact_particles == 0:
            return
        k.sum_contact_weights(self.arenas, self.touching, i.down, i.nall, self.shares)
        k.solve_contacts(
            s.rec, s.radius, s.release, i.cstart, i.nown, self.tiles, self.grid, self.shares, i.up, real(dt), self.h,
            self.friction, self.arenas, self.contacts, self.touching, self.ground,
        )  # fmt: skip
        k.apply_impulses(self.arenas, self.touching, i.down, i.nall, self.grid)
        booked = self.ground.sum(0)
        self.basal_dissipation -= float(booked[0])
        self.basal_impulse += booked[1:]

    def _to_particles(self, dt: float) -> None:
        i, s = self.index, self.old
        self.k.grid_to_particles(
            s.rec, s.state, s.release, i.cstart, i.nown, self.grid, i.up, i.around, i.bxyz, self.mats, self.scene.dtype(dt), self.h,
            self.limit, self.scratch, self.key, self.movers, self.nmovers, self.sums,
        )  # fmt: skip
        speed2, step = self.sums[:, 0].max(), self.sums[:, 1].max()
        if not (np.isfinite(speed2) and step < 1):
            raise StabilityError(
                f"a particle moved {step:.3g} cells in step {self.counters.steps} of {dt:.3g} s at {np.sqrt(speed2):.3g} m/s; "
                "use a smaller cfl, or check material and terrain there"
            )
        self.max_speed = float(np.sqrt(speed2))
        i.travelled += float(step)
        self.plastic_dissipation += float(self.sums[:, 2].sum())

    def _sort(self) -> None:
        """Bring the particles into the order of their cells; those that left the domain are booked and go."""
        i, lost = self.index, int(self.sums[:, 3].sum())
        if not self.nmovers.any():
            return
        if lost:
            self._book_escaped()
        self.k.count_cells(self.key, i.cstart, i.nown, i.around, self.movers, self.nmovers, self.count)
        cstart = np.empty_like(i.cstart)
        self.k.sum_starts(self.count, i.nown * 64, cstart)
        if cstart[-1] != self.n - lost:
            missing = self.n - lost - int(cstart[-1])
            raise StabilityError(f"{missing} particles left the index in step {self.counters.steps}; please report this")
        place = cstart[:-1].copy()
        self.k.arrange(self.old.arrays(), self.new.arrays(), self.key, i.cstart, place, i.nown, i.around, self.movers, self.nmovers)
        self.old, self.new = self.new, self.old
        i.cstart, self.n = cstart, self.n - lost
        self.held = np.diff(cstart[::64])

    def _book_escaped(self) -> None:
        gone = np.flatnonzero(self.key[: self.n] == -1)
        energy = self._energies()
        self.escaped_mass += float(self.old.rec[gone, 0].sum(dtype=np.float64))
        self.escaped_energy += float(sum(e[gone].sum() for e in energy))

    def _unpacked(self) -> tuple[np.ndarray, np.ndarray]:
        s, i, n = self.old, self.index, self.n
        node, affine = np.empty((n, 3), np.int32), np.empty((n, 3, 3))
        dt = self.scene.dtype(self.packed_dt)
        self.k.unpack(s.rec, s.state, s.release, i.cstart, i.nown, i.bxyz, self.mats, dt, self.h, node, affine)
        return node, affine

    def _energies(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Kinetic, potential and elastic energy [J] of each particle."""
        s, n = self.old, self.n
        node, affine = self._unpacked()
        m = s.rec[:n, 0].astype(np.float64)
        v = s.rec[:n, 1:4] / m[:, None]
        inertia = np.array(self.scene.spacing) ** 2 / 4
        kinetic = 0.5 * m * ((v**2).sum(1) + (affine**2 @ inertia).sum(1))
        potential = -m * (((node + s.rec[:n, 4::4]) * np.array(self.scene.spacing)) @ np.array(self.scene.gravity))
        elastic = np.empty(n)
        self.k.stored_energy(s.state, s.release, n, self.mats, elastic)
        return kinetic, potential, elastic

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""
        rec = self.old.rec[: self.n]
        kinetic, potential, elastic = self._energies()
        return LedgerRow(
            mass=float(rec[:, 0].sum(dtype=np.float64)),
            escaped_mass=self.escaped_mass,
            momentum=rec[:, 1:4].sum(0, dtype=np.float64),
            kinetic_energy=float(kinetic.sum()),
            potential_energy=float(potential.sum()),
            elastic_energy=float(elastic.sum()),
            basal_dissipation=self.basal_dissipation,
            plastic_dissipation=self.plastic_dissipation,
            escaped_energy=self.escaped_energy,
            basal_impulse=self.basal_impulse.copy(),
            max_speed=self.max_speed,
            active_blocks=int((self.held > 0).sum()),
            contact_particles=self.contact_particles,
        )

    def particles(self) -> Particles:
        """The particles as they are, in the order of their identity."""
        s, n = self.old, self.n
        node, affine = self._unpacked()
        rec, state = s.rec[:n].astype(np.float64), s.state[:n].astype(np.float64)
        m = rec[:, 0]
        p = Particles(
            node, rec[:, 4::4], rec[:, 1:4] / m[:, None], affine, state[:, :6], state[:, 6], m, state[:, 7],
            s.radius[:n].astype(np.float64), s.release[:n].copy(), s.identity[:n].copy(),
        )  # fmt: skip
        return p.take(np.argsort(p.identity))

    def columns(self) -> Columns:
        """Sums over the columns of the raster's cells."""
        i, s, r = self.index, self.old, self.scene.raster
        sums = np.zeros((r.rows, r.columns, 5))
        h, cell = np.array(self.scene.spacing), np.array(r.cell_size)
        self.k.add_columns(s.rec, s.release, i.cstart, i.nown, i.bxyz, self.density, h, cell, sums)
        return Columns(sums[..., 0], sums[..., 1], sums[..., 2:])


class _Clock:
    """Adds the seconds since the last call to a stage."""

    def __init__(self, seconds: dict[str, float]):
        self.seconds, self.last = seconds, time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self.last
        self.last = now


def _kernels(scene: Scene) -> SimpleNamespace:
    """Kernels for the law and the number type of a scene."""
    binding = numba_binding(scene.dtype)
    law = getattr(binding, scene.law.module.__name__.rsplit(".", 1)[-1])
    return binding.kernels(index, transfer, grid, particles, law_update=law.update)
