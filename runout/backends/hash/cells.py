"""Particles of each cell: counts, the list, and the order in memory.

    cstart[b]    | start of the block | cell 0 | cell 1 | ... | cell 63 |     65 numbers
                 counting: entry c + 1 holds the number of particles of cell c
                 listing:  entry c + 1 moves from the first place of cell c to its last, which is the start of cell c + 1
    order        places of the particles of cell 0 of a block, of cell 1, ...

Blocks lie in the list in any order; after a sort, and in fixed order, one behind the other.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import _clear_columns
from runout.backends.hash.groups import (
    BlockGroup,
    ColumnGroup,
    ContactGroup,
    GridGroup,
    GroundGroup,
    ParticleGroup,
    PoreGroup,
    StatusGroup,
)
from runout.backends.hash.layout import (
    AREAS_AT_ONCE,
    AT_ONCE,
    BLOCKS,
    CELL_LANES,
    COUNTED,
    HALT,
    HOMES,
    LEFT,
    NEXT,
    NOT_NEGATIVE,
    RELEASE,
    ROWS,
    SECTOR,
    SPARE,
    STARTS,
    Ints,
    Reals,
    Rows,
    Shorts,
    Table2,
    lane_count,
    node4,
    own_block,
    own_lane,
    put_node,
)
from runout.backends.hash.stencil import _cell_entry, _cell_of, _place_of_begun
from runout.physics.tensors import real

next_four: Any = None  # adds one to each of four counts and tells what they were before; the binding puts it in its place
warp_lanes: Any = None  # threads that go together; likewise
sum_before: Any = None  # sums over the lanes before a lane, and over all; likewise


def count_blocks(blocks: BlockGroup):
    """Particles of each block; the number of all starts from zero."""
    b = wp.tid()
    if b == 0:
        blocks.sums[blocks.sums.shape[0] - 1] = 0
    total = int(0)
    for c in range(64):
        total += blocks.cstart[b, c + 1]
    blocks.sums[b] = total


def _count_before(status: StatusGroup, blocks: BlockGroup, b: int, lane: int, own: int):
    """Sum of the particles in the blocks before one, which a warp adds up; the last block notes the number of all."""
    before = int(0)
    for other in range(lane, b, lane_count()):
        before += blocks.sums[other]
    before = sum_before(before)[1]
    if lane == 0 and b + 1 == status.tally[BLOCKS]:
        blocks.sums[blocks.sums.shape[0] - 1] = before + own
    return before


def _list_block(status: StatusGroup, blocks: BlockGroup, b: int, lane: int, given: int):
    """Replace the counts of the cells of a block by the places of their first particles in the list.

    Each lane has some cells in a row. ``both`` counts places and blocks in one atomic operation, since all blocks wait for it.
    """
    each = CELL_LANES // lane_count()
    mine = int(0)
    for q in range(each):
        mine += blocks.cstart[b, each * lane + q + 1]
    sums = sum_before(mine)
    total = sums[1]
    start = int(0)
    if given == COUNTED:
        start = _count_before(status, blocks, b, lane, total)
    if lane == 0:
        if total > 0:
            one = wp.int64(1) << wp.int64(32)
            if given != 0:
                start = wp.where(given == COUNTED, start, int(blocks.sums[b]))
                blocks.active[int(wp.atomic_add(status.both, 0, one) >> wp.int64(32))] = b
            else:
                before_all = wp.atomic_add(status.both, 0, one + wp.int64(total))
                start = int(before_all & wp.int64(NOT_NEGATIVE))
                blocks.active[int(before_all >> wp.int64(32))] = b
        blocks.cstart[b, 0] = start
    if total > 0:
        place = sums[0] + sum_before(wp.where(lane == 0, start, 0))[1]
        for q in range(each):
            n = int(blocks.cstart[b, each * lane + q + 1])
            blocks.cstart[b, each * lane + q + 1] = place
            place += n


def list_cells(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, columns: ColumnGroup,
    given: int, launched: int,
):  # fmt: skip
    """Start of each cell in the list, blocks that hold particles, and empty nodes for the next step.

    If ``given`` is SUMMED, ``blocks.sums`` are the starts of the blocks, if COUNTED, their particles; else each block takes the
    next free places, in no fixed order.
    """
    first, lane = wp.tid()
    first, lane = own_block(first), own_lane(lane)
    if status.flags[HALT] != 0:
        return
    for b in range(first, status.tally[BLOCKS], launched):
        _list_block(status, blocks, b, lane, given)
        if lane == 0:
            contacts.touching[b] = 0
        slot = int(ground.grounded[b])
        begun = _place_of_begun(contacts, slot)
        for c in range(lane, CELL_LANES, lane_count()):
            put_node(grid.nodes, b * CELL_LANES + c, node4())
            if slot >= 0:
                put_node(contacts.memory, slot * CELL_LANES + c, node4())
                if begun >= 0:
                    put_node(contacts.memory, begun + c, node4())
        if AREAS_AT_ONCE:
            _clear_columns(contacts, columns, b, lane)


def _entry_of(key: Ints, p: int):
    """Entry in which the particle at a place is counted; -1 if there is none."""
    if p >= key.shape[0]:
        return -1
    k = key[p]
    return wp.where(k >= 0, _cell_entry(k), -1)


def place_particles(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup):
    """List the particles of each cell; the entry of a cell moves from its start to its end as it fills.

    A thread lists four particles, so that four loads overlap; the threads of a warp read neighbours.
    """
    t = wp.tid()
    lanes = warp_lanes()
    p = AT_ONCE * t - (AT_ONCE - 1) * (t % lanes)
    entries = wp.vec4i()
    for q in range(AT_ONCE):
        entries[q] = _entry_of(particles.key, p + q * lanes)
    if status.flags[HALT] == 0:
        places = next_four(blocks.ends, entries)
        for q in range(AT_ONCE):
            if entries[q] >= 0:
                particles.order[places[q]] = p + q * lanes


def take_joining(particles: ParticleGroup, pores: PoreGroup, joining: Table2, reals: Rows, loaded: int):
    """Put particles that join behind the others: their record, radius, pore pressure and force of the ground from ``reals``.

    Each has the number of a column of ``reals`` behind those that were ``loaded``.
    """
    p = wp.tid()
    place = joining[0, 0] + p
    number = loaded + p
    for row in range(ROWS):
        particles.rec[row, place] = reals[row, p]
    particles.radius[place] = reals[ROWS, p]
    particles.release[place] = wp.int16(joining[RELEASE, p + 1])
    particles.number[place] = number
    if number < pores.left.shape[0]:
        pores.excess[number] = reals[ROWS + 1, p]
        pores.left[number] = reals[ROWS + 2, p]
    put_node(particles.forces, number, node4(reals[ROWS + 3, p], reals[ROWS + 4, p], reals[ROWS + 5, p], reals[ROWS + 6, p]))


def sort_cells(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup):
    """Sort the particles of each cell by their numbers: atomic operations have no fixed order."""
    i = wp.tid()
    if status.flags[HALT] != 0 or (i >> 6) >= status.tally[NEXT]:
        return
    t = blocks.active[i >> 6] * CELL_LANES + (i & 63)
    first = blocks.cstart[t >> 6, t & 63]
    for k in range(first + 1, blocks.cstart[t >> 6, (t & 63) + 1]):
        p = particles.order[k]
        j = int(k)
        while j > first and particles.number[particles.order[wp.max(j - 1, first)]] > particles.number[p]:
            particles.order[j] = particles.order[j - 1]
            j = j - 1
        particles.order[j] = p


def gather_reals(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, source: Reals, target: Reals):
    """Numbers in the order of the list, four a thread so that four loads overlap; ``blocks.sums`` ends with their count."""
    t = wp.tid()
    count = blocks.sums[blocks.sums.shape[0] - 1]
    threads = (count + 3) >> 2
    if status.flags[HALT] != 0 or t >= threads:
        return
    last = count - 1
    p0 = particles.order[t] & NOT_NEGATIVE
    p1 = particles.order[wp.min(t + threads, last)] & NOT_NEGATIVE
    p2 = particles.order[wp.min(t + 2 * threads, last)] & NOT_NEGATIVE
    p3 = particles.order[wp.min(t + 3 * threads, last)] & NOT_NEGATIVE
    x0 = source[p0]
    x1 = source[p1]
    x2 = source[p2]
    x3 = source[p3]
    target[t] = x0
    target[wp.min(t + threads, last)] = x1
    target[wp.min(t + 2 * threads, last)] = x2
    target[wp.min(t + 3 * threads, last)] = x3


def gather_rows(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, source: Rows, target: Rows, numbers: Ints):
    """All rows in the order of the list, five at once so that their loads overlap; and the numbers of the particles."""
    t = wp.tid()
    if status.flags[HALT] == 0 and t < blocks.sums[blocks.sums.shape[0] - 1]:
        p = particles.order[t] & NOT_NEGATIVE
        numbers[t] = particles.number[p]
        for row in range(0, SPARE, 5):
            x0 = source[row, p] * real(1.0)
            x1 = source[row + 1, p] * real(1.0)
            x2 = source[row + 2, p] * real(1.0)
            x3 = source[row + 3, p] * real(1.0)
            x4 = source[row + 4, p] * real(1.0)
            target[row, t] = x0
            target[row + 1, t] = x1
            target[row + 2, t] = x2
            target[row + 3, t] = x3
            target[row + 4, t] = x4


def _bring_one(status: StatusGroup, blocks: BlockGroup, source: Any, target: Any, t: int):
    """A number back from the place where it was gathered, unless the sort waits for room."""
    if status.flags[HALT] == 0 and t < blocks.sums[blocks.sums.shape[0] - 1]:
        target[t] = source[t]


def _gather_one(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, source: Any, target: Any, t: int):
    """The number of the particle at a place of the list, unless the sort waits for room."""
    if status.flags[HALT] == 0 and t < blocks.sums[blocks.sums.shape[0] - 1]:
        target[t] = source[particles.order[t]]


def bring_back_reals(status: StatusGroup, blocks: BlockGroup, source: Reals, target: Reals):
    """Numbers from the place where they were gathered."""
    _bring_one(status, blocks, source, target, wp.tid())


def bring_back_shorts(status: StatusGroup, blocks: BlockGroup, source: Shorts, target: Shorts):
    """Small integers from the place where they were gathered."""
    _bring_one(status, blocks, source, target, wp.tid())


def gather_ints(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, source: Ints, target: Ints):
    """Integers in the order of the list."""
    _gather_one(status, particles, blocks, source, target, wp.tid())


def gather_shorts(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, source: Shorts, target: Shorts):
    """Small integers in the order of the list."""
    _gather_one(status, particles, blocks, source, target, wp.tid())


def _note_pieces(status: StatusGroup, blocks: BlockGroup, b: int, begin: int, end: int, piece: int):
    """Cut the particles of a block into pieces of so many places at most, at whole sectors of memory."""
    cut = begin // SECTOR * SECTOR
    many = (end - cut + piece - 1) // piece
    at = wp.atomic_add(status.tally, HOMES, many)
    for n in range(many):
        blocks.homes[at + n, 0] = b
        blocks.homes[at + n, 1] = wp.max(begin, cut + n * piece)
        blocks.homes[at + n, 2] = wp.min(end, cut + (n + 1) * piece)


def renumber(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, contacts: ContactGroup, numbers: Ints, piece: int,
    launched: int,
):  # fmt: skip
    """Renumber the list and the cells after the particles have moved, and note the pieces of each block.

    The gathered ``numbers`` of the particles come back, and the places behind the last particle are marked as empty. Also write the
    number of all particles for the host, and an unknown (infinite) speed of approach for each block.
    """
    first, lane = wp.tid()
    first, lane = own_block(first), own_lane(lane)
    if status.flags[HALT] != 0:
        return
    many = blocks.sums[blocks.sums.shape[0] - 1]
    if first == 0 and lane == 0:
        status.counts[LEFT] = many
    for t in range(many + first * lane_count() + lane, particles.key.shape[0], launched * lane_count()):
        particles.key[t] = -1
    for a in range(first, status.tally[NEXT], launched):
        b = blocks.active[a]
        if lane == 0:
            contacts.approach_speeds[2 * b] = real(wp.inf)  # to the next step
            _note_pieces(status, blocks, b, blocks.cstart[b, 0], blocks.cstart[b, CELL_LANES], piece)
        starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
        for q in range((STARTS + lane_count() - 1) // lane_count()):
            c = q * lane_count() + lane
            wp.tile_scatter_masked(starts, c, blocks.cstart[b, wp.min(c, CELL_LANES)], c < STARTS)
        for t in range(int(starts[0]) + lane, int(starts[CELL_LANES]), lane_count()):
            particles.order[t] = t
            particles.number[t] = numbers[t]
            particles.key[t] = b * CELL_LANES + _cell_of(starts, t)
