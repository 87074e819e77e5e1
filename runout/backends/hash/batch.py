"""Scenes on a device, stepped together, and what the host reads between series of steps.

The scenes of a batch share spacing, law and number type. Each has a range of block coordinates of its own, one north of the other,
so that one index serves all; and its own terrain, materials, friction, time step and end.
"""

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import warp as wp

from runout.backends import footprints
from runout.backends.hash import addition, readback, sort, step
from runout.backends.hash.account import Account
from runout.backends.hash.columns import ColumnSums
from runout.backends.hash.device_status import DeviceStatus, Snapshot
from runout.backends.hash.graphs import Graphs
from runout.backends.hash.ground import Ground
from runout.backends.hash.index import Index, box_around
from runout.backends.hash.kernels import compiled_kernels
from runout.backends.hash.layout import FAILED, PENDING, STEPS, UNSTABLE, run
from runout.backends.hash.loading import Loaded
from runout.backends.hash.looks import Looks, Take
from runout.backends.hash.node_columns import NodeColumns
from runout.backends.hash.parts import Parts
from runout.backends.hash.scenes import SceneArrays, reach_of
from runout.backends.hash.structures import Structures
from runout.backends.hash.validation import require_alike
from runout.backends.loading import fastest
from runout.backends.protocol import Counters, LedgerRow, NodeSums, RasterSums, Sinking
from runout.backends.waiting import wait_briefly
from runout.errors import CapacityError, StabilityError
from runout.model.particle_source import ParticleSource
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics.contact import kept_share

STEPS_PER_SORT = 64  # the particles come back into the order of their cells in memory after so many steps
SORTS_BEFORE = 2  # for either place of the rows, before a sort is recorded as a graph
FEWEST = 4  # but not before so many, unless a particle leaves the index


class Batch:
    """Scenes and their particles on one device.

    Parameters
    ----------
    scenes : sequence of (Scene, ParticleSource)
        All of one spacing, law, gravity, precision and contact band.
    device : str
        "cpu" or "cuda:N".
    deterministic : bool
        Results on a GPU repeat bit by bit, and those of a scene equal those of its own run.
    dense : bool
        All blocks of the box around the particles at the start are in use, for measurements.
    more : int
        Particles that are expected to join: places are made for them.

    Raises
    ------
    ConfigError
        If scenes differ in what they must share.
    CapacityError
        If they need more memory or more blocks than there are.
    """

    def __init__(
        self, scenes: Sequence[tuple[Scene, ParticleSource]], device: str = "cpu", deterministic: bool = False,
        dense: bool = False, more: int = 0,
    ):  # fmt: skip
        wait_briefly()
        self.device, self.deterministic, self.counters = wp.get_device(device), deterministic, Counters()
        given = [s for s, _ in scenes]
        require_alike(given)
        kernels = compiled_kernels(
            given[0].law, given[0].basal.law, given[0].precision, deterministic,
            zoned=any(s.friction_zones for s in given),
            structured=any(map(structured, given)), substepped=any(s.substeps > 1 for s in given),
            wet=any(s.is_wet for s in given),
        )  # fmt: skip
        self.graphs = Graphs(self.device, kernels.modules)
        self.present = np.ones(len(scenes), bool)
        self.since_sort, self.looks, self.around = 0, Looks(len(scenes)), NodeColumns()
        self.sorting: Snapshot | None = None  # behind a sort of which the host does not know yet
        self.joining: list[tuple[int, Particles]] = []  # scene, and particles that wait for the next sort
        with self._on_device(sum(len(p) for _, p in scenes)):
            self.report = readback.Report(kernels.groups, len(given), self.device.is_cuda)
            loaded = Loaded.of(SceneArrays(given, kernels), [p for _, p in scenes], more)
            self.accounts = loaded.accounts
            self.joined = [(s, a.particles) for s, a in enumerate(self.accounts)]  # scene and number of particles by number
            self.parts: Parts = self._parts_of(loaded, kernels)
            if dense:
                self.parts.index.box = wp.array(box_around(loaded.nodes.numpy()), dtype=wp.int32)
            self._place(loaded.nodes)

    @contextmanager
    def _on_device(self, loaded: int | None = None) -> Iterator[None]:
        """Scope of the device; a device without memory left is a CapacityError with numbers."""
        try:
            with wp.ScopedDevice(self.device):
                yield
        except RuntimeError as error:
            if "allocate" not in str(error):
                raise
            many = len(self.parts.store.identity) if loaded is None else loaded
            raise CapacityError(
                f"{self.device.alias} has no memory left ({error}) for {many} particles; "
                f"this run holds {self.bytes_used() / 2**30:.2f} GiB so far; use larger cells or fewer particles per cell"
            ) from error

    def _parts_of(self, loaded: Loaded, kernels: SimpleNamespace) -> Parts:
        """Parts whose index has no block yet."""
        scenes, store, accounts = loaded.scenes, loaded.store, loaded.accounts
        status = DeviceStatus(len(accounts), scenes.number)
        status.peaks.assign(np.array([*(a.max_speed**2 for a in accounts), 0.0], scenes.scenes[0].dtype))
        largest = scenes.largest_blocks(self.deterministic)
        index = Index(kernels, status, store.n, self.deterministic, largest, len(accounts), scenes.rows, store.size)
        ground = ground_of(scenes, loaded.largest_radius)
        structures = structures_of(scenes, kernels, accounts, len(store.forces), loaded.largest_radius)
        columns = ColumnSums(len(accounts))
        return Parts(kernels, self.deterministic, scenes, status, ground, store, index, structures, columns, self.graphs)

    def _place(self, nodes: wp.array) -> None:
        """Find the blocks of the particles from their first nodes (n, 3), and bring these into the order of the cells."""
        parts = self.parts
        parts.make_nodes()
        if not parts.store.n:
            return
        works = sort.given(parts, nodes)
        sort.enqueue(parts, *works)
        parts.store.turn_over()
        sort.settle(parts, lambda: works)

    def _rebuild(self) -> None:
        """Find the blocks anew and bring the particles back into the order of their cells in memory; the host does not wait."""
        self._finish_sort()
        self.counters.rebuilds += 1
        self.since_sort = 0
        self.parts.store.forget_joined()
        self.parts.launch((self.parts.store.turn, -1), lambda: sort.enqueue_again(self.parts, self.report), SORTS_BEFORE)
        self.parts.store.turn_over()
        self.sorting = self.parts.status.snapshot()

    def _settle(self) -> bool:
        """Let the host know of the last sort, once it is done; returns whether the arrays had room for it at once."""
        found, generation = self.sorting, self.parts.generation
        self.sorting = None
        sort.settle(self.parts, lambda: sort.present(self.parts), found)
        return generation == self.parts.generation

    def _finish_sort(self) -> None:
        """Let the host know of the last sort if it does not yet."""
        if self.sorting:
            self._settle()

    def join(self, more: Sequence[tuple[int, Particles]]) -> None:
        """Add particles to scenes between two steps, as :meth:`runout.backends.protocol.Backend.add`.

        They wait for the next step, or until the state is read: then all come to the device at once.
        """
        more = [(scene, p) for scene, p in more if len(p)]
        addition.require_joinable(self.parts, more, sum(len(p) for _, p in self.joining))
        for scene, p in more:
            speed = fastest(p)
            if self.present[scene] and speed > self.accounts[scene].max_speed:
                self._note_speed(scene, speed)
            self.accounts[scene].join(p, self.parts.scenes.scenes[scene].densities, speed)
            self.looks.join(scene, p)
        self.joining += more
        self._forget()

    def _forget(self) -> None:
        """The state changes: what has been read or launched is no longer that of the present."""
        self.report.forget()
        self.around.launched.clear()

    def _note_speed(self, scene: int, speed: float) -> None:
        """Let the device know of a largest speed [m/s] of a scene, from which contact is found."""
        with self._on_device():
            peaks = self.parts.status.peaks.numpy()
            peaks[scene] = max(peaks[scene], speed**2)
            self.parts.status.peaks.assign(peaks)

    def _take_up(self) -> None:
        """Bring the particles that wait to the device, and launch a sort that takes them up; the host does not wait for it."""
        more, self.joining = self.joining, []
        if not more:
            return
        self._finish_sort()
        many = sum(len(p) for _, p in more)
        if addition.lacks_places(self.parts, many):
            self._rebuild()
            self._settle()
            addition.grow(self.parts, many)
        addition.put(self.parts, self.accounts, more, self.looks.made)
        self.joined += [(scene, len(p)) for scene, p in more]
        self._rebuild()
        self.parts.store.taken_up = True

    def _finish_joining(self) -> None:
        """Let the host know of the last sort if particles have joined in it: there may be too little room for their blocks."""
        if self.parts.store.taken_up:
            self._finish_sort()

    @contextmanager
    def _at_rest(self) -> Iterator[None]:
        """Scope of the device in which all particles have joined."""
        with self._on_device():
            self._take_up()
            self._finish_joining()
            yield

    def lower_of(self, scene: int, first: tuple[int, int], depth: np.ndarray, flow: Sinking | None = None) -> None:
        """Lower the ground of a scene, as :meth:`runout.backends.protocol.Backend.lower`; the ``flow`` above follows.

        A sort cuts the ground anew before the next step.
        Scenes that share the ground share what is lowered.
        """
        parts, ground = self.parts, self.parts.scenes.scenes[scene].ground
        assert ground is not None
        assert parts.ground is not None
        if not depth.size:
            return
        ground.lower(first, depth)
        if flow is None:
            with self._on_device():
                parts.ground.take_changes(ground, first[0] - ground.first[0], len(depth), scene)
        else:
            with self._at_rest():
                self._finish_sort()
                parts.ground.take_changes(ground, first[0] - ground.first[0], len(depth), scene)
                column = wp.array(flow.column, dtype=wp.float64)
                groups = parts.store.group, parts.index.block_group, parts.scenes.group, parts.scenes.constants
                run(parts.k.sink, parts.store.n, *groups, column[0], column[1], scene, *flow.first, flow.turn)
            self._forget()
        self.since_sort = STEPS_PER_SORT

    def bytes_used(self) -> int:
        """Memory of the device arrays of the run [byte]."""
        parts: Parts | None = vars(self).get("parts")
        return parts.bytes_used() if parts else 0

    def memory_bytes(self) -> int:
        """The same."""
        return self.bytes_used()

    def stable_step(self, scene: int = 0) -> float:
        """Largest admissible time step [s] of a scene."""
        return self.parts.scenes.scenes[scene].stable_step(self.accounts[scene].max_speed)

    def advance(
        self, dt: Sequence[float], count: Sequence[int], looks: Mapping[int, Sequence[int]] | None = None, take: Take | None = None,
        going_on: Collection[int] = (), substeps: Sequence[int] | None = None, nodes: Collection[int] = (),
    ) -> None:  # fmt: skip
        """``count[s]`` transfers of scene s, each of ``substeps[s]`` substeps (1) of ``dt[s]`` [s].

        The host looks in only when particles are sorted.
        ``take`` gets scene, transfer and columns after the transfers that ``looks`` names by scene, from 1 on. A step is checked
        where its series begins: scenes that are ``going_on`` with one keep its length, as in a run of their own. Sums around nodes
        are asked for next in the scenes ``nodes``.
        """
        started = time.perf_counter()
        each = np.ones(len(self.accounts), np.int64) if substeps is None else np.asarray(substeps, np.int64)
        for scene, number in zip(self.parts.scenes.scenes, each, strict=True):
            scene.require_substeps(int(number))
        self.looks.begin(looks or {}, take, each)
        lengths = np.asarray(dt, float) * each * np.asarray(count)
        with self._on_device():
            self._take_up()
            self.looks.find_mass(self.parts, self.report, self.accounts, lengths, self._finish_joining)
        self._forget()
        self.around.begin(nodes)
        self._require_stable(dt, [0 if s in going_on else n for s, n in enumerate(count)])
        left = np.where(self.present, np.asarray(count, np.int64), 0)
        with self._on_device():
            self._set_steps(np.asarray(dt, float), each, left)
            given = np.zeros_like(left)
            while (most := int(left.max())) > 0 and self.parts.store.n > 0:
                between = self._steps_per_sort(left)
                if self.since_sort >= between:
                    self._rebuild()
                if (left != given).any():  # the device counts for itself
                    self.parts.scenes.set_left(left)
                done = self._batch(min(most, between - self.since_sort), left, most)
                given = np.maximum(left - done, 0)
                left = np.where(self.present, given, 0)
            self.looks.deliver()
        self.counters.steps += int((left * each).max())
        self.counters.transfers += int(left.max())
        seconds = self.counters.seconds
        seconds["steps"] = seconds.get("steps", 0.0) + time.perf_counter() - started

    def _set_steps(self, dt: np.ndarray, substeps: np.ndarray, left: np.ndarray) -> None:
        """Time steps [s] of the scenes that have transfers ``left``; packed records are packed anew where theirs changes."""
        parts, scenes = self.parts, self.parts.scenes
        before = np.array([a.packed_dt for a in self.accounts])
        now, substeps = np.where(left > 0, dt, before), np.where(left > 0, substeps, scenes.substeps)
        if np.array_equal(before, now) and np.array_equal(scenes.substeps, substeps):
            return
        self._finish_sort()
        if not np.array_equal(before, now):
            longer = wp.array(now - before, dtype=scenes.number)
            groups = parts.store.group, parts.index.block_group, scenes.constants, scenes.materials
            run(parts.k.change_step, parts.store.n, *groups, longer)
        self._limit_forces(now, before)
        for account, length in zip(self.accounts, now, strict=True):
            account.packed_dt = float(length)
        scenes.set_steps(now, substeps)

    def _limit_forces(self, now: np.ndarray, before: np.ndarray) -> None:
        """Reduce the forces from which contacts start where the steps of a scene become much longer than those before."""
        shares = np.array([kept_share(*lengths) for lengths in zip(now, before, strict=True)])
        if shares.min() == 1.0:
            return
        scenes, count = zip(*self.joined, strict=True)
        factor = np.repeat(shares[list(scenes)], count)[:, None] if len(shares) > 1 else shares
        structures = self.parts.structures
        for held in (self.parts.store.forces, *([structures.forces] if structures else [])):
            forces = held.numpy()
            forces[: len(self.parts.store.identity), 1:] *= factor.astype(forces.dtype)
            held.assign(forces)

    def _require_stable(self, dt: Sequence[float], count: Sequence[int]) -> None:
        """A scene whose step is too long ends the run if it is the only one; one of several leaves."""
        for s in map(int, np.flatnonzero(self.present & (np.asarray(count) > 0))):
            try:
                self.parts.scenes.scenes[s].require_stable(float(dt[s]), self.accounts[s].max_speed, self.counters.steps + 1)
            except StabilityError as error:
                self._break(s, str(error))

    def _steps_per_sort(self, left: np.ndarray) -> int:
        """Transfers from one sort to the next: as many as the fastest particle takes to come one cell further."""
        each = zip(self.accounts, self.parts.scenes.substeps, left, strict=True)
        moves = [a.packed_dt * k * a.max_speed for a, k, n in each if n > 0]
        cells = max(moves) / min(self.parts.scenes.scenes[0].spacing)
        return STEPS_PER_SORT if cells * STEPS_PER_SORT <= 1 else max(FEWEST, int(1 / cells))

    def _batch(self, count: int, left: np.ndarray, most: int) -> int:
        """Up to ``count`` steps without a look at the device, of ``most`` that are left; returns how many were done.

        If more are left, the next sort is launched before the host looks: the device never waits for it. The host takes the columns
        of the steps before meanwhile; those of the last steps follow at once.
        """
        parts, before = self.parts, len(self.looks.launched)
        if not self.sorting:
            parts.status.flags.zero_()
        substeps = int(parts.scenes.substeps[left > 0].max())
        for k in range(count):
            name = parts.store.turn, parts.index.launched, substeps
            self.parts.launch(name, lambda: step.enqueue(parts, substeps), int(count == 1))
            self.looks.launch(parts, self.accounts, k + 1, left)
        ready = not self.sorting or self._settle()
        if ready and most == count:
            self._look_around()
        found, ahead = parts.status.snapshot(), ready and most > count
        if ahead:
            self._rebuild()
        self.looks.deliver(before if most > count else None)
        status = found.arrived()
        flags, peaks, contacts = status["flags"], status["peaks"].astype(float), status["contacts"]
        done = int(flags[STEPS])
        if done < count:
            self.around.launched.clear()
        self.looks.made += np.minimum(done, left) * parts.scenes.substeps
        self._count(done, left, parts.scenes.substeps)
        self.since_sort += 0 if ahead else done
        for account, peak, touching in zip(self.accounts, peaks, contacts, strict=False):
            account.max_speed, account.contact_particles = float(np.sqrt(peak)), int(touching)
        broken = self.present & ~np.isfinite(peaks[:-1])
        if flags[PENDING] >= UNSTABLE:
            broken[flags[FAILED]] = True
        unstable = np.flatnonzero(broken)
        for s in unstable:
            a = self.accounts[s]
            moved = f"a particle moved {peaks[-1]:.3g} cells in step {self.counters.steps} of {a.packed_dt:.3g} s"
            self._break(int(s), f"{moved} at {a.max_speed:.3g} m/s; use a smaller cfl, or check material and terrain there")
        if (flags[PENDING] and not ahead) or len(unstable):
            self._rebuild()
            self._settle()
        return done

    def _count(self, done: int, left: np.ndarray, substeps: np.ndarray) -> None:
        """Count ``done`` transfers, of each scene at most those that are ``left``."""
        made, alone = np.minimum(done, left) * substeps, len(self.accounts) == 1
        held = [self.parts.store.n if alone else a.particles for a in self.accounts]
        self.counters.steps += int(made.max(initial=0))
        self.counters.transfers += done
        self.counters.particle_steps += int(made @ np.array(held))

    def _break(self, scene: int, reason: str) -> None:
        """A scene has become unstable: the only one ends the run, one of several leaves."""
        self._finish_sort()
        if len(self.accounts) == 1:
            raise StabilityError(reason)
        self.accounts[scene].failure = reason
        self.leave([scene])

    def failure(self, scene: int) -> str:
        """Why a scene has left before its end; empty if it has not."""
        return self.accounts[scene].failure

    def leave(self, scenes: Sequence[int]) -> None:
        """Scenes that have come to their end leave the device at the next sort; look at them before."""
        self.report.cached_ledger = None
        self.around.launched.clear()
        with self._at_rest():
            parts = self.parts
            self.present[list(scenes)] = False
            peaks = parts.status.peaks.numpy()
            peaks[list(scenes)] = 0.0
            parts.status.peaks.assign(peaks)
            gone = wp.array((~self.present).astype(np.int32), dtype=wp.int32)
            run(parts.k.leave, parts.store.n, parts.store.group, parts.index.block_group, gone)

    def ledgers(self) -> list[LedgerRow]:
        """Sums of the present state, a row a scene."""
        with self._at_rest():
            return readback.ledgers(self.parts, self.report, self.accounts)

    def particles_of(self, scene: int) -> Particles:
        """The particles of a scene as they are, in the order of their identity."""
        with self._at_rest():
            return readback.particles(self.parts, scene)

    def columns_of(self, scene: int) -> RasterSums:
        """Sums over the columns of the cells of a scene's raster."""
        with self._at_rest():
            return readback.whole(self.parts, self.report, self.accounts, scene)

    def flow_columns_of(self, scene: int) -> RasterSums:
        """The same over a window of cells that holds all mass."""
        s = self.parts.scenes.scenes[scene]
        found = self.lattice_columns_of(scene)
        return footprints.on_raster(found, s.raster, footprints.lattice_cell(s))

    def lattice_columns_of(self, scene: int) -> RasterSums:
        """The same on the lattice of footprints."""
        if scene not in self.report.cached_columns:
            self.look_at([scene])
        return self.report.cached_columns[scene]

    def node_columns_of(self, scene: int) -> NodeSums | None:
        """Sums around nodes of the plan; None without particles."""
        with self._at_rest():
            if scene not in self.around.launched:
                known = None if self.report.cached_ledger is not None else self.looks.window(scene)
                wide = known or readback.bounds_of(self.parts, self.report, scene)
                if wide is None:
                    return None
                self.around.launch(self.parts, self.accounts, scene, wide)
            found = self.around.take(self.parts, scene)
            if found is None:
                return None
            self.looks.note(scene, found[1])
            return found[0]

    def _look_around(self) -> None:
        """Launch the sums around nodes that the host takes next, behind the last transfer of the series."""
        for scene in self.around.wanted:
            wide = self.looks.window(scene)
            if wide is not None:
                self.around.launch(self.parts, self.accounts, scene, wide)

    def plan_masses_of(self, scene: int, first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
        """Masses (releases, 2, nx, ny) of a scene by release around nodes of the plan."""
        with self._at_rest():
            return readback.plan_masses(self.parts, self.accounts, scene, first, shape)

    def structure_impulses_of(self, scene: int) -> np.ndarray:
        """Impulse (patches, 3) [N s] of the mass on each patch of a scene's structures since the start; (0, 3) without any."""
        structures = self.parts.structures
        if structures is None:
            return np.zeros((0, 3))
        with self._at_rest():
            return structures.impulses(scene)

    def max_speed_of(self, scene: int) -> float:
        """Largest speed [m/s] of any particle of a scene."""
        return self.accounts[scene].max_speed

    def look_at(self, scenes: Sequence[int]) -> None:
        """Bring the columns over windows of some scenes at once, for :meth:`flow_columns_of`; the host waits once for all."""
        with self._at_rest():
            self.report.cached_columns |= readback.around_flow(self.parts, self.report, self.accounts, scenes)


def ground_of(scenes: SceneArrays, largest: float) -> Ground | None:
    """The surfaces of the scenes, None without any; ``largest`` is the largest radius [m], which contact depends on too."""
    scenes.constants.largest = largest
    surfaces = [s.ground for s in scenes.scenes if s.ground is not None]
    return Ground(surfaces, scenes.scenes[0].spacing, reach_of(scenes, largest), scenes.number) if surfaces else None


def structures_of(
    scenes: SceneArrays, kernels: SimpleNamespace, accounts: Sequence[Account], particles: int, largest: float
) -> Structures | None:
    """The structures of the scenes, None without any, for so many ``particles`` and the ``largest`` radius [m]."""
    if not any(map(structured, scenes.scenes)):
        return None
    return Structures(scenes, kernels, accounts, particles, reach_of(scenes, largest))


def structured(scene: Scene) -> bool:
    """Whether a scene has structures."""
    return scene.structures is not None
