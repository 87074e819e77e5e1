"""Where the ground keeps the elevations of crests: on the cells that the masses may reach, within a bound of memory."""

import math
from dataclasses import dataclass

import numpy as np

from runout.terrain.prepare import below_energy_line

MARGIN = 4  # cells of the raster around what the masses may reach
LARGEST = 250_000  # cells in the window
LARGEST_TABLE = 2_000_000  # nodes in the window
FINE = 0.2  # cells of the raster: crests stand well enough on nodes that lie no farther apart without a table of their own

Box = tuple[tuple[int, int], tuple[int, int]]  # first cell and the one behind the last, east and north


@dataclass(frozen=True)
class Mass:
    """What is released.

    Attributes
    ----------
    thickness : ndarray (rows, columns)
        On the cells of the terrain [m].
    angle : float
        Smallest friction angle [rad] that acts on any ground, 0 for a fluid.
    """

    thickness: np.ndarray
    angle: float


def window(ground: np.ndarray, cell: tuple[float, float], box: Box, top: float, angle: float, most: float = math.inf) -> Box:
    """Cells around all that a mass can reach by the energy line, at most ``most``; see :func:`runout.terrain.prepare.reachable`.

    Where they are more, those nearest to the mass. Simpler than there: distances count from the box of the mass.

    Parameters
    ----------
    ground : ndarray (nx, ny)
        Elevation [m].
    cell : tuple of float
        Size of the cells, east and north [m].
    box : tuple
        Cells that hold the mass.
    top : float
        Its highest elevation [m].
    angle : float
        Smallest angle of the energy line [rad].
    """
    reach = _reached(ground, cell, box, top, angle)
    reach = _within(_grown(reach, MARGIN), ((0, ground.shape[0]), (0, ground.shape[1])))
    if _cells(reach) <= most:
        return reach
    low, high = -max(last - first for first, last in box), max(ground.shape)  # cells by which the box grows: fit, do not fit
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _cells(_within(_grown(box, middle), reach)) <= most else (low, middle)
    return _within(_grown(box, low), reach)


def most_cells(cell: tuple[float, float], spacing: tuple[float, float]) -> float:
    """Most cells [1] of a window, of ``cell`` [m] and on a grid of ``spacing`` [m]."""
    if not needs_table(cell, spacing):
        return LARGEST
    return min(LARGEST, LARGEST_TABLE * spacing[0] * spacing[1] / (cell[0] * cell[1]))


def needs_table(cell: tuple[float, float], spacing: tuple[float, float]) -> bool:
    """Whether crests need corrections on the nodes of a grid of ``spacing`` [m] over cells of ``cell`` [m]."""
    return any(h > FINE * size for h, size in zip(spacing, cell, strict=True))


def _reached(ground: np.ndarray, cell: tuple[float, float], box: Box, top: float, angle: float) -> Box:
    """Box of the cells below the energy line that hang together with the box of the mass."""
    aside = [
        size * np.maximum(np.maximum(first - np.arange(count), np.arange(count) - last + 1), 0)
        for (first, last), size, count in zip(box, cell, ground.shape, strict=True)
    ]
    start = np.zeros(ground.shape, bool)
    start[tuple(slice(*sides) for sides in box)] = True
    distance = np.add.outer(aside[0] ** 2, aside[1] ** 2)
    reach = below_energy_line(ground, start, np.sqrt(distance, out=distance), top, angle, cell)
    cells = [np.flatnonzero(reach.any(axis=axis)) for axis in (1, 0)]
    return (int(cells[0][0]), int(cells[0][-1]) + 1), (int(cells[1][0]), int(cells[1][-1]) + 1)


def _grown(box: Box, by: int) -> Box:
    (west, east), (south, north) = box
    return (west - by, east + by), (south - by, north + by)


def _within(box: Box, limits: Box) -> Box:
    """The part of a box in another one; empty boxes have no cells."""
    sides = []
    for (first, last), (low, high) in zip(box, limits, strict=True):
        start = min(max(first, low), high)
        sides.append((start, max(start, min(last, high))))
    return sides[0], sides[1]


def _cells(box: Box) -> int:
    return math.prod(last - first for first, last in box)
