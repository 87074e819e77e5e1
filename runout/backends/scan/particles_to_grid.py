"""Phase "particles to grid": mass and momentum of the particles are added to the nodes.

Each block adds its particles to an arena. Each node then sums the up to eight arenas that overlap it, in a fixed order. A node is
summed as soon as its arenas are complete and still in the cache; after that other blocks use these arenas
(:mod:`runout.backends.scan.schedule`).

    arenas.values[number[b]]     6 x 6 x 6 nodes that the particles of block b reach

       x = 0 .. 5                one plane of nodes   144 numbers
         y = 0 .. 5              one row of nodes      24 numbers
           z = 0 .. 5            one node               4 numbers  m | px py pz

       parts of an arena         q = 0: nodes 0 to 3 in x, y and z: those of block b itself
       along one axis            bit of the axis set (x 4, y 2, z 1): nodes 4 and 5: those of the next block up
       0 1 2 3 | 4 5

    grid.nodes[n]                4 x 4 x 4 nodes of node block n, z fastest, 4 numbers each:  m | vx vy vz

Bit q of ``reached[b]`` is set if the particles of block b reach part q. Parts that no particle reaches are neither summed nor
written; nodes there keep finite numbers, and their weight is zero.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import constant, lane_sum, load4, load8, load16, local_array, permutation, prefetch, select, store
from runout.backends.scan.schedule import STRIP
from runout.backends.scan.stencil import (
    AHEAD,
    ARENA,
    EVERY,
    PLANE,
    ROW,
    UPPER,
    _add_rows,
    _clear,
    _first_node,
    _next_filled,
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

LOWER = EVERY & ~UPPER
LEAST_MASS = 1e-37  # [kg] of a node that moves: the inverse of less overflows in float32; its weight to particles is as small
ROW_OF_SHARES, PLANE_OF_SHARES = 6, 36  # numbers in a row of six nodes, and in six rows, where a node has one number
SHARES = 232  # six planes and padding
PLAN = 16  # columns of nodes of a block
ROWS, SHARED, TOUCH, TAKEN, FREE = range(5)  # cursors of a thread: rows, shares, contacts, arenas, arenas free again
USES_AREA, DRAGS_COLUMN = False, False  # whether columns of nodes are summed (node_columns.py); the binding decides
masses = permutation(in_groups((0, 4, 8, 12)))
heads = permutation((0, 4, 8, 12))
least_masses, four_least_masses = constant([LEAST_MASS] * 16), constant([LEAST_MASS] * 4)
four_ones, four_zeros = constant([1.0] * 4), constant([0.0] * 4)
local_places = local_array((8,))
widened = permutation([*range(8), *[8] * 8])
lower_two = permutation((0, 1, 4, 4))
lower_half, upper_half = permutation(range(8)), permutation(range(8, 16))
lower_group, upper_group, four_times_first = permutation(range(4)), permutation(range(4, 8)), permutation((0, 0, 0, 0))


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


def _expect_next(rec, order, starts, first, held, bounds, b, end):
    """Prefetch the cells and the first particles of the next block before ``end`` that holds any."""
    later = _next_filled(held, b, end)
    if later < end:
        prefetch(bounds, 2 * later)
        for c in range(0, 65, 16):
            prefetch(starts, 65 * later + c)
        f = first[later]
        for t in range(0, AHEAD + 16, 16):
            prefetch(order, f + t)
        for t in range(AHEAD):  # nearly all lie in the order of their list
            prefetch(rec, 16 * (f + t))


def _fill_arena(rec, order, starts, first, b, parts, arenas, a, near, planes, cut, listed):
    """Add the particles of a block to the arena at place ``a``, of which they reach some ``parts``; returns how many it lists.

    Where the ground is ``near``, candidates for contact are listed: particles less than ``cut`` cells above the bound of the ground
    in their column of cells (:func:`ground.cut_tiles`). A cell that lies higher as a whole is not tested.
    """
    _clear(arenas, a, parts)
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
        k = 3 * (c >> 2)
        east = planes[b, k + 1]
        north = planes[b, k + 2]
        limit = cut + planes[b, k] - real(c & 3)
        low = near and real(0.5) - _highest_rise(east, north) <= limit
        for t in range(s, e):
            p = np.uint64(order[t])
            prefetch(rec, np.uint64(order[t + np.uint64(AHEAD)]) * np.uint64(16))
            _weigh(rec, np.uint64(order[t + np.uint64(1)]) * np.uint64(16), ready, _place_of(t + np.uint64(1)))
            rows = _scatter(rec, p * np.uint64(16), ready, _place_of(t), rows)
            if low:
                listed[f + n] = np.int32(p)
                n += rec[p, 12] - east * rec[p, 4] - north * rec[p, 8] <= limit
        _add_rows(arenas, a + _first_node(c), rows)
    return n


def _find_arenas(place, arenas, number, reached, down, block):
    """Set the places of the up to eight arenas that reach a node block; returns which do, as bits.

    The others get the place of the last arena, which is empty. Where most are filled, adding it costs less than a branch, which
    processors could not predict.
    """
    found = np.int64(0)
    last = np.int64(len(arenas) - 1)
    for q in range(8):
        b = np.int64(down[block, q])
        own = max(b, np.int64(0))
        here = (np.int64(reached[own]) >> q) & np.int64(b >= 0)
        place[q] = arenas.shape[1] * (last + here * (np.int64(number[own]) - last))
        found |= here << q
    return found


def _row_of_arena(arenas, a, upper, x, y):
    """Four nodes of row (x, y) of the arena at place ``a``; the ``upper`` two of six come first, and then nothing."""
    row = a + x * PLANE + y * ROW
    if upper:
        return widened(load8(arenas, row + 16))
    return load16(arenas, row)


def _row_of_shares(shares, a, upper, x, y):
    """The same row of an arena with one number a node."""
    row = a + x * PLANE_OF_SHARES + y * ROW_OF_SHARES
    if upper:
        return lower_two(load4(shares, row + 4))
    return load4(shares, row)


def _sum_row(arenas, place, i, j, first, step):
    """Sum of the arenas from ``first`` on in steps over four nodes in the order of their blocks."""
    s = zeros(arenas)
    for q in range(first, 8, step):
        x = i + (q & 4)
        y = j + ((q & 2) << 1)
        if x < 6 and y < 6:
            s = s + _row_of_arena(arenas, place[q], q & 1, x, y)
    return s


def _sum_all(arenas, place, there, i, j):
    """Sum over four nodes of all arenas that are ``there``, as bits; faster where all are of one half along z."""
    if there & UPPER == 0:
        return _sum_row(arenas, place, i, j, 0, 2)
    if there & LOWER == 0:
        return _sum_row(arenas, place, i, j, 1, 2)
    return _sum_row(arenas, place, i, j, 0, 1)


def _sum_filled(values, place, i, j, s, row_of):
    """Sum over four nodes of those of the eight arenas that are filled, from ``s`` on; ``row_of`` reads a row of an arena."""
    empty = values.shape[1] * (len(values) - 1)
    for q in range(8):
        x = i + (q & 4)
        y = j + ((q & 2) << 1)
        if place[q] != empty and x < 6 and y < 6:
            s = s + row_of(values, place[q], q & 1, x, y)
    return s


def _inverse(s):
    """One over each of four masses [1/kg], zero where there is none."""
    m = heads(s)
    filled = m > four_least_masses(m)
    return select(filled, four_ones(m) / select(filled, m, four_ones(m)), four_zeros(m))


def _node_velocities(s, inverse, before):
    """Velocity of four nodes from their mass and momentum, and what they have ``before`` these; without mass they rest."""
    v = velocity_after(before, s, in_all_four(inverse))
    return select(masses(s) > least_masses(s), v, zeros(s))


def _note_masses(grid, b, i, j, s):
    """Note the masses of four nodes of a block, where the scene needs them."""
    if len(grid.masses) > 0:
        store(grid.masses, b * 64 + (i * 4 + j) * 4, heads(s))


def _note_no_masses(grid, b):
    """The same for a block that no particle reaches, whose nodes are those of an earlier step."""
    if len(grid.masses) > 0:
        for n in range(0, 64, 16):
            store(grid.masses, b * 64 + n, zeros(grid.masses))


def _update_block(arenas, number, reached, down, b, grid, dv):
    """Mass and velocity of the nodes of a block, after internal forces and gravity; without mass they rest."""
    place = local_places(down)
    there = _find_arenas(place, arenas, number, reached, down, b)
    if there == 0:
        _note_no_masses(grid, b)
    if there:
        for i in range(4):
            for j in range(4):
                s = _sum_all(arenas, place, there, i, j)
                v = _node_velocities(s, _inverse(s), load16(dv, 0))
                _note_masses(grid, b, i, j, s)
                store(grid.nodes, b * 256 + (i * 4 + j) * 16, heads_and_tails(s, v))


def _sum_of_nodes(s):
    """Sum of the four numbers of each of four nodes along z."""
    s = lower_half(s) + upper_half(s)
    return lower_group(s) + upper_group(s)


def _update_block_over_ground(arenas, contacts, grid, columns, down, b, dv):
    """The same; where contacts reach, their compliance takes the place of the mass: sum of their weights over mass [1/kg].

    ``contacts.shares`` are arenas with these weights, ``grid.shared`` notes whether any contact reaches the block, and
    ``grid.inverse`` keeps the inverse mass [1/kg] of its nodes. ``columns`` get what the law of friction uses of them.
    """
    values, shares, shared = arenas.values, contacts.shares, grid.shared
    shared[b] = False
    place = local_places(down)
    there = _find_arenas(place, values, arenas.number, arenas.reached, down, b)
    if DRAGS_COLUMN:
        columns.filled[b] = there != 0
    if there == 0:
        _note_no_masses(grid, b)
        return
    sharing = local_places(down)
    shared[b] = _find_arenas(sharing, shares, contacts.sharer, contacts.pressed, down, b) != 0
    for i in range(4):
        for j in range(4):
            s = _sum_all(values, place, there, i, j)
            one_over = _inverse(s)
            _note_masses(grid, b, i, j, s)
            v = _node_velocities(s, one_over, load16(dv, 0))
            if DRAGS_COLUMN:
                moving = _sum_of_nodes(s)
                store(columns.moving, b * 64 + (i * 4 + j) * 4, moving + four_times_first(moving) * load4(dv, 0))
            if shared[b]:
                w = _sum_filled(shares, sharing, i, j, four_zeros(shares), _row_of_shares)
                felt = w > four_zeros(w)
                compliance = w * one_over
                kept = select(felt, compliance / select(felt, w, four_ones(w)), one_over)
                store(grid.inverse, b * 64 + (i * 4 + j) * 4, kept)
                s = in_all_four(compliance)
                if USES_AREA:
                    columns.weights[b, i * 4 + j] = lane_sum(w)
            store(grid.nodes, b * 256 + (i * 4 + j) * 16, heads_and_tails(s, v))


def _push_block(arenas, number, pressed, down, b, grid, columns):
    """Add the impulses to the velocities of the nodes of a block that contacts reach; the first number of an arena is the drag."""
    nodes = grid.nodes
    place = local_places(down)
    _find_arenas(place, arenas, number, pressed, down, b)
    for i in range(4):
        for j in range(4):
            o = b * 256 + (i * 4 + j) * 16
            push = _sum_filled(arenas, place, i, j, zeros(arenas), _row_of_arena)
            one_over = load4(grid.inverse, b * 64 + (i * 4 + j) * 4)
            v = load16(nodes, o)
            store(nodes, o, heads_and_tails(v, velocity_after(v, push, in_all_four(one_over))))
            if DRAGS_COLUMN:
                store(columns.pushed, b * 64 + (i * 4 + j) * 4, _sum_of_nodes(push))


def _strip_of(owner):
    """The first strip that begins at or after an owner."""
    return (owner + STRIP - 1) // STRIP


def _start(cursors):
    """Set all counters of the threads to zero."""
    for t in range(len(cursors)):
        for k in range(cursors.shape[1]):
            cursors[t, k] = 0


def _take_arena(cursors, thread, free):
    """Number of an arena for the ``thread``: the one that became free last, which is in the cache, or a new one of the thread."""
    capacity = free.shape[1]
    n = cursors[thread, FREE]
    if n > 0:
        cursors[thread, FREE] = n - 1
        return free[thread, n - 1]
    n = cursors[thread, TAKEN]
    cursors[thread, TAKEN] = n + 1
    return np.int32(thread * capacity + min(n, capacity - 1))


def _leave_arenas(schedule, arenas, thread, s, held, number):
    """Add the arenas that are free after strip ``s`` to the list of the thread: ``number`` of the owners with ``held`` > 0."""
    free = arenas.free
    n = arenas.cursors[thread, FREE]
    for k in range(schedule.over[s], schedule.over[s + 1]):
        owner = schedule.owners[k]
        if held[owner] > 0 and n < free.shape[1]:
            free[thread, n] = number[owner]
            n += 1
    arenas.cursors[thread, FREE] = n


def _most_of(cursors, what):
    """Most that a thread needs of something."""
    most = 0
    for t in range(len(cursors)):
        most = max(most, cursors[t, what])
    return most


def particles_to_nodes(particles, blocks, schedule, arenas, grid, dv):
    """Fill an arena for each block with particles, and sum the nodes that are due.

    The nodes of the ``grid`` get mass and velocity. Returns the number of arenas that a thread needs; if it has fewer, the result
    is invalid.
    """
    rec, order, starts, first, held = particles.rec, particles.order, blocks.starts, blocks.first, blocks.held
    values, cursors = arenas.values, arenas.cursors
    number = arenas.number
    reached = arenas.reached
    _start(cursors)
    for cut in prange(len(schedule.cuts) - 1):
        thread = np.uint64(cut)
        for s in range(_strip_of(schedule.cuts[thread]), _strip_of(schedule.cuts[thread + 1])):
            for b in range(STRIP * s, min(STRIP * s + STRIP, schedule.nown)):
                reached[b] = 0
                if held[b] > 0:
                    reached[b] = _reached_parts(starts, b)
                    number[b] = _take_arena(cursors, thread, arenas.free)
                    a = ARENA * np.int64(number[b])
                    _expect_next(rec, order, starts, first, held, rec, b, schedule.nown)
                    _fill_arena(rec, order, starts, first, b, reached[b], values, a, False, rec, real(0.0), order)
            for k in range(schedule.due[s], schedule.due[s + 1]):
                _update_block(values, number, reached, blocks.down, np.int64(schedule.nodes[k]), grid, dv)
            _leave_arenas(schedule, arenas, thread, s, held, number)
    return _most_of(cursors, TAKEN)
