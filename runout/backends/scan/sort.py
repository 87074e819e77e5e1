"""Phase "sort": exchange of particles between blocks, lists by cell; :mod:`runout.backends.scan.slots` draws the slots.

    listed       | slot, neighbour, cell of those that leave ->        <- slot, old cell, cell of those that shift |
                 ^ first[b]                                                                first[b] + held[b] - 1 ^

Particles that change their cell or block are listed anew; the others already lie in the order of the list. Blocks without changes
cost nothing.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import load8, load16, local_array, prefetch, store
from runout.backends.scan.grid_to_particles import HERE, LEFT, OUTSIDE
from runout.backends.scan.slots import CELLS, _make_room, _spacious
from runout.backends.scan.workspace import _total_held

CALLED = 8  # blocks whose memory is prefetched, where there is little to do in each
LONGEST = 1023  # particles of a block whose list is updated from its changes; longer lists are sorted
local_counts = local_array((CELLS + 1,))  # of cells and of those that leave
local_places = local_array((3, CELLS))
local_steps = local_array((LONGEST + 1,))


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


def make_way(listed, blocks, moves, end, slots, holes, n):
    """Count arrivals and find room for them, unless ``slots`` are too few; returns the fresh slots needed, ``end`` and ``n``."""
    needed = _count_arrivals(listed, blocks, moves)
    if end + needed <= slots:
        end, n = _make_room(blocks, moves.arrivals, end, holes, n)
    return needed, end, n


def _copy_slot(particles, p, d, c):
    """Copy a particle from slot ``p`` to slot ``d``, into cell ``c``."""
    rec, state, particle_index, pores = particles.rec, particles.state, particles.particle_index, particles.pores
    store(rec, 16 * d, load16(rec, 16 * p))
    store(state, 8 * d, load8(state, 8 * p))
    particle_index[d] = particle_index[p]
    particles.cell[d] = c
    for k in range(len(pores)):
        pores[k, d] = pores[k, p]


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
    for k in range(len(particles.pores)):
        prefetch(particles.pores, particles.pores.shape[1] * k + p)


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
