"""Nodes: sums of the arenas, momentum to velocity, and the impulses of the ground."""

from numba import prange

from runout.backends.scan.transfer import ARENA, PLANE, ROW, _first_node
from runout.physics.bspline import first_node, weight_slopes, weights
from runout.physics.contact import impulse, in_contact, work
from runout.physics.heightfield import distance, interpolate, normal_z, quasi_interpolant
from runout.physics.tensors import real, vec


def _sum_arenas(arenas, filled, down, block, n):
    """Sums of the four numbers at a node over the up to eight arenas that overlap it, in a fixed order."""
    s0 = s1 = s2 = s3 = real(0.0)
    for q in range(8):
        b = down[block, q]
        i = (n >> 4) + (q & 4)
        j = ((n >> 2) & 3) + ((q & 2) << 1)
        k = (n & 3) + ((q & 1) << 2)
        if b >= 0 and i < 6 and j < 6 and k < 6 and filled[b] > 0:
            a = i * PLANE + j * ROW + k * 4
            s0 += arenas[b, a]
            s1 += arenas[b, a + 1]
            s2 += arenas[b, a + 2]
            s3 += arenas[b, a + 3]
    return s0, s1, s2, s3


def _any_filled(filled, down, block):
    """Whether any arena that overlaps a node block holds something."""
    for q in range(8):
        if down[block, q] >= 0 and filled[down[block, q]] > 0:
            return True
    return False


def update_nodes(arenas, held, down, nall, grid, dv):
    """Mass and velocity of every node after internal forces and gravity; nodes without mass stay at rest."""
    for b in prange(nall):
        if not _any_filled(held, down, b):
            for n in range(64):
                for d in range(4):
                    grid[b, n, d] = real(0.0)
            continue
        for n in range(64):
            m, p0, p1, p2 = _sum_arenas(arenas, held, down, b, n)
            inverse = real(0.0)
            moving = real(0.0)
            if m > real(0.0):
                inverse = real(1.0) / m
                moving = real(1.0)
            grid[b, n, 0] = m
            grid[b, n, 1] = p0 * inverse + moving * dv[0]
            grid[b, n, 2] = p1 * inverse + moving * dv[1]
            grid[b, n, 3] = p2 * inverse + moving * dv[2]


def _surface_at(tile, cx, cy, fx, fy):
    """Elevation above the block [cells] and its two slopes [cells per cell], from the 6 x 6 coefficients of a block."""
    wx = weights(fx)
    wy = weights(fy)
    dx = weight_slopes(fx)
    dy = weight_slopes(fy)
    o = cx * 6 + cy
    r0 = interpolate(wy, tile[o], tile[o + 1], tile[o + 2])
    r1 = interpolate(wy, tile[o + 6], tile[o + 7], tile[o + 8])
    r2 = interpolate(wy, tile[o + 12], tile[o + 13], tile[o + 14])
    s0 = interpolate(dy, tile[o], tile[o + 1], tile[o + 2])
    s1 = interpolate(dy, tile[o + 6], tile[o + 7], tile[o + 8])
    s2 = interpolate(dy, tile[o + 12], tile[o + 13], tile[o + 14])
    return interpolate(wx, r0, r1, r2), interpolate(dx, r0, r1, r2), interpolate(wx, s0, s1, s2)


def _ground(tile, c, fx, fy, fz, radius, dx, dy, dz):
    """Unit normal and gap [m] of a particle in cell ``c`` of a block."""
    e, sx, sy = _surface_at(tile, c >> 4, (c >> 2) & 3, fx, fy)
    sx = sx * dz / dx
    sy = sy * dz / dy
    nz = normal_z(sx, sy)
    gap = distance((real(c & 3) + fz - e) * dz, nz) - radius
    return -sx * nz, -sy * nz, nz, gap


def _spread(arena, o, fx, fy, fz, s, l0, l1, l2):
    """Add weight times (s, l0, l1, l2) to the 27 nodes at place ``o``."""
    wx = weights(fx)
    wy = weights(fy)
    wz = weights(fz)
    for i in range(3):
        for j in range(3):
            a = o + i * PLANE + j * ROW
            for k in range(3):
                w = wx[i] * wy[j] * wz[k]
                arena[a + 4 * k] += w * s
                arena[a + 4 * k + 1] += w * l0
                arena[a + 4 * k + 2] += w * l1
                arena[a + 4 * k + 3] += w * l2


def find_contacts(rec, radius, cstart, nown, tiles, lowest, dt, h, band, arenas, contacts, touching):
    """List the particles that touch the ground, and add their weights to the arenas of their blocks."""
    for b in prange(nown):
        touching[b] = 0
        start = cstart[b * 64]
        if start == cstart[b * 64 + 64] or lowest[b] > real(2.0):
            continue
        arena = arenas[b]
        found = 0
        for c in range(64):
            for p in range(cstart[b * 64 + c], cstart[b * 64 + c + 1]):
                nx, ny, nz, gap = _ground(tiles[b], c, rec[p, 4], rec[p, 8], rec[p, 12], radius[p], h[0], h[1], h[2])
                vn = (rec[p, 1] * nx + rec[p, 2] * ny + rec[p, 3] * nz) / rec[p, 0]
                if not in_contact(gap, vn, dt, band):
                    continue
                if found == 0:
                    for t in range(ARENA):
                        arena[t] = real(0.0)
                contacts[start + found, 0] = p
                contacts[start + found, 1] = c
                found += 1
                _spread(arena, _first_node(c), rec[p, 4], rec[p, 8], rec[p, 12], real(1.0), real(0.0), real(0.0), real(0.0))
        touching[b] = found


def sum_contact_weights(arenas, touching, down, nall, shares):
    """Sum of the weights of all contact particles at each node of the blocks that they reach."""
    for b in prange(nall):
        if _any_filled(touching, down, b):
            for n in range(64):
                shares[b, n] = _sum_arenas(arenas, touching, down, b, n)[0]


def _contact_velocity(grid, shares, up, b, c, fx, fy, fz):
    """Velocity that a particle would receive, and its lumped compliance [1/kg]."""
    wx = weights(fx)
    wy = weights(fy)
    wz = weights(fz)
    u0 = u1 = u2 = compliance = real(0.0)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                x = (c >> 4) + i
                y = ((c >> 2) & 3) + j
                z = (c & 3) + k
                s = up[b, ((x >> 2) << 2) | ((y >> 2) << 1) | (z >> 2)]
                n = ((x & 3) << 4) | ((y & 3) << 2) | (z & 3)
                w = wx[i] * wy[j] * wz[k]
                m = grid[s, n, 0]
                if m > real(0.0):
                    u0 += w * grid[s, n, 1]
                    u1 += w * grid[s, n, 2]
                    u2 += w * grid[s, n, 3]
                    compliance += w * shares[s, n] / m
    return u0, u1, u2, compliance


def solve_contacts(
    rec, radius, release, cstart, nown, tiles, grid, shares, up, dt, h, friction, arenas, contacts, touching, ground
):
    """One impulse per contact particle, spread to the arena of its block.

    ``ground`` (nown, 4) is what the impulses did: work [J] and their sum [N s].
    """
    for b in prange(nown):
        start = cstart[b * 64]
        for d in range(4):
            ground[b, d] = 0.0
        for q in range(touching[b]):
            p = contacts[start + q, 0]
            c = contacts[start + q, 1]
            fx = rec[p, 4]
            fy = rec[p, 8]
            fz = rec[p, 12]
            u0, u1, u2, compliance = _contact_velocity(grid, shares, up, b, c, fx, fy, fz)
            nx, ny, nz, gap = _ground(tiles[b], c, fx, fy, fz, radius[p], h[0], h[1], h[2])
            u = vec(u0, u1, u2)
            push = impulse(u, vec(nx, ny, nz), gap, compliance, friction[release[p]], dt)
            before = vec(rec[p, 1] / rec[p, 0], rec[p, 2] / rec[p, 0], rec[p, 3] / rec[p, 0])
            ground[b, 0] += work(push, before, u, compliance)
            for d in range(3):
                ground[b, d + 1] += push[d]
            _spread(arenas[b], _first_node(c), fx, fy, fz, real(0.0), push[0], push[1], push[2])


def apply_impulses(arenas, touching, down, nall, grid):
    """Add the impulses to the nodes that have mass."""
    for b in prange(nall):
        if not _any_filled(touching, down, b):
            continue
        for n in range(64):
            m = grid[b, n, 0]
            if m > real(0.0):
                _, j0, j1, j2 = _sum_arenas(arenas, touching, down, b, n)
                grid[b, n, 1] += j0 / m
                grid[b, n, 2] += j1 / m
                grid[b, n, 3] += j2 / m


def _surface_value(coefficients, qx, qy):
    """Elevation [m] at lattice position (qx, qy)."""
    i = min(max(first_node(qx), 0), coefficients.shape[0] - 3)
    j = min(max(first_node(qy), 0), coefficients.shape[1] - 3)
    wx = weights(qx - i)
    wy = weights(qy - j)
    r0 = interpolate(wy, coefficients[i, j], coefficients[i, j + 1], coefficients[i, j + 2])
    r1 = interpolate(wy, coefficients[i + 1, j], coefficients[i + 1, j + 1], coefficients[i + 1, j + 2])
    r2 = interpolate(wy, coefficients[i + 2, j], coefficients[i + 2, j + 1], coefficients[i + 2, j + 2])
    return interpolate(wx, r0, r1, r2)


def _north_south(coefficients, qx, qy, ay):
    south = _surface_value(coefficients, qx, qy - ay)
    return quasi_interpolant(south, _surface_value(coefficients, qx, qy), _surface_value(coefficients, qx, qy + ay))


def _node_coefficient(coefficients, ox, oy, sx, sy, x, y, dx, dy):
    """Coefficient at a node whose spline passes the surface at the nodes: the quasi-interpolant in both axes."""
    qx = (x - ox) / sx
    qy = (y - oy) / sy
    ax = dx / sx
    ay = dy / sy
    west = _north_south(coefficients, qx - ax, qy, ay)
    here = _north_south(coefficients, qx, qy, ay)
    east = _north_south(coefficients, qx + ax, qy, ay)
    return quasi_interpolant(west, here, east)


def cut_tiles(coefficients, ox, oy, sx, sy, bxyz, nown, h, tiles, lowest):
    """Surface coefficients on the nodes of each block, relative to its lowest node [cells]; and how far the block lies above.

    The surface is sampled at the nodes in float64, so that float32 keeps the gap of a particle to 1e-7 cells.
    ``lowest`` is the distance from the highest coefficient up to the block's lowest node [cells].
    """
    for b in prange(nown):
        top = real(-1.0e30)
        for i in range(6):
            for j in range(6):
                x = (4 * bxyz[b, 0] + i) * h[0]
                y = (4 * bxyz[b, 1] + j) * h[1]
                e = _node_coefficient(coefficients, ox, oy, sx, sy, x, y, h[0], h[1])
                c = real(e / h[2] - 4 * bxyz[b, 2])
                tiles[b, i * 6 + j] = c
                top = max(top, c)
        lowest[b] = -top
