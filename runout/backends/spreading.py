"""Loops over the cells of a plan lattice and of the raster; the binding compiles them, in parallel over rows.

Rows are independent of each other and sums have one order, so that bits do not depend on threads. They hold no formula.
"""

from typing import Any

import numpy as np

from runout.physics.numerical_scales import covered_part, footprint_area, part_beyond

prange = range  # that of the compiler takes its place


def find_spans(volume: Any, margin: int, span: Any):
    """Find the columns ``span`` (rows, 2), first and one past the last, that lie within ``margin`` cells of any ``volume``."""
    rows, columns = volume.shape
    for i in prange(rows):
        first, last = columns, 0
        for k in range(max(i - margin, 0), min(i + margin + 1, rows)):
            for j in range(columns):
                if volume[k, j] != 0.0:
                    first, last = min(first, j), max(last, j + 1)
        span[i, 0] = max(min(first, last) - margin, 0)
        span[i, 1] = min(last + margin, columns)
        if last == 0:
            span[i, 1] = span[i, 0]


def smooth(values: Any, span: Any, lanes: int, width: int, total: Any):
    """Add to ``total`` (rows, columns lanes) the means of ``values`` over squares of ``width`` cells.

    What lies beyond the ``span`` of columns of a row counts as nothing.
    """
    rows, size = values.shape
    reach, share = width // 2, 1.0 / (width * width)
    for i in prange(rows):
        first, last = span[i, 0] * lanes, span[i, 1] * lanes
        if first < last:
            column = np.zeros(size)
            for k in range(max(i - reach, 0), min(i + reach + 1, rows)):
                for j in range(span[k, 0] * lanes, span[k, 1] * lanes):
                    column[j] += share * values[k, j]
            for s in range(-reach, reach + 1):
                for j in range(max(first, -s * lanes), min(last, size - s * lanes)):
                    total[i, j] += column[j + s * lanes]


def take(sums: Any, span: Any, around: Any, covered: Any, one: float, sharing: float, areas: Any, n: int, part: Any):
    """Take the ``part`` (rows, columns, lanes) of ``sums`` that gets footprints of the area ``areas[n]`` [grid cells].

    ``around`` (rows, columns) is the mean volume over cells near each, ``one`` that of one particle a grid cell [m3]; ``covered``
    the mean of the part that the flow covers over that area, on which alone the mass will lie.
    """
    for i in prange(sums.shape[0]):
        for j in range(span[i, 0], span[i, 1]):
            scale = 0.0
            if around[i, j] > 0.0:
                area = footprint_area(around[i, j] / one, sharing, areas[-1])
                scale = 1.0
                if n > 0:
                    scale = part_beyond(area, areas[n - 1], areas[n])
                if n + 1 < len(areas):
                    scale -= part_beyond(area, areas[n], areas[n + 1])
                if n > 0 and scale > 0.0:  # where no mass is, nothing may be covered
                    scale /= max(covered[i, j], 1e-300)
            for k in range(sums.shape[2]):
                part[i, j, k] = scale * sums[i, j, k]


def cover(volume: Any, span: Any, one: float, covered: Any):
    """Part of each cell that the flow covers, ``covered`` (rows, columns), from the ``volume`` of narrow footprints in it [m3]."""
    for i in prange(volume.shape[0]):
        for j in range(span[i, 0], span[i, 1]):
            covered[i, j] = covered_part(volume[i, j], one)


def confine(rest: Any, span: Any, covered: Any, total: Any):
    """Keep the part of ``total`` (rows, columns, lanes) in cells that the flow covers, and add the ``rest``."""
    for i in prange(total.shape[0]):
        for j in range(span[i, 0], span[i, 1]):
            for k in range(total.shape[2]):
                total[i, j, k] = covered[i, j] * total[i, j, k] + rest[i, j, k]


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
