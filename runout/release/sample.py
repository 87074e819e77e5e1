"""Particles of releases: seeded, terrain-following, with the exact volume and mass, made a chunk at a time."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral
from typing import Any

import numpy as np

from runout.errors import ConfigError, ReleaseError
from runout.io.polygon_coverage import covered_area
from runout.model.materials import Material
from runout.model.nodal_surface import NodalSurface
from runout.model.particle_source import gathered
from runout.model.particles import Particles, Sums
from runout.model.release import Release
from runout.model.surface import Surface
from runout.release import stagger
from runout.release.columns import THINNEST, Columns, column_thickness, local_outline

__all__ = ["ReleaseParticles", "Sampling", "column_thickness", "count_particles", "particles_per_axis", "sample_particles"]
CELLS_ACROSS = 4  # width of a release in grid cells that messages propose

Press = Callable[[Particles, np.ndarray, int], None]


@dataclass(frozen=True)
class Sampling:
    """How particles are placed.

    Attributes
    ----------
    spacing : tuple of float
        Grid spacing (dx, dy, dz) [m].
    per_axis : tuple of int
        Particles (px, py, pz) of a full grid cell.
    seed : int
        Of the jitter; equal seeds give equal particles.
    jitter : float
        Largest horizontal displacement, as a share of the particle spacing, 0 to 0.5.
    """

    spacing: tuple[float, float, float]
    per_axis: tuple[int, int, int]
    seed: int = 0
    jitter: float = 0.25

    def __post_init__(self) -> None:
        if not 0.0 <= self.jitter <= 0.5:
            raise ConfigError(f"jitter is {self.jitter:g}; it must lie between 0 and 0.5 of the particle spacing")
        if not isinstance(self.seed, Integral) or self.seed < 0:
            raise ConfigError(f"seed is {self.seed!r}; it must be a whole number, 0 or more")

    def columns(self, release: Release) -> Columns:
        """Columns of particles of a release; ReleaseError if it is smaller than a grid cell."""
        _require_resolved(release, self.spacing)
        (dx, dy, dz), (px, py, pz) = self.spacing, self.per_axis
        return Columns.of(release, (dx / px, dy / py), dz / pz)


@dataclass(frozen=True)
class _Filled:
    """Particles of one release, made a chunk at a time; mass, stress and number of the release are left to the caller."""

    release: Release
    columns: Columns
    surface: Surface | NodalSurface
    how: Sampling

    @cached_property
    def volumes(self) -> np.ndarray:
        """Volume (columns,) of a particle in each column [m3]; their sum is that of the release."""
        volumes = self.columns.volumes
        return volumes * (self.release.volume / np.repeat(volumes, self.columns.rows).sum())

    def chunks(self, number: int) -> Iterator[tuple[Particles, np.ndarray]]:
        """Particles of release ``number``, and their depths (n,) below its surface [m]."""
        rng, outline = np.random.default_rng([self.how.seed, number]), _prepared_outline(self.release)
        for part in self.columns.parts():
            yield self._part(part, rng, outline)

    def _part(self, part: slice, rng: np.random.Generator, outline: Any) -> tuple[Particles, np.ndarray]:
        columns = self.columns
        thickness = columns.thickness[part]
        column, above, height = stagger.layered(columns.index[part], thickness, columns.layer)
        plan = columns.centres(part)[column]
        moved = plan + rng.uniform(-self.how.jitter, self.how.jitter, plan.shape) * np.array(columns.size)
        plan = _inside(outline, np.flatnonzero(columns.cut[part][column]), plan, moved)
        ground, east, north = self.surface.evaluate(plan[:, 0], plan[:, 1])
        particles = Particles.at(np.column_stack((plan, ground + above)), np.asarray(self.how.spacing, np.float64))
        particles.volume[:] = self.volumes[part][column]
        particles.radius[:] = stagger.half_size(height) / np.sqrt(1.0 + east * east + north * north)
        return particles, thickness[column] - above


class ReleaseParticles:
    """Particles at rest that fill releases from the surface upwards (:class:`runout.model.particle_source.ParticleSource`).

    The plan is divided into columns of ``dx / px`` by ``dy / py``. A column of mean thickness T holds
    ``n = max(1, round(T / (dz / pz)))`` particles of equal volume, one in each n-th of it above the surface. Their
    heights are staggered from column to column (:mod:`runout.release.stagger`), so that a thin mass has more levels than layers.
    The volume and mass of each release are exact to round-off.

    Parameters
    ----------
    releases, materials : sequence
        One material per release.
    surface : Surface or NodalSurface
        Surface below the mass, in local coordinates.
    how : Sampling
    press : callable, optional
        Sets the stress of particles of a release, from their depths (n,) [m] below its surface and its number.
    settle : callable, optional
        Moves particles that start where they cannot.

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
        surface: Surface | NodalSurface,
        how: Sampling,
        *,
        press: Press | None = None,
        settle: Callable[[Particles], Particles] = lambda particles: particles,
    ):
        if len(releases) != len(materials):
            raise ConfigError(f"{len(materials)} materials for {len(releases)} releases; give one each")
        require_apart(list(releases))
        self.how, self.press, self.settle = how, press, settle
        self.density = [material.density for material in materials]
        self.filled = [_Filled(release, how.columns(release), surface, how) for release in releases]

    def __len__(self) -> int:
        return sum(int(filled.columns.rows.sum()) for filled in self.filled)

    def chunks(self, stressed: bool = True) -> Iterator[Particles]:
        """The particles in their order: release by release, column by column."""
        first = 0
        for number, (filled, density) in enumerate(zip(self.filled, self.density, strict=True)):
            for particles, depth in filled.chunks(number):
                particles.mass[:] = particles.volume * density
                particles.release[:] = number
                particles.identity += first
                first += len(particles)
                if stressed and self.press:
                    self.press(particles, depth, number)
                yield self.settle(particles)

    def sums(self, density: np.ndarray) -> Sums:
        """Sums over all particles."""
        parts = zip(self.filled, self.density, strict=True)
        mass = np.concatenate([np.repeat(one.volumes * own, one.columns.rows) for one, own in parts])
        total = float(mass.sum())
        sizes = [int(filled.columns.rows.sum()) for filled in self.filled]
        for part, own in zip(np.split(mass, np.cumsum(sizes)[:-1]), density, strict=True):
            part /= own
        return Sums(total, float(np.mean(mass)))

    def content(self) -> Iterator[np.ndarray]:
        """What the particles depend on beside their scene."""
        yield np.frombuffer(repr((self.how, self.press is not None)).encode(), np.uint8)
        for filled in self.filled:
            release, columns = filled.release, filled.columns
            yield from (release.thickness, release.excavation, release.terrain.elevation)
            yield from (columns.index, columns.thickness, columns.cut, columns.shift, filled.volumes)
            if release.outline is not None:
                yield np.frombuffer(release.outline.wkb, np.uint8)


def count_particles(releases: Sequence[Release], how: Sampling) -> int:
    """Particles of releases, counted without making them."""
    return sum(int(how.columns(release).rows.sum()) for release in releases)


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

    Raises
    ------
    ConfigError
        If ``particles_per_cell``, ``jitter``, ``seed`` or the number of materials is unusable.
    """
    how = Sampling(spacing, particles_per_axis(particles_per_cell), seed, jitter)
    return gathered(ReleaseParticles(releases, materials, surface, how, press=press))


def particles_per_axis(particles_per_cell: int | tuple[int, int, int]) -> tuple[int, int, int]:
    """Particles (px, py, pz) of a full cell: as equal as possible, then equal in plan (8 gives 2, 2, 2; 4 gives 2, 2, 1)."""
    if not isinstance(particles_per_cell, int | np.integer):
        given = tuple(particles_per_cell)
        if len(given) != 3 or not all(isinstance(n, int | np.integer) and n >= 1 for n in given):
            raise ConfigError(f"particles_per_cell is {particles_per_cell}; give one number or three, such as 8 or (2, 2, 2)")
        return int(given[0]), int(given[1]), int(given[2])
    n = int(particles_per_cell)
    if not 1 <= n <= 1000:
        raise ConfigError(f"particles_per_cell is {n}; it must lie between 1 and 1000, 8 is usual")
    factors = [f for f in range(1, n + 1) if n % f == 0]
    triples = [(a, b, n // (a * b)) for a, b in itertools.product(factors, factors) if n % (a * b) == 0]
    return min(triples, key=lambda t: (sum(t), abs(t[0] - t[1]), -t[2], t))


def require_apart(releases: list[Release]) -> None:
    """Raise ReleaseError if releases lie on different rasters or overlap in plan."""
    for a, b in itertools.combinations(releases, 2):
        if (a.terrain.shape, a.terrain.extent) != (b.terrain.shape, b.terrain.extent):
            raise ReleaseError(f"releases {a.name!r} and {b.name!r} are on different terrains; read both with the same one")
        area = _common_area(a, b)
        if area > THINNEST * min(a.area, b.area):
            raise ReleaseError(
                f"releases {a.name!r} ({a.source}) and {b.name!r} ({b.source}) overlap by {area:.6g} m2; "
                "cut one of them back, or unite them in one file"
            )


def _common_area(a: Release, b: Release) -> float:
    """Plan area [m2] that two releases share; a release without an outline covers all of its cells."""
    if a.outline is not None and b.outline is not None:
        return float(a.outline.intersection(b.outline).area)
    both = (a.thickness > 0) & (b.thickness > 0)
    if not both.any():
        return 0.0
    outlined = a if a.outline is not None else b
    if outlined.outline is None:
        return float(both.sum() * a.terrain.cell_area)
    (rows, columns), (dx, dy) = a.terrain.shape, a.terrain.cell_size
    area = covered_area(local_outline(outlined), np.arange(columns + 1) * dx, np.arange(rows + 1) * dy)
    return float(area.T[::-1][both].sum())


def _require_resolved(release: Release, spacing: tuple[float, float, float]) -> None:
    """Raise ReleaseError if a release is smaller than one grid cell in plan."""
    if release.area >= spacing[0] * spacing[1]:
        return
    usable = float(np.sqrt(release.area)) / CELLS_ACROSS
    step = 10.0 ** (np.floor(np.log10(usable)) - 1)
    raise ReleaseError(
        f"release {release.name!r} ({release.source}) covers {release.area:.4g} m2, less than one grid cell of "
        f"{spacing[0]:g} m x {spacing[1]:g} m: it gets no particles of its own; "
        f"use a cell_size of {np.floor(usable / step) * step:g} m or less ({CELLS_ACROSS} cells across)"
    )


def _prepared_outline(release: Release) -> Any:
    """Outline of a release in local coordinates, prepared for tests of points; None if it has none."""
    if release.outline is None:
        return None
    import shapely

    outline = local_outline(release)
    shapely.prepare(outline)
    return outline


def _inside(outline: Any, at_rim: np.ndarray, plan: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Jittered local positions ``moved`` (n, 2) [m]; those in columns that the outline cuts, ``at_rim``, stay inside it."""
    if not len(at_rim):
        return moved
    import shapely

    outside = at_rim[~shapely.contains_xy(outline, moved[at_rim])]
    moved[outside] = plan[outside]  # the centroid of the covered part
    beyond = outside[~shapely.contains_xy(outline, plan[outside])]  # fallback if the centroid lies in a notch or hole
    if len(beyond):
        nearest = shapely.shortest_line(outline, shapely.points(plan[beyond]))
        moved[beyond] = shapely.get_coordinates(nearest)[::2]
    return moved
