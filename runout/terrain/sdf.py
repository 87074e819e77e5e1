"""The sliding surface and the signed distance to it."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from types import FunctionType

import numpy as np

from runout.errors import DemError
from runout.model.nodal_surface import NodalSurface
from runout.model.surface import Surface
from runout.model.terrain import Terrain
from runout.physics import heightfield, tensors
from runout.terrain import crests, relief
from runout.terrain.content_store import ContentStore, content_key
from runout.terrain.crest_window import Box, Mass, most_cells, needs_table, window
from runout.terrain.fill import continued
from runout.terrain.prepare import require_known

BEYOND = 3  # nodes beyond the cells whose crests are corrected
GROUNDS = ContentStore[NodalSurface](lambda ground: ground.surface.coefficients.nbytes + ground.change.nbytes)
STENCIL = 6.0  # cells of the grid from which the surface at a point is made
# the one formula there with a square root, for arrays
_normal_z = FunctionType(heightfield.normal_z.__code__, {**heightfield.normal_z.__globals__, "math": np})


def sliding_surface(
    terrain: Terrain, thickness_excavated: np.ndarray | None, spacing: tuple[float, float], mass: Mass | None = None
) -> NodalSurface:
    """Surface on which the mass slides, on the nodes of the grid: elevation minus what is excavated.

    That of :func:`raster_surface`. Dams, gullies and cliffs that stand out of the roughness around them have the elevations of the
    raster where the ``mass`` may come; without a mass, everywhere (:mod:`runout.terrain.crests`). Elsewhere, and on rasters beyond
    :data:`runout.terrain.crest_window.LARGEST` cells far from the mass, they are filtered as the rest; the surface has no step
    there. On nodes so close together that :func:`runout.terrain.crest_window.needs_table` is false, the crests are those of the
    raster's lattice, true to 3 %. Contact, releases and maps of the ground take the same surface; the last few are kept by their
    content (:mod:`runout.terrain.content_store`). Other parameters and errors are those of :func:`raster_surface`.
    """
    raster = _raster(terrain, thickness_excavated, spacing)
    box, top = _extent(terrain, thickness_excavated, mass, raster.count)
    box = window(raster.means, raster.sizes, box, top, mass.angle if mass else 0.0, most_cells(raster.sizes, raster.grid))
    key = content_key(raster.lattice, np.array([*raster.sizes, *raster.grid]), np.array([raster.count, *box]))
    return GROUNDS.get(key, lambda: _with_crests(raster, box))


@dataclass(frozen=True)
class _Raster:
    """Elevations of a raster for a grid.

    Attributes
    ----------
    lattice : ndarray (nx, ny)
        Those of the cells, from the south-west corner on [m].
    cell, grid : tuple of float
        Size of the cells, and spacing of the grid [m].
    count : tuple of int
        Cells in a mean: as many as a cell of the grid holds whole.
    means : ndarray (mx, my)
        Means of so many cells [m].
    """

    lattice: np.ndarray
    cell: tuple[float, float]
    grid: tuple[float, float]
    count: tuple[int, int]
    means: np.ndarray

    @property
    def sizes(self) -> tuple[float, float]:
        """Size of what a mean covers [m]."""
        return self.count[0] * self.cell[0], self.count[1] * self.cell[1]

    @property
    def on_cells(self) -> bool:
        """Whether the surface has its coefficients at the cells of the raster, since these are coarser than the grid."""
        return all(h < cell for h, cell in zip(self.grid, self.cell, strict=True))

    @cached_property
    def unfiltered(self) -> Surface:
        """The surface through the means."""
        return Surface.through(self.means, self.sizes, (self.sizes[0] / 2, self.sizes[1] / 2), self.count)

    @cached_property
    def stays(self) -> np.ndarray:
        """How much of each mean stays unfiltered, 0 to 1, whether it stands out or not."""
        ratio, coarser = (max(h / one for h, one in zip(self.grid, sizes, strict=True)) for sizes in (self.cell, self.sizes))
        return relief.stays(relief.two_cell_share(self.means), ratio, coarser)

    def surface(self) -> Surface:
        """The surface of the relief that the grid can carry, on its nodes; on the cells of the raster if these are coarser."""
        places = [self._places(axis) for axis in (0, 1)]
        x, y = ((place + 0.5) * cell for place, cell in zip(places, self.cell, strict=True))
        widths = [h / cell for h, cell in zip(self.grid, self.cell, strict=True)]
        z = relief.filtered(relief.filtered(self.lattice, widths[0], places[0]).T, widths[1], places[1]).T
        own = self.means if self.on_cells else self.unfiltered.on_lattice(x, y)
        z += self.between(self.stays, x, y) * (own - z)
        return Surface.through(z, (float(x[1] - x[0]), float(y[1] - y[0])), (float(x[0]), float(y[0])))

    def _places(self, axis: int) -> np.ndarray:
        """Where the surface has coefficients along an axis [cells], 0 in the middle of the first cell."""
        ratio, count = self.grid[axis] / self.cell[axis], self.lattice.shape[axis]
        if self.on_cells:
            return np.arange(float(count))
        return np.arange(-1, max(math.ceil(count / ratio) + 2, 2)) * ratio - 0.5

    def between(self, values: np.ndarray, x: np.ndarray, y: np.ndarray, first: tuple[int, int] = (0, 0)) -> np.ndarray:
        """Values of the means from the ``first`` on, at all pairs of positions [m]."""
        places = [place / size - one - 0.5 for place, size, one in zip((x, y), self.sizes, first, strict=True)]
        return relief.between(values, places)


def _with_crests(raster: _Raster, box: Box) -> NodalSurface:
    """The surface of a raster on the nodes of a grid; in a box of its means, what stands out is that of the raster."""
    surface, sizes, grid = raster.surface(), raster.sizes, raster.grid
    cells, first = tuple(slice(*sides) for sides in box), (box[0][0], box[1][0])
    corner = first[0] * sizes[0], first[1] * sizes[1]
    edges = relief.standing_out(raster.means[cells])
    stays = np.maximum(raster.stays[cells], edges)
    found = crests.Crests.of(raster.means[cells], sizes, min(grid))
    share = np.maximum(*(stays[cell] for cell in relief.cells_of(found, stays.shape, sizes)))
    found = replace(found, weight=found.weight * share).take(share > 0.0).moved(corner)
    if not len(found.axis) and not edges.any():
        return NodalSurface(surface, grid)
    own, middle = raster.unfiltered, (corner[0] + sizes[0] / 2, corner[1] + sizes[1] / 2)
    own.coefficients[cells] = crests.kept(Surface(own.coefficients[cells], sizes, middle), found).coefficients
    if raster.on_cells:
        surface.coefficients[cells] += stays * (own.coefficients[cells] - surface.coefficients[cells])
        if not len(found.axis) or not needs_table(sizes, grid):
            return NodalSurface(surface, grid)
    low, high = (
        [round_of(sides[k] * size / h) + beyond for sides, size, h in zip(box, sizes, grid, strict=True)]
        for k, round_of, beyond in ((0, math.floor, -BEYOND), (1, math.ceil, BEYOND + 1))
    )
    start, shape = (low[0], low[1]), (high[0] - low[0], high[1] - low[1])
    x, y = ((one + np.arange(count)) * h for one, count, h in zip(start, shape, grid, strict=True))
    nodes = crests.kept((surface if raster.on_cells else own).on_nodes(grid, start, shape), found).coefficients
    share = 1.0 if raster.on_cells else raster.between(stays, x, y, first)
    return NodalSurface(surface, grid, share * (nodes - surface.on_nodes(grid, start, shape).coefficients), start)


def raster_surface(terrain: Terrain, thickness_excavated: np.ndarray | None, spacing: tuple[float, float]) -> Surface:
    """Surface of the elevation minus what is excavated, filtered to the relief that a grid of this ``spacing`` can carry.

    Its coefficients lie on the nodes of the grid, or on the cells of a coarser raster (:mod:`runout.terrain.relief`). Planes and
    parabolas stay exact (:func:`runout.physics.heightfield.weight_of_means`); cliffs and dams get no lip and no moat that the
    raster does not have. Into cells without an elevation the surface is continued (:func:`runout.terrain.fill.continued`); no
    mass stays there, see :mod:`runout.terrain.open_edge`.

    Parameters
    ----------
    terrain : Terrain
    thickness_excavated : ndarray (rows, columns) or None
        Vertical thickness of the masses that lie below the surface [m].
    spacing : tuple of float
        Horizontal spacing of the grid, east and north [m]; also the half-width of the filter.

    Raises
    ------
    DemError
        If a cell that is excavated has no elevation, the shapes differ, or a spacing is not positive.
    """
    return _raster(terrain, thickness_excavated, spacing).surface()


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


def _raster(terrain: Terrain, thickness_excavated: np.ndarray | None, spacing: tuple[float, float]) -> _Raster:
    """Elevation minus what is excavated, continued into cells without one."""
    if len(spacing) != 2 or not all(np.isfinite(h) and h > 0 for h in spacing):
        raise DemError(f"{terrain.source}: spacing of the sliding surface is {spacing} m; both numbers must be positive")
    reach = STENCIL * max(*spacing, *terrain.cell_size)
    z = continued(terrain.elevation, terrain.cell_size, reach) - _excavated(terrain, thickness_excavated)
    lattice = z[::-1].T  # (nx, ny), index 0 west and south
    axes = zip(spacing, terrain.cell_size, lattice.shape, strict=True)
    count = [min(max(1, int(h / cell * (1.0 + 1e-9))), n // 3) for h, cell, n in axes]
    means = _block_means(_block_means(lattice, count[0]).T, count[1]).T
    return _Raster(lattice, terrain.cell_size, (float(spacing[0]), float(spacing[1])), (count[0], count[1]), means)


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
