"""Points at which a flow was observed: values of a map there, and errors of arrival, thickness and speed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.scores.field_errors import differences
from runout.scores.grid import Grid

POINT_UNITS = {"arrival_time": "s", "thickness": "m", "speed": "m s-1"}


@dataclass(frozen=True)
class PointErrors:
    """Differences at points, modelled minus observed, in the unit of the quantity.

    Attributes
    ----------
    points : int
        Number of points that are scored.
    unknown : int
        Number of points without an observation, or outside the known part of the map.
    missed : int
        Number of points with an observed arrival that the modelled flow does not reach; they are not scored.
    bias, rmse, mean_absolute_error : float
        NaN if no point is scored. 0 is best.
    """

    points: int
    unknown: int
    missed: int
    bias: float
    rmse: float
    mean_absolute_error: float


def values_at(grid: Grid, values: np.ndarray, easting: Any, northing: Any) -> np.ndarray:
    """Values (n,) of the cells of a map (rows, columns) that hold points (n,) [m]; NaN outside of the map."""
    x, y = np.asarray(easting, np.float64), np.asarray(northing, np.float64)
    west, south, east, north = grid.extent
    column = np.floor((x - west) / grid.cell_size[0]).astype(np.int64)
    row = np.floor((north - y) / grid.cell_size[1]).astype(np.int64)
    inside = (x >= west) & (x < east) & (y > south) & (y <= north)
    rows, columns = grid.shape
    nearest = np.asarray(values, np.float64)[row.clip(0, rows - 1), column.clip(0, columns - 1)]
    return np.where(inside, nearest, np.nan)


def point_errors(modelled: Any, observed: Any) -> PointErrors:
    """Errors of a quantity at points (n,); NaN where unknown."""
    m, o = np.asarray(modelled, np.float64), np.asarray(observed, np.float64)
    known = np.isfinite(m) & np.isfinite(o)
    return PointErrors(int(known.sum()), int((~known).sum()), 0, *differences(m[known], o[known]))


def arrival_errors(modelled: Any, observed: Any) -> PointErrors:
    """Errors of the arrival time [s] at points (n,).

    Parameters
    ----------
    modelled : array_like (n,)
        Arrival of the flow; infinite where it never arrives, NaN where that is not known.
    observed : array_like (n,)
        Observed arrival, NaN where unknown.
    """
    m, o = np.asarray(modelled, np.float64), np.asarray(observed, np.float64)
    missed = np.isposinf(m) & np.isfinite(o)
    scored = point_errors(np.where(np.isposinf(m), math.nan, m), o)
    return PointErrors(
        scored.points, scored.unknown - int(missed.sum()), int(missed.sum()), scored.bias, scored.rmse, scored.mean_absolute_error
    )


def arrival_or_never(arrival: np.ndarray, thickness: np.ndarray) -> np.ndarray:
    """Arrival times with infinity in known cells that the flow never reaches, NaN in unknown cells.

    Maps of runout have no arrival in both; the thickness tells them apart.
    """
    return np.where(np.isnan(arrival) & np.isfinite(thickness), np.inf, arrival)


@dataclass(frozen=True)
class Gauges:
    """Points with observed values."""

    # easting, northing (n,): map coordinates [m]
    easting: np.ndarray
    northing: np.ndarray
    # ``arrival_time`` [s], ``thickness`` [m, vertical] and ``speed`` [m/s], as far as observed; NaN where unknown
    values: Mapping[str, np.ndarray]

    def label(self, index: int) -> str:
        """What was observed at a point, for maps."""
        known = {name: float(values[index]) for name, values in self.values.items() if np.isfinite(values[index])}
        return ", ".join(f"{value:.3g} {POINT_UNITS[name].replace('m s-1', 'm/s')}" for name, value in known.items())
