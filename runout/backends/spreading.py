"""Loops over the cells of a plan lattice and of the raster; the binding compiles them, in parallel over rows.

Rows are independent of each other and sums have one order, so that bits do not depend on threads. They hold no formula.
"""

from typing import Any

import numpy as np

from runout.physics.resolution import footprint_area, part_beyond

prange = range  # that of the compiler takes its place


def smooth(values: Any, lanes: int, width: int, half: Any, total: Any):
    """Add to ``total`` (rows, columns lanes) the means of ``values`` over squares of ``width`` cells; ``half`` is scratch.

    What lies beyond the rim counts as nothing.
    """
    rows, size = values.shape
    reach = width // 2
    for i in prange(rows):
        for j in range(size):
            half[i, j] = 0.0
        for k in range(max(i - reach, 0), min(i + reach + 1, rows)):
            for j in range(size):
                half[i, j] += values[k, j]
        for s in range(-reach, reach + 1):
            for j in range(max(0, -s * lanes), min(size, size - s * lanes)):
                total[i, j] += half[i, j + s * lanes] / (width * width)


def divide(sums: Any, around: Any, one: float, areas: Any, parts: Any):
    """Divide ``sums`` (rows, columns, 5) into ``parts`` (3, rows, columns, 5) of footprints of three ``areas`` [grid cells].

    ``around`` (rows, columns) is the mean volume over cells near each, ``one`` that of one particle a grid cell [m3].
    """
    for i in prange(sums.shape[0]):
        for j in range(sums.shape[1]):
            near = far = 0.0
            if around[i, j] > 0.0:
                area = footprint_area(around[i, j] / one)
                near = part_beyond(area, areas[0], areas[1])
                far = part_beyond(area, areas[1], areas[2])
            for k in range(5):
                parts[0, i, j, k] = (1.0 - near) * sums[i, j, k]
                parts[1, i, j, k] = (near - far) * sums[i, j, k]
                parts[2, i, j, k] = far * sums[i, j, k]


def share(sums: Any, row: Any, row_part: Any, column: Any, column_part: Any, shared: Any):
    """Bring ``sums`` (rows, columns, 5) of a lattice to the cells of a raster, ``shared`` (rows, columns, 5).

    ``row`` (rows,) is the first row of the lattice under each row of the raster and ``row_part`` (rows, n) its parts that lie in
    it; ``column`` and ``column_part`` likewise.
    """
    for i in prange(shared.shape[0]):
        across = np.zeros((sums.shape[1], 5))
        for a in range(row_part.shape[1]):
            part = row_part[i, a]
            if part > 0.0:
                for j in range(sums.shape[1]):
                    for k in range(5):
                        across[j, k] += part * sums[row[i] + a, j, k]
        for j in range(shared.shape[1]):
            for k in range(5):
                shared[i, j, k] = 0.0
            for a in range(column_part.shape[1]):
                part = column_part[j, a]
                if part > 0.0:
                    for k in range(5):
                        shared[i, j, k] += part * across[column[j] + a, k]
