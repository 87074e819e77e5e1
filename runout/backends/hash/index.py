"""Sparse index: which blocks of 4 x 4 x 4 cells exist, their neighbours, and where each block's particles are listed.

    keys.table   [ key+1 |   0   | key+1 | key+1 |   0   | ... ]   hash table of block keys; a collision takes the next entry
    keys.slots   [   2   |   .   |   0   |   1   |   .   | ... ]   block of the entry
    blocks       0, 1, 2, ...                                      numbered in the order of their keys
      coordinates[b]  x, y, z of the block        around[b]  27 neighbours, itself in the middle
      up[b]           8 blocks, one step up       cstart[b]  start of its 64 cells in particles.order, and the end of the last

To make an index, every particle enters the blocks that it can reach before the next sort. The keys are then sorted, which numbers
the blocks independently of the order of the threads, and each block looks up its neighbours. Particles are only in blocks whose
seven neighbours upwards exist: these hold the remaining nodes of its cells.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.device_status import DeviceStatus
from runout.backends.hash.groups import BlockGroup, ContactGroup, GridGroup, KeyGroup, ParticleGroup, StatusGroup, filled
from runout.backends.hash.layout import (
    ALL_AT_WORK,
    BLOCKS,
    CELL_LANES,
    COUNTED,
    ENTERED,
    GROW,
    HALT,
    NODE,
    OFFSET,
    OWNERS,
    SHARED_BLOCKS,
    SUMMED,
    TALLY,
    WARP,
    Ints,
    Table2,
    more_room_for,
    room_for,
    run,
    run_blocks,
    run_each,
)
from runout.backends.hash.limits import room_within
from runout.backends.hash.stencil import _cell_entry
from runout.physics.blocks import block_key, block_of, key_x, key_y, key_z, local_index, mixed
from runout.physics.bspline import first_node
from runout.physics.tensors import i64, real

count_in: Any = None  # adds one to a count; the binding puts it in its place
add_marks: Any = None  # sets bits of a block, likewise

SMALLEST_TABLE = 2**13  # entries
PARTICLES_PER_ENTRY = 128  # of the first table; it grows when it is half full
NO_KEY = 2**63 - 1  # comes after every key
MARGIN = 1  # cells that a particle moves from one sort to the next at most
LARGEST_PIECE = 2**20  # particles: whole blocks, whose sums then have a fixed order
RANKED = 12288  # blocks up to which a warp for each that counts is faster than to sort keys, or to sum in several launches


def _slot(keys: KeyGroup, key: Any):
    """Number of the block of a key, -1 if there is none."""
    mask = keys.table.shape[0] - 1
    wanted = wp.uint64(key + i64(1))
    place = int(mixed(key)) & mask
    for _probe in range(keys.table.shape[0]):
        found = keys.table[place]
        if found == wanted:
            return keys.slots[place]
        if found == wp.uint64(0):
            return -1
        place = (place + 1) & mask
    return -1


def _enter(status: StatusGroup, keys: KeyGroup, key: Any, owner: int):
    """Enter a key unless it is there. Nothing more is entered once the table is half full; the count shows that.

    If its block is an ``owner``, which may hold particles, it is counted with these too; they are entered before all others.
    """
    mask = keys.table.shape[0] - 1
    wanted = wp.uint64(key + i64(1))
    place = int(mixed(key)) & mask
    for _probe in range(keys.table.shape[0]):
        found = keys.table[place]
        if found == wp.uint64(0):
            if 2 * status.counts[ENTERED] > keys.table.shape[0]:
                return
            found = wp.atomic_cas(keys.table, place, wp.uint64(0), wanted)
            if found == wp.uint64(0):
                m = wp.atomic_add(status.counts, ENTERED, 1)
                wp.atomic_add(status.counts, OWNERS, owner)
                if m < keys.members.shape[0]:
                    keys.members[m] = key
                return
        if found == wanted:
            return
        place = (place + 1) & mask


def _enter_around(status: StatusGroup, keys: KeyGroup, x: int, y: int, z: int):
    """Enter the blocks that a particle may reach before the next sort."""
    for i in range(block_of(x - MARGIN), block_of(x + MARGIN) + 1):
        for j in range(block_of(y - MARGIN), block_of(y + MARGIN) + 1):
            for k in range(block_of(z - MARGIN), block_of(z + MARGIN) + 1):
                _enter(status, keys, block_key(i, j, k), 1)


def _present(particles: ParticleGroup, coordinates: Table2, p: int, d: int):
    """First node of a particle along axis ``d``; its offset may lie outside its cell."""
    k = particles.key[p]
    return 4 * coordinates[k >> 6, d] + ((k >> (4 - 2 * d)) & 3) + first_node(particles.rec[OFFSET + d, p])


def enter_given(status: StatusGroup, keys: KeyGroup, node: Table2):
    """Enter the blocks around given first nodes (n, 3)."""
    p = wp.tid()
    _enter_around(status, keys, node[p, 0], node[p, 1], node[p, 2])


def mark_around(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, keys: KeyGroup, marks: Ints):
    """Mark which of the 27 blocks around its own each particle may reach before the next sort, one bit each.

    A particle that is outside of all 27 enters its blocks at once.
    """
    p = wp.tid()
    k = particles.key[p]
    if k < 0:
        return
    b = k >> 6
    far = int(0)
    mark = int(1)
    for d in range(3):
        x = ((k >> (4 - 2 * d)) & 3) + first_node(particles.rec[OFFSET + d, p])
        low = block_of(x - MARGIN) + 1
        high = block_of(x + MARGIN) + 1
        if low < 0 or high > 2:
            far = int(1)
        else:
            row = int(0)
            for i in range(low, high + 1):
                row |= mark << (i * wp.where(d == 0, 9, wp.where(d == 1, 3, 1)))
            mark = row
    if far != 0:
        x = _present(particles, blocks.former, p, 0)
        y = _present(particles, blocks.former, p, 1)
        _enter_around(status, keys, x, y, _present(particles, blocks.former, p, 2))
    else:
        add_marks(marks, b, mark)


def enter_marked(status: StatusGroup, blocks: BlockGroup, keys: KeyGroup, marks: Ints):
    """Enter the marked blocks of the 27 around each block."""
    b, q = wp.tid()
    if ((marks[b] >> q) & 1) != 0:
        i = blocks.former[b, 0] + q // 9 - 1
        j = blocks.former[b, 1] + (q // 3) % 3 - 1
        _enter(status, keys, block_key(i, j, blocks.former[b, 2] + q % 3 - 1), 1)


def clear_index(
    status: StatusGroup, blocks: BlockGroup, keys: KeyGroup, grid: GridGroup, contacts: ContactGroup, keeps: int,
):  # fmt: skip
    """Set flags, counts, table, lists and what is known or booked by block to zero; ``keeps`` where the blocks are."""
    t = wp.tid()
    if t < status.flags.shape[0]:
        status.flags[t] = 0
    if t < status.counts.shape[0]:
        status.counts[t] = 0
    if t < keys.table.shape[0]:
        keys.table[t] = wp.uint64(0)
    if t < blocks.ends.shape[0]:
        blocks.ends[t] = 0
    if t < contacts.approach_speeds.shape[0]:
        contacts.approach_speeds[t] = real(0.0)
    if t < contacts.touching.shape[0]:
        contacts.touching[t] = 0
        for d in range(grid.booked.shape[1]):
            grid.booked[t, d] = wp.float64(0.0)
        if keeps != 0:
            for d in range(3):
                blocks.former[t, d] = blocks.coordinates[t, d]


def enter_above(status: StatusGroup, keys: KeyGroup):
    """Enter the seven neighbours upwards of a block: they hold the remaining nodes of its cells."""
    m, q = wp.tid()
    if m < status.counts[OWNERS] and q > 0:
        key = keys.members[m]
        x = int(key_x(key)) + (q >> 2)
        y = int(key_y(key)) + ((q >> 1) & 1)
        _enter(status, keys, block_key(x, y, int(key_z(key)) + (q & 1)), 0)


def require_room(status: StatusGroup, keys: KeyGroup, entries: int, capacity: int):
    """Reset the numbers of a step; halt if the table or the arrays are too small. Unused keys get the largest value."""
    m = wp.tid()
    entered = status.counts[ENTERED]
    fits = 2 * entered <= entries and entered <= capacity
    if m >= entered and m < keys.members.shape[0]:
        keys.members[m] = i64(NO_KEY)
    if m < TALLY:
        status.tally[m] = 0
        if m == BLOCKS and fits:
            status.tally[m] = entered
    if m == 0 and not fits:
        status.flags[HALT] = GROW


def number_given(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, keys: KeyGroup, node: Table2):
    """Cell of particles whose first nodes (n, 3) are given; count them by cell."""
    p = wp.tid()
    if status.flags[HALT] != 0:
        return
    x = node[p, 0]
    y = node[p, 1]
    z = node[p, 2]
    k = _slot(keys, block_key(block_of(x), block_of(y), block_of(z))) * 64 + local_index(x, y, z)
    particles.key[p] = k
    count_in(blocks.ends, _cell_entry(k))


def number_present(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, keys: KeyGroup):
    """Cell of the particles in the new index; count them by cell. Offsets are reduced to the new cell."""
    p = wp.tid()
    if status.flags[HALT] != 0 or particles.key[p] < 0:
        return
    x = _present(particles, blocks.former, p, 0)
    y = _present(particles, blocks.former, p, 1)
    z = _present(particles, blocks.former, p, 2)
    for d in range(3):
        f = particles.rec[OFFSET + d, p]
        particles.rec[OFFSET + d, p] = f - wp.floor(f - type(f)(0.5))
    k = _slot(keys, block_key(block_of(x), block_of(y), block_of(z))) * 64 + local_index(x, y, z)
    particles.key[p] = k
    count_in(blocks.ends, _cell_entry(k))


def enter_joining(status: StatusGroup, keys: KeyGroup, joining: Table2):
    """Enter the blocks around the first nodes of the particles that join, see :attr:`runout.backends.hash.state.Store.joining`."""
    p = wp.tid()
    if p < joining[1, 0]:
        _enter_around(status, keys, joining[NODE, p + 1], joining[NODE + 1, p + 1], joining[NODE + 2, p + 1])


def number_joining(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, keys: KeyGroup, joining: Table2):
    """Cell of the particles that join; count them by cell."""
    p = wp.tid()
    if status.flags[HALT] != 0 or p >= joining[1, 0]:
        return
    x = joining[NODE, p + 1]
    y = joining[NODE + 1, p + 1]
    z = joining[NODE + 2, p + 1]
    k = _slot(keys, block_key(block_of(x), block_of(y), block_of(z))) * 64 + local_index(x, y, z)
    particles.key[joining[0, 0] + p] = k
    count_in(blocks.ends, _cell_entry(k))


class Index:
    """The table and its blocks, on the device of the scope in which it is made.

    Its arrays are those of :class:`runout.backends.hash.groups.BlockGroup` and ``KeyGroup``.

    Attributes
    ----------
    nown, nall : int
        Blocks that may hold particles; all blocks. Read with the device status.
    capacity : int
        Blocks that the arrays have room for.
    largest : int
        Blocks that can be addressed.
    shared, launched : int
        Blocks of threads of kernels in which each takes several blocks in turn; of those in which each takes one with particles.
    piece, more_pieces : int
        Places of memory in a piece of a block, whose particles a block of threads steps; pieces beyond one of each block.
    generation : int
        Counts how often arrays were made anew.
    status : DeviceStatus
        Where the numbers of a step and of a sort are written.
    box : (blocks, 3) int32, optional
        A node of each block that is in use whether it holds particles or not: a dense grid, the control of measurements.
    """

    def __init__(
        self, kernels: SimpleNamespace, status: DeviceStatus, particles: int, ordered: bool, largest: int, many: int = 1,
        rows: int = 2**20, places: int = 0,
    ):  # fmt: skip
        self.k, self.status, self.ordered, self.many, self.rows, self.largest = kernels, status, ordered, many, rows, largest
        self._choose_pieces(particles, max(particles, places))
        self.nown = self.nall = self.capacity = self.generation = self.launched = 0
        self.former: Any = None
        self.box: Any = None
        self.make_table(first_table(particles))
        self.make_room(0)

    def _choose_pieces(self, particles: int, places: int) -> None:
        self.piece = LARGEST_PIECE if self.ordered else CELL_LANES * max(2, particles // (CELL_LANES * ALL_AT_WORK))
        self.more_pieces = places // self.piece

    def fit_pieces(self, particles: int) -> None:
        """Pieces for so many places; a sort cuts them."""
        self.generation += 1
        self._choose_pieces(particles, particles)
        self.homes = wp.zeros((2 * self.capacity + self.more_pieces, 3), dtype=wp.int32)
        self.block_group = filled(self.k.groups.BlockGroup, self)

    def make_table(self, entries: int) -> None:
        """An empty table."""
        self.generation += 1
        self.table = wp.zeros(entries, dtype=wp.uint64)
        self.slots = wp.zeros(entries, dtype=wp.int32)
        self.members = wp.zeros(entries, dtype=wp.int64)
        self.key_group = filled(self.k.groups.KeyGroup, self)

    def make_room(self, blocks: int) -> None:
        """Empty arrays for so many blocks; where blocks were before the present sort stays known."""
        self.generation += 1
        former = self.former if self.capacity else None
        self.capacity, self.shared = blocks, min(blocks, SHARED_BLOCKS)
        pieces = 2 * blocks + self.more_pieces
        shapes = ((blocks, 3), (blocks, 3), (blocks, 27), (blocks, 8), (blocks * self.ordered, 8), (blocks, 65), (pieces, 3))
        tables = (wp.zeros(shape, dtype=wp.int32) for shape in shapes)
        self.coordinates, self.former, self.around, self.up, self.down, self.cstart, self.homes = tables
        if former is not None:
            wp.copy(self.former[: len(former)], former)
        self.ends = self.cstart.flatten()
        self.member, self.active = (wp.zeros(blocks, dtype=wp.int32) for _ in range(2))
        self.sums = wp.zeros(blocks + 1, dtype=wp.int32)
        self.block_group = filled(self.k.groups.BlockGroup, self)

    def clear(self, nodes: Any, keeps: bool) -> None:
        """Empty table, lists and marks before a sort; ``keeps`` where the blocks are, which the particles still name meanwhile."""
        groups = self.status.group, self.block_group, self.key_group, nodes.grid_group, nodes.contact_group
        run(self.k.clear_index, max(self.table.shape[0], self.ends.shape[0]), *groups, int(keeps))

    def find_blocks(self, enter: Callable[[], None]) -> None:
        """Enter blocks by ``enter``, and number and link them; halts where table or arrays have no room for them.

        Only launches; :meth:`grow` follows once the host has seen that.
        """
        k, entries, status = self.k, self.table.shape[0], self.status.group
        enter()
        if self.box is not None:
            run(k.enter_given, len(self.box), status, self.key_group, self.box)
        sorted_ = min(self.capacity, entries // 2)
        run(k.enter_above, (entries // 2, 8), status, self.key_group)
        run(k.require_room, max(sorted_, TALLY), status, self.key_group, entries, self.capacity)
        self._number_blocks(sorted_)
        if self.ordered:
            self.down.fill_(-1)
        run(k.link_blocks, (self.capacity, 27), status, self.block_group, self.key_group)
        run(k.note_up, self.capacity, status, self.block_group)

    def _number_blocks(self, sorted_: int) -> None:
        """Number the blocks in the order of their keys, of which there are ``sorted_`` at most."""
        arguments = self.status.group, self.block_group, self.key_group, self.rows, self.many
        if self.capacity <= RANKED:
            run_each(self.k.rank_blocks, self.capacity, WARP, *arguments)
            return
        wp.utils.radix_sort_pairs(self.members, self.slots, sorted_)
        run(self.k.number_blocks, self.capacity, *arguments)

    def grow(self, counts: np.ndarray) -> None:
        """Make room for what the last try counted: a table that got half full becomes twice as large.

        Raises CapacityError if so many blocks cannot be addressed.
        """
        self.nown, self.nall = int(counts[OWNERS]), int(counts[ENTERED])
        room = room_within(more_room_for(self.nall) if self.capacity else room_for(self.nall), self.nall, self.largest, "blocks")
        if 2 * self.nall > self.table.shape[0]:
            self.make_table(2 * self.table.shape[0])
        elif self.nall > self.capacity:
            self.make_room(room)

    def list_cells(self, nodes: Any, given: int = 0) -> None:
        """Where the cells start in the list: by what is ``given`` in the order of the blocks, else each takes the next stretch.

        A block of threads for each: then blocks are listed nearly in their order, and neighbours are read while they are at hand.
        """
        run_blocks(
            self.k.list_cells, self.capacity, WARP, self.status.group, self.block_group, nodes.grid_group, nodes.ground_group,
            nodes.contact_group, nodes.column_group, given,
        )  # fmt: skip

    def count_blocks(self) -> int:
        """Numbers of particles in the blocks into ``sums``: in each, or where blocks are many in those before; returns which."""
        run(self.k.count_blocks, self.capacity, self.block_group)
        if self.capacity <= RANKED:
            return COUNTED
        wp.utils.array_scan(self.sums, self.sums, inclusive=False)
        return SUMMED

    def number_marked(self, marks: Any, which: int, room: int, marked: Any) -> None:
        """Number the marked blocks in their order, and count them; halts if there is no ``room`` for so many."""
        blocks, summed = self.block_group, self.capacity > RANKED
        if summed:
            run(self.k.note_marks, self.capacity, blocks, marks)
            wp.utils.array_scan(self.sums, self.sums, inclusive=False)
        warps = -(-self.capacity // WARP) if summed else self.capacity
        run_blocks(self.k.number_marked, warps, WARP, self.status.group, blocks, marks, which, room, marked, int(summed))

    def fit_launches(self, held: int) -> None:
        """Blocks of threads for ``held`` blocks with particles and some more; a step that needs others does them in turn.

        Idle ones cost less than the graph that is recorded for each number.
        """
        if not held <= self.launched <= 2 * room_for(held):
            self.launched = min(room_for(held), self.capacity)


def box_around(nodes: np.ndarray) -> np.ndarray:
    """Node (blocks, 3) int32 inside each block of the box around particles with first nodes (n, 3), a block wider on each side."""
    low, high = (nodes.min(0) >> 2) - 1, (nodes.max(0) >> 2) + 1
    shape = tuple((high - low + 1).tolist())
    place = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1) + low
    return (4 * place + MARGIN).astype(np.int32)  # so far inside that no other block is entered


def first_table(particles: int) -> int:
    """Entries of the first table."""
    return int(max(SMALLEST_TABLE, 1 << (particles // PARTICLES_PER_ENTRY).bit_length()))
