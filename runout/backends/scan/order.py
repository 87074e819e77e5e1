"""Order of the particles: slots of the blocks, lists by cell, exchange between blocks, and the rare move to fresh slots.

A block owns the slots first to first + room; ``order`` names the occupied ones by cell. A particle that changes its cell
stays in its slot; one that changes its block is copied to a free slot there. Blocks whose particles stay in their
cells cost nothing.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import local_array
from runout.backends.scan.motion import DEAD

CELLS = 64
local_counts = local_array((CELLS,))


def _spacious(n):
    """Slots for ``n`` particles now and some that will come: a multiple of 16."""
    return (n + (n >> 4) + 23) & ~15


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
            needed += _spacious(held[b] + arrivals[b] + (held[b] >> 3) + 16)
    return needed


def make_room(nown, held, arrivals, first, room, end):
    """Give fresh slots from ``end`` on to the blocks that overflow; returns the new end."""
    for b in range(nown):
        if held[b] + arrivals[b] > room[b]:
            first[b] = end
            room[b] = _spacious(held[b] + arrivals[b] + (held[b] >> 3) + 16)
            end += room[b]
    return end


def _copy_slot(rec, state, radius, label, p, rec2, state2, radius2, label2, d):
    for k in range(16):
        rec2[d, k] = rec[p, k]
    for k in range(8):
        state2[d, k] = state[p, k]
    radius2[d, 0] = radius[p, 0]
    label2[d, 0] = label[p, 0]
    label2[d, 1] = label[p, 1]


def _relocate(rec, state, radius, label, cell, old, new, extent):
    """Copy what stays in a block to fresh slots; returns their number."""
    n = 0
    for p in range(old, old + extent):
        if cell[p] < DEAD:
            _copy_slot(rec, state, radius, label, p, rec, state, radius, label, new + n)
            cell[new + n] = cell[p]
            n += 1
    return n


def _receive(rec, state, radius, label, cell, around, before, movers, leaving, b, first, extent):
    """Copy the arrivals of a block to its free slots; returns the slots in use.

    Slots that particles left in this step are still read by the neighbours: they are free from the next step on.
    """
    free = 0
    for q in range(27):
        s = around[b, q]
        if s < 0 or leaving[s] == 0:
            continue
        for t in range(leaving[s]):
            entry = movers[before[s] + t]
            if (entry >> 6) & 63 != 26 - q:
                continue
            while free < extent and cell[first + free] != DEAD:
                free += 1
            extent = max(extent, free + 1)
            _copy_slot(rec, state, radius, label, before[s] + (entry >> 12), rec, state, radius, label, first + free)
            cell[first + free] = entry & 63
    return extent


def _list_by_cell(cell, order, starts, b, first, extent):
    """Sort the occupied slots of a block by cell; slots that were left become free."""
    place = local_counts(starts)
    for c in range(CELLS):
        place[c] = 0
    for p in range(np.uint64(first), np.uint64(first + extent)):
        c = np.uint64(cell[p])
        if c < np.uint64(DEAD):
            place[c] += 1
        else:
            cell[p] = DEAD
    total = 0
    for c in range(CELLS):
        n = place[c]
        place[c] = first + total
        starts[b, c] = total
        total += n
    starts[b, CELLS] = total
    for p in range(np.uint64(first), np.uint64(first + extent)):
        c = np.uint64(cell[p])
        if c < np.uint64(DEAD):
            order[place[c]] = p
            place[c] += 1
    return total


def settle(
    rec, state, radius, label, cell, order, starts, first, room, extent, held, before, around, nown, movers, leaving,
    changed, arrivals,
):  # fmt: skip
    """Let particles enter their new blocks, and list the blocks in which anything changed by cell."""
    for b in prange(nown):
        if arrivals[b] == 0 and not changed[b]:
            continue
        f = first[b]
        n = extent[b]
        if f != before[b]:
            n = _relocate(rec, state, radius, label, cell, before[b], f, n)
        if arrivals[b] > 0:
            n = _receive(rec, state, radius, label, cell, around, before, movers, leaving, b, f, n)
        extent[b] = n
        held[b] = _list_by_cell(cell, order, starts, b, f, n)


def plan_slots(old_bxyz_slot, old_starts, old_nown, starts, first, room, extent, held, nown):
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
        extent[b] = held[b]
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


def mark_slots(starts, first, room, nown, cell, order):
    """Cells of the slots and their order once particles lie sorted by cell."""
    for b in prange(nown):
        f = first[b]
        for c in range(CELLS):
            for p in range(f + starts[b, c], f + starts[b, c + 1]):
                cell[p] = c
                order[p] = p
        for p in range(f + starts[b, CELLS], f + room[b]):
            cell[p] = DEAD
