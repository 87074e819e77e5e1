"""Columns of the flow on a GPU: footprints of the mass as in :mod:`runout.backends.footprints`, a thread for each cell.

A thread reads the square around its cell. On a CPU :mod:`runout.backends.spreading` does the same with sums along rows and across
them. Only sums over a square have another order here, so that columns of the two agree to rounding.

    windows   first cell, columns and rows of the window of each scene (scenes, 3); -1, 0, 0 without one
    units     numbers of each scene (scenes, 15): whole numbers for a unit of volume [1/m3], mass [1/kg] and momentum
              [1/(kg m/s)], volume in a cell where one particle stands over a grid cell [m3]; of the extent, then of the thickness,
              how many particles share a place and the areas of the footprints (3); a grid cell in cells of the lattice, and the
              first cell of the window, east and north
    raster    whole numbers (5 cells,): volume, mass, momentum (3)
    values    the same in SI (5, cells): volume, momentum (3), mass
    parts     of the volume that spread over one, 3 x 3 and 5 x 5 cells (3, cells); with them the part that flows (cells,)
    covered   part of each cell that the flow covers (1, cells)
    scales    what each cell gives to footprints of 3 x 3, 5 x 5 and 9 x 9 cells (3, cells), in place of the parts
    spread    the values over their footprints, and the part of the volume that flows (6 cells,)

The cells of all windows lie one behind the other, each window row by row from the south.
"""

from __future__ import annotations

import warp as wp

from runout.backends.hash.layout import Doubles, Doubles2, Longs, Table2
from runout.physics.numerical_scales import covered_part as covered_part64
from runout.physics.numerical_scales import depth_count as depth_count64
from runout.physics.numerical_scales import depth_scales as depth_scales64
from runout.physics.numerical_scales import extent_count as extent_count64
from runout.physics.numerical_scales import extent_parts as extent_parts64
from runout.physics.numerical_scales import flowing_part as flowing_part64

LANES = 5  # volume, momentum (3), mass
NUMBERS = 15  # of a scene


def _square(values: Doubles2, lane: int, begin: int, columns: int, rows: int, c: int, reach: int):
    """Sum over the square around a cell of a window; nothing lies beyond."""
    total = wp.float64(0.0)
    i = c / columns
    j = c - i * columns
    for a in range(wp.max(i - reach, 0), wp.min(i + reach + 1, rows)):
        for b in range(wp.max(j - reach, 0), wp.min(j + reach + 1, columns)):
            total += values[lane, begin + a * columns + b]
    return total


def _scaled_square(values: Doubles2, lane: int, scales: Doubles2, s: int, window: Table2, w: int, c: int, reach: int):
    """Sum over the square around a cell of a window, of what each cell gives to a footprint."""
    total = wp.float64(0.0)
    begin = window[w, 0]
    columns = window[w, 1]
    i = c / columns
    j = c - i * columns
    for a in range(wp.max(i - reach, 0), wp.min(i + reach + 1, window[w, 2])):
        for b in range(wp.max(j - reach, 0), wp.min(j + reach + 1, columns)):
            k = begin + a * columns + b
            total += scales[s, k] * values[lane, k]
    return total


def scale_columns(windows: Table2, units: Doubles2, raster: Longs, values: Doubles2):
    """Sums of whole numbers (cells, 5) to ``values`` (5, cells). Rows of ``windows``: first cell, columns, rows."""
    w, c = wp.tid()
    if c >= windows[w, 1] * windows[w, 2]:
        return
    k = windows[w, 0] + c
    values[0, k] = wp.float64(raster[5 * k]) / units[w, 0]
    values[4, k] = wp.float64(raster[5 * k + 1]) / units[w, 1]
    for d in range(3):
        values[1 + d, k] = wp.float64(raster[5 * k + 2 + d]) / units[w, 2]


def find_flowing(windows: Table2, units: Doubles2, values: Doubles2, parts: Doubles2, flowing: Doubles):
    """Parts of the volume of each cell that spread over one, 3 x 3 and 5 x 5 cells to find the extent; the part that flows."""
    w, c = wp.tid()
    if c >= windows[w, 1] * windows[w, 2]:
        return
    k = windows[w, 0] + c
    around = _square(values, 0, windows[w, 0], windows[w, 1], windows[w, 2], c, 2)
    count = extent_count64(around, units[w, 3])
    flowing[k] = flowing_part64(count, units[w, 4])
    each = extent_parts64(values[0, k], count, units[w, 4], units[w, 5], units[w, 6], units[w, 7])
    for s in range(3):
        parts[s, k] = each[s]


def find_covered(windows: Table2, units: Doubles2, parts: Doubles2, covered: Doubles2):
    """Part of each cell that the flow covers."""
    w, c = wp.tid()
    if c >= windows[w, 1] * windows[w, 2]:
        return
    begin = windows[w, 0]
    columns = windows[w, 1]
    rows = windows[w, 2]
    three = _square(parts, 1, begin, columns, rows, c, 1)
    five = _square(parts, 2, begin, columns, rows, c, 2)
    covered[0, begin + c] = covered_part64(parts[0, begin + c] + three + five, units[w, 3])


def find_scales(windows: Table2, units: Doubles2, values: Doubles2, covered: Doubles2, scales: Doubles2):
    """Parts of the mass of each cell that get footprints of 3 x 3, 5 x 5 and 9 x 9 cells, over the covered part of these."""
    w, c = wp.tid()
    if c >= windows[w, 1] * windows[w, 2]:
        return
    begin = windows[w, 0]
    columns = windows[w, 1]
    rows = windows[w, 2]
    k = begin + c
    for s in range(3):
        scales[s, k] = wp.float64(0.0)
    if values[0, k] <= wp.float64(0.0):
        return  # there is no mass to spread
    count = depth_count64(_square(values, 0, begin, columns, rows, c, 4), units[w, 3])
    three = _square(covered, 0, begin, columns, rows, c, 1)
    five = _square(covered, 0, begin, columns, rows, c, 2)
    nine = _square(covered, 0, begin, columns, rows, c, 4)
    each = depth_scales64(count, units[w, 8], units[w, 9], units[w, 10], units[w, 11], three, five, nine)
    for s in range(3):
        scales[s, k] = each[s]


def spread_columns(
    windows: Table2, values: Doubles2, covered: Doubles2, scales: Doubles2, flowing: Doubles, lanes: int, spread: Doubles
):  # fmt: skip
    """Spread each lane within the covered part of each cell; a last lane has the part of the volume that flows.

    ``spread`` has the lanes of a window one behind the other.
    """
    w, c = wp.tid()
    cells = windows[w, 1] * windows[w, 2]
    if c >= cells:
        return
    k = windows[w, 0] + c
    begin = (lanes + 1) * windows[w, 0] + c
    inside = covered[0, k]
    for lane in range(lanes + 1):
        spread[begin + lane * cells] = wp.float64(0.0)
    if inside > wp.float64(0.0):
        for lane in range(lanes):
            three = _scaled_square(values, lane, scales, 0, windows, w, c, 1)
            five = _scaled_square(values, lane, scales, 1, windows, w, c, 2)
            nine = _scaled_square(values, lane, scales, 2, windows, w, c, 4)
            spread[begin + lane * cells] = inside * (three + five + nine)
        spread[begin + lanes * cells] = flowing[k] * spread[begin]
