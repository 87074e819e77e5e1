"""Particles to grid: every block fills an arena, then every node sums the arenas that overlap it in a fixed order.

An arena has eight *parts*, q = 0 to 7: the nodes of the block itself and of its neighbours one step up in the axes whose bit is set
in q (x 4, y 2, z 1). What no particle reaches is neither summed nor written: ``reached`` has bit q of a block set if its particles
reach part q. Nodes that are not written keep finite numbers, whose weight is zero.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import constant, load4, load8, load16, local_array, permutation, prefetch, select, store
from runout.backends.scan.stencil import (
    AHEAD,
    EVERY,
    PLANE,
    ROW,
    _add_rows,
    _clear,
    _first_node,
    _nothing,
    _place_of,
    _scatter,
    _weigh,
    heads_and_tails,
    in_all_four,
    in_groups,
    local_weights,
    zeros,
)
from runout.physics.moments import velocity_after
from runout.physics.tensors import real

LEAST_MASS = 1e-37  # [kg] of a node that moves: one over less is no number in float32, and its weight to any particle is as small
ROW_OF_SHARES, PLANE_OF_SHARES = 6, 36  # numbers of a row of six nodes, and of six rows, where a node has one
SHARES = 232  # six planes and padding
STRIP = 16  # owners, one after the other
masses = permutation(in_groups((0, 4, 8, 12)))
heads = permutation((0, 4, 8, 12))
least_masses, four_least_masses = constant([LEAST_MASS] * 16), constant([LEAST_MASS] * 4)
four_ones, four_zeros = constant([1.0] * 4), constant([0.0] * 4)
local_places = local_array((8,))
widened = permutation([*range(8), *[8] * 8])
lower_two = permutation((0, 1, 4, 4))


def _octant(c):
    """Octant of cell ``c`` of a block: bit 2, 1, 0 is set in its upper half along x, y, z."""
    return ((c >> 3) & 4) | ((c >> 2) & 2) | ((c >> 1) & 1)


def _parts_of(octants):
    """Parts of an arena that the nodes of the cells in some octants lie in, both as bits."""
    octants |= (octants & 0xF0) >> 4
    octants |= (octants & 0xCC) >> 2
    return octants | ((octants & 0xAA) >> 1)


def _reached_parts(starts, b):
    """Parts of its arena that the particles of a block reach, as bits."""
    octants = 0
    for c in range(0, 64, 2):
        octants |= np.int64(starts[b, c + 2] > starts[b, c]) << _octant(c)
    return _parts_of(octants)


def _highest_rise(east, north):
    """Largest rise [cells] of a plane with these slopes from the first node of a column of cells to a particle in it."""
    return east + north + real(0.5) * (abs(east) + abs(north))


def _fill_arena(rec, order, starts, first, b, arena, near, planes, cut, listed):
    """Add the particles of a block to its arena; where the ground is ``near``, list those that may touch it; returns their number.

    They are less than ``cut`` cells above the bound of the ground in their column of cells (:func:`ground.cut_tiles`). Where no
    particle of a cell is, none is tested.
    """
    _clear(arena, EVERY)
    f = first[b]
    n = 0
    ready = local_weights(rec)
    _weigh(rec, np.uint64(order[f]) * np.uint64(16), ready, _place_of(np.uint64(f)))
    for c in range(64):
        s = np.uint64(f + starts[b, c])
        e = np.uint64(f + starts[b, c + 1])
        if s == e:
            continue
        rows = _nothing(rec)
        a = 3 * (c >> 2)
        east = planes[b, a + 1]
        north = planes[b, a + 2]
        limit = cut + planes[b, a] - real(c & 3)
        low = near and real(0.5) - _highest_rise(east, north) <= limit
        for t in range(s, e):
            p = np.uint64(order[t])
            prefetch(rec, np.uint64(order[t + np.uint64(AHEAD)]) * np.uint64(16))
            _weigh(rec, np.uint64(order[t + np.uint64(1)]) * np.uint64(16), ready, _place_of(t + np.uint64(1)))
            rows = _scatter(rec, p * np.uint64(16), ready, _place_of(t), rows)
            if low:
                listed[f + n] = np.int32(p)
                n += rec[p, 12] - east * rec[p, 4] - north * rec[p, 8] <= limit
        _add_rows(arena, _first_node(c), rows)
    return n


def particles_to_arenas(rec, order, starts, first, giving, nown, number, arenas, reached):
    """Each block whose particles give to nodes adds them to its own arena; ``reached`` are the parts of it that they reach."""
    for b in prange(nown):
        reached[b] = 0
        if giving[b] > 0:
            reached[b] = _reached_parts(starts, b)
            _fill_arena(rec, order, starts, first, b, arenas[number[b]], False, rec, real(0.0), order)


def _find_arenas(place, arenas, number, reached, down, block):
    """Where the up to eight arenas begin that reach a node block; whether any does.

    For the others stands the last arena, which is empty: where most are there, to add it takes less than to ask.
    """
    found = False
    for q in range(8):
        b = down[block, q]
        here = b >= 0 and (reached[b] >> q) & 1 != 0
        place[q] = arenas.shape[1] * (np.int64(number[b]) if here else len(arenas) - 1)
        found = found or here
    return found


def _strip_of_nodes(s, strips, nown, nall):
    """Blocks of nodes of strip ``s``: first owner, number of owners, first of the others, number of all.

    Those that are no owners are few and sum little: each strip gets as many, so that threads get as much to do.
    """
    low = s * STRIP
    more = (nall - nown) * s // strips
    own = min(STRIP, nown - low)
    return low, own, nown + more, own + (nall - nown) * (s + 1) // strips - more


def _row_of_arena(arenas, a, upper, x, y):
    """Four nodes of row (x, y) of the arena at place ``a``; the ``upper`` two of six come first, and then nothing."""
    row = a + x * PLANE + y * ROW
    if upper:
        return widened(load8(arenas, row + 16))
    return load16(arenas, row)


def _row_of_shares(shares, a, upper, x, y):
    """The same of an arena with one number a node."""
    row = a + x * PLANE_OF_SHARES + y * ROW_OF_SHARES
    if upper:
        return lower_two(load4(shares, row + 4))
    return load4(shares, row)


def _sum_row(arenas, place, i, j):
    """Sum of the arenas over four nodes in the order of their blocks."""
    s = zeros(arenas)
    for q in range(8):
        x = i + (q & 4)
        y = j + ((q & 2) << 1)
        if x < 6 and y < 6:
            s = s + _row_of_arena(arenas, place[q], q & 1, x, y)
    return s


def _sum_shares(shares, place, i, j):
    """The same of the contacts' weights, one number a node; of the eight most are not there, and are asked for."""
    s = four_zeros(shares)
    empty = shares.shape[1] * (len(shares) - 1)
    for q in range(8):
        x = i + (q & 4)
        y = j + ((q & 2) << 1)
        if place[q] != empty and x < 6 and y < 6:
            s = s + _row_of_shares(shares, place[q], q & 1, x, y)
    return s


def _sum_both(arenas, place, shares, sharing, i, j):
    """Both sums, where the same blocks have an arena and shares: one test for each."""
    s = zeros(arenas)
    w = four_zeros(shares)
    empty = shares.shape[1] * (len(shares) - 1)
    for q in range(8):
        x = i + (q & 4)
        y = j + ((q & 2) << 1)
        if sharing[q] != empty and x < 6 and y < 6:
            s = s + _row_of_arena(arenas, place[q], q & 1, x, y)
            w = w + _row_of_shares(shares, sharing[q], q & 1, x, y)
    return s, w


def _inverse(s):
    """One over each of four masses [1/kg], zero where there is none."""
    m = heads(s)
    filled = m > four_least_masses(m)
    return select(filled, four_ones(m) / select(filled, m, four_ones(m)), four_zeros(m))


def _node_velocities(s, inverse, dv):
    """Mass and velocity of four nodes from their mass and momentum; without mass they rest."""
    v = velocity_after(load16(dv, 0), s, in_all_four(inverse))
    return select(masses(s) > least_masses(s), v, zeros(s))


def update_nodes(arenas, number, reached, down, nall, grid, dv):
    """Mass and velocity of every node that particles reach, after internal forces and gravity; without mass it rests."""
    strips = (len(number) + STRIP - 1) // STRIP
    for strip in prange(strips):
        low, own, other, n = _strip_of_nodes(strip, strips, len(number), nall)
        for k in range(n):
            b = low + k if k < own else other + k - own
            place = local_places(down)
            if not _find_arenas(place, arenas, number, reached, down, b):
                continue
            for i in range(4):
                for j in range(4):
                    s = _sum_row(arenas, place, i, j)
                    v = _node_velocities(s, _inverse(s), dv)
                    store(grid, b * 256 + (i * 4 + j) * 16, heads_and_tails(s, v))


def update_nodes_over_ground(arenas, number, reached, shares, sharer, pressed, down, nall, grid, shared, dv):
    """The same; where the stencil of a contact reaches, the sum of the contacts' weights over the mass in the place of the mass.

    ``shares`` are arenas with these weights, ``pressed`` their parts that are reached; ``shared`` (nall,) tells which blocks of
    nodes any does.
    """
    strips = (len(number) + STRIP - 1) // STRIP
    for strip in prange(strips):
        low, own, other, n = _strip_of_nodes(strip, strips, len(number), nall)
        for k in range(n):
            b = low + k if k < own else other + k - own
            shared[b] = False
            place = local_places(down)
            if not _find_arenas(place, arenas, number, reached, down, b):
                continue
            sharing = local_places(down)
            shared[b] = _find_arenas(sharing, shares, sharer, pressed, down, b)
            for i in range(4):
                for j in range(4):
                    s = _sum_row(arenas, place, i, j)
                    inverse = _inverse(s)
                    v = _node_velocities(s, inverse, dv)
                    if shared[b]:
                        s = in_all_four(_sum_shares(shares, sharing, i, j) * inverse)
                    store(grid, b * 256 + (i * 4 + j) * 16, heads_and_tails(s, v))


def apply_impulses(arenas, number, shares, sharer, pressed, shared, down, nall, grid):
    """Add the impulses to the velocities of the nodes that contacts reach.

    One over the mass is what :func:`update_nodes_over_ground` has left, over the sum of weights: to add that again takes no longer
    than to keep it.
    """
    strips = (len(number) + STRIP - 1) // STRIP
    for strip in prange(strips):
        low, own, other, n = _strip_of_nodes(strip, strips, len(number), nall)
        for k in range(n):
            b = low + k if k < own else other + k - own
            if not shared[b]:
                continue
            place = local_places(down)
            sharing = local_places(down)
            _find_arenas(place, arenas, number, pressed, down, b)
            _find_arenas(sharing, shares, sharer, pressed, down, b)
            for i in range(4):
                for j in range(4):
                    o = b * 256 + (i * 4 + j) * 16
                    node = load16(grid, o)
                    push, w = _sum_both(arenas, place, shares, sharing, i, j)
                    felt = w > four_zeros(w)
                    inverse = select(felt, heads(node) / select(felt, w, four_ones(w)), four_zeros(w))
                    store(grid, o, velocity_after(node, push, in_all_four(inverse)))
