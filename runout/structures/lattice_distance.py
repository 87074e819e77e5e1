"""Nearest triangles and sides of the nodes of lattice blocks, for numba; the kernels release the lock of Python."""

import math

import numpy as np
from numba import njit

from runout.model.structures import CELLS
from runout.structures.point_triangle import OPTIONS, dot, minus, near_enough, nearest_triangle

HALF = CELLS // 2  # cells along a quarter of a face of a block, whose nodes share a list of triangles
NODES = CELLS + 1
NEXT = 1.000001


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
                found = nearest_triangle(p, corners, discs, lists[2], count, bound)
                distance[b, i, j, k], index[b, i, j, k] = found[0], found[1]
                for axis in range(3):
                    foot[b, i, j, k, axis] = found[3][axis]
                bound = found[0] + NEXT * spacing  # the distance changes by no more than the step


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
