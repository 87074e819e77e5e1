"""The order of one step on the CPU, and the parts that it works on.

A step calls one phase after the other; the parts hold what the phases share.

    index -> particles to grid (with contact detection) -> contact solution -> grid to particles -> sort
                                    for further substeps:  substep -> contact solution -> ...

    store      particles by slot                 runout.backends.scan.state
    index      blocks and their neighbours       runout.backends.scan.index
    workspace  arrays by block                   runout.backends.scan.workspace
    tables     constants of run and time step    runout.backends.scan.constants
    totals     sums over the run                 runout.backends.scan.totals
    workers    threads and their buffers         runout.backends.scan.workers
"""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from runout.backends.loading import surveyed
from runout.backends.protocol import INDEXES, Counters, LedgerRow, NodeSums, RasterSums, Sinking
from runout.backends.scan import checkpoint, grid, grid_to_particles
from runout.backends.scan.addition import placed
from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks, Ground
from runout.backends.scan.index import Index, require_held
from runout.backends.scan.kernels import entries_for, reads_nodes
from runout.backends.scan.raster_sums import Summed
from runout.backends.scan.schedule import Schedule
from runout.backends.scan.state import NO_STAMP, SELDOM, Store, capacity, reserve, stamp_of
from runout.backends.scan.structures import Structures
from runout.backends.scan.totals import Totals, add_up
from runout.backends.scan.unloading import unloaded
from runout.backends.scan.workers import Workers
from runout.backends.scan.workspace import Workspace
from runout.backends.state import State, put_arrays
from runout.backends.waiting import wait_briefly
from runout.errors import ConfigError, StabilityError
from runout.model.particle_source import ParticleSource, slices
from runout.model.particles import Particles, joined_mean, node_range, require_index_range
from runout.model.scene import Scene
from runout.physics.contact import kept_share
from runout.physics.substeps import time_ahead

MARGIN = 3  # cells that a particle may move before the index is rebuilt
MOST_IN_A_BLOCK = 2**18
TILE_NODES = 6  # along each side of the ground under a block
PARTS = "to_grid", "to_particles", "contacts", "sums", "sort", "change_step", "unload", "pack"  # of a transfer and what follows it
OF_SUBSTEPS = ("substep",)  # part of scenes with several substeps


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

    index: Index

    def __init__(self, threads: int | None = None, index: str = "sparse"):
        if index not in INDEXES:
            raise ConfigError(f"index is {index!r}; choose one of {', '.join(INDEXES)}")
        wait_briefly()
        self.workers, self.counters = Workers.at_most(threads), Counters()
        self.dense = index == "dense"
        self.counted: tuple[Any, ...] = ()  # groups of arrays when their bytes were added up
        self.counted_bytes = 0
        self.period = (0, 0, 0)  # [cells] after which the grid, not the ground, repeats; may be set where the index is dense

    def load(self, scene: Scene, particles: ParticleSource, more: int = 0) -> None:
        """Take over a scene and its particles."""
        nodes, speed = surveyed(particles)
        self.scene, self.k, self.counters = scene, entries_for(scene), Counters()
        self.workers.divide(len(nodes))
        self.totals = Totals(speed)
        corner = node_range(nodes)[0] if len(nodes) else np.zeros(3, np.int64)
        self.tables = Tables.of(scene, particles.sums(scene.densities).mean_volume, corner)
        require_index_range(nodes, scene.spacing, corner)
        nodes -= corner.astype(np.int32)
        self.structures = Structures(scene, scene.structures, len(nodes)) if scene.structures else None
        rank, found = Index.of_nodes(nodes)
        del nodes
        self._place(particles, rank, found)

    def add(self, particles: Particles) -> None:
        """Add particles to those that are there: into slots of their blocks, for which a new index is made."""
        if not len(particles):
            return
        nodes, speed = surveyed(particles)
        corner, s, t = self.tables.constants.corner, self.store, self.tables
        require_index_range(nodes, self.scene.spacing, corner)
        self._require_slots()
        index, slots = placed(s, self.index.blocks, nodes - corner.astype(np.int32), MOST_IN_A_BLOCK)
        volume = particles.sums(self.scene.densities).mean_volume
        t.particle_volume = joined_mean(t.particle_volume, len(s.particles.label), volume, len(particles))
        s.join(slots, index.blocks, particles, self.scene, stamp_of(self.counters.steps))
        self._pack_stress(slots)
        self.workers.divide(len(s.particles.label))
        if self.structures:
            self.structures.join(len(particles))
        self.totals.max_speed = max(self.totals.max_speed, speed)
        self.counters.rebuilds += 1
        self._rebuild(index, self.workspace)

    def _pack_stress(self, slots: np.ndarray) -> None:
        """Pack the records of some ``slots`` (m,), which hold no stress yet, for the time step of the others."""
        t, real = self.tables, self.scene.dtype
        alone = Index.of_size(1, 1).blocks._replace(held=np.array([len(slots)]))
        self.k.change_step(self.store.particles._replace(order=slots), alone, t.moduli, real(t.packed_dt), t.constants.h)

    def lower(self, first: tuple[int, int], depth: np.ndarray, flow: Sinking | None = None) -> None:
        """Lower the ground at the nodes from the ``first`` on by a ``depth`` (nx, ny) [m]; the ``flow`` above follows.

        The next step cuts the tiles of the blocks there anew.
        """
        ground = self.scene.ground
        assert ground is not None
        ground.lower(first, depth)
        if flow is not None:
            self._sink(flow)
        self.lowered.append((first, depth.shape))

    def _sink(self, flow: Sinking) -> None:
        c = self.tables.constants
        self.k.sink(self.store.particles, self.index.blocks, c.corner, c.spacing, flow.column, flow.first, flow.turn)

    def _cut_lowered(self, first: tuple[int, int], shape: tuple[int, ...]) -> None:
        """Cut the tiles of the blocks over so many nodes from the ``first`` on."""
        b, corner = self.index.blocks, self.tables.constants.corner[:2]
        begin = corner + 4 * b.bxyz[: b.nown, :2]
        self._cut_some(np.flatnonzero(((begin < np.add(first, shape)) & (begin + TILE_NODES > first)).all(axis=1)))
        self._note_normals()

    def _cut_some(self, owners: np.ndarray) -> None:
        """Cut the tiles of some ``owners`` (m,)."""
        b, w = self.index.blocks, self.workspace
        row = np.full(b.nown + 1, -1, np.int32)  # the last one stands for no block
        row[owners] = np.arange(len(owners))
        some = b._replace(nown=len(owners), bxyz=b.bxyz[owners], around=row[b.around[owners]])
        tiles = Ground(*(values[owners] for values in w.ground))
        self._cut_tiles(some, tiles)
        for values, changed in zip(w.ground, tiles, strict=True):
            values[owners] = changed

    def _note_normals(self) -> None:
        """Note the normals of the ground, in which layers drain."""
        w = self.workspace
        if w.layers:
            self.k.note_normals(w.ground.tiles, self.tables.constants.spacing, w.layers.upward)

    @property
    def allowed(self) -> int:
        """Largest number of threads."""
        return self.workers.allowed

    @property
    def threads(self) -> int:
        """Threads that share the loaded particles."""
        return self.workers.threads

    def _place(self, particles: ParticleSource, rank: np.ndarray, found: Index) -> None:
        """Give every particle a slot, by block and cell: by its ``rank`` (n,) in this order.

        Blocks are counted from the lowest node in use, so that a scene that is moved by whole cells gives the same bits.
        """
        b, n = found.blocks, len(rank)
        require_held(b.held, MOST_IN_A_BLOCK)
        before = b.first.copy()
        end = int(self.k.give_slots(b))
        slot = np.arange(n, dtype=np.int32)
        slot += np.repeat((b.first - before).astype(np.int32), b.held)
        self.store = Store.of(capacity(end), end, n, self.scene)
        for part, chunk in slices(particles):
            self.store.put(rank[part], slot, chunk, self.scene)
        self.store.share_numbers(slot, self.scene)
        self.lowered: list[tuple[tuple[int, int], tuple[int, ...]]] = []
        self._rebuild(found)
        self.k.mark_slots(self.store.particles, self.index.blocks)

    def _rebuild(self, old: Index, former: Workspace | None = None) -> None:
        """Find the blocks anew. Particles keep their slots; contacts keep the room that they had in the ``former`` arrays.

        Blocks that were there already keep their tiles of the ground.
        """
        before = self.index.blocks if former else None
        self.index, numbers = old.rebuilt(self.k, MARGIN, self.dense)
        self.k.hand_over_slots(old.blocks, numbers, self.index.blocks)
        if any(self.period):
            self.index.join_ends(self.period)
        self._make_workspace(former)
        self._cut_ground(before, former)

    def _cut_ground(self, before: Blocks | None = None, former: Workspace | None = None) -> None:
        """Cut the ground into the tiles of all blocks; blocks that were there ``before`` keep those of the ``former`` arrays."""
        if self.scene.ground is None:
            return
        if former and before:
            self._keep_tiles(before, former.ground)
        else:
            self._cut_tiles(self.index.blocks, self.workspace.ground)
        self._note_normals()

    def _keep_tiles(self, before: Blocks, tiles: Ground) -> None:
        """Take over the ``tiles`` of the blocks that were there ``before``, and cut those of the others."""
        b = self.index.blocks
        known_keys, keys = (_keys_of(blocks.bxyz[: blocks.nown]) for blocks in (before, b))
        _, old, new = np.intersect1d(known_keys, keys, assume_unique=True, return_indices=True)
        for values, known in zip(self.workspace.ground, tiles, strict=True):
            values[new] = known[old]
        self._cut_some(np.setdiff1d(np.arange(b.nown), new, assume_unique=True))

    def _require_slots(self) -> None:
        """Close the gaps between the slots of blocks where a step might lack slots."""
        s = self.store
        if s.end + max(reserve(s.n), s.surge) > s.slots:
            self._close_gaps()

    def _close_gaps(self) -> None:
        """Close the gaps between the slots of blocks; make more slots if that gains few."""
        b, s, k, steps = self.index.blocks, self.store, self.k, self.counters.steps
        often = SELDOM * (s.end - s.closed_end) // max(steps - s.closed_at, 1)
        s.closed_at, s.n_holes = steps, 0
        packed, spare = k.packed_end(b), max(4 * reserve(s.n), 2 * s.surge, min(often, s.n // 5))
        if packed + spare > s.slots:
            s.grow(max(packed + spare, capacity(packed)))
        by_slot = (used := np.flatnonzero(b.held))[np.argsort(b.first[used])]
        s.closed_end = s.end = k.pack_slots(s.particles, b, by_slot, self.workers.buffers)

    def _make_workspace(self, former: Workspace | None = None) -> None:
        """Arrays by block, after a rebuild."""
        b, k, t = self.index.blocks, self.k, self.tables
        schedule = Schedule.of(b, self.workers.threads)
        contacts = former.contacts if former else None
        self.workspace = Workspace.of(b, schedule, self.scene, t.domain, contacts)
        self.workers.fit(k.total_held(b)[1], self.scene.dtype)
        if self.structures:
            self.structures.find_near(b, t.constants)

    def _cut_tiles(self, blocks: Blocks, tiles: Ground) -> None:
        """Cut the ground into the ``tiles`` of blocks."""
        ground, c = self.scene.ground, self.tables.constants
        assert ground is not None
        surface = ground.surface
        origin, size = tuple(map(float, surface.origin)), tuple(map(float, surface.spacing))
        self.k.cut_tiles(surface.coefficients, origin, size, ground.change, ground.first, blocks, c.corner, c.spacing, tiles)

    @property
    def max_speed(self) -> float:
        """Largest speed [m/s] of any particle."""
        return self.totals.max_speed

    def stable_step(self) -> float:
        """Largest admissible time step [s]."""
        return self.scene.stable_step(self.totals.max_speed)

    def step(self, dt: float, substeps: int = 1) -> None:
        """One transfer of ``substeps`` explicit substeps of ``dt`` [s]."""
        import numba

        s = self.store
        self.scene.require_stable(dt, self.totals.max_speed, self.counters.steps + 1)
        self.scene.require_substeps(substeps)
        numba.set_num_threads(self.workers.threads)
        self.counters.add(substeps, s.n)
        if s.n == 0:
            return
        clock = _Clock(self.counters.seconds)
        if self.index.travelled + 1 > MARGIN:
            self.counters.rebuilds += 1
            self._rebuild(self.index, self.workspace)
        self._require_slots()
        while self.lowered:
            self._cut_lowered(*self.lowered.pop())
        clock("index")
        self._to_grid(dt, substeps)
        grid.drain(self.k, self.index.blocks, self.workspace, self.tables)
        clock("p2g")
        self._solve_contacts(time_ahead(substeps * dt, dt), last=substeps == 1)
        if self.structures:
            b, t, steps = self.index.blocks, self.tables, self.counters.steps
            self.structures.find(self.k, s, b, t, steps, substeps, self.totals.max_speed)
            self.structures.push(self.k, s, t, steps, self.workspace.grid, substeps > 1)
        clock("contact")
        for substep in range(1, substeps):
            self._substep(substep == 1, substep == substeps - 1, clock)
        self._to_particles(dt, substeps)
        clock("g2p")
        self._sort()
        clock("sort")

    def pass_part(self, part: str, dt: float) -> None:
        """Call the kernels of one of PARTS or OF_SUBSTEPS: of a scene without particles, to compile them."""
        self.tables.set_step(self.scene, dt)
        match part:
            case "to_grid":
                self._to_grid(dt)
            case "to_particles":
                self._to_particles(dt)
            case "substep":
                self._substep(first=True, last=True)
            case "contacts":
                self.totals.contact_particles = 1
                self._solve_contacts()
            case "sums":
                self.ledger()
                self._book_escaped()
            case "sort":
                self.totals.moved = True
                self._sort()
            case "change_step":
                self._change_step(dt)
            case "unload":
                self.particles()
            case "pack":
                self._close_gaps()
                self._sink(Sinking((0, 0), np.zeros((2, 1, 1)), 0.0))

    def _change_step(self, dt: float) -> None:
        """Set the constants of steps of ``dt`` [s], and pack the records anew."""
        share = kept_share(dt, float(self.tables.step.dt))
        if share < 1.0:
            for forces in (self.store.particles.force, *([self.structures.force] if self.structures else [])):
                forces[:, 1:] *= self.scene.dtype(share)
        longer, c = self.tables.set_step(self.scene, dt), self.tables.constants
        self.k.change_step(self.store.particles, self.index.blocks, self.tables.moduli, longer, c.h)

    def _to_grid(self, dt: float, substeps: int = 1) -> None:
        if dt != self.tables.packed_dt:
            self._change_step(dt)
        parts = self.k, self.store, self.index.blocks, self.workspace, self.tables
        if self.scene.surface is None:
            grid.fill(*parts)
        else:
            before = self.counters.steps - substeps
            search = grid.search_of(self.scene, self.store, self.totals.max_speed, dt, substeps, before)
            self.totals.contact_particles = grid.fill_over_ground(*parts, search)

    def _substep(self, first: bool, last: bool, clock: Callable[[str], None] = lambda stage: None) -> None:
        """One substep on the present nodes, up to contacts: the ``first`` one after that of the transfer, or the ``last`` one."""
        s, b, t = self.store, self.index.blocks, self.tables
        self.totals.plastic_dissipation += grid.substep(self.k, s, b, self.workspace, t, self.workers.buffers, first)
        clock("substep")
        self._solve_contacts(again=True, last=last)
        if self.structures:
            self.structures.push(self.k, s, t, self.counters.steps, self.workspace.grid, not last)
        clock("contact")

    def _solve_contacts(self, ahead: float = 0.0, again: bool = False, last: bool = True) -> None:
        """Impulses of the ground, with the friction where particles are after a time ``ahead`` [s].

        Those of a later substep meet the zones and areas of the first one ``again``. The next transfer starts from the forces of
        the ``last`` one.
        """
        parts, c = (self.k, self.store, self.index.blocks, self.workspace, self.tables), self.tables.constants
        law, w = self.scene.basal.law, self.workspace
        if self.totals.contact_particles > 0:
            if self.tables.zones and not again:
                where = c.corner, c.spacing, self.tables.zones, ahead
                self.k.take_zones(self.store.particles, self.index.blocks, w.contacts, *where)
            if law.uses_area and not again:
                self.k.sum_columns(w.grid.shared, w.columns)
            stamp = self.scene.dtype(stamp_of(self.counters.steps) if last else NO_STAMP)
            grid.push(*parts, self.totals, stamp, not again)
        if law.drags_column and self.scene.surface is not None:
            self._slow_columns(again)

    def share_releases(self) -> None:
        """Call the kernel that mixes the friction of releases: of a scene where all are alike, to compile it."""
        self.k.share_releases(self.store.particles, self.index.blocks, self.workspace.columns)

    def _slow_columns(self, again: bool) -> None:
        """Drag on the columns of nodes."""
        w, t, total = self.workspace, self.tables, np.zeros(4)
        if not (self.scene.basal.alike or again):
            self.share_releases()
        self.k.slow_columns(self.index.blocks, w.grid.shared, w.columns, t.free_drag, t.constants, t.step.dt, total)
        if reads_nodes(self.scene):
            self.k.change_nodes(w.columns, w.grid.nodes)
        self.totals.basal_dissipation -= float(total[0])
        self.totals.basal_impulse += total[1:]

    def _to_particles(self, dt: float, substeps: int = 1) -> None:
        b, w, t = self.index.blocks, self.workspace, self.tables
        columns = w.columns if self.scene.basal.law.drags_column else ()
        speed2, step, lost, refused, self.totals.moved = self.k.grid_to_particles(
            self.store.particles, b, w.schedule.cuts, w.arenas.reached, w.grid.nodes, columns, w.moves,
            t.domain, grid.wet_step(self.store, t, w, substeps == 1), self.workers.buffers, substeps == 1,
        )  # fmt: skip
        grid.advance_pores(self.store, w, ends=True)
        if refused > 0:
            raise StabilityError(
                f"a particle moved {step:.3g} cells in step {self.counters.steps} of {dt:.3g} s at {math.sqrt(speed2):.3g} m/s; "
                "use a smaller cfl, or check material and terrain there"
            )
        self.totals.max_speed = math.sqrt(speed2)
        self.index.travelled += step
        self.totals.plastic_dissipation += lost

    def _sort(self) -> None:
        """Move particles to the blocks that they enter; particles that left the domain are booked and removed."""
        if not self.totals.moved:
            return
        b, s, w, k = self.index.blocks, self.store, self.workspace, self.k
        if w.moves.rim.any():
            self._book_escaped()
        while True:
            end = s.end
            needed, s.end, s.n_holes = k.make_way(s.particles.listed, b, w.moves, end, s.slots, s.holes, s.n_holes)
            if end + needed <= s.slots:
                break
            s.grow(end + needed)
        s.surge = max(needed, s.surge - s.surge // 8)
        there, fullest = k.settle(s.particles, b, w.schedule.cuts, w.moves)
        if self.workers.too_small(fullest):
            self.workers.fit(fullest, self.scene.dtype)
        if there != s.n:
            raise StabilityError(f"{s.n - there} particles left the index in step {self.counters.steps}; please report this")

    def _book_escaped(self) -> None:
        """Book the particles that leave the domain in this step, and remove them."""
        leaving = self.workspace.moves.leaving
        self.totals.book_escaped(self._sum(self.k.sum_escaped, leaving))
        self.store.n -= self.k.total_escaped(self.store.particles.listed, leaving, self.index.blocks, grid_to_particles.OUTSIDE)

    def _sum(self, kernel: Any, chosen: np.ndarray) -> np.ndarray:
        """Sums (7,) over the ``chosen`` (nown,) particles of each block (see :mod:`runout.backends.scan.observe`)."""
        return add_up(self.k, kernel, chosen, self.store, self.index.blocks, self.workspace, self.tables)

    def checkpoint(self) -> State:
        """The state between two steps; its arrays change with the next one."""
        index = self.index
        parts = checkpoint.Saved(self.tables, self.store, index.blocks, index.travelled, self.totals, self.counters)
        state = checkpoint.save(parts)
        return state | (self.structures.checkpoint("structures.") if self.structures else {})

    def restore(self, scene: Scene, state: State) -> None:
        """Go on from a state of the same scene."""
        self.load(scene, Particles.zeros(0))
        self.k, parts = entries_for(scene), checkpoint.restored(scene, state)
        self.tables = parts.tables
        self._change_step(float(state["packed_dt"]))  # while there is no particle: the records hold that step already
        self.store, self.totals, self.counters = parts.store, parts.totals, parts.counters
        self.index = Index(parts.blocks, parts.travelled)
        if self.structures:
            put_arrays(self.structures, state, "structures.")
        self.workers.divide(len(self.store.particles.label))
        self._make_workspace()
        self._cut_ground()

    def memory(self) -> dict[str, int]:
        """Bytes by array: those of the particles, of the index and of the blocks; the scene's own do not count."""
        more = self.structures.memory() if self.structures else {}
        return {**self.store.memory(), **self.workspace.memory(self.index.blocks), **self.workers.memory(), **more}

    def memory_bytes(self) -> int:
        """Sum of :meth:`memory` [byte], added up where groups of arrays were made anew since the last call."""
        w, s = self.workspace, self.structures
        groups = self.store.particles, w, w.contacts, self.workers.buffers, *((s.near, s.touching, s.force) if s else ())
        if len(groups) != len(self.counted) or any(a is not b for a, b in zip(groups, self.counted, strict=True)):
            self.counted, self.counted_bytes = groups, sum(self.memory().values())
        return self.counted_bytes

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""
        b = self.index.blocks
        row = self.totals.row(self._sum(self.k.sum_blocks, b.held), b.bxyz[: b.nown][b.held > 0])
        row.structure_dissipation = self.structures.dissipation if self.structures else 0.0
        return row

    def structure_impulses(self) -> np.ndarray:
        """Impulse (patches, 3) [N s] of the mass on each patch since the start."""
        return self.structures.impulses.copy() if self.structures else np.zeros((0, 3))

    def particles(self) -> Particles:
        """The particles as they are, in the order of their identity."""
        return unloaded(self.k, self.store, self.index.blocks, self.tables, self.counters.steps)

    def columns(self) -> RasterSums:
        """Sums over the columns of the cells of the raster."""
        return self._summed().whole()

    def flow_columns(self) -> RasterSums:
        """The same over a window of cells that holds all mass."""
        return self._summed().around_flow()

    def lattice_columns(self) -> RasterSums:
        """The same over the cells of the lattice of footprints."""
        return self._summed().on_lattice()

    def node_columns(self) -> NodeSums | None:
        """Sums around nodes of the plan."""
        return self._summed().around_nodes()

    def plan_masses(self, first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
        """Masses (releases, 2, nx, ny) by release around nodes of the plan."""
        return self._summed().plan_masses(first, shape)

    def _summed(self) -> Summed:
        return Summed(self.scene, self.k, self.store, self.index.blocks, self.tables)


def _keys_of(bxyz: np.ndarray) -> np.ndarray:
    """One number (n,) for each block with coordinates (n, 3) of 21 bits."""
    keys: np.ndarray = bxyz.astype(np.int64) @ np.array([1 << 42, 1 << 21, 1])
    return keys


class _Clock:
    """Adds the seconds since the last call to a stage."""

    def __init__(self, seconds: dict[str, float]):
        self.seconds, self.last = seconds, time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self.last
        self.last = now
