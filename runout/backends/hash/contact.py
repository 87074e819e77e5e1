"""Particles in contact with the ground: which they are, and one impulse each, spread to the nodes."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.layout import (
    CELL_LANES,
    HALT,
    MASS,
    MOMENTUM,
    OFFSET,
    ORDERED,
    PADDED,
    RADIUS,
    TILE,
    TOUCHED,
    Doubles2,
    Ints,
    Nodes,
    Reals,
    Rows,
    Shorts,
    Table2,
    Tile,
    Vector,
    add_node,
    double4,
    node4,
    sums1,
    sums3,
)
from runout.backends.hash.stencil import _block, _first_node, _load, _local
from runout.physics.bspline import weights
from runout.physics.contact import impulse, in_contact, work
from runout.physics.heightfield import distance, surface_at, upward_normal
from runout.physics.tensors import dot, real, tens, vec

PUSHES = 128  # contact particles of a block whose impulses are held at once
STARTS = CELL_LANES + 1


def _around(tiles: Rows, near: int, c: int):
    """Nine coefficients of the surface under a cell of a block, from the 6 x 6 at place ``near``."""
    o = (c >> 4) * 6 + ((c >> 2) & 3)
    return tens(
        tiles[near, o], tiles[near, o + 1], tiles[near, o + 2], tiles[near, o + 6], tiles[near, o + 7], tiles[near, o + 8],
        tiles[near, o + 12], tiles[near, o + 13], tiles[near, o + 14],
    )  # fmt: skip


def _listed(order: Ints, t: int):
    """Particle at a place of the list; one in contact is listed as -1 - its place in memory."""
    p = order[t]
    return wp.max(p, -1 - p)


def _ground(around: Any, z: int, rec: Rows, p: int, h: Vector):
    """Unit normal and gap [m] of a particle in a cell whose nine coefficients and lowest node ``z`` are given."""
    e = surface_at(around, rec[OFFSET, p], rec[OFFSET + 1, p])
    n = upward_normal(e[1] * h[2] / h[0], e[2] * h[2] / h[1])
    return n, distance((real(z) + rec[OFFSET + 2, p] - e[0]) * h[2], n[2]) - rec[RADIUS, p]


def _is_near(around: Any, z: int, h: Vector, reach: Any):
    """Whether a particle above node ``z`` may be within ``reach`` [m] of the ground: a spline keeps to the hull of its values.

    The particle is half a cell above that node at least, and no steeper slope is found than between two coefficients.
    """
    top = around[0]
    east = real(0.0)
    north = real(0.0)
    for i in range(3):
        for j in range(3):
            top = wp.max(top, around[3 * i + j])
            if i > 0:
                east = wp.max(east, wp.abs(around[3 * i + j] - around[3 * i + j - 3]))
            if j > 0:
                north = wp.max(north, wp.abs(around[3 * i + j] - around[3 * i + j - 1]))
    n = upward_normal(east * h[2] / h[0], north * h[2] / h[1])
    return distance((real(z) + real(0.5) - top) * h[2], n[2]) <= reach


def _find_contacts(
    rec: Rows, order: Ints, first: int, last: int, tiles: Rows, near: int, c: int, h: Vector, dt: Any, band: Any, reach: Any
):
    """Bring the particles of a cell that touch the ground to the front of its list, marked; returns how many."""
    if first == last:
        return 0
    around = _around(tiles, near, c)
    if not _is_near(around, c & 3, h, reach):
        return 0
    end = int(first)
    for t in range(first, last):
        p = int(order[t])
        n, gap = _ground(around, c & 3, rec, p, h)
        approach = dot(vec(rec[MOMENTUM, p], rec[MOMENTUM + 1, p], rec[MOMENTUM + 2, p]), n) / rec[MASS, p]
        if in_contact(gap, approach, dt, band):
            order[t] = order[end]
            order[end] = -1 - p
            end += 1
    return end - first


def _touching(order: Ints, cstart: Table2, b: int, c: int):
    """Particles of a cell that are in contact: the marked ones at the front of its list."""
    n = int(0)
    for t in range(cstart[b, c], cstart[b, c + 1]):
        if order[t] < 0:
            n += 1
    return n


def add_shares(
    rec: Rows, order: Ints, cstart: Table2, up: Table2, flags: Ints, tally: Ints, touched: Ints, grounded: Ints,
    shares: Reals, arenas: Nodes, launched: int,
):  # fmt: skip
    """Weights of the contact particles to the nodes; ``shares`` is the first of the four numbers of each node."""
    begin, lane = wp.tid()
    if flags[HALT] != 0:
        return
    for a in range(begin, tally[TOUCHED], launched):
        b = touched[a]
        tile = wp.tile_zeros(shape=TILE, dtype=real, storage="shared")
        for c in range(lane, CELL_LANES, wp.block_dim()):
            acc = sums1()
            for t in range(cstart[b, c], cstart[b, c + 1]):
                if order[t] < 0:
                    p = _listed(order, t)
                    wx = weights(rec[OFFSET, p])
                    wy = weights(rec[OFFSET + 1, p])
                    wz = weights(rec[OFFSET + 2, p])
                    for i in range(3):
                        for j in range(3):
                            for k in range(3):
                                acc[(i * 3 + j) * 3 + k] += wx[i] * wy[j] * wz[k]
            first = _first_node(c)
            for i in range(3):
                for j in range(3):
                    for k in range(3):
                        wp.tile_scatter_add(tile, first + (i * 6 + j) * 6 + k, acc[(i * 3 + j) * 3 + k], True, False)
        for t in range(lane, TILE, wp.block_dim()):
            s = tile[t]
            if ORDERED:
                arenas[b * TILE + t] = node4(s, real(0.0), real(0.0), real(0.0))
            elif s != real(0.0):
                wp.atomic_add(shares, 4 * (grounded[_block(up, b, t)] * 64 + _local(t)), s)


def _contact_velocity(tile: Tile, first: int, wx: Any, wy: Any, wz: Any):
    """Velocity that a particle would receive, and its lumped compliance [1/kg]."""
    u = node4()
    for i in range(3):
        for j in range(3):
            s = node4()
            for k in range(3):
                s += wz[k] * tile[first + (i * 6 + j) * 6 + k]
            u += (wx[i] * wy[j]) * s
    return vec(u[0], u[1], u[2]), u[3]


def _push(rec: Rows, release: Shorts, tiles: Rows, tile: Tile, near: int, c: int, p: int, h: Vector, friction: Reals, dt: Any):
    """Impulse [N s] of the ground on a particle of a cell, and its work [J]."""
    wx = weights(rec[OFFSET, p])
    wy = weights(rec[OFFSET + 1, p])
    wz = weights(rec[OFFSET + 2, p])
    u, compliance = _contact_velocity(tile, _first_node(c), wx, wy, wz)
    n, gap = _ground(_around(tiles, near, c), c & 3, rec, p, h)
    push = impulse(u, n, gap, compliance, friction[int(release[p])], dt)
    m = rec[MASS, p]
    before = vec(rec[MOMENTUM, p] / m, rec[MOMENTUM + 1, p] / m, rec[MOMENTUM + 2, p] / m)
    return node4(push[0], push[1], push[2], work(push, before, u, compliance))


def _cell_of(starts: Tile, n: int):
    """Cell that holds number ``n`` of the contact particles of a block: the last whose start is not beyond it."""
    c = int(0)
    for q in range(6):
        further = c + (32 >> q)
        if starts[further] <= n:
            c = further
    return c


def _start_pushes(starts: Tile, order: Ints, cstart: Table2, b: int, lane: int):
    """Number of the first contact particle of each cell of a block, and of all."""
    total = int(0)
    for q in range(CELL_LANES // wp.block_dim()):
        c = q * wp.block_dim() + lane
        n = _touching(order, cstart, b, c)
        cells = wp.tile(n)
        wp.tile_scatter_masked(starts, c, total + wp.untile(wp.tile_scan_exclusive(cells)), True)
        total += wp.tile_sum(cells)[0]
    wp.tile_scatter_masked(starts, CELL_LANES, total, lane == 0)
    return total


def _spread(tile: Tile, pushes: Tile, starts: Tile, rec: Rows, order: Ints, place: int, c: int, base: int):
    """Impulses of the contact particles of a cell to its 27 nodes, nine at a time; returns impulse and work of all."""
    done = double4()
    n = int(starts[c])
    begin = wp.max(n, base)
    end = wp.min(int(starts[c + 1]), base + PUSHES)
    first = _first_node(c)
    for i in range(3):
        acc = sums3()
        for t in range(begin, end):
            p = _listed(order, place + t - n)
            push = pushes[t - base]
            wx = weights(rec[OFFSET, p])
            wy = weights(rec[OFFSET + 1, p])
            wz = weights(rec[OFFSET + 2, p])
            for j in range(3):
                for k in range(3):
                    for d in range(3):
                        acc[j * 3 + k, d] += wx[i] * wy[j] * wz[k] * push[d]
            if i == 0:
                done += double4(wp.float64(push[3]), wp.float64(push[0]), wp.float64(push[1]), wp.float64(push[2]))
        for j in range(3):
            for k in range(3):
                s = vec(acc[j * 3 + k, 0], acc[j * 3 + k, 1], acc[j * 3 + k, 2])
                wp.tile_scatter_add(tile, first + (i * 6 + j) * 6 + k, s, True, False)
    return done


def solve_contacts(
    rec: Rows, release: Shorts, order: Ints, cstart: Table2, up: Table2, flags: Ints, tally: Ints, touched: Ints,
    member: Ints, clock: Rows, tiles: Rows, near: Ints, h: Vector, friction: Reals, grounded: Ints, grid: Nodes, contact: Nodes,
    arenas: Nodes, booked: Doubles2, launched: int,
):  # fmt: skip
    """One impulse per contact particle, spread to the nodes; ``booked`` (blocks, 5) adds up work [J] and impulse [N s].

    A thread first owns a particle and finds its impulse, then a cell and adds up those of its particles.
    """
    begin, lane = wp.tid()
    if flags[HALT] != 0:
        return
    for a in range(begin, tally[TOUCHED], launched):
        b = touched[a]
        dt = clock[member[b], 0]
        velocities = wp.tile_zeros(shape=PADDED, dtype=node4, storage="shared")
        _load(velocities, grid, contact, grounded, up, b, lane)
        starts = wp.tile_zeros(shape=STARTS, dtype=int, storage="shared")
        total = _start_pushes(starts, order, cstart, b, lane)
        tile = wp.tile_zeros(shape=TILE, dtype=vec, storage="shared")
        pushes = wp.tile_zeros(shape=PUSHES, dtype=node4, storage="shared")
        done = double4()
        for base in range(0, total, PUSHES):
            for q in range(PUSHES // wp.block_dim()):
                n = base + q * wp.block_dim() + lane
                push = node4()
                if n < total:
                    c = _cell_of(starts, n)
                    p = _listed(order, cstart[b, c] + n - starts[c])
                    push = _push(rec, release, tiles, velocities, near[b], c, p, h, friction, dt)
                wp.tile_scatter_masked(pushes, n - base, push, n < total)
            for c in range(lane, CELL_LANES, wp.block_dim()):
                done += _spread(tile, pushes, starts, rec, order, cstart[b, c], c, base)
        all_done = wp.tile_sum(wp.tile(done, preserve_type=True))
        if lane == 0:
            for d in range(4):
                booked[b, d + 1] = booked[b, d + 1] + all_done[0][d]
        for t in range(lane, TILE, wp.block_dim()):
            s = tile[t]
            if ORDERED:
                arenas[b * TILE + t] = node4(real(0.0), s[0], s[1], s[2])
            elif s[0] != real(0.0) or s[1] != real(0.0) or s[2] != real(0.0):
                add_node(contact, grounded[_block(up, b, t)] * 64 + _local(t), node4(real(0.0), s[0], s[1], s[2]))
