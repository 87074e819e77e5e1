"""Polygons on the cells of a terrain: numbers that they carry, and means by area."""

from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.model.terrain import Terrain
from runout.release.coverage import covered_window
from runout.release.polygons import PolygonLayer


def numbers_of(layer: PolygonLayer, given: Any, name: str, bounds: tuple[float, float], unit: str) -> np.ndarray:
    """Numbers (n,) of the polygons of a layer: one for all, or those of an attribute.

    Raises
    ------
    ReleaseError
        If an attribute is missing or no number, or a number lies outside ``bounds``; names the polygon.
    """
    values = layer.numbers(given, name) if isinstance(given, str) else np.full(len(layer.polygons), given, np.float64)
    wrong = np.flatnonzero(~((values >= bounds[0]) & (values <= bounds[1])))
    if len(wrong):
        allowed = f"it must be {bounds[0]:g} to {bounds[1]:g}{unit}"
        raise ReleaseError(f"{layer.source}: {name} of polygon {wrong[0] + 1} is {values[wrong[0]]:g}; {allowed}")
    return values


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
    kept : list of (geometry, value)
    """
    import shapely

    inside = shapely.intersection(parts, shapely.box(*terrain.extent))
    kept = [(part, float(value)) for part, value in zip(inside, values, strict=True) if part.area > 0]
    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    edges = np.arange(columns + 1) * dx, np.arange(rows + 1) * dy
    covered, weighted = np.zeros((columns, rows)), np.zeros((columns, rows))
    for value in sorted({value for _, value in kept}):
        united = shapely.union_all([part for part, own in kept if own == value])
        window, area = covered_window(shapely.transform(united, terrain.frame.to_local), edges)
        covered[window] += area / terrain.cell_area
        weighted[window] += value * area / terrain.cell_area
    return covered, weighted, kept
