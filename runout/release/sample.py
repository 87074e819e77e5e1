"""Where the particles of releases lie in the plan, how many there are, and how they come onto cells with elevation."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np

from runout.errors import ConfigError, ReleaseError
from runout.io.polygon_coverage import covered_area
from runout.model.particles import Particles
from runout.model.release import Placement, Release
from runout.model.scene import Scene
from runout.release.columns import THINNEST, Columns, local_outline

CELLS_ACROSS = 4  # width of a release in grid cells that messages propose
WITHIN = 1e-3  # distance from the edge of a raster cell, as a share of its size


@dataclass(frozen=True)
class Sampling:
    """How particles are placed."""

    spacing: tuple[float, float, float]  # grid spacing (dx, dy, dz) [m]
    per_axis: tuple[int, int, int]  # particles (px, py, pz) of a full grid cell
    seed: int = 0  # of the jitter; equal seeds give equal particles
    jitter: float = 0.25  # largest horizontal displacement, as a share of the particle spacing, 0 to 0.5

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


def count_particles(releases: Sequence[Release], how: Sampling) -> int:
    """Particles of releases, counted without making them."""
    return sum(int(how.columns(release).rows.sum()) for release in releases)


def particles_per_axis(particles_per_cell: int | tuple[int, int, int]) -> tuple[int, int, int]:
    """Particles (px, py, pz) of a full cell: as equal as possible, then equal in plan (8 gives 2, 2, 2; 4 gives 2, 2, 1)."""
    if not isinstance(particles_per_cell, int | np.integer):
        counts = tuple(particles_per_cell)
        if len(counts) != 3 or not all(isinstance(n, int | np.integer) and n >= 1 for n in counts):
            raise ConfigError(f"particles_per_cell is {particles_per_cell}; give one number or three, such as 8 or (2, 2, 2)")
        return int(counts[0]), int(counts[1]), int(counts[2])
    n = int(particles_per_cell)
    if not 1 <= n <= 1000:
        raise ConfigError(f"particles_per_cell is {n}; it must lie between 1 and 1000, 8 is usual")
    factors = [f for f in range(1, n + 1) if n % f == 0]
    triples = [(a, b, n // (a * b)) for a, b in itertools.product(factors, factors) if n % (a * b) == 0]
    return min(triples, key=lambda t: (sum(t), abs(t[0] - t[1]), -t[2], t))


def require_apart(releases: list[Release]) -> None:
    """Raise ReleaseError if releases lie on different rasters or overlap in plan.

    Releases that start at different times may overlap, unless both are excavated: the same ground fails once.
    """
    for a, b in itertools.combinations(releases, 2):
        if (a.terrain.shape, a.terrain.extent) != (b.terrain.shape, b.terrain.extent):
            raise ReleaseError(f"releases {a.name!r} and {b.name!r} are on different terrains; read both with the same one")
        if may_overlap(a, b):
            continue
        area = _common_area(a, b)
        if area > THINNEST * min(a.area, b.area):
            raise ReleaseError(
                f"releases {a.name!r} ({a.source}) and {b.name!r} ({b.source}) overlap by {area:.6g} m2; "
                "cut one of them back, or unite them in one file"
            )


def may_overlap(a: Release, b: Release) -> bool:
    """Whether two releases may overlap in plan: one is put on what lies there when it starts, later or earlier than the other."""
    at_once = (a.start_time, a.starts_when) == (b.start_time, b.starts_when)
    return not at_once and Placement.ON_SURFACE in (a.placement, b.placement)


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


def prepared_outline(release: Release) -> Any:
    """Outline of a release in local coordinates, prepared for tests of points; None if it has none."""
    if release.outline is None:
        return None
    import shapely

    outline = local_outline(release)
    shapely.prepare(outline)
    return outline


def kept_inside(outline: Any, middle: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Local positions ``moved`` (n, 2) [m] of particles in columns that an outline cuts; those outside go to the ``middle`` (n, 2).

    That is the centroid of the covered part of their column, or the nearest place on the outline if it lies in a notch or hole.
    """
    import shapely

    outside = np.flatnonzero(~shapely.contains_xy(outline, moved))
    moved[outside] = middle[outside]
    beyond = outside[~shapely.contains_xy(outline, middle[outside])]
    if len(beyond):
        nearest = shapely.shortest_line(outline, shapely.points(middle[beyond]))
        moved[beyond] = shapely.get_coordinates(nearest)[::2]
    return moved


def onto_known_ground(particles: Particles, scene: Scene) -> Particles:
    """The particles; those whose grid column extends beyond the domain are moved to the nearest cell of the domain.

    Grid columns and raster cells have different edges. Heights above the ground are kept.
    """
    spacing = np.array(scene.spacing)
    place = particles.position(spacing)
    out = ~scene.holds(place[:, 0], place[:, 1])
    if not out.any() or scene.surface is None:
        return particles
    from_here = place[out]
    to_there = np.column_stack([_nearest(scene, from_here[:, 0], from_here[:, 1]), from_here[:, 2]])
    surface = scene.surface
    to_there[:, 2] += surface.elevation(*to_there.T[:2]) - surface.elevation(*from_here.T[:2])
    moved = Particles.at(to_there, spacing)
    particles.node[out], particles.offset[out] = moved.node, moved.offset
    return particles


def _nearest(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Positions (n, 2) [m] in the known raster cells nearest to the cells of given positions."""
    from scipy import ndimage

    raster = scene.raster
    unknown = np.zeros((raster.columns, raster.rows), bool) if scene.unknown is None else scene.unknown
    cell = np.array(raster.cell_size)
    index = np.clip(np.floor(np.stack([x, y]) / cell[:, None]).astype(np.int64), 0, np.array(unknown.shape)[:, None] - 1)
    if unknown.any():
        known = ndimage.distance_transform_edt(unknown, sampling=cell, return_distances=False, return_indices=True)
        index = known[:, index[0], index[1]]
    low, high = (index + WITHIN) * cell[:, None], (index + 1 - WITHIN) * cell[:, None]
    return np.clip(np.stack([x, y]), low, high).T  # type: ignore[no-any-return]
