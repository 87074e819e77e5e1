"""Particles of releases at rest: seeded, terrain-following, with the exact volume and mass, made a chunk at a time.

:mod:`runout.backends.resting_loops` makes them, compiled in double precision without fused operations, so that each particle has
the same bits on every machine.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends import resting_loops
from runout.backends.compile import numba_binding
from runout.errors import ConfigError
from runout.model.materials import Material
from runout.model.nodal_surface import TILE, WIDTH, NodalSurface
from runout.model.particle_source import gathered
from runout.model.particles import Particles, Sums
from runout.model.release import Release
from runout.model.scene import Scene
from runout.model.surface import Surface
from runout.release import arrangement
from runout.release.columns import Columns
from runout.release.sample import Sampling, kept_inside, onto_known_ground, particles_per_axis, prepared_outline, require_apart

Press = Callable[[Particles, np.ndarray, int], None]
Wet = Callable[[Particles, int], None]
Settle = Callable[[Particles], Particles]
Launch = Callable[[Particles, int], None]


@cache
def loops() -> SimpleNamespace:
    """The compiled loops of :mod:`runout.backends.resting_loops`."""
    return numba_binding(np.float64, contract=False).kernels(resting_loops, nogil=True)


class GroundTiles:
    """Coefficients of the ground below a release in square tiles of patches, made when a particle first meets one.

    Parameters
    ----------
    surface : NodalSurface
    extent : tuple of float
        Of the terrain, east and north [m]; particles lie less than a tile outside.

    Attributes
    ----------
    slots : ndarray (nx, ny) int32
        Place of each tile in ``table``, from tile (-1, -1) on; -1 where it is not made yet.
    table : ndarray (some,)
        Coefficients of the tiles, one behind the other, and room for more.
    """

    def __init__(self, surface: NodalSurface, extent: tuple[float, float]):
        self.surface, self.number, self.table = surface, 0, np.empty(0)
        shape = [(int(length / h) + 2) // TILE + 2 for length, h in zip(extent, surface.spacing, strict=True)]
        self.slots = np.full(shape, -1, np.int32)

    def add(self, node: np.ndarray) -> None:
        """Make the tile that holds a node (at least 2,)."""
        i, j = int(node[0]) // TILE, int(node[1]) // TILE
        used = self.number * WIDTH**2
        if used == len(self.table):
            more = np.empty(max(2 * used, 4 * WIDTH**2))
            more[:used] = self.table
            self.table = more
        tile = self.surface.on_nodes((i * TILE, j * TILE), (WIDTH, WIDTH))
        self.table[used : used + WIDTH**2] = tile.coefficients.ravel()
        self.slots[i + 1, j + 1] = self.number
        self.number += 1


@dataclass(frozen=True)
class _Filled:
    """Particles of one release, made a chunk at a time; stress and numbers are left to the caller."""

    release: Release
    columns: Columns
    surface: NodalSurface
    how: Sampling
    density: float

    @cached_property
    def volumes(self) -> np.ndarray:
        """Volume (columns,) of a particle in each column [m3]; their sum is that of the release."""
        volumes = self.columns.volumes
        return volumes * (self.release.volume / np.repeat(volumes, self.columns.rows).sum())

    @cached_property
    def tiles(self) -> GroundTiles:
        """The ground below the release."""
        (rows, columns), (dx, dy) = self.release.terrain.shape, self.release.terrain.cell_size
        return GroundTiles(self.surface, (columns * dx, rows * dy))

    def chunks(self, number: int) -> Iterator[tuple[Particles, np.ndarray]]:
        """Particles of release ``number``, and their depths (n,) below its surface [m]."""
        rng, outline = np.random.default_rng([self.how.seed, number]), prepared_outline(self.release)
        for part in self.columns.parts():
            yield self._part(part, rng, outline)

    def _part(self, part: slice, rng: np.random.Generator, outline: Any) -> tuple[Particles, np.ndarray]:
        columns = self.columns
        rows, thickness, volume = columns.rows[part], columns.thickness[part], self.volumes[part]
        n, height, centre = int(rows.sum()), thickness / rows, columns.centres(part)
        column = np.column_stack((height, thickness, volume, volume * self.density, arrangement.half_size(height)))
        jitter = rng.uniform(-self.how.jitter, self.how.jitter, (n, 2))
        particles, plan, above, depth = Particles.at_rest(n), np.empty((n, 2)), np.empty(n), np.empty(n)
        own = particles.volume, particles.mass, particles.radius
        loops().spread_columns(
            rows, centre, arrangement.shares(columns.index[part]), column, jitter, columns.size, plan, above, depth, *own
        )
        _keep_inside(outline, np.flatnonzero(columns.cut[part]), rows, centre, plan)
        self._stand(particles, plan, above)
        return particles, depth

    def _stand(self, particles: Particles, plan: np.ndarray, above: np.ndarray) -> None:
        """Put particles on places (n, 2) of the plan, some way (n,) ``above`` the ground [m]."""
        n, tiles, done = len(particles), self.tiles, 0
        begins, room = np.empty(n, np.int64), np.empty((resting_loops.ROWS, n))
        while True:
            done = loops().stand_on_ground(
                done, plan, above, self.how.spacing, tiles.slots, tiles.table, begins, room,
                particles.node, particles.offset, particles.radius,
            )  # fmt: skip
            if done == n:
                return
            tiles.add(particles.node[done])


def _keep_inside(outline: Any, cut: np.ndarray, rows: np.ndarray, centre: np.ndarray, plan: np.ndarray) -> None:
    """Bring particles of the columns that an outline cuts back inside; ``rows`` and ``centre`` are of all columns."""
    if not len(cut):
        return
    count, first = rows[cut], (np.cumsum(rows) - rows)[cut]
    place = np.arange(count.sum()) + np.repeat(first - (np.cumsum(count) - count), count)
    plan[place] = kept_inside(outline, np.repeat(centre[cut], count, axis=0), plan[place])


class ReleaseParticles:
    """Particles at rest that fill releases from the surface upwards (:class:`runout.model.particle_source.ParticleSource`).

    The plan is divided into columns of ``dx / px`` by ``dy / py``. A column of mean thickness T holds
    ``n = max(1, round(T / (dz / pz)))`` particles of equal volume, one in each n-th of it above the surface. Their
    heights are staggered from column to column (:mod:`runout.release.arrangement`): a thin mass has more levels than layers.
    The volume and mass of each release are exact to round-off.

    Parameters
    ----------
    releases, materials : sequence
        One material per release.
    surface : NodalSurface
        Surface below the mass, in local coordinates.
    how : Sampling
    press : callable, optional
        Sets the strain of particles of a release, from their depths (n,) [m] below its surface and its number.
    wet : callable, optional
        Sets the pore pressure of particles of a release from its number, before ``press``.
    settle : callable, optional
        Moves particles that start where they cannot.
    launch : callable, optional
        Sets the velocity of particles of a release from its number, also of those without stress.

    Raises
    ------
    ReleaseError
        If releases overlap in plan or one is smaller than a grid cell.
    ConfigError
        If the number of materials is wrong.
    """

    def __init__(
        self,
        releases: Sequence[Release],
        materials: Sequence[Material],
        surface: NodalSurface,
        how: Sampling,
        *,
        press: Press | None = None,
        wet: Wet | None = None,
        settle: Settle = lambda particles: particles,
        launch: Launch | None = None,
    ):
        if len(releases) != len(materials):
            raise ConfigError(f"{len(materials)} materials for {len(releases)} releases; give one each")
        require_apart(list(releases))
        self.how, self.press, self.wet, self.settle, self.launch = how, press, wet, settle, launch
        self.numbers = tuple(range(len(releases)))
        self.density = [float(material.density) for material in materials]
        pairs = zip(releases, self.density, strict=True)
        self.filled = [_Filled(release, how.columns(release), surface, how, density) for release, density in pairs]

    def __len__(self) -> int:
        return sum(int(filled.columns.rows.sum()) for filled in self.filled)

    def of(self, numbers: Sequence[int], surface: NodalSurface) -> "ReleaseParticles":
        """The particles of some of these releases, by their ``numbers`` among all, on another ``surface``."""
        some = copy(self)
        some.numbers = tuple(numbers)
        filled = dict(zip(self.numbers, self.filled, strict=True))
        some.filled = [replace(filled[number], surface=surface) for number in numbers]
        return some

    def chunks(self, stressed: bool = True) -> Iterator[Particles]:
        """The particles in their order: release by release, column by column."""
        first = 0
        for number, filled in zip(self.numbers, self.filled, strict=True):
            for particles, depth in filled.chunks(number):
                particles.release[:] = number
                particles.identity += first
                first += len(particles)
                if stressed and self.wet:
                    self.wet(particles, number)
                if stressed and self.press:
                    self.press(particles, depth, number)
                if self.launch:
                    self.launch(particles, number)
                yield self.settle(particles)

    def sums(self, density: np.ndarray) -> Sums:
        """Sums over all particles."""
        if not self.filled:
            return Sums(0.0, 0.0)
        mass = np.concatenate([np.repeat(one.volumes * one.density, one.columns.rows) for one in self.filled])
        total = float(mass.sum())
        sizes = [int(filled.columns.rows.sum()) for filled in self.filled]
        for part, own in zip(np.split(mass, np.cumsum(sizes)[:-1]), density[list(self.numbers)], strict=True):
            part /= own
        return Sums(total, float(np.mean(mass)))

    def content(self) -> Iterator[np.ndarray]:
        """What the particles depend on beside their scene."""
        yield np.frombuffer(repr((self.how, self.press is not None)).encode(), np.uint8)
        for filled in self.filled:
            release, columns = filled.release, filled.columns
            yield from (release.thickness, release.excavation, release.terrain.elevation)
            yield from (columns.index, columns.thickness, columns.cut, columns.shift, filled.volumes)
            if release.waits or release.velocity:
                yield np.frombuffer(repr((release.start_time, release.velocity, release.starts_when)).encode(), np.uint8)
            if release.pore_pressure is not None:
                yield from release.pore_pressure.content()
            if release.outline is not None:
                yield np.frombuffer(release.outline.wkb, np.uint8)


def sample_particles(
    releases: list[Release],
    materials: Sequence[Material],
    surface: Surface | NodalSurface,
    spacing: tuple[float, float, float],
    particles_per_cell: int | tuple[int, int, int] = 8,
    seed: int = 0,
    jitter: float = 0.25,
    press: Press | None = None,
) -> Particles:
    """All particles of :class:`ReleaseParticles`, ``particles_per_cell`` of a full cell or its factors (px, py, pz).

    A ``surface`` on another lattice is resampled to the nodes of the grid.

    Raises ConfigError if ``particles_per_cell``, ``jitter``, ``seed`` or the number of materials is unusable.
    """
    how = Sampling(spacing, particles_per_axis(particles_per_cell), seed, jitter)
    ground = surface if isinstance(surface, NodalSurface) else NodalSurface(surface, spacing[:2])
    return gathered(ReleaseParticles(releases, materials, ground, how, press=press))


def settled_in(scene: Scene) -> Settle:
    """Function that moves particles that start outside the domain of a scene onto known ground."""
    raster = scene.raster
    limits = raster.columns * raster.cell_size[0], raster.rows * raster.cell_size[1]
    unknown = np.zeros((0, 0), bool) if scene.unknown is None else np.array(scene.unknown, order="C")

    def settle(particles: Particles) -> Particles:
        place = particles.node, particles.offset, scene.spacing
        outside = loops().count_outside(*place, raster.cell_size, limits, unknown)
        return onto_known_ground(particles, scene) if outside else particles

    return settle
