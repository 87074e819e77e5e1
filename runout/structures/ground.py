"""Elevation of the ground at and around structures."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.model.terrain import Terrain


def elevation_at(terrain: Terrain, points: np.ndarray) -> np.ndarray:
    """Elevation [m] of the ground, linear between the centres of cells, at local positions (..., 2 or 3) [m].

    NaN beyond the raster and beside cells without elevation.
    """
    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    x, y = points[..., 0] / dx, points[..., 1] / dy
    outside = (x < 0) | (x > columns) | (y < 0) | (y > rows)
    return np.where(outside, np.nan, terrain.elevation_at(points))


@dataclass(frozen=True)
class GroundUnder:
    """Lowest, mean and highest elevation [m] of the ground under a footprint; NaN where a part of it is unknown."""

    lowest: float
    mean: float
    highest: float


def ground_under(footprint: Any, terrain: Terrain) -> GroundUnder:
    """The ground under a footprint (shapely, local positions), at a lattice of points in it and along its outline."""
    import shapely

    step = min(terrain.cell_size) / 2
    west, south, east, north = footprint.bounds
    axes = [low + (np.arange(max(1, round((high - low) / step))) + 0.5) * (high - low) / max(1, round((high - low) / step))
            for low, high in ((west, east), (south, north))]  # fmt: skip
    x, y = (one.ravel() for one in np.meshgrid(*axes))
    within = shapely.contains_xy(footprint, x, y)
    inner = np.column_stack([x[within], y[within]])
    outline = shapely.get_coordinates(shapely.segmentize(footprint.boundary, step))
    z_inner, z_outline = elevation_at(terrain, inner), elevation_at(terrain, outline)
    both = np.concatenate([z_inner, z_outline])
    mean = z_inner.mean() if len(z_inner) else z_outline.mean()
    return GroundUnder(float(both.min()), float(mean), float(both.max()))
