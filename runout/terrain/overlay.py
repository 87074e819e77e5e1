"""Polygons on the cells of a terrain: means by area."""

from typing import Any

import numpy as np

from runout.io.polygon_coverage import covered_window, within_extent
from runout.model.terrain import Terrain


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
