"""Outlines as shares of the cells of a grid."""

from typing import Any

import numpy as np

from runout.scores.grid import Grid
from runout.terrain.overlay import on_cells


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
