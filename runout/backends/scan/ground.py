"""The ground under each block: spline coefficients on its nodes, computed once when the index is made.

The surface is the same spline on the nodes for all backends.

    tiles[b]     6 x 6 nodes of block b, south to north within west to east:  coefficient above the lowest node [cells]
    planes[b]    4 x 4 columns of cells, in the same order:                   value | slope east | slope north, of a plane above
    bounds[b]    highest point of these planes | least vertical component of the normal
"""

import math

import numpy as np
from numba import prange

from runout.backends.lanes import local_array
from runout.physics.bed import chance_at, sunk
from runout.physics.bspline import first_node, weights
from runout.physics.heightfield import (
    bend_smoothness,
    distance,
    interpolate,
    normal_z,
    resampled_coefficient,
    surface_at,
    upward_normal,
)
from runout.physics.tensors import real

BELOW, ABOVE = 12, 14  # places of the blocks below and above among the neighbours
local_elevations = local_array((36,))


def _kind_at(x, y, size, kind):
    """Kind of ground at a place [m], from the cells of the raster; beyond the rim that of the rim."""
    i = min(max(np.int64(math.floor(x / size[0])), 0), kind.shape[0] - 1)
    j = min(max(np.int64(math.floor(y / size[1])), 0), kind.shape[1] - 1)
    return np.int64(kind[i, j])


def _sample(coefficients, qx, qy):
    """Elevation [m] at lattice position (qx, qy) and its slopes by qx and qy [m]."""
    i = min(max(first_node(qx), 0), coefficients.shape[0] - 3)
    j = min(max(first_node(qy), 0), coefficients.shape[1] - 3)
    a, b, c = coefficients[i], coefficients[i + 1], coefficients[i + 2]
    nine = (a[j], a[j + 1], a[j + 2], b[j], b[j + 1], b[j + 2], c[j], c[j + 1], c[j + 2])
    return surface_at(nine, qx - i, qy - j)


def _along_north(coefficients, qx, qy, ay):
    """Coefficient along the north axis from samples ``ay`` apart, and the slope along the east axis."""
    farther = _sample(coefficients, qx, qy - ay - ay)
    south = _sample(coefficients, qx, qy - ay)
    here = _sample(coefficients, qx, qy)
    north = _sample(coefficients, qx, qy + ay)
    smooth = bend_smoothness(farther[2], south[2], here[2], north[2], _sample(coefficients, qx, qy + ay + ay)[2])
    return resampled_coefficient(south[0], here[0], north[0], smooth), here[1]


def _node_coefficient(coefficients, ox, oy, sx, sy, x, y, dx, dy):
    """Coefficient at a node of the spline on the nodes that follows the surface, from samples half a cell apart."""
    qx = (x - ox) / sx
    qy = (y - oy) / sy
    ax = real(0.5) * dx / sx
    ay = real(0.5) * dy / sy
    farther = _sample(coefficients, qx - ax - ax, qy)
    west = _along_north(coefficients, qx - ax, qy, ay)
    here = _along_north(coefficients, qx, qy, ay)
    east = _along_north(coefficients, qx + ax, qy, ay)
    smooth = bend_smoothness(farther[1], west[1], here[1], east[1], _sample(coefficients, qx + ax + ax, qy)[1])
    return resampled_coefficient(west[0], here[0], east[0], smooth)


def _change_at(change, i, j):
    """What a node's coefficient has more [m]: a place of the table ``change``, nothing beyond it."""
    if i < 0 or j < 0 or i >= change.shape[0] or j >= change.shape[1]:
        return real(0.0)
    return change[i, j]


def _bound_column(tile, o, plane, a):
    """Note a plane value + slopes . f that no point of a column's surface exceeds; returns its highest point in the column.

    The slopes are those at the middle. A spline lies below a plane by no less than all its coefficients do.
    """
    w = weights(real(1.0))
    west = interpolate(w, tile[o], tile[o + 1], tile[o + 2])
    east = interpolate(w, tile[o + 12], tile[o + 13], tile[o + 14])
    south = interpolate(w, tile[o], tile[o + 6], tile[o + 12])
    north = interpolate(w, tile[o + 2], tile[o + 8], tile[o + 14])
    sx = (east - west) * real(0.5)
    sy = (north - south) * real(0.5)
    top = tile[o]
    for i in range(3):
        for j in range(3):
            top = max(top, tile[o + 6 * i + j] - i * sx - j * sy)
    plane[a] = top
    plane[a + 1] = sx
    plane[a + 2] = sy
    return top + sx + sy + real(0.5) * (abs(sx) + abs(sy))


def _least_normal_z(tile, h):
    """Bound of the normal's vertical component over a block: slopes do not exceed the differences of coefficients."""
    sx = real(0.0)
    sy = real(0.0)
    for i in range(6):
        for j in range(6):
            if i > 0:
                sx = max(sx, abs(tile[6 * i + j] - tile[6 * i + j - 6]))
            if j > 0:
                sy = max(sy, abs(tile[6 * i + j] - tile[6 * i + j - 1]))
    return normal_z(real(sx * h[2] / h[0]), real(sy * h[2] / h[1]))


def _joined(around, bxyz, b, q):
    """The block above or below, q, on the same column of the ground; -1 where none is, or the far end of a period."""
    n = around[b, q]
    return n if n >= 0 and bxyz[n, 2] == bxyz[b, 2] + q - 13 else -1


def _cut_tile(elevation, floor, h, tile, plane, bound):
    """Tile, planes and bounds of a block from the elevations [m] at its nodes; ``floor`` is the level of the lowest [cells]."""
    for k in range(36):
        tile[k] = real(elevation[k] / h[2] - floor)
    top = real(-1.0e30)
    for c in range(16):
        top = max(top, _bound_column(tile, (c >> 2) * 6 + (c & 3), plane, 3 * c))
    bound[0] = top
    bound[1] = _least_normal_z(tile, h)


def cut_tiles(coefficients, origin, size, change, first, blocks, corner, h, ground):
    """Compute the ``ground`` of all blocks: coefficients on the nodes of each block, and bounds.

    The surface, a spline with ``coefficients`` on a lattice with ``origin`` (2,) and cells of ``size`` (2,) [m], is sampled at the
    nodes in float64, so that float32 keeps the gap of a particle to 1e-7 cells. ``change`` [m] is added to the nodes from ``first``
    on. Blocks are counted from the node ``corner``. Blocks one above the other take the same elevations.
    """
    tiles, planes, bounds, bxyz, around = ground.tiles, ground.planes, ground.bounds, blocks.bxyz, blocks.around
    ox, oy = origin
    sx, sy = size
    for b in prange(blocks.nown):
        if _joined(around, bxyz, b, BELOW) >= 0:
            continue
        elevation = local_elevations(h)
        for i in range(6):
            for j in range(6):
                m = corner[0] + 4 * bxyz[b, 0] + i
                n = corner[1] + 4 * bxyz[b, 1] + j
                e = _node_coefficient(coefficients, ox, oy, sx, sy, m * h[0], n * h[1], h[0], h[1])
                elevation[i * 6 + j] = e + _change_at(change, m - first[0], n - first[1])
        block = np.int64(b)
        while block >= 0:
            _cut_tile(elevation, corner[2] + 4 * bxyz[block, 2], h, tiles[block], planes[block], bounds[block])
            block = _joined(around, bxyz, block, ABOVE)


def _nine_of(table, i, j):
    """Places of a table (nx, ny) around the node (i + 1, j + 1), nothing beyond it."""
    return (
        _change_at(table, i, j), _change_at(table, i, j + 1), _change_at(table, i, j + 2),
        _change_at(table, i + 1, j), _change_at(table, i + 1, j + 1), _change_at(table, i + 1, j + 2),
        _change_at(table, i + 2, j), _change_at(table, i + 2, j + 1), _change_at(table, i + 2, j + 2),
    )  # fmt: skip


def sink(particles, blocks, corner, h, column, first, turn):
    """Let particles above nodes from ``first`` on sink as their ground falls (:func:`runout.physics.bed.sunk`), each in its cell.

    ``column`` (2, nx, ny) [m]: by how much the ground falls, and its coefficients before. Velocities stay the same: the record
    holds the momentum at the middle of the cell.
    """
    rec, order, starts, bxyz = particles.rec, particles.order, blocks.starts, blocks.bxyz
    falls, ground = column[0], column[1]
    for b in prange(blocks.nown):
        m = corner[0] + 4 * bxyz[b, 0] - first[0]
        n = corner[1] + 4 * bxyz[b, 1] - first[1]
        if m <= -6 or n <= -6 or m >= falls.shape[0] or n >= falls.shape[1]:
            continue
        for c in range(64):
            i = m + (c >> 4)
            j = n + ((c >> 2) & 3)
            nine, floor = _nine_of(falls, i, j), _nine_of(ground, i, j)
            level = np.float64(corner[2] + 4 * bxyz[b, 2] + (c & 3))
            for t in range(starts[b, c], starts[b, c + 1]):
                p = order[blocks.first[b] + t]
                fx, fy, fz = np.float64(rec[p, 4]), np.float64(rec[p, 8]), np.float64(rec[p, 12])
                base = surface_at(floor, fx, fy)
                of_its_own = particles.particle_index[p] if len(particles.radius) > 1 else 0
                touching = np.float64(particles.radius[of_its_own]) / normal_z(base[1] / h[0], base[2] / h[1])
                chance = chance_at(np.float64(i + first[0]) + fx, np.float64(j + first[1]) + fy, turn)
                way = sunk((level + fz) * h[2] - base[0], surface_at(nine, fx, fy)[0], touching, chance)
                lower = real(max(fz - way / h[2], 0.5))
                moved = rec[p, 12] - lower
                for k in range(3):
                    rec[p, 1 + k] += moved * rec[p, 13 + k]
                rec[p, 12] = lower


def _ground(a, fx, fy, z, radius, east, north, dz):
    """Unit normal and gap [m] of a particle at height ``z`` [cells] in a block; east, north = dz/dx, dz/dy."""
    e = surface_at(a, fx, fy)
    n = upward_normal(e[1] * east, e[2] * north)
    return n[0], n[1], n[2], distance((z - e[0]) * dz, n[2]) - radius
