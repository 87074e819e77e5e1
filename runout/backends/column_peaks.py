"""Chain of calls that raises the peaks of a cell, one link for each quantity of :mod:`runout.quantities`.

Compiled code cannot loop over functions; each link holds one formula and the next link.
"""

from typing import Any

PLACE = 0  # of the peak that a link raises, among the peaks


def formula(depth: Any, speed: Any, density: Any):
    """Quantity of a column; each link has that of its own place."""
    return depth


def others(peaks: Any, row: int, column: int, depth: float, speed: float, density: float):
    """End of the chain; each link has the next one."""


def raise_peaks(peaks: Any, row: int, column: int, depth: float, speed: float, density: float):
    """Raise the ``peaks`` (quantities, rows, columns) of a cell to those of a column of ``depth`` [m] and ``density`` [kg/m3]."""
    peaks[PLACE, row, column] = max(peaks[PLACE, row, column], formula(depth, speed, density))
    others(peaks, row, column, depth, speed, density)
