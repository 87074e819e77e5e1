"""Particles to grid and back.

Record of a particle (16 numbers, one cache line in float32), sorted by cell; f is the offset from the cell's first node:

    [ m, m vx, m vy, m vz | fx, A column 0 | fy, A column 1 | fz, A column 2 ]

with A = h_j (m C - dt 4/h_j^2 V0 tau), so that the momentum at node x is m v + A (x - f) with x in cells
(Hu et al. 2018, ACM TOG 37:150, eq. 18). An arena holds the 6 x 6 x 6 nodes that the particles of one block reach, four
numbers a node.
"""

from numba import prange

from runout.physics.bspline import weights
from runout.physics.tensors import real

ROW = 24  # numbers per row of six nodes
PLANE = 144
ARENA = 864


def _first_node(c):
    """Place in the arena of the first node of cell ``c`` of a block."""
    return (c >> 4) * PLANE + ((c >> 2) & 3) * ROW + (c & 3) * 4


def _scatter(rec, p, arena, o):
    """Add mass and momentum of a particle to its 27 nodes, the first at place ``o``."""
    m = rec[p, 0]
    fx = rec[p, 4]
    fy = rec[p, 8]
    fz = rec[p, 12]
    wx = weights(fx)
    wy = weights(fy)
    wz = weights(fz)
    q0 = rec[p, 1] - fx * rec[p, 5] - fy * rec[p, 9] - fz * rec[p, 13]
    q1 = rec[p, 2] - fx * rec[p, 6] - fy * rec[p, 10] - fz * rec[p, 14]
    q2 = rec[p, 3] - fx * rec[p, 7] - fy * rec[p, 11] - fz * rec[p, 15]
    for i in range(3):
        for j in range(3):
            wij = wx[i] * wy[j]
            r0 = q0 + real(i) * rec[p, 5] + real(j) * rec[p, 9]
            r1 = q1 + real(i) * rec[p, 6] + real(j) * rec[p, 10]
            r2 = q2 + real(i) * rec[p, 7] + real(j) * rec[p, 11]
            a = o + i * PLANE + j * ROW
            for k in range(3):
                w = wij * wz[k]
                arena[a + 4 * k] += w * m
                arena[a + 4 * k + 1] += w * (r0 + real(k) * rec[p, 13])
                arena[a + 4 * k + 2] += w * (r1 + real(k) * rec[p, 14])
                arena[a + 4 * k + 3] += w * (r2 + real(k) * rec[p, 15])


def particles_to_arenas(rec, cstart, nown, arenas):
    """Each block adds its particles to its own arena."""
    for b in prange(nown):
        if cstart[b * 64] == cstart[b * 64 + 64]:
            continue
        arena = arenas[b]
        for t in range(ARENA):
            arena[t] = real(0.0)
        for c in range(64):
            o = _first_node(c)
            for p in range(cstart[b * 64 + c], cstart[b * 64 + c + 1]):
                _scatter(rec, p, arena, o)


def _load_arena(grid, up, b, arena):
    """Nodes of the up to eight node blocks that the particles of block ``b`` reach."""
    for x in range(6):
        for y in range(6):
            for z in range(6):
                s = up[b, ((x >> 2) << 2) | ((y >> 2) << 1) | (z >> 2)]
                n = ((x & 3) << 4) | ((y & 3) << 2) | (z & 3)
                a = x * PLANE + y * ROW + z * 4
                for d in range(4):
                    arena[a + d] = grid[s, n, d]


def _gather(rec, p, arena, o):
    """Velocity and its first moments B_ij = sum w v_i (x_j - f_j) [m/s cells] from the 27 nodes at place ``o``."""
    fx = rec[p, 4]
    fy = rec[p, 8]
    fz = rec[p, 12]
    wx = weights(fx)
    wy = weights(fy)
    wz = weights(fz)
    z = real(0.0)
    v0 = v1 = v2 = z
    x0 = x1 = x2 = z
    y0 = y1 = y2 = z
    z0 = z1 = z2 = z
    for i in range(3):
        for j in range(3):
            wij = wx[i] * wy[j]
            a = o + i * PLANE + j * ROW
            s0 = s1 = s2 = z
            for k in range(3):
                w = wij * wz[k]
                u0 = w * arena[a + 4 * k + 1]
                u1 = w * arena[a + 4 * k + 2]
                u2 = w * arena[a + 4 * k + 3]
                s0 += u0
                s1 += u1
                s2 += u2
                z0 += (real(k) - fz) * u0
                z1 += (real(k) - fz) * u1
                z2 += (real(k) - fz) * u2
            v0 += s0
            v1 += s1
            v2 += s2
            x0 += (real(i) - fx) * s0
            x1 += (real(i) - fx) * s1
            x2 += (real(i) - fx) * s2
            y0 += (real(j) - fy) * s0
            y1 += (real(j) - fy) * s1
            y2 += (real(j) - fy) * s2
    return v0, v1, v2, x0, x1, x2, y0, y1, y2, z0, z1, z2
