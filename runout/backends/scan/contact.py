"""Contact with the ground: one impulse per contact particle, see :mod:`runout.physics.contact`.

Only cells near the ground are looked at, and only particles under a bound of its surface are measured: the candidates. Each
gets a row of 16 numbers in ``contacts``, and a weight of one if it touches, of zero if not. The rows of a block lie one
after the other from ``place[b]`` on, in the region of the thread that found them:

    [ weight, then compliance; 0, then velocity, then impulse | fx, normal | fy, gap, friction, weight | fz, v before ]
"""

import numpy as np
from numba import get_thread_id, prange

from runout.backends.lanes import (
    constant,
    lane_sum,
    listed_record_vectors,
    load4,
    load16,
    local_array,
    permutation,
    prefetch,
    record_vectors,
    row_vectors,
    select,
    store,
)
from runout.backends.scan.ground import _ground
from runout.backends.scan.stencil import (
    _add_rows,
    _clear,
    _first_node,
    _load_nodes,
    _load_rows,
    _mean,
    _nothing,
    _spread,
    _z_weights,
    heads_and_tails,
    in_groups,
    local_nodes,
    zeros,
)
from runout.backends.scan.transfer import _fill_arena, _find_arenas, _sum_row, local_places
from runout.physics.bspline import weights
from runout.physics.contact import impulse, in_contact, work
from runout.physics.moments import momentum_at
from runout.physics.tensors import real, vec

TILE = 64
ROW_OF_WEIGHTS, PLANE_OF_WEIGHTS = 8, 48  # numbers of a row of six nodes, and of six rows, where a node has one
ASIDE = 16  # first row of a tile of candidates behind their records
FLOOR, RADIUS, FRICTION = 19, 23, 24
DONE, PUSH_X, PUSH_Y, PUSH_Z = 16, 17, 18, 19  # and of contacts
local_tile = local_array((32, TILE))
local_aside = local_array((16 * TILE,))
load_listed = listed_record_vectors(16)
load_contacts, store_contacts = record_vectors(16)
_, store_heads = record_vectors(4, 16)
load_16_rows, store_16_rows = row_vectors(16, TILE)
load_4_rows, _ = row_vectors(4, TILE)
heads = permutation((0, 4, 8, 12))
in_all_four = permutation(in_groups(range(4)))
four_ones, four_zeros = constant([1.0] * 4), constant([0.0] * 4)


def _take_candidates(aside, cell, who, radius, label, tile, friction, listed, start, n):
    """What the records of ``n`` listed particles do not hold: ground in their columns of cells, level, size and friction."""
    for q in range(n):
        p = listed[start + q]
        c = np.int64(cell[p])
        o = (c >> 4) * 6 + ((c >> 2) & 3)
        r = 16 * q
        store(aside, r, load4(tile, o))
        store(aside, r + 4, load4(tile, o + 6))
        store(aside, r + 8, load4(tile, o + 11))
        aside[r + 3] = real(c & 3)
        aside[r + 7] = radius[who[p]]
        aside[r + 8] = friction[label[who[p], 0]] if len(friction) > 1 else friction[0]


def _load_candidates(t, rec, aside, listed, start, n):
    """Records of ``n`` listed particles, and what they do not hold, as columns of a tile."""
    for g in range(n >> 4):
        store_16_rows(t, 16 * g, load_listed(rec, listed, start + 16 * g))
        store_16_rows(t, ASIDE * TILE + 16 * g, load_contacts(aside, 256 * g))


def _coefficients(t, q):
    return (
        t[ASIDE, q], t[ASIDE + 1, q], t[ASIDE + 2, q],
        t[ASIDE + 4, q], t[ASIDE + 5, q], t[ASIDE + 6, q],
        t[ASIDE + 9, q], t[ASIDE + 10, q], t[ASIDE + 11, q],
    )  # fmt: skip


def _momentum(t, q):
    """Momentum [kg m/s] of a particle from its record: that at the middle node, and its slopes."""
    return momentum_at(
        vec(t[1, q], t[2, q], t[3, q]),
        vec(t[5, q], t[6, q], t[7, q]),
        vec(t[9, q], t[10, q], t[11, q]),
        vec(t[13, q], t[14, q], t[15, q]),
        vec(t[4, q] - real(1.0), t[8, q] - real(1.0), t[12, q] - real(1.0)),
    )


def _measure(t, n, east, north, dz, dt, band):
    """Turn records into rows of contacts: weight, normal, gap, friction and velocity."""
    for q in range(n):
        z = t[FLOOR, q] + t[12, q]
        nx, ny, nz, gap = _ground(_coefficients(t, q), t[4, q], t[8, q], z, t[RADIUS, q], east, north, dz)
        m = real(1.0) / t[0, q]
        px, py, pz = _momentum(t, q)
        vx = px * m
        vy = py * m
        vz = pz * m
        weight = real(1.0) if in_contact(gap, vx * nx + vy * ny + vz * nz, dt, band) else real(0.0)
        t[0, q] = weight
        t[1, q] = real(0.0)
        t[2, q] = real(0.0)
        t[3, q] = real(0.0)
        t[5, q] = nx
        t[6, q] = ny
        t[7, q] = nz
        t[9, q] = gap
        t[10, q] = t[FRICTION, q]
        t[11, q] = weight
        t[13, q] = vx
        t[14, q] = vy
        t[15, q] = vz


def _store_candidates(t, contacts, row, end, n):
    """Rows of ``n`` candidates, if there is room before ``end``; returns how many touch."""
    groups = (n + 15) >> 4
    if row + 16 * groups <= end:
        for g in range(groups):
            store_contacts(contacts, 16 * (row + 16 * g), load_16_rows(t, 16 * g))
    found = 0
    for q in range(np.uint64(n)):
        found += t[0, q] > real(0.0)
    return found


def _examine(rec, who, radius, label, cell, f, tile, friction, dt, h, band, contacts, row, end, listed, n):
    """Rows of the ``n`` candidates of a block; returns how many of them touch. The last one fills the last vector."""
    t = local_tile(rec)
    aside = local_aside(rec)
    for q in range(n, (n + 15) & ~15):
        listed[f + q] = listed[f + n - 1]
    found = 0
    for k in range(0, n, TILE):
        some = min(TILE, n - k)
        full = (some + 15) & ~15
        _take_candidates(aside, cell, who, radius, label, tile, friction, listed, f + k, full)
        _load_candidates(t, rec, aside, listed, f + k, full)
        _measure(t, np.uint64(full), h[2] / h[0], h[2] / h[1], h[2], dt, band)
        found += _store_candidates(t, contacts, row + k, end, some)
    return found


def _spread_block(flat, row, listed, cell, f, n, arena):
    """Fill the arena of a block with the first four numbers of its contacts."""
    _clear(arena)
    for t in range(n):
        place = _first_node(np.int64(cell[listed[f + t]]))
        _add_rows(arena, place, _spread(flat, np.uint64(16 * (row + t)), _nothing(flat)))


def _call_up(tiles, who, b, f, held):
    """Ask for what :func:`_take_candidates` of a block will read, while its arena is filled."""
    for k in range(0, 36, 16):
        prefetch(tiles, 36 * b + k)
    for p in range(f, f + held, 16):
        prefetch(who, p)


def particles_to_arenas_and_contacts(
    rec, who, radius, label, cell, order, starts, first, giving, nown, tiles, planes, bounds, friction, reach, dt, h, band, number,
    arenas, contacts, region, cursors, place, listed, candidates, touching,
):  # fmt: skip
    """Fill the arenas, and find the particles that touch the ground while a block is in cache.

    ``reach`` [m] is the distance from the ground beyond which no centre of a particle can touch. Gives the numbers
    (nown,) of ``candidates``, none where no particle touches, and of particles that are ``touching``. Each thread has
    ``region`` rows of contacts and counts in ``cursors`` (threads, 1) those that it needs; where one needs more, rows are missing.
    """
    for b in prange(nown):
        candidates[b] = 0
        touching[b] = 0
        if giving[b] == 0:
            continue
        cut = reach / (bounds[b, 1] * h[2])
        near = real(0.5) - bounds[b, 0] <= cut
        if near:
            _call_up(tiles, who, b, first[b], giving[b])
        n = _fill_arena(rec, order, starts, first, b, arenas[number[b]], near, planes, cut, listed)
        if n == 0:
            continue
        thread = get_thread_id()
        row = thread * region + cursors[thread, 0]
        found = _examine(
            rec, who, radius, label, cell, first[b], tiles[b], friction, dt, h, band, contacts, row, (thread + 1) * region,
            listed, n,
        )  # fmt: skip
        if found > 0:
            candidates[b] = n
            touching[b] = found
            place[b] = row
            cursors[thread, 0] += (n + 15) & ~15


def _spread_block_weights(flat, row, listed, cell, f, n, arena):
    """Fill the arena of a block with the weights of its contacts alone: one number a node, rows of eight."""
    for o in range(0, 6 * PLANE_OF_WEIGHTS, 16):
        store(arena, o, zeros(arena))
    for t in range(n):
        c = np.int64(cell[listed[f + t]])
        r = np.uint64(16 * (row + t))
        x = weights(flat[r + np.uint64(4)])
        y = weights(flat[r + np.uint64(8)])
        z = heads(_z_weights(flat[r + np.uint64(12)])) * flat[r]
        first = (c >> 4) * PLANE_OF_WEIGHTS + ((c >> 2) & 3) * ROW_OF_WEIGHTS + (c & 3)
        for i in range(3):
            for j in range(3):
                o = first + i * PLANE_OF_WEIGHTS + j * ROW_OF_WEIGHTS
                store(arena, o, load4(arena, o) + (x[i] * y[j]) * z)


def _sum_weights(arenas, place, i, j):
    """Sum of the arenas' weights over four nodes in the order of their blocks."""
    s = heads(zeros(arenas))
    for q in range(8):
        x = i + (q & 4)
        y = j + ((q & 2) << 1)
        if place[q] >= 0 and x < 6 and y < 6:
            s = s + load4(arenas, place[q] + x * PLANE_OF_WEIGHTS + y * ROW_OF_WEIGHTS + 4 * (q & 1))
    return s


def spread_weights(contacts, place, listed, cell, first, nown, candidates, number, arenas):
    """Put the weights of the contacts into the arenas of their blocks, once the nodes have taken the mass."""
    flat = contacts.reshape(-1)
    for b in prange(nown):
        if candidates[b] > 0:
            _spread_block_weights(flat, place[b], listed, cell, first[b], candidates[b], arenas[number[b]])


def share_contacts(arenas, number, touching, down, nall, grid, inverse_mass):
    """Put the sum of the contacts' weights over the mass in the place of the mass, and one over the mass in ``inverse_mass``."""
    for b in prange(nall):
        overlapping = local_places(touching)
        if not _find_arenas(overlapping, number, touching, down, b):
            continue
        for i in range(4):
            for j in range(4):
                o = b * 256 + (i * 4 + j) * 16
                node = load16(grid, o)
                m = heads(node)
                filled = m > four_zeros(m)
                inverse = select(filled, four_ones(m) / select(filled, m, four_ones(m)), four_zeros(m))
                s = in_all_four(_sum_weights(arenas, overlapping, i, j) * inverse)
                store(grid, o, heads_and_tails(s, node))
                store(inverse_mass, o >> 2, inverse)


def _meet_grid(flat, row, listed, cell, f, n, nodes):
    """Compliance and velocity that the grid would give to each contact."""
    for t in range(n):
        r = np.uint64(16 * (row + t))
        rows = _load_rows(nodes, _first_node(np.int64(cell[listed[f + t]])))
        store(flat, r, _mean(flat, r, rows))


def _push(t, count, dt):
    """Impulse of each column and its work; nothing beyond ``count``."""
    for q in range((count + np.uint64(15)) & ~np.uint64(15)):
        compliance = t[0, q]
        u = vec(t[1, q], t[2, q], t[3, q])
        here = (q < count) & (t[11, q] > real(0.0))
        push = impulse(u, vec(t[5, q], t[6, q], t[7, q]), t[9, q], compliance, t[10, q], dt)
        done = work(push, vec(t[13, q], t[14, q], t[15, q]), u, compliance)
        t[0, q] = real(0.0)
        t[1, q] = push[0] if here else real(0.0)
        t[2, q] = push[1] if here else real(0.0)
        t[3, q] = push[2] if here else real(0.0)
        t[DONE, q] = done if here else real(0.0)
        t[PUSH_X, q] = push[0] if here else real(0.0)
        t[PUSH_Y, q] = push[1] if here else real(0.0)
        t[PUSH_Z, q] = push[2] if here else real(0.0)


def _push_block(contacts, first_row, n, dt, ground, b):
    """Impulses of all contacts of a block; their work [J] and sums [N s] go to ``ground``."""
    t = local_tile(contacts)
    for k in range(4):
        ground[b, k] = 0.0
    for k in range(0, n, TILE):
        some = min(TILE, n - k)
        groups = (some + 15) >> 4
        for g in range(groups):
            store_16_rows(t, 16 * g, load_contacts(contacts, 16 * (first_row + k + 16 * g)))
        _push(t, np.uint64(some), dt)
        for g in range(groups):
            store_heads(contacts, 16 * (first_row + k + 16 * g), load_4_rows(t, 16 * g))
            for row in range(4):
                ground[b, row] += lane_sum(load16(t, (DONE + row) * TILE + 16 * g))


def solve_contacts(contacts, place, listed, cell, first, nown, grid, up, dt, number, arenas, candidates, ground):
    """One impulse per contact, spread to the arena of its block; ``ground`` (nown, 4) is their work [J] and sum [N s]."""
    flat = contacts.reshape(-1)
    for b in prange(nown):
        n = candidates[b]
        if n == 0:
            continue
        nodes = local_nodes(contacts)
        _load_nodes(nodes, grid, up, b)
        _meet_grid(flat, place[b], listed, cell, first[b], n, nodes)
        _push_block(contacts, place[b], n, dt, ground, b)
        _spread_block(flat, place[b], listed, cell, first[b], n, arenas[number[b]])


def apply_impulses(arenas, number, touching, down, nall, grid, inverse_mass):
    """Add the impulses to the nodes that have mass."""
    for b in prange(nall):
        overlapping = local_places(touching)
        if not _find_arenas(overlapping, number, touching, down, b):
            continue
        for i in range(4):
            for j in range(4):
                o = b * 256 + (i * 4 + j) * 16
                s = _sum_row(arenas, overlapping, i, j)
                store(grid, o, load16(grid, o) + s * in_all_four(load4(inverse_mass, o >> 2)))
