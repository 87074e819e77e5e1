"""Grids of maps, maps brought to another grid by area, and outlines as shares of the cells of a grid."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ObservationError, ReleaseError
from runout.io.layer_crs import Points, ToTerrain, to_terrain
from runout.io.polygon_coverage import SAME_EDGE, on_cells, regrid
from runout.model.terrain import Terrain

if TYPE_CHECKING:
    import xarray as xr

KNOWN_SHARE = 0.5  # least share of a cell's area with known values
EDGE_POINTS = 33  # along each side of a map in another coordinate system
FEWEST, MOST = 4, 16  # sampling points along each side of a cell of another coordinate system


@dataclass(frozen=True)
class Grid:
    """Cells of a map, north up.

    Attributes
    ----------
    west, south : float
        Map coordinates of the outer south-west corner [m].
    cell_size : tuple of float
        Size of a cell east-west and north-south [m].
    shape : tuple of int
        Rows and columns.
    crs : str or None
        Coordinate reference system as WKT; None for a local one.
    source : str
        Where it comes from, for messages.

    Raises
    ------
    ObservationError
        If it has fewer than 3 x 3 cells, or a size is not positive and finite.
    """

    west: float
    south: float
    cell_size: tuple[float, float]
    shape: tuple[int, int]
    crs: str | None = None
    source: str = "map"

    def __post_init__(self) -> None:
        if min(self.shape) < 3 or not all(math.isfinite(v) for v in self.extent) or min(self.cell_size) <= 0:
            cells = f"{self.shape[0]} x {self.shape[1]} cells of {self.cell_size} m"
            raise ObservationError(f"{self.source}: has {cells}; 3 x 3 of a positive size are needed")

    @classmethod
    def of(cls, terrain: Terrain) -> "Grid":
        """Grid of a terrain."""
        return cls(terrain.west, terrain.south, terrain.cell_size, terrain.shape, terrain.crs, terrain.source)

    @classmethod
    def of_dataset(cls, dataset: "xr.Dataset", source: str) -> "Grid":
        """Grid of a dataset as runout writes it: cell centres ``x`` and ``y``, and ``crs`` unless it is local."""
        x, y = dataset["x"].values, dataset["y"].values
        dx, dy = (x[-1] - x[0]) / (x.size - 1), (y[0] - y[-1]) / (y.size - 1)
        crs = dataset["crs"].attrs["crs_wkt"] if "crs" in dataset.variables else None
        return cls(float(x[0] - dx / 2), float(y[-1] - dy / 2), (float(dx), float(dy)), (y.size, x.size), crs, source)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Outer edges ``(west, south, east, north)`` [m]."""
        (rows, columns), (dx, dy) = self.shape, self.cell_size
        return self.west, self.south, self.west + columns * dx, self.south + rows * dy

    @property
    def cell_area(self) -> float:
        """Plan area of a cell [m2]."""
        return self.cell_size[0] * self.cell_size[1]

    @property
    def easting(self) -> np.ndarray:
        """Easting of the cell centres (columns,) [m], ascending."""
        return self.west + (np.arange(self.shape[1]) + 0.5) * self.cell_size[0]

    @property
    def northing(self) -> np.ndarray:
        """Northing of the cell centres (rows,) [m], descending."""
        return self.south + (self.shape[0] - 0.5 - np.arange(self.shape[0])) * self.cell_size[1]

    def covering(self, extents: Iterable[tuple[float, float, float, float]]) -> "Grid":
        """The grid with whole cells more on each side, so that it holds all extents (west, south, east, north)."""
        (dx, dy), own = self.cell_size, self.extent
        boxes = np.array([own, *extents])
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        beyond = (*(own[:2] - low), *(high - own[2:]))
        more = [max(math.ceil(d / size - SAME_EDGE), 0) for d, size in zip(beyond, (dx, dy, dx, dy), strict=True)]
        shape = self.shape[0] + more[1] + more[3], self.shape[1] + more[0] + more[2]
        return Grid(self.west - more[0] * dx, self.south - more[1] * dy, self.cell_size, shape, self.crs, self.source)

    def terrain(self) -> Terrain:
        """Level ground on these cells, for readers that place files on a terrain."""
        return Terrain(np.zeros(self.shape), self.cell_size, self.west, self.south, self.crs, self.source)

    def same_cells(self, other: "Grid") -> bool:
        """Whether both have the same cells, within the digits of a file header."""
        near = SAME_EDGE * min(*self.cell_size, *other.cell_size)
        return self.shape == other.shape and bool(np.abs(np.subtract(self.extent, other.extent)).max() < near * max(self.shape))


def resampled(values: np.ndarray, grid: Grid, target: Grid) -> np.ndarray:
    """Mean by area of a map over the cells of another grid.

    Parameters
    ----------
    values : ndarray (rows, columns)
        Values on ``grid``, NaN where unknown.
    grid, target : Grid
        Grids that the values lie on and go to. Their coordinate systems may differ if a transformation is known; then each cell
        is the mean at 4 x 4 to 16 x 16 points.

    Returns
    -------
    ndarray (rows, columns)
        Mean over the known part of each cell; NaN where less than half of the cell is known. Sums over areas that are known
        completely are kept.

    Raises
    ------
    ObservationError
        If no transformation between the systems is known.
    """
    inverse = placed(grid, target).inverse
    if inverse is None and grid.same_cells(target):
        return np.array(values, np.float64)
    known = np.isfinite(values)
    layers = [np.where(known, values, 0.0), known.astype(np.float64)]
    if inverse is None:
        total, share = (_shared(layer, grid, target) for layer in layers)
    else:
        total, share = _looked_up(layers, grid, target, inverse)
    return np.divide(total, share, out=np.full(target.shape, np.nan), where=share >= KNOWN_SHARE - SAME_EDGE)


def placed(grid: Grid, target: Grid) -> ToTerrain:
    """Transformation of map coordinates of a grid to those of a target.

    Raises ObservationError if no transformation between the systems is known.
    """
    try:
        return to_terrain(Path(grid.source), grid.crs, target.terrain(), grid.extent, "gdalwarp")
    except ReleaseError as error:  # the readers of layers are those of a release, and so are their errors
        raise ObservationError(str(error)) from error


def common_grid(one: Grid, other: Grid) -> Grid:
    """Grid that covers two maps, in the system of the first: on the cells of the coarser one, or of the first if systems differ.

    Raises ObservationError if the maps do not overlap, or no transformation between their systems is known.
    """
    transformation = placed(other, one)
    bounds = other.extent if transformation.forward is None else _moved_bounds(other, transformation.forward)
    (w1, s1, e1, n1), (w2, s2, e2, n2) = one.extent, bounds
    if not (max(w1, w2) < min(e1, e2) and max(s1, s2) < min(n1, n2)):
        first, second = ([f"{edge:.10g}" for edge in box] for box in (one.extent, bounds))
        raise ObservationError(
            f"{one.source} and {other.source} do not overlap: [{', '.join(first)}] and [{', '.join(second)}] (west, south, east, "
            "north); check the coordinate systems of both"
        )
    coarser = other if transformation.forward is None and other.cell_area > one.cell_area * (1 + SAME_EDGE) else one
    return replace(coarser, crs=one.crs).covering([one.extent, bounds])


def _moved_bounds(grid: Grid, forward: Points) -> tuple[float, float, float, float]:
    """West, south, east and north of a grid in another system; edges are followed at points."""
    west, south, east, north = grid.extent
    x, y = np.linspace(west, east, EDGE_POINTS), np.linspace(south, north, EDGE_POINTS)
    rim = [(x, np.full_like(x, south)), (x, np.full_like(x, north)), (np.full_like(y, west), y), (np.full_like(y, east), y)]
    moved = forward(np.concatenate([np.column_stack(side) for side in rim]))
    if not np.isfinite(moved).all():
        raise ObservationError(f"{grid.source}: part of it has no place in the other system; cut it to the area under study")
    (low_x, low_y), (high_x, high_y) = moved.min(axis=0).tolist(), moved.max(axis=0).tolist()
    return low_x, low_y, high_x, high_y


def _shared(values: np.ndarray, grid: Grid, target: Grid) -> np.ndarray:
    """Mean by area of values (rows, columns); what lies outside the grid counts as 0."""
    edges = _edges(grid, 0.0, 0.0), _edges(target, target.west - grid.west, target.south - grid.south)
    shared = regrid(np.ascontiguousarray(values[::-1].T), *edges)
    return np.ascontiguousarray(shared.T[::-1])


def _edges(grid: Grid, west: float, south: float) -> tuple[np.ndarray, np.ndarray]:
    (rows, columns), (dx, dy) = grid.shape, grid.cell_size
    return west + np.arange(columns + 1) * dx, south + np.arange(rows + 1) * dy


def _looked_up(layers: list[np.ndarray], grid: Grid, target: Grid, there: Points) -> list[np.ndarray]:
    """Means of layers (rows, columns) at points all over the cells of a target in another system; 0 outside the grid."""
    count = int(np.clip(math.ceil(2.0 * math.sqrt(target.cell_area / grid.cell_area)), FEWEST, MOST))
    (dx, dy), sums = target.cell_size, [np.zeros(target.shape) for _ in layers]
    for u in (np.arange(count) + 0.5) / count - 0.5:
        for v in (np.arange(count) + 0.5) / count - 0.5:
            x, y = np.meshgrid(target.easting + u * dx, target.northing + v * dy)
            for total, value in zip(sums, _at(layers, grid, there(np.column_stack([x.ravel(), y.ravel()]))), strict=True):
                total += value.reshape(target.shape)
    return [total / count**2 for total in sums]


def _at(layers: list[np.ndarray], grid: Grid, points: np.ndarray) -> list[Any]:
    """Values of the cells that hold points (n, 2); 0 outside."""
    west, _, _, north = grid.extent
    column, row = (points[:, 0] - west) / grid.cell_size[0], (north - points[:, 1]) / grid.cell_size[1]
    inside = (row >= 0) & (column >= 0) & (row < grid.shape[0]) & (column < grid.shape[1])  # false where not finite
    i, j = (np.where(inside, place, 0).astype(np.int64) for place in (row, column))
    return [np.where(inside, layer[i, j], 0.0) for layer in layers]


def outline_shares(outline: Any, grid: Grid) -> np.ndarray:
    """Share (rows, columns) of each cell that an outline covers [1], exact; holes are outside.

    Parameters
    ----------
    outline : shapely Polygon or MultiPolygon
        In the map coordinates of the grid. What lies beyond the grid is left out: enlarge the grid first
        (:meth:`runout.scores.Grid.covering`).
    """
    covered, _, _ = on_cells(np.array([outline], dtype=object), np.ones(1), grid.terrain())
    return np.clip(np.ascontiguousarray(covered.T[::-1]), 0.0, 1.0)  # areas of parts may add up to more by rounding
