"""Particles of each cell: counts, the list, and the order in memory."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.layout import (
    AT_ONCE,
    BLOCKS,
    CELL_LANES,
    CLEARING,
    HALT,
    HOMES,
    LEFT,
    NEXT,
    NOT_NEGATIVE,
    STARTS,
    Ints,
    Longs,
    Nodes,
    Reals,
    Shorts,
    Table2,
    lane_count,
    node4,
    own_block,
    own_lane,
    put_node,
)
from runout.backends.hash.stencil import _cell_entry, _cell_of
from runout.physics.tensors import real

next_four: Any = None  # adds one to each of four counts and tells what they were before; the binding puts it in its place
warp_lanes: Any = None  # threads that go together; likewise
sum_before: Any = None  # sums over the lanes before a lane, and over all; likewise


def count_blocks(cstart: Table2, totals: Ints):
    """Particles of each block."""
    b = wp.tid()
    total = int(0)
    for c in range(64):
        total += cstart[b, c + 1]
    totals[b] = total


def _list_block(b: int, lane: int, totals: Ints, given: int, cstart: Table2, active: Ints, both: Longs):
    """Places of the first particles of a block's cells, each in the place of the next cell, where these were counted.

    Each lane has some cells in a row. ``both`` counts places and blocks at once: all blocks wait for it.
    """
    each = CELL_LANES // lane_count()
    mine = int(0)
    for q in range(each):
        mine += cstart[b, each * lane + q + 1]
    sums = sum_before(mine)
    total = sums[1]
    start = int(0)
    if lane == 0:
        if total > 0:
            one = wp.int64(1) << wp.int64(32)
            if given != 0:
                start = int(totals[b])
                active[int(wp.atomic_add(both, 0, one) >> wp.int64(32))] = b
            else:
                before_all = wp.atomic_add(both, 0, one + wp.int64(total))
                start = int(before_all & wp.int64(NOT_NEGATIVE))
                active[int(before_all >> wp.int64(32))] = b
        cstart[b, 0] = start
    if total > 0:
        place = sums[0] + sum_before(start)[1]
        for q in range(each):
            n = int(cstart[b, each * lane + q + 1])
            cstart[b, each * lane + q + 1] = place
            place += n


def list_cells(
    flags: Ints, totals: Ints, given: int, cstart: Table2, active: Ints, both: Longs, tally: Ints, grounded: Ints,
    touching: Ints, grid: Nodes, contact: Nodes, launched: int,
):  # fmt: skip
    """Where the cells start in the list of particles, which blocks hold any; and nodes without mass for the next step.

    With ``given``, ``totals`` are the sums over the blocks before; else each block takes the next free stretch, in no fixed order.
    """
    first, lane = wp.tid()
    first, lane = own_block(first), own_lane(lane)
    if flags[HALT] != 0:
        return
    for b in range(first, tally[BLOCKS], launched):
        _list_block(b, lane, totals, given, cstart, active, both)
        if lane == 0:
            touching[b] = 0
        for c in range(lane, CELL_LANES, lane_count()):
            put_node(grid, b * CELL_LANES + c, node4())
            if grounded[b] >= 0:
                put_node(contact, grounded[b] * CELL_LANES + c, node4())


def _entry_of(key: Ints, p: int):
    """Where the particle at a place is counted; -1 if there is none."""
    if p >= key.shape[0]:
        return -1
    k = key[p]
    return wp.where(k >= 0, _cell_entry(k), -1)


def place_particles(flags: Ints, key: Ints, ends: Ints, order: Ints):
    """List the particles of each cell; the start of each cell, in the place of the next, moves on to its end as it fills.

    A thread takes four particles, which wait for memory together; those of a warp are neighbours each time.
    """
    t = wp.tid()
    lanes = warp_lanes()
    p = AT_ONCE * t - (AT_ONCE - 1) * (t % lanes)
    entries = wp.vec4i()
    for q in range(AT_ONCE):
        entries[q] = _entry_of(key, p + q * lanes)
    if flags[HALT] == 0:
        places = next_four(ends, entries)
        for q in range(AT_ONCE):
            if entries[q] >= 0:
                order[places[q]] = p + q * lanes


def sort_cells(flags: Ints, tally: Ints, active: Ints, number: Ints, cstart: Table2, order: Ints):
    """Bring the particles of each cell into the order of their numbers: atomic ranks come in any order."""
    i = wp.tid()
    if flags[HALT] != 0 or (i >> 6) >= tally[NEXT]:
        return
    t = active[i >> 6] * CELL_LANES + (i & 63)
    first = cstart[t >> 6, t & 63]
    for k in range(first + 1, cstart[t >> 6, (t & 63) + 1]):
        p = order[k]
        j = int(k)
        while j > first and number[order[wp.max(j - 1, first)]] > number[p]:
            order[j] = order[j - 1]
            j = j - 1
        order[j] = p


def gather_reals(flags: Ints, source: Reals, order: Ints, totals: Ints, target: Reals):
    """Numbers in the order of the list, four a thread under way at once; as many as the last of ``totals`` tells."""
    t = wp.tid()
    count = totals[totals.shape[0] - 1]
    threads = (count + 3) >> 2
    if flags[HALT] != 0 or t >= threads:
        return
    last = count - 1
    p0 = order[t] & NOT_NEGATIVE
    p1 = order[wp.min(t + threads, last)] & NOT_NEGATIVE
    p2 = order[wp.min(t + 2 * threads, last)] & NOT_NEGATIVE
    p3 = order[wp.min(t + 3 * threads, last)] & NOT_NEGATIVE
    x0 = source[p0]
    x1 = source[p1]
    x2 = source[p2]
    x3 = source[p3]
    target[t] = x0
    target[wp.min(t + threads, last)] = x1
    target[wp.min(t + 2 * threads, last)] = x2
    target[wp.min(t + 3 * threads, last)] = x3


def bring_back_reals(flags: Ints, source: Reals, totals: Ints, target: Reals):
    """Numbers from the place where they were gathered, unless the sort waits for room."""
    t = wp.tid()
    if flags[HALT] == 0 and t < totals[totals.shape[0] - 1]:
        target[t] = source[t]


def gather_ints(flags: Ints, source: Ints, order: Ints, totals: Ints, target: Ints):
    """Integers in the order of the cells."""
    t = wp.tid()
    if flags[HALT] == 0 and t < totals[totals.shape[0] - 1]:
        target[t] = source[order[t]]


def bring_back_ints(flags: Ints, source: Ints, totals: Ints, target: Ints):
    """Integers from the place where they were gathered, unless the sort waits for room."""
    t = wp.tid()
    if flags[HALT] == 0 and t < totals[totals.shape[0] - 1]:
        target[t] = source[t]


def gather_shorts(flags: Ints, source: Shorts, order: Ints, totals: Ints, target: Shorts):
    """Small integers in the order of the cells."""
    t = wp.tid()
    if flags[HALT] == 0 and t < totals[totals.shape[0] - 1]:
        target[t] = source[order[t]]


def bring_back_shorts(flags: Ints, source: Shorts, totals: Ints, target: Shorts):
    """Small integers from the place where they were gathered, unless the sort waits for room."""
    t = wp.tid()
    if flags[HALT] == 0 and t < totals[totals.shape[0] - 1]:
        target[t] = source[t]


def renumber(
    flags: Ints, tally: Ints, active: Ints, cstart: Table2, totals: Ints, counts: Ints, homes: Ints, home: Table2, order: Ints,
    key: Ints, approach_speeds: Reals, launched: int,
):  # fmt: skip
    """Particles lie as the list tells: what is listed and in which cell, and where those of each block begin and end.

    ``counts`` is told how many there are in all, the last of ``totals``; ``approach_speeds`` that nobody knows how fast those of a
    block are.
    """
    first, lane = wp.tid()
    first, lane = own_block(first), own_lane(lane)
    if flags[HALT] != 0:
        return
    if first == 0 and lane == 0:
        tally[HOMES] = tally[NEXT]
        counts[LEFT] = totals[totals.shape[0] - 1]
    for a in range(first, tally[NEXT], launched):
        b = active[a]
        if lane == 0:
            homes[a] = b
            approach_speeds[2 * b] = real(wp.inf)  # to the next step
            home[b, 0] = cstart[b, 0]
            home[b, 1] = cstart[b, CELL_LANES]
        starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
        for q in range((STARTS + lane_count() - 1) // lane_count()):
            c = q * lane_count() + lane
            wp.tile_scatter_masked(starts, c, cstart[b, wp.min(c, CELL_LANES)], c < STARTS)
        for t in range(int(starts[0]) + lane, int(starts[CELL_LANES]), lane_count()):
            order[t] = t
            key[t] = b * CELL_LANES + _cell_of(starts, t)


def clear_beyond(flags: Ints, totals: Ints, key: Ints):
    """Places from the last of ``totals`` on hold no particle; some threads take turns, since they are few."""
    if flags[HALT] == 0:
        for t in range(totals[totals.shape[0] - 1] + wp.tid(), key.shape[0], CLEARING):
            key[t] = -1
