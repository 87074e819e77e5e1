"""Ground under a scarp between the cell centres, and means over cells."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from runout.terrain.fill import filled

if TYPE_CHECKING:
    from runout.model.terrain import Terrain

POINTS = 8  # along each side of a cell, at which the thickness is averaged
Points = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # thickness [m] at easting, northing, ground [m]


def ground_at(terrain: "Terrain", x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Elevation [m] at points by bilinear interpolation between cell centres; constant beyond the outermost ones."""
    from scipy import ndimage

    column, row = (x - terrain.easting[0]) / terrain.cell_size[0], (terrain.northing[0] - y) / terrain.cell_size[1]
    z = filled(terrain.elevation, terrain.cell_size)
    return ndimage.map_coordinates(z, [row, column], order=1, mode="nearest")  # type: ignore[no-any-return]


def fitted_plane(terrain: "Terrain", centre: tuple[float, float], radius: float) -> tuple[np.ndarray, float]:
    """Gradient to the east and north, and elevation at the centre [m], of the least-squares plane of the ground in a circle."""
    around = np.linspace(-radius, radius, 41)
    dx, dy = (axis.ravel() for axis in np.meshgrid(around, around))
    inside = np.hypot(dx, dy) <= radius
    dx, dy = dx[inside], dy[inside]
    ground = ground_at(terrain, centre[0] + dx, centre[1] + dy)
    fitted, *_ = np.linalg.lstsq(np.column_stack([dx, dy, np.ones_like(dx)]), ground, rcond=None)
    return fitted[:2], float(fitted[2])


def mean_thickness(terrain: "Terrain", thickness: Points, cells: np.ndarray, points: int = POINTS) -> np.ndarray:
    """Mean thickness (rows, columns) [m] over the cells of a mask, from ``points`` x ``points`` within each."""
    from scipy import ndimage

    rows, columns = np.nonzero(cells)
    offsets = (np.arange(points) + 0.5) / points - 0.5
    total = np.zeros(len(rows))
    z, (dx, dy) = filled(terrain.elevation, terrain.cell_size), terrain.cell_size
    for v in offsets:
        for u in offsets:
            x, y = terrain.easting[columns] + u * dx, terrain.northing[rows] + v * dy
            total += thickness(x, y, ndimage.map_coordinates(z, [rows - v, columns + u], order=1, mode="nearest"))
    values = np.zeros(terrain.shape)
    values[rows, columns] = total / points**2
    return values
