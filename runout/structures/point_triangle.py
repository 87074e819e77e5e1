"""The point of a triangle nearest to a point, for numba."""

import math
from typing import Any

from numba import njit

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
INSIDE, CORNER_A, CORNER_B, CORNER_C, EDGE_AB, EDGE_BC, EDGE_CA = range(7)  # parts of a triangle


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

    ``bound`` is a distance that one of them is nearer than, or inf.
    ``discs`` (n, 7) holds centre, radius and normal of a disc around each triangle.
    """
    best, row, part, foot = bound, -1, 0, p
    for n in range(count):
        f = chosen[n]
        away = minus(p, (discs[f, 0], discs[f, 1], discs[f, 2]))
        square, reach = dot(away, away), best + discs[f, 3]
        if square >= reach * reach:
            continue
        height = dot(away, (discs[f, 4], discs[f, 5], discs[f, 6]))
        beside = math.sqrt(max(square - height * height, 0.0)) - discs[f, 3]
        if beside > 0.0 and height * height + beside * beside >= best * best:
            continue
        point, region = nearest_point(p, corners, f)
        offset = minus(p, point)
        length = math.sqrt(dot(offset, offset))
        if length < best:
            best, row, part, foot = length, f, region, point
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
    kept = 0
    for n in range(count):
        f = among[n]
        away = minus(centre, (discs[f, 0], discs[f, 1], discs[f, 2]))
        if math.sqrt(dot(away, away)) - discs[f, 3] <= nearest + 2.0 * radius:
            chosen[kept] = f
            kept += 1
    return kept
