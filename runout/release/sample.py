"""Particles of releases: seeded, terrain-following, with the exact volume and mass."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np

from runout.errors import ConfigError, ReleaseError
from runout.io.polygon_coverage import ROUND_OFF, covered_area, covered_centroid, regrid, regrid_within
from runout.model.materials import Material
from runout.model.nodal_surface import NodalSurface
from runout.model.particles import Particles
from runout.model.release import Release
from runout.model.surface import Surface
from runout.release import stagger

CELLS_ACROSS = 4  # width of a release in grid cells that messages propose
THINNEST = 1e-6  # columns thinner than this share of a particle layer get no particle; their volume goes to the others
CLOSE = 1e-9  # share of the volume that regridding may miss by round-off


@dataclass(frozen=True)
class RasterSums:
    """Particle columns of one release: indices of the plan lattice and mean thickness [m]."""

    index: np.ndarray  # (n, 2), east and north
    size: tuple[float, float]  # [m]
    thickness: np.ndarray  # (n,)
    centre: np.ndarray  # (n, 2) local position around which the particles lie [m]
    cut: np.ndarray  # (n,) whether the outline cuts the column


def column_thickness(release: Release, edges_x: np.ndarray, edges_y: np.ndarray) -> np.ndarray:
    """Mean vertical thickness (nx, ny) [m] over the columns of a local lattice.

    The volume of each terrain cell lies on its part inside the outline, or without an outline on the whole cell.
    ``sum(thickness * column area)`` is the release's volume to round-off.

    Parameters
    ----------
    release : Release
    edges_x, edges_y : ndarray (nx + 1,), (ny + 1,)
        Ascending local edges of the columns [m]; they must hold the whole release.

    Raises
    ------
    ReleaseError
        If part of the release lies outside the lattice.
    """
    thickness, edges = _occupied(release)
    to_edges = (_padded(np.asarray(edges_x, np.float64), edges[0]), _padded(np.asarray(edges_y, np.float64), edges[1]))
    if release.outline is None:
        columns = regrid(thickness, edges, to_edges)
    else:
        columns = regrid_within(_local_outline(release), thickness, edges, to_edges)
    columns = columns[1:-1, 1:-1]
    held = float(np.diff(edges_x) @ columns @ np.diff(edges_y))
    if abs(held / release.volume - 1.0) > CLOSE:
        raise ReleaseError(
            f"release {release.name!r}: the lattice holds {held:.6g} of its {release.volume:.6g} m3; make the lattice larger"
        )
    return columns * (release.volume / held)


def _occupied(release: Release) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Thickness (nx, ny) of the smallest window of terrain cells that holds the release, and its local edges."""
    cells = release.thickness[::-1].T
    window = []
    for axis in (0, 1):
        used = np.flatnonzero(cells.any(axis=1 - axis))
        window.append(slice(used[0], used[-1] + 1))
    edges = tuple(np.arange(w.start, w.stop + 1) * size for w, size in zip(window, release.terrain.cell_size, strict=True))
    return np.ascontiguousarray(cells[window[0], window[1]]), (edges[0], edges[1])


def _padded(edges: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Edges with one more cell on either side that cover those of ``around``."""
    width = edges[-1] - edges[0]
    return np.concatenate(([min(edges[0], around[0]) - width], edges, [max(edges[-1], around[-1]) + width]))


def _local_outline(release: Release) -> Any:
    import shapely

    return shapely.transform(release.outline, release.terrain.frame.to_local)


def sample_particles(
    releases: list[Release],
    materials: Sequence[Material],
    surface: Surface | NodalSurface,
    spacing: tuple[float, float, float],
    particles_per_cell: int | tuple[int, int, int] = 8,
    seed: int = 0,
    jitter: float = 0.25,
    press: Callable[[Particles, np.ndarray, int], None] | None = None,
) -> Particles:
    """Particles at rest that fill the releases from the surface upwards.

    The plan is divided into columns of ``dx / px`` by ``dy / py``. A column of mean thickness T holds
    ``n = max(1, round(T / (dz / pz)))`` particles of equal volume, one in each n-th of it above the surface. Their
    heights are staggered from column to column (:mod:`runout.release.stagger`), so that a thin mass has more levels than layers.
    The volume and mass of each release are exact to round-off.

    Parameters
    ----------
    releases, materials : list
        One material per release.
    surface : Surface or NodalSurface
        Surface below the mass, in local coordinates.
    spacing : tuple of float
        Grid spacing (dx, dy, dz) [m].
    particles_per_cell : int or tuple of int
        Number in a full grid cell, or its factors (px, py, pz).
    seed : int
        Of the jitter; equal seeds give equal particles.
    jitter : float
        Largest horizontal displacement, as a share of the particle spacing, 0 to 0.5.
    press : callable, optional
        Sets the stress of the particles of a release, from their depths (n,) [m] below its surface and its number.

    Raises
    ------
    ReleaseError
        If releases overlap in plan or one is smaller than a grid cell.
    ConfigError
        If ``particles_per_cell``, ``jitter`` or the number of materials is unusable.
    """
    per_axis = particles_per_axis(particles_per_cell)
    if not 0.0 <= jitter <= 0.5:
        raise ConfigError(f"jitter is {jitter:g}; it must lie between 0 and 0.5 of the particle spacing")
    if not isinstance(seed, Integral) or seed < 0:
        raise ConfigError(f"seed is {seed!r}; it must be a whole number, 0 or more")
    if len(releases) != len(materials):
        raise ConfigError(f"{len(materials)} materials for {len(releases)} releases; give one each")
    require_apart(releases)
    sets = []
    for number, (release, material) in enumerate(zip(releases, materials, strict=True)):
        _require_resolved(release, spacing)
        columns = _columns(release, (spacing[0] / per_axis[0], spacing[1] / per_axis[1]), spacing[2] / per_axis[2])
        rng = np.random.default_rng([seed, number])
        particles, depth = _fill(release, columns, surface, spacing, spacing[2] / per_axis[2], jitter, rng)
        particles.mass[:] = particles.volume * material.density
        particles.release[:] = number
        if press:
            press(particles, depth, number)
        sets.append(particles)
    return sets[0] if len(sets) == 1 else Particles.concatenate(sets)


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
    area = covered_area(_local_outline(outlined), np.arange(columns + 1) * dx, np.arange(rows + 1) * dy)
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


def _columns(release: Release, size: tuple[float, float], layer: float) -> RasterSums:
    """Columns of the plan lattice that hold enough of the release for particles."""
    _, edges = _occupied(release)
    first = [int(np.floor(e[0] / h + ROUND_OFF)) for e, h in zip(edges, size, strict=True)]
    last = [int(np.ceil(e[-1] / h - ROUND_OFF)) for e, h in zip(edges, size, strict=True)]
    edges_x, edges_y = (np.arange(a, b + 1) * h for a, b, h in zip(first, last, size, strict=True))
    thickness = column_thickness(release, edges_x, edges_y)
    used = thickness > THINNEST * layer
    if not used.any():
        thinnest = THINNEST * layer
        raise ReleaseError(f"release {release.name!r} is thinner than {thinnest:.3g} m everywhere; check the unit of its thickness")
    index = np.argwhere(used)
    centre = (index + first + 0.5) * np.array(size)
    cut = np.zeros(len(index), bool)
    if release.outline is not None:
        outline = _local_outline(release)
        share = covered_area(outline, edges_x, edges_y)[used] / (size[0] * size[1])
        cut = (share > 0) & (share < 1)
        east, north = covered_centroid(outline, edges_x, edges_y)
        centre += np.column_stack((east[used], north[used]))
    return RasterSums(index + first, size, thickness[used], centre, cut)


def _fill(
    release: Release,
    columns: RasterSums,
    surface: Surface | NodalSurface,
    spacing: tuple[float, float, float],
    layer: float,
    jitter: float,
    rng: np.random.Generator,
) -> tuple[Particles, np.ndarray]:
    """Particles of one release and their depths (n,) below its surface [m]; mass and release index are left to the caller."""
    column, above, height = stagger.layered(columns.index, columns.thickness, layer)
    plan = _plan_positions(release, columns, column, jitter, rng)
    ground, east, north = surface.evaluate(plan[:, 0], plan[:, 1])
    position = np.column_stack((plan, ground + above))
    particles = Particles.at(position, np.asarray(spacing, np.float64))
    volume = height * (columns.size[0] * columns.size[1])
    particles.volume[:] = volume * (release.volume / volume.sum())
    particles.radius[:] = stagger.half_size(height) / np.sqrt(1.0 + east * east + north * north)
    return particles, columns.thickness[column] - above


def _plan_positions(
    release: Release, columns: RasterSums, column: np.ndarray, jitter: float, rng: np.random.Generator
) -> np.ndarray:
    """Jittered local positions (n, 2) [m]; positions in columns that the outline cuts stay inside it."""
    plan = columns.centre[column]
    moved = plan + rng.uniform(-jitter, jitter, plan.shape) * np.array(columns.size)
    at_rim = np.flatnonzero(columns.cut[column])
    if not len(at_rim):
        return moved
    import shapely

    outline = _local_outline(release)
    shapely.prepare(outline)
    outside = at_rim[~shapely.contains_xy(outline, moved[at_rim])]
    moved[outside] = plan[outside]  # the centroid of the covered part
    beyond = outside[~shapely.contains_xy(outline, plan[outside])]  # fallback if the centroid lies in a notch or hole
    if len(beyond):
        nearest = shapely.shortest_line(outline, shapely.points(plan[beyond]))
        moved[beyond] = shapely.get_coordinates(nearest)[::2]
    return moved
