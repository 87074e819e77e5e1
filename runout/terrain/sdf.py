"""The sliding surface and the signed distance to it."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from types import FunctionType

import numpy as np

from runout.errors import DemError
from runout.model.nodal_surface import NodalSurface
from runout.model.surface import REACH, Surface, by_blocks
from runout.model.terrain import Terrain
from runout.physics import heightfield, tensors
from runout.terrain import crests, relief
from runout.terrain.content_store import ContentStore, content_key
from runout.terrain.crests import Box, Mass, crest_window, most_cells, needs_table
from runout.terrain.open_edge import continued
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
    :data:`runout.terrain.crests.LARGEST_WINDOW` cells far from the mass, they are filtered as the rest; the surface has no step
    there. On nodes so close together that :func:`runout.terrain.crests.needs_table` is false, the crests are those of the
    raster's lattice, true to 3 %. Contact, releases and maps of the ground take the same surface; the last few are kept by their
    content (:mod:`runout.terrain.content_store`). Other parameters and errors are those of :func:`raster_surface`.
    """
    raster = _raster(terrain, thickness_excavated, spacing)
    box, top = _extent(terrain, thickness_excavated, mass, raster.count)
    box = crest_window(raster.means, raster.sizes, box, top, mass.angle if mass else 0.0, most_cells(raster.sizes, raster.grid))
    made_of = [raster.elevation] if raster.count == (1, 1) else [raster.means.T, raster.filtered.T]
    key = content_key(*made_of, np.array([*raster.sizes, *raster.grid, raster.resolved]), np.array([raster.count, *box]))
    return GROUNDS.get(key, lambda: _with_crests(raster, box))


@dataclass(frozen=True)
class _Raster:
    elevation: np.ndarray  # (rows, columns): those of the cells, north-west corner first [m]
    # cell, grid: size of the cells, and spacing of the grid [m]
    cell: tuple[float, float]
    grid: tuple[float, float]
    count: tuple[int, int]  # cells in a mean: as many as a cell of the grid holds whole
    means: np.ndarray  # (mx, my): means of so many cells [m]
    fine_relief: float | None = None  # part of the waves of two cells that stays, 0 to 1; None: by the grid

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

    def coefficients(self, box: Box) -> np.ndarray:
        """Coefficients (k, l) [m] of the surface through the means, in a box of these."""
        cells = tuple(slice(*sides) for sides in box)
        if not self.on_cells:
            return self.unfiltered.coefficients[cells]
        around = [(max(0, low - REACH), high + REACH) for low, high in box]
        part = Surface.through(self.means[tuple(slice(*sides) for sides in around)], self.sizes, averaged=self.count)
        own = tuple(slice(low - first, high - first) for (low, high), (first, _) in zip(box, around, strict=True))
        return part.coefficients[own]

    @cached_property
    def filtered(self) -> np.ndarray:
        """Elevations (k, l) [m] of the relief that the grid can carry, where the surface has coefficients."""
        widths = [width / cell for width, cell in zip(relief.half_width(self.grid), self.cell, strict=True)]
        axes = enumerate(zip(self.elevation.shape[::-1], widths, strict=True))
        east, north = (relief.filter_weights(count, width, self._places(axis)) for axis, (count, width) in axes)
        return relief.along_both(north[:, ::-1], self.elevation, east).T

    @property
    def resolved(self) -> float:
        """Part of the waves of two cells of the raster that stays, 0 to 1."""
        return relief.resolved_in(self.grid, self.cell) if self.fine_relief is None else self.fine_relief

    @cached_property
    def stays(self) -> np.ndarray:
        """How much of each mean stays unfiltered, 0 to 1, whether it stands out or not."""
        coarser = max(h / one for h, one in zip(self.grid, self.sizes, strict=True))
        return by_blocks(lambda share: relief.stays(share, self.resolved, coarser), relief.two_cell_share(self.means), (0, 0))

    def surface(self) -> Surface:
        """The surface of the relief that the grid can carry, on its nodes; on the cells of the raster if these are coarser."""
        x, y = ((self._places(axis) + 0.5) * cell for axis, cell in enumerate(self.cell))
        z = np.empty(self.filtered.shape)
        if self.on_cells:
            for strip in relief.strips(z.shape):
                z[strip] = self.filtered[strip] + self.stays[strip] * (self.means[strip] - self.filtered[strip])
        else:
            spline = [relief.spline_weights(self.unfiltered, axis, place) for axis, place in enumerate((x, y))]
            in_means = [place / size - 0.5 for place, size in zip((x, y), self.sizes, strict=True)]
            for strip in relief.strips(z.shape):
                own = relief.along_both(spline[0][strip], self.unfiltered.coefficients, spline[1])
                stays = relief.between(self.stays, (in_means[0][strip], in_means[1]))
                z[strip] = self.filtered[strip] + stays * (own - self.filtered[strip])
        return Surface.through(z, (float(x[1] - x[0]), float(y[1] - y[0])), (float(x[0]), float(y[0])))

    def _places(self, axis: int) -> np.ndarray:
        """Where the surface has coefficients along an axis [cells], 0 in the middle of the first cell."""
        ratio, count = self.grid[axis] / self.cell[axis], self.elevation.shape[1 - axis]
        if self.on_cells:
            return np.arange(float(count))
        return np.arange(-1, max(math.ceil(count / ratio) + 2, 2)) * ratio - 0.5


def _with_crests(raster: _Raster, box: Box) -> NodalSurface:
    """The surface of a raster on the nodes of a grid; in a box of its means, what stands out is that of the raster."""
    surface, sizes, grid = raster.surface(), raster.sizes, raster.grid
    cells, first = tuple(slice(*sides) for sides in box), (box[0][0], box[1][0])
    corner = first[0] * sizes[0], first[1] * sizes[1]
    edges = relief.standing_out(raster.means[cells])
    stays = np.maximum(raster.stays[cells], edges)
    points = crests.Crests.of(raster.means[cells], sizes, min(grid))
    share = np.maximum(*(stays[cell] for cell in relief.cells_of(points, stays.shape, sizes)))
    points = replace(points, weight=points.weight * share).take(share > 0.0).moved(corner)
    if not len(points.axis) and not edges.any():
        return NodalSurface(surface, grid)
    middle = corner[0] + sizes[0] / 2, corner[1] + sizes[1] / 2
    own = crests.with_crests(Surface(raster.coefficients(box), sizes, middle), points).coefficients
    if raster.on_cells:
        surface.coefficients[cells] += stays * (own - surface.coefficients[cells])
        if not len(points.axis) or not needs_table(sizes, grid):
            return NodalSurface(surface, grid)
    low, high = (
        [round_of(sides[k] * size / h) + beyond for sides, size, h in zip(box, sizes, grid, strict=True)]
        for k, round_of, beyond in ((0, math.floor, -BEYOND), (1, math.ceil, BEYOND + 1))
    )
    start, shape = (low[0], low[1]), (high[0] - low[0], high[1] - low[1])
    filtered = surface.on_nodes(grid, start, shape)
    if raster.on_cells:
        return NodalSurface(surface, grid, crests.with_crests(filtered, points).coefficients - filtered.coefficients, start)
    raster.unfiltered.coefficients[cells] = own
    nodes = crests.with_crests(raster.unfiltered.on_nodes(grid, start, shape), points)
    places = [(one + np.arange(count)) * h for one, count, h in zip(start, shape, grid, strict=True)]
    share = relief.between(stays, [place / size - one - 0.5 for place, size, one in zip(places, sizes, first, strict=True)])
    return NodalSurface(surface, grid, share * (nodes.coefficients - filtered.coefficients), start)


def raster_surface(terrain: Terrain, thickness_excavated: np.ndarray | None, spacing: tuple[float, float]) -> Surface:
    """Surface of the elevation minus what is excavated, filtered to the relief that a grid of this ``spacing`` can carry.

    Its coefficients lie on the nodes of the grid, or on the cells of a coarser raster (:mod:`runout.terrain.relief`). Planes and
    parabolas stay exact (:func:`runout.physics.heightfield.weight_of_means`); cliffs and dams get no lip and no moat that the
    raster does not have. Into cells without an elevation the surface is continued (:func:`runout.terrain.open_edge.continued`); no
    mass stays there, see :mod:`runout.terrain.open_edge`.

    ``thickness_excavated`` (rows, columns): vertical thickness of the masses that lie below the surface [m]. ``spacing``:
    horizontal spacing of the grid, east and north [m]; it gives the width of the filter. Raises DemError if a cell that is
    excavated has no elevation, the shapes differ, or a spacing is not positive.
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
    z = continued(terrain.elevation, terrain.cell_size, reach)
    if thickness_excavated is not None:
        z = z - _excavated(terrain, thickness_excavated)
    axes = zip(spacing, terrain.cell_size, z.shape[::-1], strict=True)
    east, north = (min(max(1, int(h / cell * (1.0 + 1e-9))), n // 3) for h, cell, n in axes)
    means = z[::-1].T
    if (east, north) != (1, 1):
        weights = relief.mean_weights(z.shape[0], north)[:, ::-1], relief.mean_weights(z.shape[1], east)
        means = relief.along_both(weights[0], z, weights[1]).T
    return _Raster(z, terrain.cell_size, (float(spacing[0]), float(spacing[1])), (east, north), means, terrain.fine_relief)


def _extent(
    terrain: Terrain, thickness_excavated: np.ndarray | None, mass: Mass | None, count: tuple[int, int]
) -> tuple[Box, float]:
    """Box of the lattice, ``count`` cells of the terrain each, that holds the mass, and the highest elevation of the mass [m]."""
    rows, columns = terrain.shape
    inside = [] if mass is None else [np.flatnonzero(mass.thickness.max(axis=axis) > 0) for axis in (0, 1)]
    if mass is None or not len(inside[0]):
        return ((0, -(-columns // count[0])), (0, -(-rows // count[1]))), math.inf
    part = np.s_[inside[1][0] : inside[1][-1] + 1, inside[0][0] : inside[0][-1] + 1]
    thickness, dug = mass.thickness[part], 0.0 if thickness_excavated is None else thickness_excavated[part]
    top = float((terrain.elevation[part] - dug + thickness)[thickness > 0].max())
    cells = zip((inside[0], rows - 1 - inside[1]), count, strict=True)
    sides = [(int(n.min()) // each, int(n.max()) // each + 1) for n, each in cells]
    return (sides[0], sides[1]), top


def _excavated(terrain: Terrain, thickness: np.ndarray) -> np.ndarray:
    t = np.asarray(thickness, dtype=np.float64)
    if t.shape != terrain.shape or not np.isfinite(t).all() or t.min() < 0:
        reason = f"shape {t.shape} on a terrain of {terrain.shape}, {int((~(t >= 0)).sum())} values negative or NaN"
        raise DemError(f"{terrain.source}: the excavated thickness does not fit ({reason}); give one number >= 0 for each cell")
    require_known(terrain, t > 0, "the excavated mass")
    return t


def _tangent_plane(
    surface: Surface | NodalSurface, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Elevation [m] and upward unit normal of the surface under a point."""
    elevation, east, north = surface.evaluate(x, y)
    n_z = _normal_z(east, north)
    return elevation, (-east * n_z, -north * n_z, n_z)
