"""Nearest triangles and sides of the nodes of lattice blocks, for numba; the kernels release the lock of Python.

Numba's cache stamps only the file of a kernel, so all functions that a kernel calls are in this file.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from runout.model.structures import CELLS

HALF = CELLS // 2  # cells along a quarter of a face of a block, whose nodes share a list of triangles
NODES = CELLS + 1
NEXT = 1.000001
OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
INSIDE, CORNER_A, CORNER_B, CORNER_C, EDGE_AB, EDGE_BC, EDGE_CA = range(7)  # parts of a triangle
ALIKE = 1e-9  # part by which two distances differ by rounding


@njit(**OPTIONS)
def dot(u, v):
    """Scalar product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(**OPTIONS)
def minus(u, v):
    """Difference of two points."""
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


@njit(**OPTIONS)
def along(a, u, s, v, t):
    """The point a + s u + t v."""
    return a[0] + s * u[0] + t * v[0], a[1] + s * u[1] + t * v[1], a[2] + s * u[2] + t * v[2]


@njit(**OPTIONS)
def corner(corners, f, k):
    """Corner k of triangle f."""
    return corners[f, k, 0], corners[f, k, 1], corners[f, k, 2]


@njit(**OPTIONS)
def nearest_point(p, corners, f):
    """Point of triangle f of ``corners`` (n, 3, 3) nearest to p, and its part.

    After Ericson (2005), Real-Time Collision Detection, section 5.1.5.
    """
    a = corner(corners, f, 0)
    ab, ac, ap = minus(corner(corners, f, 1), a), minus(corner(corners, f, 2), a), minus(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return a, CORNER_A
    bp = minus(ap, ab)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return along(a, ab, 1.0, ac, 0.0), CORNER_B
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return along(a, ab, d1 / (d1 - d3), ac, 0.0), EDGE_AB
    cp = minus(ap, ac)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return along(a, ab, 0.0, ac, 1.0), CORNER_C
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return along(a, ab, 0.0, ac, d2 / (d2 - d6)), EDGE_CA
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return along(a, ab, 1.0 - w, ac, w), EDGE_BC
    scale = 1.0 / (va + vb + vc)
    return along(a, ab, vb * scale, ac, vc * scale), INSIDE


@njit(**OPTIONS)
def nearest_triangle(p, corners, discs, chosen, count, bound):
    """Of the first ``count`` ``chosen`` triangles the one nearest to p: its distance, row, part, and nearest point.

    Of those that are equally near, because they meet at an edge or a corner, it is the one that faces p most: p is farthest from
    its plane. ``bound`` is a distance that one of them is nearer than, or inf.
    ``discs`` (n, 7) holds centre, radius and normal of a disc around each triangle.
    """
    best, row, part, foot, facing = bound, -1, 0, p, 0.0
    for n in range(count):
        f = chosen[n]
        away = minus(p, (discs[f, 0], discs[f, 1], discs[f, 2]))
        farthest = best * (1.0 + ALIKE)
        square, reach = dot(away, away), farthest + discs[f, 3]
        if square >= reach * reach:
            continue
        height = dot(away, (discs[f, 4], discs[f, 5], discs[f, 6]))
        beside = math.sqrt(max(square - height * height, 0.0)) - discs[f, 3]
        if beside > 0.0 and height * height + beside * beside >= farthest * farthest:
            continue
        point, region = nearest_point(p, corners, f)
        offset = minus(p, point)
        length = math.sqrt(dot(offset, offset))
        alike = row >= 0 and abs(length - best) <= ALIKE * best
        if (alike and abs(height) > facing * (1.0 + ALIKE)) or (not alike and length < best):
            best, row, part, foot, facing = length, f, region, point, abs(height)
    return best, row, part, foot


@njit(**OPTIONS)
def near_enough(centre, radius, discs, among, count, chosen):
    """Write to ``chosen`` the triangles ``among`` some that may be nearest to a point of a ball; their number.

    For a point of the ball the nearest triangle is no further from the centre than the nearest to the centre plus the diameter.
    """
    nearest = math.inf
    for n in range(count):
        f = among[n]
        away = minus(centre, (discs[f, 0], discs[f, 1], discs[f, 2]))
        nearest = min(nearest, math.sqrt(dot(away, away)) + discs[f, 3])
    near_count = 0
    for n in range(count):
        f = among[n]
        away = minus(centre, (discs[f, 0], discs[f, 1], discs[f, 2]))
        if math.sqrt(dot(away, away)) - discs[f, 3] <= nearest + 2.0 * radius:
            chosen[near_count] = f
            near_count += 1
    return near_count


@njit(**OPTIONS)
def nearest_in_blocks(groups, low, spacing, corners, discs, distance, index, foot):
    """Fill distance [m], row and nearest point of the nearest triangle for the nodes of blocks.

    Parameters
    ----------
    groups : ndarray (g, 2) of int
        First block, and the one after the last, of neighbours that share a list of triangles.
    low : ndarray (n, 3)
        First node of each block [m].
    spacing : float
        Of the lattice [m].
    corners, discs : ndarray (t, 3, 3), (t, 7)
        Of the triangles, see :func:`runout.structures.solid.discs_around`.
    distance, index, foot : ndarray (n, 9, 9, 9), the last (n, 9, 9, 9, 3)
        To fill.
    """
    all_of_them = np.arange(len(corners))
    lists = np.empty((3, len(corners)), np.int64)
    edge = CELLS * spacing
    for g in range(len(groups)):
        first, last = groups[g]
        centre, radius = _ball(low, first, last, edge)
        in_group = near_enough(centre, radius, discs, all_of_them, len(corners), lists[0])
        for b in range(first, last):
            centre, radius = _ball(low, b, b + 1, edge)
            in_block = near_enough(centre, radius, discs, lists[0], in_group, lists[1])
            for part in range(8):
                _fill_part(b, part, low, spacing, corners, discs, lists, in_block, distance, index, foot)


@njit(**OPTIONS)
def _ball(low, first, last, edge):
    """Centre and radius of a ball around blocks."""
    least, most = (math.inf, math.inf, math.inf), (-math.inf, -math.inf, -math.inf)
    for b in range(first, last):
        x, y, z = low[b, 0], low[b, 1], low[b, 2]
        least = min(least[0], x), min(least[1], y), min(least[2], z)
        most = max(most[0], x + edge), max(most[1], y + edge), max(most[2], z + edge)
    size = minus(most, least)
    return (least[0] + 0.5 * size[0], least[1] + 0.5 * size[1], least[2] + 0.5 * size[2]), 0.5 * math.sqrt(dot(size, size))


@njit(**OPTIONS)
def _fill_part(b, part, low, spacing, corners, discs, lists, in_block, distance, index, foot):
    """An eighth of a block."""
    i0, j0, k0 = (part >> 2) * HALF, (part >> 1 & 1) * HALF, (part & 1) * HALF
    half = 0.5 * HALF * spacing
    centre = low[b, 0] + i0 * spacing + half, low[b, 1] + j0 * spacing + half, low[b, 2] + k0 * spacing + half
    count = near_enough(centre, half * math.sqrt(3.0), discs, lists[1], in_block, lists[2])
    for i in range(i0, i0 + HALF + 1):
        for j in range(j0, j0 + HALF + 1):
            bound = math.inf
            for k in range(k0, k0 + HALF + 1):
                p = low[b, 0] + i * spacing, low[b, 1] + j * spacing, low[b, 2] + k * spacing
                nearest_one = nearest_triangle(p, corners, discs, lists[2], count, bound)
                distance[b, i, j, k], index[b, i, j, k] = nearest_one[0], nearest_one[1]
                for axis in range(3):
                    foot[b, i, j, k, axis] = nearest_one[3][axis]
                bound = nearest_one[0] + NEXT * spacing  # the distance changes by no more than the step


@njit(**OPTIONS)
def mark_inside(blocks, low, spacing, body, distance, gap, inside):
    """Set ``inside`` (n, 9, 9, 9) at the nodes of ``blocks`` that lie in a closed body.

    So do nodes within a ``gap`` [m] of the body and three times as far from every surface: they lie between bodies that touch.
    ``body`` holds corners (t, 3, 3), discs (t, 7), normals (t, 7, 3) of :func:`runout.structures.solid.pseudo_normals`, and the box
    around it (2, 3), by ``gap`` larger.
    """
    corners, discs, normals, box = body
    all_of_them = np.arange(len(corners))
    chosen = np.empty(len(corners), np.int64)
    for b in blocks:
        centre, radius = _ball(low, b, b + 1, CELLS * spacing)
        count = near_enough(centre, radius, discs, all_of_them, len(corners), chosen)
        for i in range(NODES):
            for j in range(NODES):
                for k in range(NODES):
                    p = low[b, 0] + i * spacing, low[b, 1] + j * spacing, low[b, 2] + k * spacing
                    if _within(p, box) and not inside[b, i, j, k]:
                        away = signed_distance(p, corners, discs, normals, chosen, count)
                        inside[b, i, j, k] = away < 0.0 or (away <= gap and distance[b, i, j, k] > 3.0 * gap)


@njit(**OPTIONS)
def _within(p, box):
    """Whether a point lies in a box."""
    east, north = box[0, 0] <= p[0] <= box[1, 0], box[0, 1] <= p[1] <= box[1, 1]
    return east and north and box[0, 2] <= p[2] <= box[1, 2]


@njit(**OPTIONS)
def signed_distance(p, corners, discs, normals, chosen, count):
    """Distance [m] of a point from a closed body, negative inside, by the normal of the part of it that is nearest."""
    away, row, part, foot = nearest_triangle(p, corners, discs, chosen, count, math.inf)
    side = dot(minus(p, foot), (normals[row, part, 0], normals[row, part, 1], normals[row, part, 2]))
    return -away if side < 0.0 else away


@njit(**OPTIONS)
def points_inside(points, body):
    """Whether each of some points (n, 3) lies in a closed body (n,), which is given as for :func:`mark_inside`."""
    corners, discs, normals, box = body
    inside = np.zeros(len(points), np.bool_)
    all_of_them = np.arange(len(corners))
    for n in range(len(points)):
        p = points[n, 0], points[n, 1], points[n, 2]
        if _within(p, box):
            inside[n] = signed_distance(p, corners, discs, normals, all_of_them, len(corners)) < 0.0
    return inside
