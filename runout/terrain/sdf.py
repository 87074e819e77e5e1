"""The sliding surface and the signed distance to it."""

import math
from types import FunctionType

import numpy as np

from runout.errors import DemError
from runout.model.nodal_surface import NodalSurface
from runout.model.surface import Surface
from runout.model.terrain import Terrain
from runout.physics import heightfield, tensors
from runout.terrain import crests
from runout.terrain.crest_window import Box, Mass, most_cells, needs_table, window
from runout.terrain.fill import continued
from runout.terrain.ground_store import GroundStore, content_key
from runout.terrain.prepare import require_known

BEYOND = 3  # nodes beyond the cells whose crests are corrected
GROUNDS = GroundStore()
STENCIL = 4.0  # cells of the grid from which the surface at a point is made
# the one formula there with a square root, for arrays
_normal_z = FunctionType(heightfield.normal_z.__code__, {**heightfield.normal_z.__globals__, "math": np})


def sliding_surface(
    terrain: Terrain, thickness_excavated: np.ndarray | None, spacing: tuple[float, float], mass: Mass | None = None
) -> NodalSurface:
    """Surface on which the mass slides, on the nodes of the grid: elevation minus what is excavated.

    That of :func:`raster_surface`, with crests and channels at the elevations of its cells (:mod:`runout.terrain.crests`) where the
    ``mass`` may come; without one everywhere. Elsewhere, and on rasters beyond :data:`runout.terrain.crest_window.LARGEST` cells
    far from the mass, crests are as that surface has them; the surface has no step there. On nodes so close together that
    :func:`runout.terrain.crest_window.needs_table` is false, the crests are those of the raster's lattice, true to 3 %. Contact,
    releases and maps of the ground take the same surface; the last few are kept by their content
    (:mod:`runout.terrain.ground_store`). Other parameters and errors are those of :func:`raster_surface`.
    """
    means, sizes, count = _means(terrain, thickness_excavated, spacing)
    grid = float(spacing[0]), float(spacing[1])
    box, top = _extent(terrain, thickness_excavated, mass, count)
    box = window(means, sizes, box, top, mass.angle if mass else 0.0, most_cells(sizes, grid))
    key = content_key(means, np.array([*sizes, *grid]), np.array([count, *box]))
    return GROUNDS.get(key, lambda: _with_crests(_through(means, sizes, count), means, box, grid))


def _with_crests(surface: Surface, means: np.ndarray, box: Box, grid: tuple[float, float]) -> NodalSurface:
    """The surface of elevations ``means`` (nx, ny) [m] on the nodes of a grid, with crests corrected in a box of its cells."""
    cells, sizes = tuple(slice(*sides) for sides in box), surface.spacing
    corner = box[0][0] * sizes[0], box[1][0] * sizes[1]
    found = crests.Crests.of(means[cells], sizes, min(grid), corner)
    middle = corner[0] + sizes[0] / 2, corner[1] + sizes[1] / 2
    surface.coefficients[cells] = crests.kept(Surface(surface.coefficients[cells], sizes, middle), found).coefficients
    if not len(found.axis) or not needs_table(sizes, grid):
        return NodalSurface(surface, grid)
    low, high = (
        [round_of(sides[k] * size / h) + beyond for sides, size, h in zip(box, sizes, grid, strict=True)]
        for k, round_of, beyond in ((0, math.floor, -BEYOND), (1, math.ceil, BEYOND + 1))
    )
    nodes = surface.on_nodes(grid, (low[0], low[1]), (high[0] - low[0], high[1] - low[1]))
    change = crests.kept(nodes, found).coefficients - nodes.coefficients
    return NodalSurface(surface, grid, change, (low[0], low[1]))


def raster_surface(terrain: Terrain, thickness_excavated: np.ndarray | None, spacing: tuple[float, float]) -> Surface:
    """Surface of the elevation minus what is excavated, on a lattice of the raster's cells.

    Cells finer than ``spacing`` are averaged in whole blocks to just below it: the grid cannot resolve what is smaller, and
    noisy normals disturb contact. Planes and parabolas stay exact (:func:`runout.physics.heightfield.weight_of_means`); cliffs
    and dams get no lip and no moat that the raster does not have. Into cells without an elevation the surface is continued
    (:func:`runout.terrain.fill.continued`); no mass stays there, see :mod:`runout.terrain.open_edge`.

    Parameters
    ----------
    terrain : Terrain
    thickness_excavated : ndarray (rows, columns) or None
        Vertical thickness of the masses that lie below the surface [m].
    spacing : tuple of float
        Horizontal spacing of the grid, east and north [m].

    Raises
    ------
    DemError
        If a cell that is excavated has no elevation, the shapes differ, or a spacing is not positive.
    """
    return _through(*_means(terrain, thickness_excavated, spacing))


def distance(surface: Surface | NodalSurface, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance [m] from a surface, positive above, and its upward unit normal.

    First order, gap times n_z, leads to a foot point; the distance to the tangent plane of the surface there is the result.
    Contact does without the foot point: within half a cell of the ground the first order is as good (verification T8). Within two
    cells h of a surface with slopes to 43 deg and a radius of curvature of 3.4 h (6.8 h) the error is 0.0013 h
    (0.0002 h) rms. Exact for planes.

    Parameters
    ----------
    surface : Surface or NodalSurface
    x, y, z : ndarray
        Local positions [m] of any common shape.

    Returns
    -------
    distance : ndarray (...)
        Signed distance [m].
    normal : ndarray (..., 3)
        Upward unit normal at the foot point [1].
    """
    ground, normal = _tangent_plane(surface, x, y)
    first = heightfield.distance(np.asarray(z, np.float64) - ground, normal[2])
    foot = [np.asarray(p, np.float64) - first * n for p, n in zip((x, y, z), normal, strict=True)]
    ground, normal_at_foot = _tangent_plane(surface, foot[0], foot[1])
    result = first * tensors.dot(normal, normal_at_foot) + heightfield.distance(foot[2] - ground, normal_at_foot[2])
    return result, np.stack(np.broadcast_arrays(*normal_at_foot), axis=-1)


def _means(
    terrain: Terrain, thickness_excavated: np.ndarray | None, spacing: tuple[float, float]
) -> tuple[np.ndarray, tuple[float, float], tuple[int, int]]:
    """Elevations (nx, ny) [m] on the lattice from its south-west corner on, its cells [m], and how many of the raster each has."""
    if len(spacing) != 2 or not all(np.isfinite(h) and h > 0 for h in spacing):
        raise DemError(f"{terrain.source}: spacing of the sliding surface is {spacing} m; both numbers must be positive")
    reach = STENCIL * max(*spacing, *terrain.cell_size)
    z = continued(terrain.elevation, terrain.cell_size, reach) - _excavated(terrain, thickness_excavated)
    lattice = z[::-1].T  # (nx, ny), index 0 west and south
    axes = zip(spacing, terrain.cell_size, lattice.shape, strict=True)
    count = [min(max(1, int(h / cell * (1.0 + 1e-9))), n // 3) for h, cell, n in axes]
    sizes = count[0] * terrain.cell_size[0], count[1] * terrain.cell_size[1]
    means = _block_means(_block_means(lattice, count[0]).T, count[1]).T
    return means, sizes, (count[0], count[1])


def _extent(
    terrain: Terrain, thickness_excavated: np.ndarray | None, mass: Mass | None, count: tuple[int, int]
) -> tuple[Box, float]:
    """Box of the lattice, ``count`` cells of the terrain each, that holds the mass, and the highest elevation of the mass [m]."""
    rows, columns = terrain.shape
    if mass is None or not (mass.thickness > 0).any():
        return ((0, -(-columns // count[0])), (0, -(-rows // count[1]))), math.inf
    row, column = np.nonzero(mass.thickness > 0)
    dug = 0.0 if thickness_excavated is None else thickness_excavated[row, column]
    top = float((terrain.elevation[row, column] - dug + mass.thickness[row, column]).max())
    sides = [(int(n.min()) // each, int(n.max()) // each + 1) for n, each in zip((column, rows - 1 - row), count, strict=True)]
    return (sides[0], sides[1]), top


def _through(means: np.ndarray, sizes: tuple[float, float], count: tuple[int, int]) -> Surface:
    return Surface.through(means, sizes, (sizes[0] / 2, sizes[1] / 2), count)


def _excavated(terrain: Terrain, thickness: np.ndarray | None) -> np.ndarray:
    if thickness is None:
        return np.zeros(terrain.shape)
    t = np.asarray(thickness, dtype=np.float64)
    if t.shape != terrain.shape or not np.isfinite(t).all() or t.min() < 0:
        reason = f"shape {t.shape} on a terrain of {terrain.shape}, {int((~(t >= 0)).sum())} values negative or NaN"
        raise DemError(f"{terrain.source}: the excavated thickness does not fit ({reason}); give one number >= 0 for each cell")
    require_known(terrain, t > 0, "the excavated mass")
    return t


def _block_means(values: np.ndarray, count: int) -> np.ndarray:
    """Means of blocks of ``count`` cells along axis 0; the last block may reach beyond the raster."""
    values = np.pad(values, ((0, -len(values) % count), (0, 0)), mode="reflect", reflect_type="odd")
    return values.reshape(-1, count, values.shape[1]).mean(axis=1)  # type: ignore[no-any-return]


def _tangent_plane(
    surface: Surface | NodalSurface, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Elevation [m] and upward unit normal of the surface under a point."""
    elevation, east, north = surface.evaluate(x, y)
    n_z = _normal_z(east, north)
    return elevation, (-east * n_z, -north * n_z, n_z)
