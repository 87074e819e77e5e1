"""Loops over the cells of a plan lattice and of the raster; the binding compiles them, in parallel over bands of rows.

Bands are independent of each other and sums have one order, so that bits do not depend on threads. They hold no formula.

Footprints are boxes of one grid cell smoothed over squares of 1, 3, 5 and 9 cells. A mean over a square is a sum along the row and
one across the rows, over all cells of a band in one loop: the band is stored row behind row, with :data:`MARGIN` empty columns, so
that a sum which passes the end of a row finds nothing there. Each loop leaves out as many cells at both ends of the band as it
reads beyond.
"""

from typing import Any

import numpy as np

from runout.backends.column_peaks import raise_peaks
from runout.backends.column_shares import least_share
from runout.physics.flow_columns import column_speed, time_of_passing
from runout.physics.numerical_scales import covered_part, depth_count, depth_scales, extent_count, extent_parts, flowing_part

prange = range  # that of the compiler takes its place
BAND = 64  # rows of the lattice that a thread spreads at once
HALO = 13  # rows around a band that its footprints depend on: 4 of mass, 4 of the covered part, 4 of the extent, and one
REACH = 4  # cells that a mass spreads at most
MARGIN = 6  # empty columns on either side of a band, so that no footprint reaches from one row into the next


def _three(x: Any, step: Any, first: Any, last: Any, y: Any):
    """Sums of three cells, ``step`` apart, from the cell ``first`` to ``last``."""
    for j in range(first, last):
        y[j] = x[j - step] + x[j] + x[j + step]


def _five(x: Any, step: Any, first: Any, last: Any, y: Any):
    """Sums of five cells."""
    two = step + step
    for j in range(first, last):
        y[j] = (x[j - two] + x[j - step]) + x[j] + (x[j + step] + x[j + two])


def _three_parts(x: Any, scale: Any, first: Any, last: Any, y: Any):
    """Sums of the parts ``scale`` of three cells in a row."""
    by = np.uint64(1)
    for j in range(first, last):
        y[j] = scale[j - by] * x[j - by] + scale[j] * x[j] + scale[j + by] * x[j + by]


def _five_parts(x: Any, scale: Any, first: Any, last: Any, y: Any):
    """Sums of the parts ``scale`` of five cells in a row."""
    by, two = np.uint64(1), np.uint64(2)
    for j in range(first, last):
        outer, inner = scale[j - two] * x[j - two] + scale[j - by] * x[j - by], scale[j] * x[j]
        y[j] = outer + inner + (scale[j + by] * x[j + by] + scale[j + two] * x[j + two])


def _columns_with_mass(volume: Any, south: int, north: int):
    """First column with any ``volume`` between two rows, and one past the last."""
    first, last = volume.shape[1], 0
    for i in range(max(south, 0), min(north, volume.shape[0])):
        for j in range(first):
            if volume[i, j] != 0.0:
                first = j
                break
        for j in range(volume.shape[1], last, -1):
            if volume[i, j - 1] != 0.0:
                last = j
                break
    return first, last


def _fill(values: Any, south: int, west: int, columns: int, band: Any):
    """Copy the part of ``values`` (rows, columns) from a row and column on to a band with so many columns; nothing beyond."""
    rows = len(band) // columns
    for i in range(rows):
        k = south + i
        for j in range(columns):
            band[i * columns + j] = 0.0
        if 0 <= k < values.shape[0]:
            for j in range(max(0, -west), min(columns, values.shape[1] - west)):
                band[i * columns + j] = values[k, west + j]


def find_extent(v: Any, one: float, sharing: float, areas: Any, columns: int, work: Any, covered: Any, flowing: Any):
    """Part of each cell of a band that its volume ``v`` covers over narrow footprints, and part of that which flows.

    ``work`` holds five bands.
    """
    m, n = np.uint64(columns), np.uint64(len(v))
    row, around, narrow, wide = work[0], work[1], work[2], work[3]
    a = np.uint64(2)
    _five(v, np.uint64(1), a, n - a, row)
    a += np.uint64(2) * m
    _five(row, m, a, n - a, around)
    for j in range(a, n - a):
        count = extent_count(around[j], one)
        flowing[j] = flowing_part(count, sharing)
        around[j], narrow[j], wide[j] = extent_parts(v[j], count, sharing, areas[0], areas[1], areas[2])
    a += np.uint64(2)
    _three(narrow, np.uint64(1), a, n - a, row)
    _five(wide, np.uint64(1), a, n - a, narrow)
    a += np.uint64(2) * m
    two = m + m
    for j in range(a, n - a):
        three = row[j - m] + row[j] + row[j + m]
        five = (narrow[j - two] + narrow[j - m]) + narrow[j] + (narrow[j + m] + narrow[j + two])
        covered[j] = covered_part(around[j] + three + five, one)


def find_scales(v: Any, one: float, sharing: float, areas: Any, columns: int, covered: Any, work: Any, scales: Any):
    """Parts of the mass of each cell of a band that get each of three footprints, over the covered part of these (3, cells)."""
    m, n, by = np.uint64(columns), np.uint64(len(v)), np.uint64(1)
    row, around, three, five, nine = work[0], work[1], work[2], work[3], work[4]
    a = np.uint64(4)
    _three(v, by, a - np.uint64(3), n - a + np.uint64(3), row)
    _three(row, np.uint64(3), a, n - a, five)
    _three(five, m, a + m, n - a - m, around)  # of columns: nine in a row, three across
    a += np.uint64(4) * m
    _three(covered, by, a + by, n - a - by, three)
    _five(covered, by, a + by + by, n - a - by - by, five)
    a += np.uint64(4)
    _three(three, np.uint64(3), a, n - a, row)
    _three(row, m, a + m, n - a - m, nine)
    a += np.uint64(4) * m
    above, two = np.uint64(3) * m, m + m
    for j in range(a, n - a):
        count = depth_count(around[j - above] + around[j] + around[j + above], one)
        in_three = three[j - m] + three[j] + three[j + m]
        in_five = (five[j - two] + five[j - m]) + five[j] + (five[j + m] + five[j + two])
        in_nine = nine[j - above] + nine[j] + nine[j + above]
        each = depth_scales(count, sharing, areas[0], areas[1], areas[2], in_three, in_five, in_nine)
        scales[0, j], scales[1, j], scales[2, j] = each


def smooth_band(x: Any, scales: Any, columns: int, covered: Any, work: Any, total: Any):
    """Sums ``x`` of a band over the footprints that the ``scales`` (3, cells) tell, within the covered part of each cell."""
    m, n, by = np.uint64(columns), np.uint64(len(x)), np.uint64(1)
    part, three, five, nine, row = work[0], work[1], work[2], work[3], work[4]
    o, two, above = np.uint64(8) * m + np.uint64(8), m + m, np.uint64(3) * m
    a = o + np.uint64(4)
    _three_parts(x, scales[0], a, n - a, three)
    _five_parts(x, scales[1], a, n - a, five)
    _three_parts(x, scales[2], o + by, n - o - by, row)
    _three(row, np.uint64(3), a, n - a, part)
    _three(part, m, a + m, n - a - m, nine)
    a += np.uint64(4) * m
    for j in range(a, n - a):
        in_three = three[j - m] + three[j] + three[j + m]
        in_five = (five[j - two] + five[j - m]) + five[j] + (five[j + m] + five[j + two])
        in_nine = nine[j - above] + nine[j] + nine[j + above]
        total[j] = covered[j] * (in_three + in_five + in_nine)


def spread_band(sums: Any, one: float, sharing: Any, areas: Any, first: int, spread: Any):
    """Write the rows of a band, from ``first`` on, of ``spread`` (lanes + 1, rows, columns): see :func:`spread_bands`."""
    lanes, rows, columns = sums.shape
    end = min(first + BAND, rows)
    low, high = _columns_with_mass(sums[0], first - HALO, end + HALO)
    spread[:, first:end] = 0.0
    if low >= high:
        return
    west, m, n = low - MARGIN, high - low + 2 * MARGIN, end - first + 2 * HALO
    x, covered, total = np.empty(n * m), np.empty(n * m), np.empty(n * m)
    flowing, work, scales = np.empty(n * m), np.empty((5, n * m)), np.empty((3, n * m))
    _fill(sums[0], first - HALO, west, m, x)
    find_extent(x, one, sharing[0], areas[0], m, work, covered, flowing)
    find_scales(x, one, sharing[1], areas[1], m, covered, work, scales)
    for k in range(lanes):
        if k > 0:
            _fill(sums[k], first - HALO, west, m, x)
        smooth_band(x, scales, m, covered, work, total)
        for i in range(first, end):
            for j in range(max(low - REACH, 0), min(high + REACH, columns)):
                at = (i - first + HALO) * m + j - west
                spread[k, i, j] = total[at]
                if k == 0:
                    spread[lanes, i, j] = flowing[at] * total[at]


def spread_bands(sums: Any, one: float, sharing: Any, areas: Any, spread: Any):
    """Bring ``sums`` (lanes, rows, columns) on a lattice to ``spread``, each mass over the footprint that the volume around needs.

    The first lane is volume, ``one`` that of a particle a cell [m3]; ``spread`` has one more lane, the part of it that flows.
    ``sharing`` (2,) particles share each place of the extent and of the thickness; ``areas`` (2, 3) are those of the footprints
    [grid cells].
    """
    for band in prange((sums.shape[1] + BAND - 1) // BAND):
        spread_band(sums, one, sharing, areas, BAND * band, spread)


def _of_cell(cells: Any, lane: int, density: float, row: int, column: int):
    """A lane of a cell of the lattice, 0 beyond it; the last is the mass, which may follow from the volume."""
    if row < 0 or column < 0 or row >= cells.shape[1] or column >= cells.shape[2]:
        return 0.0
    return cells[lane, row, column] if lane < cells.shape[0] else density * cells[0, row, column]


def sum_around_nodes(cells: Any, west: int, south: int, density: float, nodes: Any):
    """Bring ``cells`` (lanes, rows, columns) to ``nodes`` (5, nx, ny), each of which has the two cells on either side of it.

    The first cell is number ``west`` and ``south`` of the lattice, whose cell 0 lies north-east of node 0. Without a lane of mass
    all have one ``density`` [kg/m3].
    """
    for i in prange(nodes.shape[1]):
        a = 2 * (i + (west + 1) // 2) - 1 - west
        for lane in range(nodes.shape[0]):
            for j in range(nodes.shape[2]):
                b = 2 * (j + (south + 1) // 2) - 1 - south
                below = _of_cell(cells, lane, density, b, a) + _of_cell(cells, lane, density, b, a + 1)
                above = _of_cell(cells, lane, density, b + 1, a), _of_cell(cells, lane, density, b + 1, a + 1)
                nodes[lane, i, j] = below + above[0] + above[1]


def share(sums: Any, row: Any, row_part: Any, column: Any, column_part: Any, shared: Any):
    """Bring ``sums`` (lanes, rows, columns) of a lattice to the cells of a raster, ``shared`` (lanes, rows, columns).

    ``row`` (rows,) is the first row of the lattice under each row of the raster and ``row_part`` (rows, n) its parts that lie in
    it; ``column`` and ``column_part`` likewise. Unsigned places let the longest loop, along the lattice, run in vector lanes.
    """
    count, parts, one = np.uint64(sums.shape[2]), column_part.shape[1], np.uint64(1)
    for i in prange(shared.shape[1]):
        across = np.empty(sums.shape[2] + 2 * parts)
        for lane in range(sums.shape[0]):
            across[:] = 0.0  # nothing beyond the ends
            for a in range(row_part.shape[1]):
                part = row_part[i, a]
                if part > 0.0:
                    here, begin = np.uint64(row[i] + a), np.uint64(parts)
                    for j in range(count):
                        across[begin + j] += part * sums[np.uint64(lane), here, j]
            for j in range(shared.shape[2]):
                at = np.uint64(parts + column[j])
                total = 0.0
                for a in range(parts):
                    total += column_part[j, a] * across[at]
                    at += one
                shared[lane, i, j] = total


def take_peaks(
    volume: Any, flowing: Any, mass: Any, momentum: Any, corner: Any, area: float, threshold: float, times: Any, thickness: Any,
    peaks: Any, arrival: Any, limits: Any, shares: Any,
):  # fmt: skip
    """Raise the ``peaks`` (quantities, rows, columns) to those of a window of columns, from ``corner`` on; thickness is the first.

    ``thickness`` (rows, columns) is that of the look before, and becomes that of this one; ``times`` (2,) are those of both. Peaks
    are those of the ``flowing`` volume. Cells of ``area`` [m2] count from a ``threshold`` [m] on, and get the time of ``arrival``
    at which the thickness passed it. ``shares`` (conditions, rows, columns) are raised to those of the thresholds ``limits``.
    """
    for i in prange(volume.shape[0]):
        r = corner[0] + i
        for j in range(volume.shape[1]):
            c = corner[1] + j
            before, depth = thickness[r, c], flowing[i, j] / area
            thickness[r, c] = volume[i, j] / area
            if depth > peaks[0, r, c]:
                peaks[0, r, c] = depth
            if depth >= threshold and depth > 0.0:
                speed = column_speed(mass[i, j], momentum[0, i, j], momentum[1, i, j], momentum[2, i, j])
                density = mass[i, j] / volume[i, j]
                raise_peaks(peaks, r, c, depth, speed, density)
                for k in range(limits.shape[0]):
                    shares[k, r, c] = max(shares[k, r, c], least_share(limits, k, depth, speed, density))
                if np.isnan(arrival[r, c]):
                    arrival[r, c] = time_of_passing(threshold, min(before, threshold), depth, times[0], times[1])
