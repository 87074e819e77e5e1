"""Phase "sort": slots of the blocks, lists by cell, exchange of particles between blocks.

    slots        | block 4: held | free |   hole   | block 0: held | free | block 9: ... |  reserve  |
                 ^ first[4]              capacity[4] slots in all
    order        slots of the particles of a block by cell:   cell 0   | cell 1 | ... | cell 63
                                                   first + starts[b, 0]  ...            first + starts[b, 64]
    listed       | slot, neighbour, cell of those that leave ->        <- slot, old cell, cell of those that shift |
                 ^ first[b]                                                                first[b] + held[b] - 1 ^

Particles that change their cell or block are listed anew; the others already lie in the order of the list. A block that overflows
moves to a hole or to the end of the slots. Blocks without changes cost nothing.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import load8, load16, local_array, prefetch, store
from runout.backends.scan.grid_to_particles import HERE, LEFT, OUTSIDE
from runout.backends.scan.workspace import _total_held

CELLS = 64
CALLED = 8  # blocks whose memory is prefetched, where there is little to do in each
LONGEST = 1023  # particles of a block whose list is updated from its changes; longer lists are sorted
local_counts = local_array((CELLS + 1,))  # of cells and of those that leave
local_places = local_array((3, CELLS))
local_steps = local_array((LONGEST + 1,))


def _spacious(n):
    """Slots for ``n`` particles and some that will come: a multiple of 16."""
    return (n + (n >> 5) + 19) & ~15


def _count_arrivals(listed, blocks, moves):
    """Count the particles that enter each block; returns the number of fresh slots that overflowing blocks will need.

    One thread counts: few particles leave their blocks, fewer than blocks have neighbours.
    """
    nown, first, around, held, capacity = blocks.nown, blocks.first, blocks.around, blocks.held, blocks.capacity
    before, arrivals, leaving = moves.before, moves.arrivals, moves.leaving
    for b in range(nown):
        before[b] = first[b]
        arrivals[b] = 0
    for b in range(nown):
        if b + CALLED < nown:
            prefetch(listed, first[b + CALLED])
        for t in range(first[b], first[b] + leaving[b]):
            q = (listed[t] >> 6) & 63
            if q < OUTSIDE and around[b, q] >= 0:
                arrivals[around[b, q]] += 1
    needed = 0
    for b in range(nown):
        if held[b] + arrivals[b] > capacity[b]:
            needed += _spacious(held[b] + arrivals[b] + (held[b] >> 4) + 16)
    return needed


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


def make_way(listed, blocks, moves, end, slots, holes, n):
    """Count arrivals and find room for them, unless ``slots`` are too few; returns the fresh slots needed, ``end`` and ``n``."""
    needed = _count_arrivals(listed, blocks, moves)
    if end + needed <= slots:
        end, n = _make_room(blocks, moves.arrivals, end, holes, n)
    return needed, end, n


def _copy_slot(particles, p, d, c):
    """Copy a particle from slot ``p`` to slot ``d``, into cell ``c``."""
    rec, state, particle_index = particles.rec, particles.state, particles.particle_index
    store(rec, 16 * d, load16(rec, 16 * p))
    store(state, 8 * d, load8(state, 8 * p))
    particle_index[d] = particle_index[p]
    particles.cell[d] = c


def _relocate(particles, old, new, n):
    """Copy the particles that stay in a block to fresh slots; returns their number."""
    cell = particles.cell
    kept = 0
    for p in range(old, old + n):
        if cell[p] < LEFT:
            _copy_slot(particles, p, new + kept, cell[p])
            kept += 1
    return kept


def _expect_slot(particles, p):
    """Prefetch the memory of a slot."""
    prefetch(particles.rec, 16 * p)
    prefetch(particles.state, 8 * p)
    prefetch(particles.particle_index, p)


def _receive(particles, around, moves, b, end, copies):
    """Copy the arrivals of a block to the slots from ``end`` on, or only prefetch both; returns the slot after the last one."""
    for q in range(27):
        s = around[b, q]
        if q == HERE or s < 0 or (moves.changed[s] >> (26 - q)) & 1 == 0:
            continue
        before = moves.before[s]
        for t in range(moves.leaving[s]):
            entry = particles.listed[before + t]
            if (entry >> 6) & 63 == 26 - q:
                if copies:
                    _copy_slot(particles, before + (entry >> 12), end, entry & 63)
                else:
                    _expect_slot(particles, before + (entry >> 12))
                    _expect_slot(particles, end)
                    prefetch(particles.cell, end)
                end += 1
    return end


def _expect_lists(particles, blocks, b):
    """Prefetch the lists of a block."""
    for c in range(0, CELLS + 1, 16):
        prefetch(blocks.starts, (CELLS + 1) * b + c)
    f = blocks.first[b]
    for t in range(f, f + blocks.held[b], 16):
        prefetch(particles.order, t)
    prefetch(particles.listed, f)
    prefetch(particles.listed, f + blocks.held[b] - 1)


def _list_by_cell(cell, order, starts, b, first, end):
    """Sort the occupied slots of a block by cell; returns their number. Particles that leave come last and are not counted."""
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


def _note_changes(steps, place, cell, starts, b, first, end, listed, leaving, shifted):
    """Count how a list changes: ``steps`` is the number of entries between one slot of the block and the next in the new list.

    Rows of ``place``, by cell: particles gained; 0; minus the number of newcomers from higher slots than those that stay.
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
        slot = listed[first + t] >> 12
        steps[slot + 1] -= 1
        place[0, cell[first + slot] - LEFT] -= 1
    for t in range(shifted):
        entry = listed[first + held - 1 - t]
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


def _list_newcomers(place, cell, order, starts, b, first, held, end, listed, shifted):
    """Write the newcomers of each cell to the entries that the list has left for them, by slot."""
    for t in range(shifted):
        entry = listed[first + held - 1 - t]
        c = entry & 63
        from_above = np.int64((entry >> 6) & 63 > c)
        order[first + starts[b, c + from_above] + place[1 + from_above, c]] = first + (entry >> 12)
        place[1 + from_above, c] += 1
    for p in range(first + held, end):
        c = np.int64(cell[p])
        order[first + starts[b, c + 1] + place[2, c]] = p
        place[2, c] += 1


def _list_anew(cell, order, starts, b, first, end, listed, leaving, shifted):
    """The same for a block whose particles lay in the order of their cells before this step, from the changes alone.

    Newcomers that left a lower cell come from lower slots than the particles that stayed; the others, and arrivals from other
    blocks, come from higher slots. So the list equals that of a sort, but no key is read. Each slot is written to the present end
    of the list, and the next one overwrites it if its particle has left: this has no branch, which processors could not predict.
    """
    held = np.int64(starts[b, CELLS])
    steps = local_steps(starts)
    place = local_places(starts)
    _note_changes(steps, place, cell, starts, b, first, end, listed, leaving, shifted)
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
    _list_newcomers(place, cell, order, starts, b, first, held, end, listed, shifted)
    return starts[b, CELLS]


def settle(particles, blocks, cuts, moves):
    """Move particles into their new blocks, and update the lists; returns how many there are in all and in the fullest block."""
    cell, order, listed = particles.cell, particles.order, particles.listed
    starts, first, around, nown = blocks.starts, blocks.first, blocks.around, blocks.nown
    held = blocks.held
    arrivals, changed, before = moves.arrivals, moves.changed, moves.before
    for thread in prange(len(cuts) - 1):
        for b in range(np.uint64(cuts[thread]), np.uint64(cuts[thread + 1])):
            if b + 2 < nown and (arrivals[b + 2] > 0 or changed[b + 2] != 0):
                _expect_lists(particles, blocks, np.int64(b) + 2)
            if b + 1 < nown and arrivals[b + 1] > 0:
                _receive(particles, around, moves, b + 1, first[b + 1] + held[b + 1], False)
            if arrivals[b] == 0 and changed[b] == 0:
                continue
            f = first[b]
            end = f + held[b]
            moved = f != before[b]
            if moved:
                end = f + _relocate(particles, before[b], f, held[b])
            if arrivals[b] > 0:
                end = _receive(particles, around, moves, b, end, True)
            if moved or starts[b, CELLS] > LONGEST:
                held[b] = _list_by_cell(cell, order, starts, b, f, end)
            else:
                held[b] = _list_anew(cell, order, starts, b, f, end, listed, moves.leaving[b], moves.shifted[b])
    return _total_held(held, nown)


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


def _move_block(particles, starts, b, first, to, buffers):
    """Move the particles of a block, by cell, to the slots from ``to`` on, which may be some of its own; through a buffer."""
    rec, state, particle_index = particles.rec, particles.state, particles.particle_index
    cell, order = particles.cell, particles.order
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
