"""The order of one step on a device, and the look of the host at it once a batch."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.compile import warp_binding, warp_kernels, warp_record
from runout.backends.hash import grid, index, particles, transfer
from runout.backends.hash.grid import Ground, NodeArrays
from runout.backends.hash.index import (
    CELL_LANES,
    CONTACTS,
    PARTICLE_LANES,
    PENDING,
    STEPS,
    UNSTABLE,
    Index,
    bytes_of,
    first_table,
    room_for,
    run,
    run_blocks,
)
from runout.backends.hash.particles import Store
from runout.backends.protocol import Columns, Counters, LedgerRow
from runout.errors import CapacityError, StabilityError
from runout.model.laws import LAWS
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics import timestep

STEPS_PER_SORT = 64  # the particles come back into the order of their cells in memory after so many steps
ROW_LANES = 4096  # threads of a GPU that share the sums over all particles
LARGEST_BLOCK = 2**20
CHUNK = 2**21  # particles that are brought to the host at once
WHOLE = 2.0**62  # sums over columns are whole numbers below this
CELL_KERNELS = ("particles_to_grid", "find_contacts", "solve_contacts")


def create(device: str = "cpu", deterministic: bool = False) -> "HashBackend":
    """A backend on a device; ``deterministic`` makes a GPU repeat a run bit by bit (the CPU always does)."""
    return HashBackend(device, deterministic)


def cuda_devices() -> tuple[str, ...]:
    """Names of the CUDA devices of this machine."""
    return tuple(device.alias for device in wp.get_cuda_devices())


class HashBackend:
    """Sparse hash backend (see :class:`runout.backends.protocol.Backend`)."""

    def __init__(self, device: str = "cpu", deterministic: bool = False):
        self.device = wp.get_device(device)
        self.deterministic = deterministic
        self.graphs = self.device.is_cuda  # record steps as a graph
        self.counters = Counters()

    def load(self, scene: Scene, particles: Particles) -> None:
        """Take over a scene and its particles."""
        _require_finite(particles, scene)
        self.scene = scene
        self.k = compiled_kernels(scene.law.name, scene.precision, self.deterministic)
        self.counters = Counters()
        self.packed_dt = 0.0
        self.max_speed = float(np.sqrt((particles.velocity**2).sum(1).max(initial=0.0)))
        self.escaped_mass = self.escaped_energy = 0.0
        self.booked_before = np.zeros(5)
        self.contact_particles = self.since_sort = 0
        self.identity = particles.identity.copy()
        self.graph, self.graph_of = None, -1
        with self._on_device():
            self._load_scene()
            self._load_particles(particles)

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

    def _load_scene(self) -> None:
        s = self.scene
        self.real = wp.float32 if s.precision == "float32" else wp.float64
        self.h = wp.types.vector(length=3, dtype=self.real)(*s.spacing)
        self.mats = wp.array(s.law.table(s.materials, s.dtype), dtype=self.k.record)
        self.friction = wp.array(np.array(s.friction), dtype=self.real)
        self.density = wp.array(np.array([m.density for m in s.materials]), dtype=wp.float64)
        extent = (s.raster.columns * s.raster.cell_size[0], s.raster.rows * s.raster.cell_size[1])
        self.limit = wp.vec2d(*(np.array(extent) / np.array(s.spacing[:2])))
        self.flags, self.peaks, self.clock = wp.zeros(5, dtype=wp.int32), wp.zeros(2, dtype=self.real), wp.zeros(4, dtype=self.real)
        self.ground = None if s.surface is None else Ground(s.surface, s.spacing)

    def _load_particles(self, p: Particles) -> None:
        """Find the blocks of the particles, and bring their arrays to the device in the order of the cells."""
        self.store = s = Store(len(p), self.real)
        self.index = i = Index(self.k, s.size, self.deterministic)
        self.nodes, self.nodes_of = self._node_arrays(), i.room
        if not s.size:
            return
        s.fill(p, self.scene.spacing, self.scene.dtype)
        node = wp.array(np.ascontiguousarray(p.node, np.int32), dtype=wp.int32)
        i.find_blocks(lambda i: run(self.k.enter_given, s.n, node, i.table, i.members, i.entered))
        run(self.k.number_given, s.n, node, i.table, i.slots, s.key, s.rank, i.count)
        self._sort()

    def _node_arrays(self) -> NodeArrays:
        return NodeArrays(self.index.room, self.real, self.ground is not None, self.deterministic)

    def _rebuild(self) -> None:
        """Find the blocks anew; bring the particles back into the order of their cells in memory."""
        self.counters.rebuilds += 1
        i, k, s = self.index, self.k, self.store
        self.booked_before += self.nodes.booked.numpy().sum(0)
        self.nodes.booked.zero_()
        gone = self._sums(False)
        self.escaped_mass += float(gone[0])
        self.escaped_energy += float(gone[4:].sum())
        old = wp.clone(i.coordinates)
        i.find_blocks(lambda i: run(k.enter_present, s.n, s.rec, s.key, old, i.table, i.members, i.entered))
        run(k.number_present, s.n, s.rec, old, i.table, i.slots, s.key, s.rank, i.count)
        self._sort()

    def _sort(self) -> None:
        """After the cells have been numbered: sort the particles, and make the arrays by block fit."""
        if self.nodes_of != self.index.room:
            self.nodes, self.nodes_of = self._node_arrays(), self.index.room
        self.flags.zero_()
        self.store.sort(self.k, self.index, self.deterministic, self.flags)
        self.since_sort = 0
        if self.ground is not None:
            self.ground.cut(self.k, self.index, self.nodes)

    def bytes_used(self) -> int:
        """Memory of the device arrays of the run [byte]."""
        return bytes_of(*(part for part in map(vars(self).get, ("store", "index", "nodes", "ground")) if part is not None))

    def stable_step(self) -> float:
        """Largest admissible time step [s]."""
        h = min(self.scene.spacing)
        limit = timestep.acoustic_limit(self.scene.cfl, h, self.scene.wave_speed, self.max_speed)
        return min(limit, timestep.particle_limit(h, self.max_speed)) if self.max_speed > 0 else limit

    def step(self, dt: float) -> None:
        """One explicit step of ``dt`` [s]."""
        self.steps(dt, 1)

    def steps(self, dt: float, count: int) -> None:
        """``count`` explicit steps of ``dt`` [s]; the host looks in only when particles are sorted or the index must grow."""
        started = time.perf_counter()
        left = count
        with self._on_device():
            self._set_clock(dt)
            while left > 0 and self.store.n > 0:
                if self.since_sort >= STEPS_PER_SORT:
                    self._rebuild()
                left -= self._batch(dt, min(left, STEPS_PER_SORT - self.since_sort))
        self.counters.steps += left
        seconds = self.counters.seconds
        seconds["steps"] = seconds.get("steps", 0.0) + time.perf_counter() - started

    def _set_clock(self, dt: float) -> None:
        if dt == self.packed_dt:
            return
        s = self.store
        run(self.k.change_step, s.n, s.rec, s.key, s.release, self.mats, self.real(dt - self.packed_dt), self.h)
        self.packed_dt = dt
        self.clock.assign(np.array([dt, *(dt * np.array(self.scene.gravity))], self.scene.dtype))

    def _batch(self, dt: float, count: int) -> int:
        """Up to ``count`` steps without a look at the device; returns how many were done."""
        self.flags.zero_()
        self._launch_steps(count)
        flags, peaks = self.flags.numpy(), self.peaks.numpy()
        done = int(flags[STEPS])
        self.counters.steps += done
        self.counters.particle_steps += done * self.store.n
        self.since_sort += done
        self.max_speed = float(np.sqrt(peaks[0]))
        self.contact_particles = int(flags[CONTACTS])
        if flags[PENDING] >= UNSTABLE or not np.isfinite(peaks[0]):
            raise StabilityError(
                f"a particle moved {peaks[1]:.3g} cells in step {self.counters.steps} of {dt:.3g} s at {self.max_speed:.3g} m/s; "
                "use a smaller cfl, or check material and terrain there"
            )
        if flags[PENDING]:
            self._rebuild()
        return done

    def _launch_steps(self, count: int) -> None:
        if not self.graphs or count == 1:
            for _ in range(count):
                self._enqueue()
            return
        if self.graph is None or self.graph_of != self.index.generation:
            for module, lanes in self.k.modules:
                wp.load_module(module, device=self.device, block_dim=lanes)
            with wp.ScopedCapture(force_module_load=False) as capture:
                self._enqueue()
            self.graph, self.graph_of = capture.graph, self.index.generation
        for _ in range(count):
            wp.capture_launch(self.graph)

    def _enqueue(self) -> None:
        """Launches of one step."""
        run(self.k.begin_step, 1, self.flags, self.peaks)
        self._to_grid()
        if self.ground is not None:
            self._contact()
        self._to_particles()
        self._list_cells()

    def _list_cells(self) -> None:
        """The particles of each cell, after they have moved."""
        i, k, s = self.index, self.k, self.store
        run(k.start_cells, i.room, self.flags, i.count, i.cstart)
        run(k.place_particles, s.size, self.flags, s.key, s.rank, i.cstart, s.order)
        if self.deterministic:
            run(k.sort_cells, i.room * 64, self.flags, i.cstart, s.order)

    def _to_grid(self) -> None:
        i, k, s, n = self.index, self.k, self.store, self.nodes
        n.grid.zero_()
        run_blocks(k.particles_to_grid, i.room, CELL_LANES, s.rec, s.order, i.cstart, i.up, self.flags, n.grid, n.arenas)
        if self.deterministic:
            run(k.note_held, i.room, i.cstart, n.held)
        run(k.update_nodes, i.room * 64, self.flags, self.clock, n.arenas, n.held, i.down, n.grid)

    def _contact(self) -> None:
        i, k, s, n = self.index, self.k, self.store, self.nodes
        band = self.real(self.scene.contact_band * min(self.scene.spacing))
        n.shares.zero_(), n.pushes.zero_(), n.touching.zero_()
        run_blocks(
            k.find_contacts, i.room, CELL_LANES, s.rec, s.order, i.cstart, i.up, self.flags, self.clock, n.tiles, n.highest,
            self.h, band, s.touches, n.touching, n.shares, n.arenas,
        )  # fmt: skip
        if self.deterministic:
            run(k.sum_shares, i.room * 64, self.flags, n.arenas, n.touching, i.down, n.shares)
        run_blocks(
            k.solve_contacts, i.room, CELL_LANES, s.rec, s.release, s.order, i.cstart, i.up, self.flags, self.clock, n.tiles,
            self.h, self.friction, s.touches, n.touching, n.grid, n.shares, n.pushes, n.arenas, n.booked,
        )  # fmt: skip
        if self.deterministic:
            run(k.sum_pushes, i.room * 64, self.flags, n.arenas, n.touching, i.down, n.pushes)

    def _to_particles(self) -> None:
        i, s, n = self.index, self.store, self.nodes
        run_blocks(
            self.k.grid_to_particles, i.room, PARTICLE_LANES, s.rec, s.release, s.key, s.rank, s.order, i.cstart, i.count, i.up,
            i.coordinates, i.table, i.slots, self.flags, self.clock, n.grid, n.pushes, int(self.ground is not None), self.mats,
            self.h, self.limit, self.peaks, n.booked,
        )  # fmt: skip

    def _sums(self, present: bool) -> np.ndarray:
        """Sums (SUMS,) over the particles that are there, or over those that have gone since the last sort."""
        s = self.store
        sums = wp.zeros((ROW_LANES if self.device.is_cuda else 1, particles.SUMS), dtype=wp.float64)
        run(
            self.k.sum_particles, sums.shape[0], s.rec, s.release, s.key, self.index.coordinates, self.mats,
            self.real(self.packed_dt), self.h, wp.vec3d(*self.scene.gravity), s.n, int(present), sums,
        )  # fmt: skip
        return sums.numpy().sum(0)  # type: ignore[no-any-return]

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""
        with self._on_device():
            here, gone, blocks = self._sums(True), self._sums(False), self.index.occupied()
            booked = self.booked_before + self.nodes.booked.numpy().sum(0)
        return LedgerRow(
            mass=float(here[0]),
            escaped_mass=self.escaped_mass + float(gone[0]),
            momentum=here[1:4],
            kinetic_energy=float(here[4]),
            potential_energy=float(here[5]),
            elastic_energy=float(here[6]),
            basal_dissipation=-float(booked[1]),
            plastic_dissipation=float(booked[0]),
            escaped_energy=self.escaped_energy + float(gone[4:].sum()),
            basal_impulse=booked[2:],
            max_speed=self.max_speed,
            active_blocks=blocks,
            contact_particles=self.contact_particles,
        )

    def particles(self) -> Particles:
        """The particles as they are, in the order of their identity."""
        n = self.store.n
        with self._on_device():
            parts = [self._brought(first, min(CHUNK, n - first)) for first in range(0, n, CHUNK)]
        if not parts:
            return Particles.zeros(0)
        p = Particles.concatenate([part for part, _ in parts])
        p.identity[:] = self.identity[np.concatenate([number for _, number in parts])]
        return p.take(np.argsort(p.identity))

    def _brought(self, first: int, count: int) -> tuple[Particles, np.ndarray]:
        s = self.store
        node, affine = wp.zeros((count, 3), dtype=wp.int32), wp.zeros((count, 9), dtype=wp.float64)
        run(
            self.k.unpack, count, s.rec, s.release, s.key, self.index.coordinates, self.mats, self.real(self.packed_dt), self.h,
            first, node, affine,
        )  # fmt: skip
        return s.brought(first, count, node, affine)

    def columns(self) -> Columns:
        """Sums over the columns of the raster's cells."""
        r, s = self.scene.raster, self.store
        with self._on_device():
            raster = wp.zeros(r.rows * r.columns * 5, dtype=wp.int64)
            mass = float(self._sums(True)[0])
            if mass == 0:
                return Columns(*(np.zeros((r.rows, r.columns, *shape)) for shape in ((), (), (3,))))
            light = min(m.density for m in self.scene.materials)
            scale = WHOLE / np.array([mass / light, mass, mass * max(self.max_speed, 1e-9)])
            h, cell = wp.vec3d(*self.scene.spacing), wp.vec2d(*r.cell_size)
            run(
                self.k.add_columns, s.n, s.rec, s.release, s.key, self.index.coordinates, self.density, h, cell, r.rows, r.columns,
                wp.vec3d(*scale), raster,
            )  # fmt: skip
            sums = raster.numpy().reshape(r.rows, r.columns, 5) / scale[[0, 1, 2, 2, 2]]
        return Columns(sums[..., 0], sums[..., 1], sums[..., 2:])


def bytes_needed(particles: int, blocks: int, precision: str = "float32", deterministic: bool = False) -> int:
    """Forecast of the memory [byte] of a run over a surface with so many particles and blocks of 4 x 4 x 4 nodes."""
    number = 4 if precision == "float32" else 8
    particle = (transfer.ROWS + 1) * number + 15  # rows and scratch; release, number, key, order, contact
    ground = 64 * 4 * number + 37 * number
    block = 64 * 4 * number + ground + 640 + deterministic * (transfer.TILE * 4 * number + 32)
    entries = max(first_table(particles), 1 << (2 * blocks - 1).bit_length())
    return particles * particle + room_for(blocks) * block + 20 * entries


def _require_finite(p: Particles, scene: Scene) -> None:
    if not np.isfinite(p.velocity).all() or not np.isfinite(p.offset).all():
        raise StabilityError("positions or velocities of the particles are not finite; check the input")
    if not (p.mass > 0).all():
        raise StabilityError("a particle has no mass; every particle needs a positive mass")
    if len(p) and np.abs(p.node).max() >= 4 * LARGEST_BLOCK - 16:
        reach = 4 * LARGEST_BLOCK * min(scene.spacing)
        raise CapacityError(f"a particle lies beyond the index range of +-{reach:g} m; use a local origin or larger cells")


def _argument_types(real: Any, record: Any) -> dict[str, Any]:
    """What the names of argument types in the kernels stand for."""
    vec, vec4 = wp.types.vector(length=3, dtype=real), wp.types.vector(length=4, dtype=real)
    ints = wp.array(dtype=wp.int32)
    return {
        "Real": real, "Vector": vec, "Rows": wp.array2d(dtype=real), "Reals": wp.array(dtype=real), "Nodes": wp.array(dtype=vec4),
        "Vectors": wp.array(dtype=vec), "Table": wp.array(dtype=wp.uint64), "Keys": wp.array(dtype=wp.int64), "Ints": ints,
        "Flags": ints, "Table2": wp.array2d(dtype=wp.int32), "Bytes": wp.array(dtype=wp.uint8), "Shorts": wp.array(dtype=wp.int16),
        "Doubles": wp.array(dtype=wp.float64), "Doubles2": wp.array2d(dtype=wp.float64), "Longs": wp.array(dtype=wp.int64),
        "Materials": wp.array(dtype=record),
        "node4": vec4, "sums4": wp.types.matrix(shape=(27, 4), dtype=real), "sums3": wp.types.matrix(shape=(27, 3), dtype=real),
        "sums1": wp.types.vector(length=27, dtype=real), "double4": wp.vec4d,
    }  # fmt: skip


_physics = cache(warp_binding)


@cache
def compiled_kernels(law: str, precision: str, ordered: bool) -> SimpleNamespace:
    """Kernels for a law and a number type; ``ordered``: sums over particles in a fixed order.

    ``modules`` are the warp modules with their lanes a block: kernels that own cells are compiled apart from the others,
    because warp compiles a module for every number of lanes.
    """
    real = wp.float32 if precision == "float32" else wp.float64
    physics, wide = _physics(real), _physics(wp.float64)
    record = warp_record(law, LAWS[law].fields, real)
    name = f"runout.hash.{law}.{precision}" + ".ordered" * ordered
    cells, others = wp.get_module(f"{name}.cells"), wp.get_module(name)
    for module in (cells, others):
        module.options.update(enable_backward=False, max_unroll=3)
    kernels = warp_kernels(
        physics, (index, transfer, grid, particles), lambda kernel: cells if kernel in CELL_KERNELS else others,
        **_argument_types(real, record), ORDERED=ordered,
        law_update=getattr(physics, LAWS[law].module.__name__.rsplit(".", 1)[-1]).update,
        first_node64=wide.bspline.first_node, weights64=wide.bspline.weights, interpolate64=wide.heightfield.interpolate,
        quasi_interpolant64=wide.heightfield.quasi_interpolant,
    )  # fmt: skip
    kernels.record, kernels.modules = record, ((cells, CELL_LANES), (others, PARTICLE_LANES))
    return kernels
