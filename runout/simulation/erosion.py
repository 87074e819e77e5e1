"""Erosion of a bed during a run, by the rate law of :mod:`runout.erosion` at the nodes of the plan.

An update takes the columns of the flow and adds what the law erodes to what each node owes. 2 x 2 nodes together give birth to
what they owe, rounded to whole particles, at the node that owes most: at rest, without stress, at the lowered ground, with the
number and the density of the mass above, and with the pore pressure of the bed. They join the running backend, which lowers its
ground by all that is eroded, so that it stays smooth; maps and ledger hold what became particles. New particles take the place
of a part of the lowest layer and bear what lies above; the rest of that layer sinks with the ground, and the flow above stays where
it is (:func:`runout.physics.bed.sunk`). The grid passes momentum to new particles in the next transfer.

Updates come when births are due, and so often that between two of them the fastest particle goes two cells and the bed falls by
2 % of a cell at most.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends import bed_loops
from runout.backends.compile import array_binding, numba_binding, threads_at_most
from runout.backends.plan_areas import nearest_nodes, weighed
from runout.backends.protocol import Backend, LedgerRow, Sinking, WindowBackend
from runout.backends.state import State, arrays_of, part, put_arrays
from runout.errors import ConfigError, require_kind
from runout.model.bed import Bed
from runout.model.erosion_laws import DENSITY, PORE_RATIO, ErosionLaw, erosion_law_of
from runout.model.friction_laws import FrictionLaw
from runout.model.nodal_surface import NodalSurface
from runout.model.particle_source import ParticleSource
from runout.model.particles import Particles
from runout.model.release import Release
from runout.model.scene import Scene
from runout.model.terrain import Terrain
from runout.quantities import CHANGE, ERODED
from runout.release import arrangement
from runout.simulation.bed_share import DepositMass
from runout.simulation.plan_nodes import NODES_OF_A_THREAD, POOL_WIDTHS, THINNEST, AreaSums, Columns, GroundCoefficients, plan_loops

LOGGER = logging.getLogger(__name__)
TRAVEL = 2.0  # cells that the fastest particle may go between two updates
LOWERING = 0.02  # cells by which the bed may fall between two updates
LATE = 0.25  # particles that 2 x 2 nodes may owe more than at the last births: each birth takes as long as a few steps
AROUND = 2  # nodes around those that fall, over which particles may sink with them
NOTHING = np.array([[2**62, 2**62], [0, 0]])  # first nodes and ends of no part of the window


@cache
def loops(law: ErosionLaw, friction: FrictionLaw) -> SimpleNamespace:
    """The compiled loop of :mod:`runout.backends.bed_loops` for two laws."""
    binding = numba_binding(np.float64, False)
    return binding.kernels(bed_loops, **vars(binding.erosion(law, friction)))


@dataclass
class Booked:
    """What the bed gave."""

    entrained_mass: float = 0.0  # [kg]
    entrained_energy: float = 0.0  # [J], potential, at birth
    entrainment_dissipation: float = 0.0  # [J]: half of the new mass times the squared speed of the column that takes it up


class ErodingBed:
    """The bed of one run: how much of it is eroded and owed, and the particles that are born of it.

    Parameters
    ----------
    bed : Bed
    scene : Scene
        :attr:`scene` is the same on a ground of its own, which births lower.
    terrain, releases
        On whose cells the depth lies.
    per_axis : tuple of int
        Particles (px, py, pz) of a cell.

    Attributes
    ----------
    first : tuple of int
        First node of the window of nodes with a bed.
    there : ndarray (nx, ny)
        Vertical depth [m] of the bed at its nodes at the start.
    eroded, owed, sunk : ndarray (nx, ny)
        Vertical depth [m] that is eroded; that part of it of which no particle is born yet, less than nothing where particles came
        early; and by which the ground was lowered when particles were born last.
    """

    def __init__(self, bed: Bed, scene: Scene, terrain: Terrain, releases: Sequence[Release], per_axis: tuple[int, int, int]):
        self.bed, self.law = bed, erosion_law_of(bed.erosion)
        self.depth = AreaSums.of_raster(bed.depth_on(terrain, releases), scene)
        self.released = np.sum([r.thickness for r in releases], axis=0)  # (rows, columns) [m]
        self.first, shape = self.depth.nodes(scene.spacing)
        self.shape = shape
        assert scene.ground is not None
        self.ground: NodalSurface = scene.ground.with_room(self.first, shape)
        self.scene = replace(scene, surface=self.ground)
        self.ground_at_start = self.ground.change.copy()
        self.there = self.depth.on_nodes(self.first, shape, scene.spacing)
        self.volume = math.prod(scene.spacing) / math.prod(per_axis)  # [m3] of a particle
        self.radius = float(arrangement.half_size(np.array(scene.spacing[2] / per_axis[2])))
        self.record, self.basal = self._bed_record(), scene.basal.table()
        self._begin_anew(shape)

    def _begin_anew(self, shape: tuple[int, int]) -> None:
        """Nothing is eroded yet on a window of nodes with a ``shape``."""
        self.ground.restore(self.ground_at_start)
        self.coefficients = GroundCoefficients(self.ground, self.first, shape)
        self.eroded, self.owed, self.sunk = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self.releases = np.zeros(shape, np.int32)  # that owns most of each column
        self.changed = NOTHING.copy()  # first nodes and ends of the part that was eroded since
        self.time = self.due = self.births_at = 0.0  # [s]
        self.born = 0
        self.particles = 0  # at the start
        self.spans = np.zeros((0, 2), np.int64)
        self.booked = Booked()

    @property
    def area(self) -> float:
        """Of a node [m2]."""
        return self.scene.spacing[0] * self.scene.spacing[1]

    @property
    def expected(self) -> int:
        """Number of particles that all of the bed makes."""
        return math.ceil(float(self.there.sum()) * self.area / self.volume)

    def content(self) -> list[np.ndarray]:
        """Arrays and numbers that, with the scene, determine what is eroded."""
        bed, unknown = self.bed, -1.0
        ratio = unknown if bed.pore_pressure_ratio is None else bed.pore_pressure_ratio
        numbers = [*bed.erosion.numbers().values(), bed.density or 0.0, ratio, self.volume, self.radius]
        return [self.depth.total, np.frombuffer((self.law.name + self.law.source).encode(), np.uint8), np.array(numbers)]

    def begin(self, particles: ParticleSource) -> None:
        """Note how many particles there are, and where those of several releases lie; what was eroded is there again."""
        self._begin_anew(self.shape)
        self.particles = len(particles)
        count = len(self.scene.materials)
        if count > 1 and self.particles:
            chunks = ((*nearest_nodes(p), p.mass, p.release) for p in particles.chunks(stressed=False))
            east, north, mass, release = (np.concatenate(values) for values in zip(*chunks, strict=True))
            shape = self.owed.shape[0], self.owed.shape[1]
            masses = weighed((east, north), mass, release, np.zeros(len(mass)), count, self.first, shape)
            self._note_releases(self.releases, masses)

    def update(self, engine: Backend, time: float) -> None:
        """Erode the bed up to a ``time`` [s]; if births are due, particles join the backend."""
        lasting, self.time = time - self.time, time
        node_sums = engine.node_columns() if isinstance(engine, WindowBackend) else None
        columns = Columns.within(node_sums, self.first, self.shape) if node_sums is not None else None
        fastest = self._erode(engine, columns, lasting) if columns is not None else 0.0
        between = LATE * self.volume / (4.0 * self.area * max(fastest, 1e-12))  # [s] from births to the next
        if columns is not None and (time - self.births_at >= between or fastest == 0.0):
            self.births_at = time
            self._give_birth(engine, columns, fastest > 0.0)
        g, h = math.hypot(*self.scene.gravity), min(self.scene.spacing)
        travel = array_binding().bed.time_to_travel(TRAVEL * h, engine.max_speed, max(g, 1e-12))
        self.due = min(time + float(travel), time + LOWERING * h / max(fastest, 1e-12), self.births_at + between)

    def _erode(self, engine: Backend, columns: Columns, lasting: float) -> float:
        """Add what is eroded in a time [s] to what nodes owe; returns the largest rate [m/s]."""
        part_of, scene = self._part(columns), self.scene
        rows = np.zeros((0, 0), np.int64)
        if self.bed.erosion.of_friction:
            x, y = ((start + np.arange(n)) * h for start, n, h in zip(columns.first, columns.shape, scene.spacing, strict=False))
            rows = scene.basal.rows(self.releases[part_of], x[:, None], y[None, :])
        self.coefficients.make(columns.mass, columns.first)
        reached = bed_loops.Reached(np.zeros(columns.shape[0]), np.zeros((columns.shape[0], 2), np.int64))
        flow = self._flow(columns, self._pore_ratios(engine, columns))
        laws = bed_loops.Laws(self.basal, rows, self.record, int(self.bed.erosion.of_friction))
        base = np.empty((columns.shape[0], 6, columns.shape[1]))
        with threads_at_most(columns.mass.size // NODES_OF_A_THREAD):
            plan_loops().note_bases(flow, self._under, base)
            loops(self.law, scene.basal.law).erode_nodes(flow, base, laws, self._depths, lasting, reached)
        self._note_changed(part_of[0].start + np.flatnonzero(reached.nodes[:, 1]), reached.nodes)
        return float(reached.fastest.max())

    def _flow(self, columns: Columns, pore_ratio: np.ndarray) -> bed_loops.Flow:
        """Columns over nodes of the bed, with a pore pressure ratio (nx, ny) or none (0, 0)."""
        (i, j), (east, north), (a, b) = columns.first, self.first, self.ground.first
        begin = np.array([*columns.begin, i - east, j - north, east - a, north - b, columns.shape[1]], np.int64)
        return bed_loops.Flow(columns.sums, pore_ratio, begin)

    @property
    def _under(self) -> bed_loops.Ground:
        spacing, gravity = np.array(self.scene.spacing), np.array(self.scene.gravity)
        return bed_loops.Ground(self.coefficients.values, self.ground.change, spacing, gravity)

    @property
    def _depths(self) -> bed_loops.Depths:
        return bed_loops.Depths(self.there, self.eroded, self.owed)

    def _note_changed(self, rows: np.ndarray, reached: np.ndarray) -> None:
        """Widen the part that was eroded by some ``rows`` (k,) and the first and last nodes (n, 2) in each of all rows."""
        if len(rows):
            low, high = (rows[0], reached[:, 0].min()), (rows[-1] + 1, reached[:, 1].max())
            self.changed = np.array([np.minimum(self.changed[0], low), np.maximum(self.changed[1], high)])

    def _bed_record(self) -> np.ndarray:
        """Record (1,) of the parameters of the law and the density [kg/m3] of the bed."""
        density = self.bed.density or float(self.scene.densities[0])
        record = np.zeros(1, [(name, np.float64) for name in self.law.fields])
        of_bed = {DENSITY: density, PORE_RATIO: self.bed.pore_pressure_ratio or 0.0}
        for name, value in {**self.bed.erosion.numbers(), **of_bed}.items():
            record[name] = value
        return record

    def _pore_ratios(self, engine: Backend, columns: Columns) -> np.ndarray:
        """Mean pore pressure ratios (nx, ny) [1] of the mass around nodes; empty where the law does not read them."""
        if not (self.scene.is_wet and self.bed.erosion.of_friction):
            return np.zeros((0, 0))
        assert isinstance(engine, WindowBackend)
        mass, wet = engine.plan_masses(columns.first, columns.shape).sum(axis=0)
        return np.divide(wet, mass, out=np.zeros(mass.shape), where=mass > 0)

    def _part(self, columns: Columns) -> tuple[slice, slice]:
        """Part of the window of the bed where columns lie."""
        begin = [a - b for a, b in zip(columns.first, self.first, strict=True)]
        along, across = (slice(b, b + n) for b, n in zip(begin, columns.shape, strict=True))
        return along, across

    def _give_birth(self, engine: Backend, columns: Columns, goes_on: bool) -> None:
        """Particles for what pools of nodes owe (``bed_loops.round_pools``); the ground falls by all that is eroded.

        Where nothing is eroded any more, so that no erosion ``goes_on``, wider pools collect what is left of particles.
        """
        part_of, densities = self._pools_around(columns), self.scene.densities
        first = np.array([[part.start for part in part_of], self.first], np.int64)
        mass = (densities * self.volume).astype(self.scene.dtype).astype(np.float64)  # of a particle of each release
        takes = mass / (self.bed.density or densities) / self.area  # [m] of the bed
        born = np.zeros([part.stop - part.start for part in part_of], np.int64)
        pools = bed_loops.Pools(self.there, self.eroded, self.owed, self.releases, takes, born)
        steps = np.array(arrangement.PLASTIC[:2])
        with threads_at_most(born.size // NODES_OF_A_THREAD):
            for size in POOL_WIDTHS[:1] if goes_on else POOL_WIDTHS:
                plan_loops().round_pools(pools, first, steps, goes_on, size)
        if not born.any():
            return
        self._lower_ground(engine)
        begin = int(first[:, 0].sum()), int(first[:, 1].sum())
        self.coefficients.make(born, begin)  # mass may have left these nodes before the run was resumed
        newborn = self._brought_forth(born, first, mass, columns)
        if len(self.scene.materials) > 1:
            assert isinstance(engine, WindowBackend)
            self._note_releases(self.releases[self._part(columns)], engine.plan_masses(columns.first, columns.shape))
        engine.add(newborn)

    def _lower_ground(self, engine: Backend) -> None:
        """Lower the ground by all that was eroded since it was lowered last."""
        (west, south), (east, north) = self.changed.tolist()
        if west >= east:
            return
        low, size = np.array([west, south]), np.array([east - west, north - south])
        column = np.empty((2, *(size + 2 * AROUND)))
        begin = np.array([0, 0, 0, 0, *np.subtract(self.first, self.ground.first), 0], np.int64)
        with threads_at_most(column[0].size // NODES_OF_A_THREAD):
            plan_loops().note_fall(self._depths, self.sunk, self._under, begin, low, size, column)
        first, turn = (self.first[0] + west, self.first[1] + south), self.born * arrangement.PLASTIC[0] % 1.0
        around = first[0] - AROUND, first[1] - AROUND
        engine.lower(first, column[0, AROUND:-AROUND, AROUND:-AROUND], Sinking(around, column, turn))
        self.changed = NOTHING.copy()

    def _pools_around(self, columns: Columns) -> tuple[slice, slice]:
        """Part of the window of the bed whose widest pools hold columns: pools stay where they are while the flow moves."""
        widest = POOL_WIDTHS[-1]
        along, across = (
            slice(part.start // widest * widest, min(-(-part.stop // widest) * widest, size))
            for part, size in zip(self._part(columns), self.owed.shape, strict=True)
        )
        return along, across

    def _brought_forth(self, born: np.ndarray, first: np.ndarray, mass: np.ndarray, columns: Columns) -> Particles:
        """The particles that are ``born`` (nx, ny) from a ``first`` node on (2, 2), at rest, of a ``mass`` (releases,) [kg]."""
        scene, raster, in_rows = self.scene, self.scene.raster, born.sum(axis=1)
        before, number = np.cumsum(in_rows) - in_rows, int(in_rows.sum())
        newborn = Particles.at_rest(number)
        newborn.ground_force, speed = np.empty((number, 3)), np.empty(number)
        found = bed_loops.Newborn(newborn.node, newborn.offset, newborn.ground_force, speed, newborn.release)
        numbers, size = np.column_stack([self.born + before, before]), (raster.columns, raster.rows) * np.array(raster.cell_size)
        domain, kinds = np.array([size, arrangement.PLASTIC[:2]]), np.array([*mass / scene.densities, self.radius])
        flow = self._flow(columns, np.zeros((0, 0)))
        with threads_at_most(born.size // NODES_OF_A_THREAD):
            plan_loops().bring_forth(born, self.releases, first, numbers, flow, self._under, domain, kinds, found)
        newborn.mass, newborn.volume = mass[newborn.release], kinds[newborn.release]
        newborn.radius[:] = self.radius
        newborn.identity += self.particles + self.born
        if scene.is_wet:
            stays = scene.pore_table()["equilibrium"][newborn.release]
            ratio = self.bed.pore_pressure_ratio
            newborn.pore_excess, newborn.pore_left = 0.0 * stays if ratio is None else ratio - stays, np.ones(number)
        self._note_births(newborn.identity)
        self._book(newborn, speed)
        self.born += number
        return newborn

    def _note_births(self, identity: np.ndarray) -> None:
        """Add consecutive identities (n,) to :attr:`spans`."""
        first, end = int(identity[0]), int(identity[-1]) + 1
        if len(self.spans) and self.spans[-1, 1] == first:
            self.spans[-1, 1] = end
        else:
            self.spans = np.concatenate([self.spans, [[first, end]]])

    def _book(self, newborn: Particles, speed: np.ndarray) -> None:
        """Add mass and energy of particles, which columns with a ``speed`` (n,) [m/s] take up."""
        booked, height = self.booked, newborn.position(np.array(self.scene.spacing)) @ np.array(self.scene.gravity)
        booked.entrained_mass += float(newborn.mass.sum())
        booked.entrained_energy -= float(newborn.mass @ height)
        booked.entrainment_dissipation += float(0.5 * newborn.mass @ speed**2)

    @staticmethod
    def _note_releases(releases: np.ndarray, masses: np.ndarray) -> None:
        """Put the release that has most of the mass around each node; ``masses`` (releases, 2, nx, ny) as of the backend."""
        own = masses[:, 0]
        releases[:] = np.where(own.any(axis=0), own.argmax(axis=0), releases)

    def ledger(self, row: LedgerRow) -> LedgerRow:
        """A row of the backend with what the bed gave."""
        return replace(row, **vars(self.booked))

    def maps(self, deposit: np.ndarray) -> dict[str, np.ndarray]:
        """Maps (rows, columns) [m] on the raster by name, beside the thickness of the ``deposit`` (rows, columns) [m].

        The depth by which the ground was lowered, and the change of elevation: the deposit less release and eroded depth.
        """
        depth = self.eroded - self.owed  # all that the flow took up, to rounding
        eroded = AreaSums.of_nodes(depth, self.first, self.scene.spacing).on_raster(self.scene.raster)
        eroded = np.where(np.abs(eroded) < THINNEST, 0.0, eroded)  # differences of sums over the raster leave rounding everywhere
        return {ERODED: eroded, CHANGE: deposit - self.released - eroded}

    def deposit_mass(self, particles: Particles) -> DepositMass:
        """Mass at the end of the run by cell of the raster, and the part of it that is born of the bed."""
        return DepositMass.of(self.scene, particles, self.is_of_bed(particles))

    def is_of_bed(self, particles: Particles) -> np.ndarray:
        """Which particles (n,) are born of the bed: their identities lie in :attr:`spans`."""
        place = np.searchsorted(self.spans[:, 0], particles.identity, side="right") - 1
        return (place >= 0) & (particles.identity < self.spans[place, 1]) if len(self.spans) else np.zeros(len(particles), bool)

    def state(self) -> State:
        """All that changes, as arrays by name, for :meth:`restore`."""
        fixed = "volume", "radius", "particles", "there", "ground_at_start", "record", "basal"
        return arrays_of(self, fixed) | arrays_of(self.booked, (), "booked.")

    def restore(self, state: State) -> None:
        """Continue from :meth:`state`; the ground is lowered as it was."""
        put_arrays(self.booked, part(state, "booked."))
        put_arrays(self, {name: values for name, values in state.items() if not name.startswith("booked.")})
        self.ground.lower(self.first, self.sunk)


def eroding_bed(
    bed: Any, scene: Scene, terrain: Terrain, releases: Sequence[Release], per_axis: tuple[int, int, int],
    inflows: Sequence[Release] = (),
) -> ErodingBed | None:  # fmt: skip
    """The bed of a run, None without one; what a user should know of it and of ``inflows``, masses at lines, is logged.

    Raises ConfigError: for an argument of another kind.
    """
    if bed is None:
        return None
    require_kind(Bed, bed, "bed", "give runout.Bed(depth=1.2), the depth in metres", ConfigError)
    eroding = ErodingBed(bed, scene, terrain, releases, per_axis)
    for sentence in bed.sentences(terrain, [*releases, *inflows], scene.spacing, eroding.volume):
        LOGGER.warning("%s", sentence)
    return eroding
