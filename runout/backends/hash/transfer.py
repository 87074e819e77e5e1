"""Particles to grid and back.

Rows of the particle matrix, one column a particle; f is the offset from the cell's first node [cells]:

    0 m | 1-3 m v | 4-6 f | 7-15 A, column by column | 16-21 B = b_e - I | 22 history | 23 stress-free volume | 24 radius

with A = h_j (m C - dt 4/h_j^2 V0 tau), so that the momentum at node x is m v + A (x - f) with x in cells
(Hu et al. 2018, ACM TOG 37:150, eq. 18). A tile holds the 6 x 6 x 6 nodes that the particles of one block reach.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.index import HALT, ORDERED, Flags, Ints, Nodes, Rows, Table2, Tile, Vectors
from runout.physics.bspline import weights
from runout.physics.tensors import real, vec

MASS, MOMENTUM, OFFSET, AFFINE, STRAIN, HISTORY, VOLUME, RADIUS, ROWS = 0, 1, 4, 7, 16, 22, 23, 24, 25
TILE = 216
PADDED = 256  # trips of a loop that every lane of a block runs alike


# vectors of the compiler that the binding puts in their place: four numbers of a node, and of 27 nodes
node4: Any = None
sums4: Any = None


def _first_node(c: int):
    """Place in the tile of the first node of cell ``c`` of a block."""
    return (c >> 4) * 36 + ((c >> 2) & 3) * 6 + (c & 3)


def _node(up: Table2, b: int, t: int):
    """Place in the grid of node ``t`` of a block's tile."""
    x = t // 36
    y = (t // 6) % 6
    z = t % 6
    return up[b, ((x >> 2) << 2) | ((y >> 2) << 1) | (z >> 2)] * 64 + (((x & 3) << 4) | ((y & 3) << 2) | (z & 3))


def _arms(f: Any):
    """Distances [cells] of the three nodes of an axis from a particle."""
    return vec(-f, real(1.0) - f, real(2.0) - f)


def particles_to_grid(rec: Rows, order: Ints, cstart: Table2, up: Table2, flags: Flags, grid: Nodes, arenas: Nodes):
    """Mass and momentum of the particles to the nodes; in fixed order, each block only fills its own arena."""
    b, lane = wp.tid()
    if flags[HALT] != 0 or cstart[b, 0] == cstart[b, 64]:
        return
    tile = wp.tile_zeros(shape=TILE, dtype=node4, storage="shared")
    for c in range(lane, 64, wp.block_dim()):
        acc = sums4()
        for t in range(cstart[b, c], cstart[b, c + 1]):
            p = order[t]
            m = rec[MASS, p]
            fx = rec[OFFSET, p]
            fy = rec[OFFSET + 1, p]
            fz = rec[OFFSET + 2, p]
            wx = weights(fx)
            wy = weights(fy)
            wz = weights(fz)
            ax = vec(rec[AFFINE, p], rec[AFFINE + 1, p], rec[AFFINE + 2, p])
            ay = vec(rec[AFFINE + 3, p], rec[AFFINE + 4, p], rec[AFFINE + 5, p])
            az = vec(rec[AFFINE + 6, p], rec[AFFINE + 7, p], rec[AFFINE + 8, p])
            q = vec(rec[MOMENTUM, p], rec[MOMENTUM + 1, p], rec[MOMENTUM + 2, p])
            dx = _arms(fx)
            dy = _arms(fy)
            dz = _arms(fz)
            for i in range(3):
                for j in range(3):
                    wij = wx[i] * wy[j]
                    r = q + dx[i] * ax + dy[j] * ay
                    for k in range(3):
                        w = wij * wz[k]
                        s = r + dz[k] * az
                        acc[(i * 3 + j) * 3 + k, 0] += w * m
                        acc[(i * 3 + j) * 3 + k, 1] += w * s[0]
                        acc[(i * 3 + j) * 3 + k, 2] += w * s[1]
                        acc[(i * 3 + j) * 3 + k, 3] += w * s[2]
        first = _first_node(c)
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    n = (i * 3 + j) * 3 + k
                    wp.tile_scatter_add(
                        tile, first + (i * 6 + j) * 6 + k, node4(acc[n, 0], acc[n, 1], acc[n, 2], acc[n, 3]), True, False
                    )
    for t in range(lane, TILE, wp.block_dim()):
        g = tile[t]
        if ORDERED:
            arenas[b * TILE + t] = g
        elif g[0] != real(0.0):
            wp.atomic_add(grid, _node(up, b, t), g)


def _load(tile: Tile, grid: Nodes, pushes: Vectors, pushed: int, up: Table2, b: int, lane: int):
    """Nodes that the particles of a block reach, with what the impulses of the ground (if ``pushed``) add to velocity."""
    for q in range(PADDED // wp.block_dim()):
        t = q * wp.block_dim() + lane
        g = node4()
        if t < TILE:
            n = _node(up, b, t)
            g = grid[n]
            if pushed != 0 and g[0] > real(0.0):
                push = pushes[n]
                g = node4(g[0], g[1] + push[0] / g[0], g[2] + push[1] / g[0], g[3] + push[2] / g[0])
        wp.tile_scatter_add(tile, t, g, t < TILE, False)


def _gather(rec: Rows, p: int, tile: Tile, first: int):
    """Velocity and its first moments sum w v (x_j - f_j) [m/s cells] along each axis from the 27 nodes at place ``first``."""
    fx = rec[OFFSET, p]
    fy = rec[OFFSET + 1, p]
    fz = rec[OFFSET + 2, p]
    wx = weights(fx)
    wy = weights(fy)
    wz = weights(fz)
    dx = _arms(fx)
    dy = _arms(fy)
    dz = _arms(fz)
    v = vec(real(0.0), real(0.0), real(0.0))
    x = vec(real(0.0), real(0.0), real(0.0))
    y = vec(real(0.0), real(0.0), real(0.0))
    z = vec(real(0.0), real(0.0), real(0.0))
    for i in range(3):
        for j in range(3):
            wij = wx[i] * wy[j]
            s = vec(real(0.0), real(0.0), real(0.0))
            for k in range(3):
                g = tile[first + (i * 6 + j) * 6 + k]
                w = wij * wz[k]
                u = vec(w * g[1], w * g[2], w * g[3])
                s += u
                z += dz[k] * u
            v += s
            x += dx[i] * s
            y += dy[j] * s
    return v, x, y, z
