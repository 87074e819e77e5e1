"""Particles to grid: every block fills an arena, then every node sums the arenas that overlap it in a fixed order."""

import numpy as np
from numba import prange

from runout.backends.lanes import constant, load8, load16, local_array, permutation, prefetch, select, store
from runout.backends.scan.stencil import (
    AHEAD,
    ARENA,
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
    in_groups,
    local_weights,
    zeros,
)
from runout.physics.moments import node_velocity
from runout.physics.tensors import real

masses = permutation(in_groups((0, 4, 8, 12)))
ones = constant([1.0] * 16)
local_places = local_array((8,))
widened = permutation([*range(8), *[8] * 8])


def _fill_arena(rec, order, starts, first, b, arena, near, planes, cut, listed):
    """Add the particles of a block to its arena; where the ground is ``near``, list those that may touch it, and return how many.

    They are less than ``cut`` cells above the bound of the ground in their column of cells (:func:`ground.cut_tiles`): while
    lanes are busy, a test of all of them costs less than finding the cells that need it.
    """
    _clear(arena)
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
        for t in range(s, e):
            p = np.uint64(order[t])
            prefetch(rec, np.uint64(order[t + np.uint64(AHEAD)]) * np.uint64(16))
            _weigh(rec, np.uint64(order[t + np.uint64(1)]) * np.uint64(16), ready, _place_of(t + np.uint64(1)))
            rows = _scatter(rec, p * np.uint64(16), ready, _place_of(t), rows)
            if near:
                bound = planes[b, a] + planes[b, a + 1] * rec[p, 4] + planes[b, a + 2] * rec[p, 8]
                listed[f + n] = order[t]
                n += real(c & 3) + rec[p, 12] - bound <= cut
        _add_rows(arena, _first_node(c), rows)
    return n


def particles_to_arenas(rec, order, starts, first, giving, nown, number, arenas):
    """Each block whose particles give to nodes adds them to its own arena."""
    for b in prange(nown):
        if giving[b] > 0:
            _fill_arena(rec, order, starts, first, b, arenas[number[b]], False, rec, real(0.0), order)


def _find_arenas(place, number, filled, down, block):
    """Where the up to eight arenas begin that overlap a node block and hold something, -1 for the others; whether any does."""
    found = False
    for q in range(8):
        b = down[block, q]
        here = b >= 0 and filled[b] > 0
        place[q] = number[b] * ARENA if here else -1
        found = found or here
    return found


def _sum_row(arenas, place, i, j):
    """Sum of the arenas over four nodes in the order of their blocks."""
    s = zeros(arenas)
    for q in range(8):
        x = i + (q & 4)
        y = j + ((q & 2) << 1)
        if place[q] >= 0 and x < 6 and y < 6:
            a = place[q] + x * PLANE + y * ROW
            if q & 1:
                s = s + widened(load8(arenas, a + 16))
            else:
                s = s + load16(arenas, a)
    return s


def update_nodes(arenas, number, held, down, nall, grid, dv):
    """Mass and velocity of every node that particles reach, after internal forces and gravity; without mass it rests."""
    for b in prange(nall):
        place = local_places(held)
        if not _find_arenas(place, number, held, down, b):
            continue
        for i in range(4):
            for j in range(4):
                s = _sum_row(arenas, place, i, j)
                m = masses(s)
                filled = m > zeros(s)
                v = select(filled, node_velocity(s, select(filled, m, ones(s)), load16(dv, 0)), zeros(s))
                store(grid, b * 256 + (i * 4 + j) * 16, heads_and_tails(s, v))
