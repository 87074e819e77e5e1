"""Exact covered areas and conservative regridding between rectangular lattices.

Lattices are given by ascending edges; arrays over them are (nx, ny), index 0 west and south.

On the cells of a terrain, polygons are means by area.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.model.terrain import Terrain

ROUND_OFF = 1e-11  # covered shares below this count as 0, above 1 minus this as 1
SAME_EDGE = 1e-6  # edges closer than this share of a cell are one edge: headers print few digits


def covered_area(outline: Any, edges_x: np.ndarray, edges_y: np.ndarray) -> np.ndarray:
    """Area (nx, ny) [m2] of each lattice cell that lies inside a polygon or multipolygon; holes count as outside.

    The outline is cut at every lattice line and Green's theorem is applied to the pieces: exact up to round-off, and
    linear in the number of cells that the outline crosses, however many vertices it has.

    ``outline``: valid and inside the lattice, in the coordinates of the edges. ``edges_x``, ``edges_y`` (nx + 1,), (ny + 1,):
    ascending [m].
    """
    pieces = _pieces(outline, edges_x, edges_y)
    # a northward piece (interior on its right) adds the area east of it; a southward piece subtracts it
    beside = pieces.summed(pieces.rise * (pieces.half_width - pieces.mean(0)))
    share = (beside + pieces.summed_from_west(pieces.rise)) / np.outer(np.diff(edges_x), np.diff(edges_y))
    share[share < ROUND_OFF] = 0.0
    share[share > 1.0 - ROUND_OFF] = 1.0
    return share * np.outer(np.diff(edges_x), np.diff(edges_y))


def covered_window(outline: Any, edges: tuple[np.ndarray, np.ndarray]) -> tuple[tuple[slice, slice], np.ndarray]:
    """Window of cells around a non-empty polygon or multipolygon, and :func:`covered_area` within it."""
    low, high = outline.bounds[:2], outline.bounds[2:]
    first = [max(int(np.searchsorted(e, v, "right")) - 1, 0) for e, v in zip(edges, low, strict=True)]
    last = [int(np.searchsorted(e, v, "left")) for e, v in zip(edges, high, strict=True)]
    x, y = (slice(a, max(b, a + 1)) for a, b in zip(first, last, strict=True))
    return (x, y), covered_area(outline, edges[0][x.start : x.stop + 1], edges[1][y.start : y.stop + 1])


def covered_centroid(outline: Any, edges_x: np.ndarray, edges_y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centroids (nx, ny) of the covered part of each lattice cell, east and north of the cell's centre [m]; 0 for uncovered cells.

    Parameters as for :func:`covered_area`.
    """
    pieces, area = _pieces(outline, edges_x, edges_y), covered_area(outline, edges_x, edges_y)
    moment_x = pieces.summed(0.5 * pieces.rise * (pieces.half_width * pieces.half_width - pieces.mean_product(0)))
    beside = pieces.summed(pieces.rise * (pieces.half_width * pieces.mean(1) - pieces.mean_product(1)))
    moment_y = beside + pieces.summed_from_west(pieces.rise * pieces.mean(1))
    cut = (area > 0) & (area < np.outer(np.diff(edges_x), np.diff(edges_y)))
    east, north = (np.divide(m, area, out=np.zeros_like(area), where=cut) for m in (moment_x, moment_y))
    half_x, half_y = 0.5 * np.diff(edges_x)[:, None], 0.5 * np.diff(edges_y)
    return np.clip(east, -half_x, half_x), np.clip(north, -half_y, half_y)  # slivers: the quotient is dominated by round-off


@dataclass(frozen=True)
class _Pieces:
    """Pieces of an outline, one cell each; coordinates from the centre of the cell."""

    start: np.ndarray  # (n, 2) [m]
    end: np.ndarray  # (n, 2) [m]
    rise: np.ndarray  # (n,) towards the north, the interior on the right [m]
    half_width: np.ndarray  # (n,) of the cell [m]
    cell: np.ndarray  # (n,) flat index
    width: np.ndarray  # (nx,) of the lattice [m]
    rows: int

    def mean(self, axis: int) -> np.ndarray:
        """Mean coordinate (n,) along each piece [m]."""
        return 0.5 * (self.start[:, axis] + self.end[:, axis])

    def mean_product(self, axis: int) -> np.ndarray:
        """Mean of x times the coordinate of an axis (n,) along each piece [m2]."""
        (a, b), (c, d) = (self.start[:, 0], self.end[:, 0]), (self.start[:, axis], self.end[:, axis])
        return (2.0 * (a * c + b * d) + a * d + b * c) / 6.0

    def summed(self, values: np.ndarray) -> np.ndarray:
        """Sum (nx, ny) of values (n,) over the pieces of each cell."""
        return np.bincount(self.cell, values, len(self.width) * self.rows).reshape(-1, self.rows)

    def summed_from_west(self, values: np.ndarray) -> np.ndarray:
        """Sum (nx, ny) of values (n,) over the pieces in the cells to the west, times the width of the cell."""
        here = self.summed(values)
        return (np.cumsum(here, axis=0) - here) * self.width[:, None]


def _pieces(outline: Any, edges_x: np.ndarray, edges_y: np.ndarray) -> _Pieces:
    start, end, sign = _directed_edges(outline)
    for axis, edges in ((1, edges_y), (0, edges_x)):
        start, end, sign = _cut_at(edges, axis, start, end, sign)
    middle = 0.5 * (start + end)
    i = np.clip(np.searchsorted(edges_x, middle[:, 0], "right") - 1, 0, len(edges_x) - 2)
    j = np.clip(np.searchsorted(edges_y, middle[:, 1], "right") - 1, 0, len(edges_y) - 2)
    centre = 0.5 * np.column_stack((edges_x[i] + edges_x[i + 1], edges_y[j] + edges_y[j + 1]))
    rise, half_width = sign * (end[:, 1] - start[:, 1]), 0.5 * (edges_x[i + 1] - edges_x[i])
    rows = len(edges_y) - 1
    return _Pieces(start - centre, end - centre, rise, half_width, i * rows + j, np.diff(edges_x), rows)


def _directed_edges(outline: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start and end (n, 2) of all edges, the interior on their right, and the sign +1 (n,) of their direction."""
    import shapely

    rings = shapely.get_rings(shapely.get_parts(shapely.normalize(outline)))  # normal form: shells clockwise, holes not
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    return points[:-1][same], points[1:][same], np.ones(int(same.sum()))


def _cut_at(
    edges: np.ndarray, axis: int, start: np.ndarray, end: np.ndarray, sign: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges cut at the lattice lines of one axis and reversed where needed to ascend; the sign of reversed edges changes."""
    turned = (start[:, axis] > end[:, axis])[:, None]
    low, high = np.where(turned, end, start), np.where(turned, start, end)
    first = np.searchsorted(edges, low[:, axis], "right")
    cuts = np.maximum(np.searchsorted(edges, high[:, axis], "left") - first, 0)
    whole = np.repeat(np.arange(len(cuts)), cuts + 1)
    piece = np.arange(len(whole)) - np.repeat(np.cumsum(cuts + 1) - cuts - 1, cuts + 1)
    line = np.append(edges, np.nan)[np.minimum(first[whole] + piece, len(edges))]  # the line above each piece
    low, high, top = low[whole], high[whole], piece == cuts[whole]
    with np.errstate(invalid="ignore", divide="ignore"):
        crossing = low + ((line - low[:, axis]) / (high[:, axis] - low[:, axis]))[:, None] * (high - low)
    crossing[:, axis] = line  # exactly on the line, so that neighbouring pieces meet
    upper = np.where(top[:, None], high, crossing)
    lower = np.where((piece == 0)[:, None], low, np.roll(upper, 1, axis=0))
    return lower, upper, (sign * np.where(turned[:, 0], -1.0, 1.0))[whole]


def regrid(thickness: np.ndarray, edges: tuple[np.ndarray, np.ndarray], to_edges: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Mean thickness [m] over the cells of another lattice, area-weighted: the volume on the common area is kept.

    ``thickness`` (nx, ny): mean thickness over the cells [m]. ``edges``, ``to_edges``: ascending edges ``(x, y)`` [m] of the
    lattice it lies on and of the one it goes to.
    """
    along_x = _regrid_rows(thickness, edges[0], to_edges[0])
    return np.ascontiguousarray(_regrid_rows(along_x.T, edges[1], to_edges[1]).T)


def _regrid_rows(values: np.ndarray, edges: np.ndarray, to_edges: np.ndarray) -> np.ndarray:
    result = np.zeros((len(to_edges) - 1, values.shape[1]))
    _, length, source, target = common_intervals(edges, to_edges)
    if len(target):
        starts = np.flatnonzero(np.diff(target, prepend=-1))
        result[target[starts]] = np.add.reduceat(values[source] * length[:, None], starts, axis=0)
    return result / np.diff(to_edges)[:, None]


def common_intervals(edges: np.ndarray, to_edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Intervals between the edges of both lattices where they overlap.

    Returns
    -------
    bounds : ndarray (m + 1,)
        Their ascending edges.
    length, source, target : ndarray (m,)
        Their lengths, and the cells of the first and of the second lattice that hold them.
    """
    near = SAME_EDGE * min(np.diff(edges).min(), np.diff(to_edges).min())
    nearest = to_edges[np.searchsorted(0.5 * (to_edges[1:] + to_edges[:-1]), edges)]
    edges = np.where(np.abs(nearest - edges) < near, nearest, edges)
    both = np.union1d(edges, to_edges)
    bounds = both[(both >= max(edges[0], to_edges[0])) & (both <= min(edges[-1], to_edges[-1]))]
    middle = 0.5 * (bounds[1:] + bounds[:-1])
    source = np.searchsorted(edges, middle, "right") - 1
    target = np.searchsorted(to_edges, middle, "right") - 1
    return bounds, np.diff(bounds), source, target


def regrid_within(
    outline: Any, thickness: np.ndarray, edges: tuple[np.ndarray, np.ndarray], to_edges: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """As :func:`regrid`, but the volume of each cell lies only on the part of it that the outline covers.

    A cell with thickness that the outline misses is spread over its whole area.
    """
    bounds_x, _, source_x, target_x = common_intervals(edges[0], to_edges[0])
    bounds_y, _, source_y, target_y = common_intervals(edges[1], to_edges[1])
    (clipped,) = within_extent(np.array([outline]), (bounds_x[0], bounds_y[0], bounds_x[-1], bounds_y[-1]))
    covered = covered_area(clipped, bounds_x, bounds_y)
    shape = thickness.shape
    cell_of, column_of = (source_x[:, None] * shape[1] + source_y), (target_x[:, None] * (len(to_edges[1]) - 1) + target_y)
    in_cell = np.bincount(cell_of.ravel(), covered.ravel(), thickness.size)
    missed = (in_cell == 0.0)[cell_of]
    covered[missed] = np.outer(np.diff(bounds_x), np.diff(bounds_y))[missed]
    in_cell = np.bincount(cell_of.ravel(), covered.ravel(), thickness.size)
    volume = (thickness * np.outer(np.diff(edges[0]), np.diff(edges[1]))).ravel()
    local = np.divide(volume, in_cell, out=np.zeros_like(volume), where=in_cell > 0)
    to_shape = (len(to_edges[0]) - 1, len(to_edges[1]) - 1)
    result = np.bincount(column_of.ravel(), (local[cell_of] * covered).ravel(), to_shape[0] * to_shape[1])
    return result.reshape(to_shape) / np.outer(np.diff(to_edges[0]), np.diff(to_edges[1]))


def within_extent(shapes: np.ndarray, extent: tuple[float, float, float, float]) -> np.ndarray:
    """Parts (n,) of polygons inside a rectangle.

    A general intersection sorts all edges: 20 s for a jagged outline of 200,000 points, where cutting at a rectangle takes 0.01 s.
    """
    import shapely

    cut = shapely.clip_by_rect(shapes, *extent)
    edges = shapely.bounds(shapes)
    whole = (edges[:, :2] >= extent[:2]).all(axis=1) & (edges[:, 2:] <= extent[2:]).all(axis=1)
    cut[whole] = shapes[whole]
    broken = ~whole
    broken[broken] = ~shapely.is_valid(cut[broken])
    cut[broken] = shapely.intersection(shapes[broken], shapely.box(*extent))
    return cut  # type: ignore[no-any-return]


def on_cells(parts: np.ndarray, values: np.ndarray, terrain: Terrain) -> tuple[np.ndarray, np.ndarray, list[tuple[Any, float]]]:
    """Share of each cell that polygons cover, their values times that share, and the parts on the terrain with their values.

    Parameters
    ----------
    parts : ndarray (n,) of shapely geometries
        In map coordinates, without overlap; what lies beyond the terrain is left out.
    values : ndarray (n,)

    Returns
    -------
    covered, weighted : ndarray (nx, ny)
        First index east, second north, from the south-west corner.
    parts_inside : list of (geometry, value)
    """
    import shapely

    inside = within_extent(parts, terrain.extent)
    parts_inside = [(part, float(value)) for part, value in zip(inside, values, strict=True) if part.area > 0]
    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    edges = np.arange(columns + 1) * dx, np.arange(rows + 1) * dy
    covered, weighted = np.zeros((columns, rows)), np.zeros((columns, rows))
    for value in sorted({value for _, value in parts_inside}):
        united = shapely.union_all([part for part, own in parts_inside if own == value])
        window, area = covered_window(shapely.transform(united, terrain.frame.to_local), edges)
        covered[window] += area / terrain.cell_area
        weighted[window] += value * area / terrain.cell_area
    return covered, weighted, parts_inside


def covered_part(shape: Any, terrain: Terrain) -> tuple[tuple[slice, slice], np.ndarray]:
    """Rows and columns around a polygon inside a terrain, and the area [m2] of each of these cells that it covers."""
    import shapely

    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    local = shapely.transform(shape, terrain.frame.to_local)
    (east, north), area = covered_window(local, (np.arange(columns + 1) * dx, np.arange(rows + 1) * dy))
    return (slice(rows - north.stop, rows - north.start), east), area.T[::-1]
