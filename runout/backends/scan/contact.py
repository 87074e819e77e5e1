"""Contact with the ground: one impulse per contact particle, see :mod:`runout.physics.contact`.

Only cells near the ground are looked at, and only particles under a bound of its surface are measured: the candidates. Each
gets a row of 16 numbers in ``contacts``, and a weight of one if it touches, of zero if not. The rows of a block lie one
after the other from ``place[b]`` on, in the region of the thread that found them:

    [ weight, then compliance; 0, then velocity, then impulse | fx, normal | fy, gap, friction, weight | fz, v before ]
"""

import numpy as np
from numba import get_thread_id, prange

from runout.backends.lanes import (
    lane_sum,
    listed_record_vectors,
    load4,
    load16,
    local_array,
    permutation,
    permutation_of_two,
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
    heads_and_tails,
    in_groups,
    local_nodes,
    zeros,
)
from runout.backends.scan.transfer import _fill_arena, _find_arenas, _sum_row, local_places, masses, ones
from runout.physics.contact import impulse, in_contact, work
from runout.physics.moments import momentum_at
from runout.physics.tensors import real, vec

TILE = 64
FLOOR, RADIUS, FRICTION, GROUND = 16, 17, 18, 19  # rows of a tile of candidates besides the record
DONE, PUSH_X, PUSH_Y, PUSH_Z = 16, 17, 18, 19  # and of contacts
local_tile = local_array((28, TILE))
load_listed = listed_record_vectors(16)
load_contacts, store_contacts = record_vectors(16)
load_16_rows, store_16_rows = row_vectors(16, TILE)
heads = permutation((0, 4, 8, 12))
in_all_four = permutation(in_groups(range(4)))
first_of_two = permutation_of_two([*range(4), *range(20, 32)])


def _near(planes, b, c, cut):
    """Whether a particle in cell ``c`` of a block may lie less than ``cut`` cells above the bound of the ground."""
    a = (c >> 2) * 3
    sx = planes[b, a + 1]
    sy = planes[b, a + 2]
    top = planes[b, a] + sx + sy + real(0.5) * (abs(sx) + abs(sy))
    return real(c & 3) + real(0.5) - top <= cut


def _below(rec, p, planes, b, c, cut):
    """Whether a particle lies less than ``cut`` cells above the bound of the ground."""
    a = (c >> 2) * 3
    bound = planes[b, a] + planes[b, a + 1] * rec[p, 4] + planes[b, a + 2] * rec[p, 8]
    return real(c & 3) + rec[p, 12] - bound <= cut


def _take_candidate(t, q, tile, c, radius, friction):
    """What the record does not hold, as column ``q``: place and size of a candidate and the ground in its column of cells."""
    o = (c >> 4) * 6 + ((c >> 2) & 3)
    t[FLOOR, q] = c & 3
    t[RADIUS, q] = radius
    t[FRICTION, q] = friction
    for i in range(3):
        for j in range(3):
            t[GROUND + 3 * i + j, q] = tile[o + 6 * i + j]


def _load_candidates(t, rec, listed, start, n):
    """Records of ``n`` listed particles as columns of a tile; behind them, their last one again."""
    for q in range(n, (n + 15) & ~15):
        listed[start + q] = listed[start + n - 1]
    for g in range((n + 15) >> 4):
        store_16_rows(t, 16 * g, load_listed(rec, listed, start + 16 * g))


def _coefficients(t, q):
    return (
        t[GROUND, q], t[GROUND + 1, q], t[GROUND + 2, q],
        t[GROUND + 3, q], t[GROUND + 4, q], t[GROUND + 5, q],
        t[GROUND + 6, q], t[GROUND + 7, q], t[GROUND + 8, q],
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
    for q in range(n):
        found += t[0, q] > real(0.0)
    return found


def _measure_candidates(t, rec, listed, contacts, start, row, end, n, dt, h, band):
    """Rows of ``n`` candidates whose places are in a tile; returns how many touch."""
    if n == 0:
        return 0
    _load_candidates(t, rec, listed, start, n)
    _measure(t, np.uint64((n + 15) & ~15), h[2] / h[0], h[2] / h[1], h[2], dt, band)
    return _store_candidates(t, contacts, row, end, n)


def _examine(rec, who, radius, label, order, starts, f, b, tile, planes, friction, cut, dt, h, band, contacts, row, end, listed):
    """Candidates of a block, and how many of them touch."""
    t = local_tile(rec)
    n = 0
    found = 0
    for c in range(64):
        if starts[b, c] == starts[b, c + 1] or not _near(planes, b, c, cut):
            continue
        for k in range(f + starts[b, c], f + starts[b, c + 1]):
            p = order[k]
            if not _below(rec, p, planes, b, c, cut):
                continue
            listed[f + n] = p
            _take_candidate(t, np.uint64(n & (TILE - 1)), tile, c, radius[who[p]], friction[label[who[p], 0]])
            n += 1
            if n & (TILE - 1) == 0:
                done = n - TILE
                found += _measure_candidates(t, rec, listed, contacts, f + done, row + done, end, TILE, dt, h, band)
    rest = n & (TILE - 1)
    done = n - rest
    found += _measure_candidates(t, rec, listed, contacts, f + done, row + done, end, rest, dt, h, band)
    return n, found


def _spread_block(contacts, row, listed, cell, f, n, arena):
    """Fill the arena of a block with the first four numbers of its contacts, which come by cell."""
    flat = contacts.reshape(-1)
    _clear(arena)
    t = 0
    while t < n:
        c = cell[listed[f + t]]
        rows = _nothing(contacts)
        while t < n and cell[listed[f + t]] == c:
            rows = _spread(flat, np.uint64(16 * (row + t)), rows)
            t += 1
        _add_rows(arena, _first_node(np.int64(c)), rows)


def particles_to_arenas_and_contacts(
    rec, who, radius, label, order, starts, first, giving, nown, tiles, planes, bounds, friction, reach, dt, h, band, number,
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
        _fill_arena(rec, order, starts, first, b, arenas[number[b]])
        cut = reach / (bounds[b, 1] * h[2])
        if real(0.5) - bounds[b, 0] > cut:
            continue
        thread = get_thread_id()
        row = thread * region + cursors[thread, 0]
        n, found = _examine(
            rec, who, radius, label, order, starts, first[b], b, tiles[b], planes, friction, cut, dt, h, band, contacts, row,
            (thread + 1) * region, listed,
        )  # fmt: skip
        if found > 0:
            candidates[b] = n
            touching[b] = found
            place[b] = row
            cursors[thread, 0] += (n + 15) & ~15


def spread_weights(contacts, place, listed, cell, first, nown, candidates, number, arenas):
    """Put the weights of the contacts into the arenas of their blocks, once the nodes have taken the mass."""
    for b in prange(nown):
        if candidates[b] > 0:
            _spread_block(contacts, place[b], listed, cell, first[b], candidates[b], arenas[number[b]])


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
                m = masses(node)
                inverse = select(m > zeros(m), ones(m) / select(m > zeros(m), m, ones(m)), zeros(m))
                s = _sum_row(arenas, overlapping, i, j)
                store(grid, o, heads_and_tails(s * inverse, node))
                store(inverse_mass, o >> 2, heads(inverse))


def _meet_grid(contacts, row, listed, cell, f, n, nodes):
    """Compliance and velocity that the grid would give to each contact."""
    flat = contacts.reshape(-1)
    t = 0
    while t < n:
        c = cell[listed[f + t]]
        rows = _load_rows(nodes, _first_node(np.int64(c)))
        while t < n and cell[listed[f + t]] == c:
            r = np.uint64(16 * (row + t))
            store(flat, r, first_of_two(_mean(flat, r, rows), load16(flat, r)))
            t += 1


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
            store_contacts(contacts, 16 * (first_row + k + 16 * g), load_16_rows(t, 16 * g))
            for row in range(4):
                ground[b, row] += lane_sum(load16(t, (DONE + row) * TILE + 16 * g))


def solve_contacts(contacts, place, listed, cell, first, nown, grid, up, dt, number, arenas, candidates, ground):
    """One impulse per contact, spread to the arena of its block; ``ground`` (nown, 4) is their work [J] and sum [N s]."""
    for b in prange(nown):
        n = candidates[b]
        if n == 0:
            continue
        nodes = local_nodes(contacts)
        _load_nodes(nodes, grid, up, b)
        _meet_grid(contacts, place[b], listed, cell, first[b], n, nodes)
        _push_block(contacts, place[b], n, dt, ground, b)
        _spread_block(contacts, place[b], listed, cell, first[b], n, arenas[number[b]])


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
