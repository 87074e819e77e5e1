"""Order of the particles: slots of the blocks, lists by cell, exchange between blocks, rare moves to fresh slots.

A block owns the slots first to first + capacity; ``order`` names the occupied ones by cell. Each step brings the particles of a
block into the order of its list (:mod:`runout.backends.scan.grid_to_particles`); here those that change their cell or block are
listed anew. Blocks whose particles stay in their cells cost nothing.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import load8, load16, local_array, prefetch, store
from runout.backends.scan.arenas import _total_held
from runout.backends.scan.grid_to_particles import HERE, LEFT, OUTSIDE

CELLS = 64
CALLED = 8  # blocks that memory is asked for ahead, where little is to be done in each
LONGEST = 1023  # list of a block that is made anew from what changed, not by a sort
local_counts = local_array((CELLS + 1,))  # of cells and of those that leave
local_places = local_array((3, CELLS))
local_steps = local_array((LONGEST + 1,))


def _spacious(n):
    """Slots for ``n`` particles now and some that will come: a multiple of 16."""
    return (n + (n >> 5) + 19) & ~15


def _count_arrivals(around, first, nown, movers, leaving, held, capacity, before, arrivals):
    """Number of particles that enter each block; returns how many fresh slots the blocks that overflow will need.

    One thread counts: few particles leave their blocks, fewer than blocks have neighbours.
    """
    for b in range(nown):
        before[b] = first[b]
        arrivals[b] = 0
    for b in range(nown):
        if b + CALLED < nown:
            prefetch(movers, first[b + CALLED])
        for t in range(first[b], first[b] + leaving[b]):
            q = (movers[t] >> 6) & 63
            if q < OUTSIDE and around[b, q] >= 0:
                arrivals[around[b, q]] += 1
    needed = 0
    for b in range(nown):
        if held[b] + arrivals[b] > capacity[b]:
            needed += _spacious(held[b] + arrivals[b] + (held[b] >> 4) + 16)
    return needed


def _fill_hole(holes, n, needed):
    """First slot of the smallest of ``n`` holes that is large enough, and its size; -1 if there is none. Takes it off the list."""
    best = -1
    for k in range(n):
        if holes[k, 1] >= needed and (best < 0 or holes[k, 1] < holes[best, 1]):
            best = k
    if best < 0:
        return -1, 0
    start = holes[best, 0]
    size = holes[best, 1]
    if size >= 2 * needed:
        holes[best, 0] += needed
        holes[best, 1] -= needed
        return start, needed
    holes[best, 1] = 0
    return start, size


def _leave_hole(holes, n, start, size):
    """Put slots on the list, if it has room; returns its new length."""
    if size > 0 and n < len(holes):
        holes[n, 0] = start
        holes[n, 1] = size
        return n + 1
    return n


def _drop_filled(holes, n):
    """Close up the list; returns its new length."""
    kept = 0
    for k in range(n):
        if holes[k, 1] > 0:
            holes[kept, 0] = holes[k, 0]
            holes[kept, 1] = holes[k, 1]
            kept += 1
    return kept


def _make_room(nown, held, arrivals, first, capacity, end, holes, n):
    """Fresh slots for the blocks that overflow: in one of ``n`` holes, else from ``end`` on; returns the new end and ``n``.

    What they leave becomes a hole for later steps: neighbours read there in this one.
    """
    for b in range(nown):
        if held[b] + arrivals[b] == 0 and capacity[b] > 0:
            n = _leave_hole(holes, n, first[b], capacity[b])
            capacity[b] = 0
    free = n
    for b in range(nown):
        if held[b] + arrivals[b] > capacity[b]:
            needed = _spacious(held[b] + arrivals[b] + (held[b] >> 4) + 16)
            n = _leave_hole(holes, n, first[b], capacity[b])
            start, size = _fill_hole(holes, free, needed)
            if start < 0:
                start = end
                size = needed
                end += needed
            first[b] = start
            capacity[b] = size
    return end, _drop_filled(holes, n)


def make_way(around, first, nown, movers, leaving, held, capacity, before, arrivals, end, slots, holes, n):
    """Count arrivals and find room for them, unless ``slots`` are too few; returns the fresh slots needed, ``end`` and ``n``."""
    needed = _count_arrivals(around, first, nown, movers, leaving, held, capacity, before, arrivals)
    if end + needed <= slots:
        end, n = _make_room(nown, held, arrivals, first, capacity, end, holes, n)
    return needed, end, n


def _copy_slot(rec, state, particle_index, cell, p, d, c):
    """Copy a particle to another slot, into cell ``c``."""
    store(rec, 16 * d, load16(rec, 16 * p))
    store(state, 8 * d, load8(state, 8 * p))
    particle_index[d] = particle_index[p]
    cell[d] = c


def _relocate(rec, state, particle_index, cell, old, new, n):
    """Copy what stays in a block to fresh slots; returns their number."""
    kept = 0
    for p in range(old, old + n):
        if cell[p] < LEFT:
            _copy_slot(rec, state, particle_index, cell, p, new + kept, cell[p])
            kept += 1
    return kept


def _expect(rec, state, particle_index, cell, around, before, movers, leaving, changed, b, end):
    """Ask for the memory of what a block will receive."""
    for q in range(27):
        s = around[b, q]
        if q == HERE or s < 0 or (changed[s] >> (26 - q)) & 1 == 0:
            continue
        for t in range(leaving[s]):
            entry = movers[before[s] + t]
            if (entry >> 6) & 63 == 26 - q:
                p = before[s] + (entry >> 12)
                prefetch(rec, 16 * p)
                prefetch(state, 8 * p)
                prefetch(particle_index, p)
                prefetch(rec, 16 * end)
                prefetch(state, 8 * end)
                prefetch(particle_index, end)
                prefetch(cell, end)
                end += 1


def _expect_lists(order, starts, movers, first, held, b):
    """Ask for the lists of a block."""
    for c in range(0, CELLS + 1, 16):
        prefetch(starts, (CELLS + 1) * b + c)
    f = first[b]
    for t in range(f, f + held[b], 16):
        prefetch(order, t)
    prefetch(movers, f)
    prefetch(movers, f + held[b] - 1)


def _receive(rec, state, particle_index, cell, around, before, movers, leaving, changed, b, end):
    """Copy the arrivals of a block to the slots from ``end`` on: the neighbours still read those that were left."""
    for q in range(27):
        s = around[b, q]
        if q == HERE or s < 0 or (changed[s] >> (26 - q)) & 1 == 0:
            continue
        for t in range(leaving[s]):
            entry = movers[before[s] + t]
            if (entry >> 6) & 63 == 26 - q:
                _copy_slot(rec, state, particle_index, cell, before[s] + (entry >> 12), end, entry & 63)
                end += 1
    return end


def _list_by_cell(cell, order, starts, b, first, end):
    """Sort the occupied slots of a block by cell; returns their number. What leaves comes last and is forgotten."""
    place = local_counts(starts)
    for c in range(CELLS + 1):
        place[c] = 0
    for p in range(first, end):
        place[min(cell[p], CELLS)] += 1
    total = first
    for c in range(CELLS + 1):
        starts[b, c] = total - first
        n = place[c]
        place[c] = total
        total += n
    for p in range(first, end):
        c = min(cell[p], CELLS)
        order[place[c]] = p
        place[c] += 1
    return starts[b, CELLS]


def _note_changes(steps, place, cell, starts, b, first, end, movers, leaving, shifted):
    """How far the list goes on behind each slot of a block, ``steps``; and in three rows of ``place``, by cell, what it gains,
    0, and less those that come from higher slots than what stays there.
    """
    held = starts[b, CELLS]
    for c in range(CELLS):
        place[0, c] = 0
        place[1, c] = 0
        place[2, c] = 0
    steps[0] = 0
    for t in range(np.uint64(held)):
        steps[t + np.uint64(1)] = 1
    for t in range(leaving):
        slot = movers[first + t] >> 12
        steps[slot + 1] -= 1
        place[0, cell[first + slot] - LEFT] -= 1
    for t in range(shifted):
        entry = movers[first + held - 1 - t]
        old = (entry >> 6) & 63
        c = entry & 63
        from_above = np.int64(old > c)
        steps[(entry >> 12) + 1] -= 1
        steps[starts[b, c + from_above]] += 1
        place[0, old] -= 1
        place[0, c] += 1
        place[2, c] -= from_above
    for p in range(first + held, end):
        steps[starts[b, cell[p] + 1]] += 1
        place[0, cell[p]] += 1
        place[2, cell[p]] -= 1


def _list_newcomers(place, cell, order, starts, b, first, held, end, movers, shifted):
    """Write those that are new in their cells to where the list has left room for them, by slot."""
    for t in range(shifted):
        entry = movers[first + held - 1 - t]
        c = entry & 63
        from_above = np.int64((entry >> 6) & 63 > c)
        order[first + starts[b, c + from_above] + place[1 + from_above, c]] = first + (entry >> 12)
        place[1 + from_above, c] += 1
    for p in range(first + held, end):
        c = np.int64(cell[p])
        order[first + starts[b, c + 1] + place[2, c]] = p
        place[2, c] += 1


def _list_anew(cell, order, starts, b, first, end, movers, leaving, shifted):
    """The same for a block whose particles lay in the order of their cells before this step, from those that changed theirs.

    Newcomers come from lower slots if they left a lower cell, else, as arrivals from other blocks do, from higher ones than
    what stayed: the list is that of a sort, without looking at its keys. Each slot is written to where the list has come to, and
    the next one over it if it was left: no processor could guess which were.
    """
    held = np.int64(starts[b, CELLS])
    steps = local_steps(starts)
    place = local_places(starts)
    _note_changes(steps, place, cell, starts, b, first, end, movers, leaving, shifted)
    n = held
    while n > 0 and steps[n] == 0:
        n -= 1
    to = np.int64(first + steps[0])
    for t in range(np.uint64(n)):
        order[np.uint64(to)] = np.uint64(first) + t
        to += steps[t + np.uint64(1)]
    gained = 0
    for c in range(CELLS):
        starts[b, c] += gained
        gained += place[0, c]
    starts[b, CELLS] += gained
    _list_newcomers(place, cell, order, starts, b, first, held, end, movers, shifted)
    return starts[b, CELLS]


def settle(
    rec, state, particle_index, cell, order, starts, first, held, before, around, nown, cuts, movers, leaving, shifted, changed,
    arrivals,
):  # fmt: skip
    """Let particles enter their new blocks, and list the blocks in which anything changed by cell.

    Returns the number of particles, and that in the fullest block.
    """
    for thread in prange(len(cuts) - 1):
        for b in range(np.uint64(cuts[thread]), np.uint64(cuts[thread + 1])):
            if b + 2 < nown and (arrivals[b + 2] > 0 or changed[b + 2] != 0):
                _expect_lists(order, starts, movers, first, held, np.int64(b) + 2)
            if b + 1 < nown and arrivals[b + 1] > 0:
                _expect(
                    rec, state, particle_index, cell, around, before, movers, leaving, changed, b + 1, first[b + 1] + held[b + 1]
                )
            if arrivals[b] == 0 and changed[b] == 0:
                continue
            f = first[b]
            end = f + held[b]
            moved = f != before[b]
            if moved:
                end = f + _relocate(rec, state, particle_index, cell, before[b], f, held[b])
            if arrivals[b] > 0:
                end = _receive(rec, state, particle_index, cell, around, before, movers, leaving, changed, b, end)
            if moved or starts[b, CELLS] > LONGEST:
                held[b] = _list_by_cell(cell, order, starts, b, f, end)
            else:
                held[b] = _list_anew(cell, order, starts, b, f, end, movers, leaving[b], shifted[b])
    return _total_held(held, nown)


def give_slots(held, first, capacity, nown):
    """Slots for blocks that hold particles, one block after the other; returns their number."""
    end = 0
    for b in range(nown):
        first[b] = end
        capacity[b] = _spacious(held[b]) if held[b] > 0 else 0
        end += capacity[b]
    return end


def hand_over_slots(numbers, old_starts, old_first, old_capacity, old_nown, starts, first, capacity, held):
    """Particles and slots of the old blocks that hold some, to their new ``numbers``: nothing is moved."""
    for b in prange(old_nown):
        if old_starts[b, CELLS] > 0:
            d = numbers[b]
            first[d] = old_first[b]
            capacity[d] = old_capacity[b]
            held[d] = old_starts[b, CELLS]
            for c in range(CELLS + 1):
                starts[d, c] = old_starts[b, c]


def _move_block(rec, state, particle_index, cell, order, starts, b, first, to, rec2, state2, who2):
    """Move the particles of a block, by cell, to the slots from ``to`` on, which may be some of its own; by a buffer."""
    for t in range(starts[b, CELLS]):
        p = np.int64(order[first + t])
        store(rec2, 16 * t, load16(rec, 16 * p))
        store(state2, 8 * t, load8(state, 8 * p))
        who2[t] = particle_index[p]
    for c in range(CELLS):
        for t in range(starts[b, c], starts[b, c + 1]):
            store(rec, 16 * (to + t), load16(rec2, 16 * t))
            store(state, 8 * (to + t), load8(state2, 8 * t))
            particle_index[to + t] = who2[t]
            cell[to + t] = c
            order[to + t] = to + t


def pack_slots(rec, state, particle_index, cell, order, starts, by_slot, first, capacity, held, rec2, state2, who2):
    """Close the gaps between the slots of the blocks ``by_slot`` that hold any, in place; returns the end of the slots.

    Each gets a room of the usual size. Who moves down goes in this order, and who moves up in the reverse one: so each finds its
    room left, and moves once. Who moves up has to lie below the next room first. ``rec2``, ``state2`` and ``who2`` have room for
    one block.
    """
    for b in range(len(held)):
        if held[b] == 0:
            capacity[b] = 0
    end = 0
    for b in by_slot:
        start = first[b]
        used = start + capacity[b]
        capacity[b] = _spacious(held[b])
        if end < start or end + capacity[b] < used:
            first[b] = min(end, start)
            _move_block(rec, state, particle_index, cell, order, starts, b, start, first[b], rec2, state2, who2)
        end += capacity[b]
    to = end
    for k in range(len(by_slot) - 1, -1, -1):
        b = by_slot[k]
        to -= capacity[b]
        if first[b] < to:
            _move_block(rec, state, particle_index, cell, order, starts, b, first[b], to, rec2, state2, who2)
            first[b] = to
    return end


def packed_end(held, nown):
    """Slots that the blocks need once they are packed."""
    end = 0
    for b in range(nown):
        end += _spacious(held[b]) if held[b] > 0 else 0
    return end


def mark_slots(starts, first, nown, cell, order):
    """Cells of the slots and their order once particles lie sorted by cell."""
    for b in prange(nown):
        for c in range(CELLS):
            for p in range(first[b] + starts[b, c], first[b] + starts[b, c + 1]):
                cell[p] = c
                order[p] = p
