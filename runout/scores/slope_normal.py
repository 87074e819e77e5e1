"""Thickness normal to the slope and vertical thickness."""

import math
from typing import Any

import numpy as np

from runout.errors import ObservationError
from runout.terrain.open_edge import continued
from runout.terrain.prepare import steepness


def vertical_thickness(normal: Any, slope: Any) -> Any:
    """Vertical thickness [m] of a layer with a thickness normal to the slope: h = d / cos(slope).

    Exact for a layer between parallel planes. Both keep the volume: d times the area of the slope is h times the plan area
    (Savage and Hutter 1989, J. Fluid Mech. 199:177; Fischer et al. 2012, Appl. Math. Modelling 36:2768).

    Parameters
    ----------
    normal : float or ndarray
        Thickness normal to the slope [m].
    slope : float or ndarray
        Slope of the terrain [rad], 0 to below pi / 2.

    Raises
    ------
    ObservationError
        If a slope is outside this range.
    """
    return np.asarray(normal, np.float64) / _cosine(slope)


def slope_normal_thickness(vertical: Any, slope: Any) -> Any:
    """Thickness normal to the slope [m] of a layer with a vertical thickness [m]: d = h cos(slope).

    The inverse of :func:`vertical_thickness`; parameters and errors as there.
    """
    return np.asarray(vertical, np.float64) * _cosine(slope)


def _cosine(slope: Any) -> np.ndarray:
    angle = np.asarray(slope, np.float64)
    wrong = (angle < 0.0) | (angle >= 0.5 * math.pi)
    if wrong.any():
        raise ObservationError(f"slope is {angle[wrong].flat[0]:g} rad; it must be 0 or more and below pi/2, in radians")
    return np.cos(angle)  # type: ignore[no-any-return]


def terrain_slope(elevation: np.ndarray, cell_size: tuple[float, float]) -> np.ndarray:
    """Slope of the ground (rows, columns) [rad] by central differences, one-sided beside unknown cells, NaN on them.

    Parameters
    ----------
    elevation : ndarray (rows, columns)
        Elevation of the cell centres [m], NaN where unknown.
    cell_size : tuple of float
        Size of a cell east-west and north-south [m].
    """
    ground = continued(elevation, cell_size, max(cell_size))
    return np.where(np.isnan(elevation), np.nan, np.arctan(steepness(ground, cell_size)))
