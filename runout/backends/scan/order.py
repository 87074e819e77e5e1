"""Order of the particles: slots of the blocks, lists by cell, exchange between blocks, and the rare move to fresh slots.

A block owns the slots first to first + room; ``order`` names the occupied ones by cell. Each step brings the particles of a
block into the order of its list (:mod:`runout.backends.scan.motion`); here those that change their cell or block are
listed anew. Blocks whose particles stay in their cells cost nothing.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import local_array
from runout.backends.scan.motion import LEFT

CELLS = 64
local_counts = local_array((CELLS + 1,))  # and those that leave


def _spacious(n):
    """Slots for ``n`` particles now and some that will come: a multiple of 16."""
    return (n + (n >> 5) + 19) & ~15


def count_arrivals(around, first, nown, movers, leaving, held, room, before, arrivals):
    """Number of particles that enter each block; returns how many fresh slots the blocks that overflow will need."""
    for b in prange(nown):
        before[b] = first[b]
        n = 0
        for q in range(27):
            s = around[b, q]
            if s < 0 or leaving[s] == 0:
                continue
            for t in range(leaving[s]):
                n += (movers[first[s] + t] >> 6) & 63 == 26 - q
        arrivals[b] = n
    needed = 0
    for b in range(nown):
        if held[b] + arrivals[b] > room[b]:
            needed += _spacious(held[b] + arrivals[b] + (held[b] >> 4) + 16)
    return needed


def make_room(nown, held, arrivals, first, room, end):
    """Give fresh slots from ``end`` on to the blocks that overflow; returns the new end."""
    for b in range(nown):
        if held[b] + arrivals[b] > room[b]:
            first[b] = end
            room[b] = _spacious(held[b] + arrivals[b] + (held[b] >> 4) + 16)
            end += room[b]
    return end


def _copy_slot(rec, state, who, cell, p, d, c):
    """Copy a particle to another slot, into cell ``c``."""
    for k in range(16):
        rec[d, k] = rec[p, k]
    for k in range(8):
        state[d, k] = state[p, k]
    who[d] = who[p]
    cell[d] = c


def _relocate(rec, state, who, cell, old, new, n):
    """Copy what stays in a block to fresh slots; returns their number."""
    kept = 0
    for p in range(old, old + n):
        if cell[p] < LEFT:
            _copy_slot(rec, state, who, cell, p, new + kept, cell[p])
            kept += 1
    return kept


def _receive(rec, state, who, cell, around, before, movers, leaving, b, end):
    """Copy the arrivals of a block to the slots from ``end`` on: the neighbours still read those that were left."""
    for q in range(27):
        s = around[b, q]
        if s < 0 or leaving[s] == 0:
            continue
        for t in range(leaving[s]):
            entry = movers[before[s] + t]
            if (entry >> 6) & 63 == 26 - q:
                _copy_slot(rec, state, who, cell, before[s] + (entry >> 12), end, entry & 63)
                end += 1
    return end


def _list_by_cell(cell, order, starts, b, first, end):
    """Sort the occupied slots of a block by cell; returns their number."""
    place = local_counts(starts)
    for c in range(CELLS + 1):
        place[c] = 0
    for p in range(np.uint64(first), np.uint64(end)):
        place[np.uint64(cell[p])] += 1
    total = 0
    for c in range(CELLS):
        n = place[c]
        place[c] = first + total
        starts[b, c] = total
        total += n
    starts[b, CELLS] = total
    for p in range(np.uint64(first), np.uint64(end)):
        c = np.uint64(cell[p])
        if c < np.uint64(CELLS):
            order[np.uint64(place[c])] = p
            place[c] += 1
    return total


def settle(
    rec, state, who, cell, order, starts, first, held, before, around, nown, movers, leaving, changed, arrivals
):
    """Let particles enter their new blocks, and list the blocks in which anything changed by cell."""
    for b in prange(nown):
        if arrivals[b] == 0 and not changed[b]:
            continue
        f = first[b]
        end = f + held[b]
        if f != before[b]:
            end = f + _relocate(rec, state, who, cell, before[b], f, held[b])
        if arrivals[b] > 0:
            end = _receive(rec, state, who, cell, around, before, movers, leaving, b, end)
        held[b] = _list_by_cell(cell, order, starts, b, f, end)


def plan_slots(old_bxyz_slot, old_starts, old_nown, starts, first, room, held, nown):
    """Slots of the blocks of a new index, each with some room; ``old_bxyz_slot`` (old_nown,) are the new numbers of blocks.

    Returns the end of the slots.
    """
    for b in prange(nown):
        held[b] = 0
        for c in range(CELLS + 1):
            starts[b, c] = 0
    for b in prange(old_nown):
        if old_starts[b, CELLS] > 0:
            d = old_bxyz_slot[b]
            held[d] = old_starts[b, CELLS]
            for c in range(CELLS + 1):
                starts[d, c] = old_starts[b, c]
    end = 0
    for b in range(nown):
        first[b] = end
        room[b] = _spacious(held[b]) if held[b] > 0 else 0
        end += room[b]
    return end


def gather_rows(values, order, old_starts, old_first, old_nown, numbers, first, sorted_values):
    """Rows of an array (slots, k) by cell in the slots of the new blocks."""
    width = values.shape[1]
    for b in prange(old_nown):
        if old_starts[b, CELLS] > 0:
            to = first[numbers[b]]
            for t in range(old_starts[b, CELLS]):
                p = order[old_first[b] + t]
                for k in range(width):
                    sorted_values[to + t, k] = values[p, k]


def copy_rows(values, first, held, nown, target):
    """The rows of all blocks back to where an array lives."""
    width = values.shape[1]
    for b in prange(nown):
        for p in range(first[b], first[b] + held[b]):
            for k in range(width):
                target[p, k] = values[p, k]


def mark_slots(starts, first, nown, cell, order):
    """Cells of the slots and their order once particles lie sorted by cell."""
    for b in prange(nown):
        for c in range(CELLS):
            for p in range(first[b] + starts[b, c], first[b] + starts[b, c + 1]):
                cell[p] = c
                order[p] = p
