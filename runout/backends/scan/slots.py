"""Slots of the blocks: their size, holes between them, and their order in memory.

    slots        | block 4: held | free |   hole   | block 0: held | free | block 9: ... |  reserve  |
                 ^ first[4]              capacity[4] slots in all
    order        slots of the particles of a block by cell:   cell 0   | cell 1 | ... | cell 63
                                                   first + starts[b, 0]  ...            first + starts[b, 64]

A block that overflows moves to a hole or to the end of the slots. Gaps are closed in place.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import load8, load16, store

CELLS = 64


def _spacious(n):
    """Slots for ``n`` particles and some that will come: a multiple of 16."""
    return (n + (n >> 5) + 19) & ~15


def _fill_hole(holes, n, needed):
    """Take the smallest hole, of ``n``, that is large enough off the list; returns first slot and size, or -1 and 0."""
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
    """Add slots to the list of holes, if it has room; returns its new length."""
    if size > 0 and n < len(holes):
        holes[n, 0] = start
        holes[n, 1] = size
        return n + 1
    return n


def _drop_filled(holes, n):
    """Remove the filled holes from the list; returns its new length."""
    kept = 0
    for k in range(n):
        if holes[k, 1] > 0:
            holes[kept, 0] = holes[k, 0]
            holes[kept, 1] = holes[k, 1]
            kept += 1
    return kept


def _make_room(blocks, arrivals, end, holes, n):
    """Give fresh slots to blocks that overflow: in one of ``n`` holes, else from ``end`` on; returns the new ``end`` and ``n``.

    The slots that a block leaves become a hole for later steps, because neighbours still read them in this step.
    """
    nown, held, first, capacity = blocks.nown, blocks.held, blocks.first, blocks.capacity
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


def give_slots(blocks):
    """Give slots to blocks that hold particles, one block after the other; returns the number of slots."""
    end = 0
    for b in range(blocks.nown):
        blocks.first[b] = end
        blocks.capacity[b] = _spacious(blocks.held[b]) if blocks.held[b] > 0 else 0
        end += blocks.capacity[b]
    return end


def hand_over_slots(old, numbers, new):
    """Give the particles and slots of the ``old`` blocks that hold some to the ``new`` blocks with their ``numbers``."""
    first = new.first
    capacity = new.capacity
    held = new.held
    starts = new.starts
    for b in prange(old.nown):
        if old.starts[b, CELLS] > 0:
            d = numbers[b]
            first[d] = old.first[b]
            capacity[d] = old.capacity[b]
            held[d] = old.starts[b, CELLS]
            for c in range(CELLS + 1):
                starts[d, c] = old.starts[b, c]


def _move_numbers(numbers, order, held, first, to, row):
    """The same for their pore pressure, through a ``row`` of the buffer."""
    for k in range(len(numbers)):
        for t in range(held):
            row[t] = numbers[k, order[first + t]]
        for t in range(held):
            numbers[k, to + t] = row[t]


def _move_block(particles, starts, b, first, to, buffers):
    """Move the particles of a block, by cell, to the slots from ``to`` on, which may be some of its own; through a buffer."""
    rec, state, particle_index = particles.rec, particles.state, particles.particle_index
    cell, order = particles.cell, particles.order
    _move_numbers(particles.pores, order, starts[b, CELLS], first, to, buffers.pores[0])
    records, states, labels = buffers.rec[0], buffers.state[0], buffers.particle_index[0]
    for t in range(starts[b, CELLS]):
        p = np.int64(order[first + t])
        store(records, 16 * t, load16(rec, 16 * p))
        store(states, 8 * t, load8(state, 8 * p))
        labels[t] = particle_index[p]
    for c in range(CELLS):
        for t in range(starts[b, c], starts[b, c + 1]):
            store(rec, 16 * (to + t), load16(records, 16 * t))
            store(state, 8 * (to + t), load8(states, 8 * t))
            particle_index[to + t] = labels[t]
            cell[to + t] = c
            order[to + t] = to + t


def pack_slots(particles, blocks, by_slot, buffers):
    """Close the gaps between the slots of the blocks ``by_slot`` that hold any, in place; returns the end of the slots.

    Each block gets a range of the usual size. Blocks that move down go in this order, blocks that move up in the reverse order: so
    each finds its range free, and moves once. A block that moves up has to lie below the next range first.
    """
    starts, first, capacity, held = blocks.starts, blocks.first, blocks.capacity, blocks.held
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
            _move_block(particles, starts, b, start, first[b], buffers)
        end += capacity[b]
    to = end
    for k in range(len(by_slot) - 1, -1, -1):
        b = by_slot[k]
        to -= capacity[b]
        if first[b] < to:
            _move_block(particles, starts, b, first[b], to, buffers)
            first[b] = to
    return end


def packed_end(blocks):
    """Number of slots that the blocks need without gaps."""
    end = 0
    for b in range(blocks.nown):
        end += _spacious(blocks.held[b]) if blocks.held[b] > 0 else 0
    return end


def mark_slots(particles, blocks):
    """Set the cells of the slots and their order where particles lie sorted by cell."""
    starts, first = blocks.starts, blocks.first
    cell = particles.cell
    order = particles.order
    for b in prange(blocks.nown):
        for c in range(CELLS):
            for p in range(first[b] + starts[b, c], first[b] + starts[b, c + 1]):
                cell[p] = c
                order[p] = p
