"""Sparse index: an open-addressing table of block keys, compact blocks, their neighbours and the particles of each cell.

A table entry holds key + 1, zero where it is free; collisions go to the next entry. Blocks are numbered in the order of
their keys, so that their numbers do not depend on which thread came first. A block *holds* particles if its eight
neighbours upwards exist; particles enter no other.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.device_status import DeviceStatus
from runout.backends.hash.layout import (
    BLOCKS,
    ENTERED,
    GROW,
    HALT,
    OFFSET,
    ORDERED,
    OWNERS,
    SHARED_BLOCKS,
    TALLY,
    WARP,
    Ints,
    Keys,
    Rows,
    Table,
    Table2,
    more_room_for,
    room_for,
    run,
    run_blocks,
)
from runout.backends.hash.stencil import _cell_entry
from runout.physics.blocks import block_key, block_of, key_x, key_y, key_z, local_index, mixed
from runout.physics.bspline import first_node
from runout.physics.tensors import i64

count_in: Any = None  # adds one to a count; the binding puts it in its place
add_marks: Any = None  # sets bits of a block, likewise

SMALLEST_TABLE = 1024  # entries
PARTICLES_PER_ENTRY = 128  # of the first table; it grows when it is half full
NO_KEY = 2**63 - 1  # comes after every key
MARGIN = 1  # cells that a particle moves from one sort to the next at most
GAP = 8  # blocks between the domains of two members, north to south


def _slot(table: Table, slots: Ints, key: Any):
    """Number of the block of a key, -1 if there is none."""
    mask = table.shape[0] - 1
    wanted = wp.uint64(key + i64(1))
    place = int(mixed(key)) & mask
    for _probe in range(table.shape[0]):
        found = table[place]
        if found == wanted:
            return slots[place]
        if found == wp.uint64(0):
            return -1
        place = (place + 1) & mask
    return -1


def _enter(table: Table, members: Keys, count: Ints, key: Any):
    """Enter a key unless it is there; once the table is half full nothing more is entered, and the count tells."""
    mask = table.shape[0] - 1
    wanted = wp.uint64(key + i64(1))
    place = int(mixed(key)) & mask
    for _probe in range(table.shape[0]):
        found = table[place]
        if found == wp.uint64(0):
            if 2 * count[0] > table.shape[0]:
                return
            found = wp.atomic_cas(table, place, wp.uint64(0), wanted)
            if found == wp.uint64(0):
                m = wp.atomic_add(count, 0, 1)
                if m < members.shape[0]:
                    members[m] = key
                return
        if found == wanted:
            return
        place = (place + 1) & mask


def _enter_around(x: int, y: int, z: int, table: Table, members: Keys, count: Ints):
    """Enter the blocks that a particle may reach before the next sort."""
    for i in range(block_of(x - MARGIN), block_of(x + MARGIN) + 1):
        for j in range(block_of(y - MARGIN), block_of(y + MARGIN) + 1):
            for k in range(block_of(z - MARGIN), block_of(z + MARGIN) + 1):
                _enter(table, members, count, block_key(i, j, k))


def _present(rec: Rows, key: Ints, coordinates: Table2, p: int, d: int):
    """First node of a particle along axis ``d``; its offset may have run past its cell."""
    k = key[p]
    return 4 * coordinates[k >> 6, d] + ((k >> (4 - 2 * d)) & 3) + first_node(rec[OFFSET + d, p])


def enter_given(node: Table2, table: Table, members: Keys, count: Ints):
    """Enter the blocks around given first nodes (n, 3)."""
    p = wp.tid()
    _enter_around(node[p, 0], node[p, 1], node[p, 2], table, members, count)


def mark_around(rec: Rows, key: Ints, coordinates: Table2, marks: Ints, table: Table, members: Keys, count: Ints):
    """Note which of the 27 blocks around its own each particle may reach before the next sort: a bit each.

    One that has come further than all of these enters its blocks at once.
    """
    p = wp.tid()
    k = key[p]
    if k < 0:
        return
    b = k >> 6
    far = int(0)
    mark = int(1)
    for d in range(3):
        x = ((k >> (4 - 2 * d)) & 3) + first_node(rec[OFFSET + d, p])
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
        x = _present(rec, key, coordinates, p, 0)
        y = _present(rec, key, coordinates, p, 1)
        _enter_around(x, y, _present(rec, key, coordinates, p, 2), table, members, count)
    else:
        add_marks(marks, b, mark)


def enter_marked(coordinates: Table2, marks: Ints, table: Table, members: Keys, count: Ints):
    """Enter the marked ones of the 27 blocks around each."""
    b, q = wp.tid()
    if ((marks[b] >> q) & 1) != 0:
        i = coordinates[b, 0] + q // 9 - 1
        j = coordinates[b, 1] + (q // 3) % 3 - 1
        _enter(table, members, count, block_key(i, j, coordinates[b, 2] + q % 3 - 1))


def note_owners(counts: Ints):
    """How many blocks may hold particles: those that were entered so far."""
    if wp.tid() == 0:
        counts[OWNERS] = counts[ENTERED]


def enter_above(table: Table, members: Keys, counts: Ints):
    """Enter the seven neighbours upwards of a block: they hold its further nodes."""
    m = wp.tid()
    if m >= counts[OWNERS]:
        return
    key = members[m]
    for q in range(1, 8):
        x = int(key_x(key)) + (q >> 2)
        y = int(key_y(key)) + ((q >> 1) & 1)
        _enter(table, members, counts, block_key(x, y, int(key_z(key)) + (q & 1)))


def require_room(counts: Ints, entries: int, capacity: int, members: Keys, flags: Ints, tally: Ints):
    """Numbers of a step in the new index; a halt if table or arrays have no room for it. Further keys come last in a sort."""
    m = wp.tid()
    entered = counts[ENTERED]
    fits = 2 * entered <= entries and entered <= capacity
    if m >= entered and m < members.shape[0]:
        members[m] = i64(NO_KEY)
    if m < TALLY:
        tally[m] = 0
        if m == BLOCKS and fits:
            tally[m] = entered
    if m == 0 and not fits:
        flags[HALT] = GROW


def number_blocks(
    tally: Ints, members: Keys, table: Table, slots: Ints, rows: int, many: int, coordinates: Table2, member: Ints
):  # fmt: skip
    """Number the entered keys by their order, and note their coordinates and member; a member has ``rows`` blocks to the north."""
    b = wp.tid()
    if b >= tally[BLOCKS]:
        return
    key = members[b]
    mask = table.shape[0] - 1
    place = int(mixed(key)) & mask
    while table[place] != wp.uint64(key + i64(1)):
        place = (place + 1) & mask
    slots[place] = b
    coordinates[b, 0] = int(key_x(key))
    coordinates[b, 1] = int(key_y(key))
    coordinates[b, 2] = int(key_z(key))
    member[b] = wp.clamp((int(key_y(key)) + GAP // 2) // rows, 0, many - 1)


def link_blocks(tally: Ints, coordinates: Table2, table: Table, slots: Ints, around: Table2, up: Table2, down: Table2):
    """The 27 blocks around, the eight upwards, the first of them -1 if any is missing; and downwards; -1 where there is none."""
    b = wp.tid()
    if b >= tally[BLOCKS]:
        return
    for q in range(27):
        i = coordinates[b, 0] + q // 9 - 1
        j = coordinates[b, 1] + (q // 3) % 3 - 1
        around[b, q] = _slot(table, slots, block_key(i, j, coordinates[b, 2] + q % 3 - 1))
    complete = int(1)
    for q in range(8):
        x = q >> 2
        y = (q >> 1) & 1
        z = q & 1
        s = _slot(table, slots, block_key(coordinates[b, 0] + x, coordinates[b, 1] + y, coordinates[b, 2] + z))
        up[b, q] = s
        if s < 0:
            complete = int(0)
        if ORDERED:
            down[b, q] = _slot(table, slots, block_key(coordinates[b, 0] - x, coordinates[b, 1] - y, coordinates[b, 2] - z))
    if complete == 0:
        up[b, 0] = -1


def number_given(flags: Ints, node: Table2, table: Table, slots: Ints, key: Ints, ends: Ints):
    """Cell number of given first nodes (n, 3), and how many are in each cell."""
    p = wp.tid()
    if flags[HALT] != 0:
        return
    x = node[p, 0]
    y = node[p, 1]
    z = node[p, 2]
    k = _slot(table, slots, block_key(block_of(x), block_of(y), block_of(z))) * 64 + local_index(x, y, z)
    key[p] = k
    count_in(ends, _cell_entry(k))


def number_present(flags: Ints, rec: Rows, old: Table2, table: Table, slots: Ints, key: Ints, ends: Ints):
    """Cell number of the particles in a new index; offsets come back into their cell."""
    p = wp.tid()
    if flags[HALT] != 0 or key[p] < 0:
        return
    x = _present(rec, key, old, p, 0)
    y = _present(rec, key, old, p, 1)
    z = _present(rec, key, old, p, 2)
    for d in range(3):
        f = rec[OFFSET + d, p]
        rec[OFFSET + d, p] = f - wp.floor(f - type(f)(0.5))
    k = _slot(table, slots, block_key(block_of(x), block_of(y), block_of(z))) * 64 + local_index(x, y, z)
    key[p] = k
    count_in(ends, _cell_entry(k))


class Index:
    """The table and its blocks, on the device of the scope in which it is made.

    Attributes
    ----------
    nown, nall : int
        Blocks that may hold particles; all blocks. Read with the device status.
    capacity : int
        Blocks that the arrays have room for.
    shared : int
        Blocks of threads of kernels in which each takes several blocks in turn.
    launched : int
        Blocks of threads of kernels in which each takes one that holds particles.
    generation : int
        Counts how often arrays were made anew.
    coordinates : (capacity, 3) int32
    member : (capacity,) int32
        Scene that a block belongs to.
    around : (capacity, 27) int32
        The block and its neighbours, -1 where there is none.
    up, down : (capacity, 8) int32
        Blocks at the block itself and one step up (down) in each axis, -1 where there is none.
    cstart : (capacity, 65) int32
        Places in the list of particles where the cells of a block start and the last ends. While particles move: how many have
        entered each cell, in the place of the next cell; in between, near the ground, the same of the particles in contact.
    ends : (65 capacity,) int32
        The same memory in a row.
    homes, home : (capacity,), (capacity, 2) int32
        Blocks that held particles at the last sort; where these start and end in memory.
    active : (capacity,) int32
        Blocks that hold particles; ``tally`` tells how many.
    touched : (capacity, 2) int32
        Blocks that hold particles in contact, and their places among those near the ground.
    touching : (capacity,) int32
        How many a block holds.
    device_status : DeviceStatus
        Where the numbers of a step and of a sort are written; ``tally`` and ``entered`` are parts of it.
    former : (capacity, 3) int32
        Coordinates of the blocks before the present sort.
    sums : (capacity + 1,) int32
        Sums over the blocks before each, and over all.
    """

    def __init__(
        self, kernels: SimpleNamespace, device_status: DeviceStatus, particles: int, ordered: bool, many: int = 1, rows: int = 2**20
    ):
        self.k, self.device_status, self.ordered, self.many, self.rows = kernels, device_status, ordered, many, rows
        self.nown = self.nall = self.capacity = self.generation = self.launched = 0
        self.tally, self.entered = device_status.tally, device_status.counts
        self.former: Any = None
        self.make_table(first_table(particles))
        self.make_room(0)

    def make_table(self, entries: int) -> None:
        """An empty table."""
        self.generation += 1
        self.table = wp.zeros(entries, dtype=wp.uint64)
        self.slots = wp.zeros(entries, dtype=wp.int32)
        self.members = wp.zeros(entries, dtype=wp.int64)

    def make_room(self, blocks: int) -> None:
        """Empty arrays for so many blocks; where blocks were before the present sort stays known."""
        self.generation += 1
        former = self.former if self.capacity else None
        self.capacity, self.shared = blocks, min(blocks, SHARED_BLOCKS)
        shapes = ((blocks, 3), (blocks, 3), (blocks, 27), (blocks, 8), (blocks * self.ordered, 8), (blocks, 65), (blocks, 2))
        tables = (wp.zeros(shape, dtype=wp.int32) for shape in shapes)
        self.coordinates, self.former, self.around, self.up, self.down, self.cstart, self.home = tables
        if former is not None:
            wp.copy(self.former[: len(former)], former)
        self.ends = self.cstart.flatten()
        lists = (wp.zeros(blocks, dtype=wp.int32) for _ in range(4))
        self.member, self.active, self.touching, self.homes = lists
        self.touched = wp.zeros((blocks, 2), dtype=wp.int32)
        self.sums = wp.zeros(blocks + 1, dtype=wp.int32)

    def keep_former(self) -> None:
        """Note where the blocks are, for particles that still name them while a new index is made."""
        if self.capacity:
            wp.copy(self.former, self.coordinates)

    def find_blocks(self, enter: Callable[[], None]) -> None:
        """Enter blocks by ``enter``, and number and link them; halts where table or arrays have no room for them.

        Only launches; :meth:`grow` follows once the host has seen that.
        """
        k, counts, entries = self.k, self.device_status.counts, self.table.shape[0]
        self.table.zero_(), counts.zero_()
        enter()
        run(k.note_owners, 1, counts)
        run(k.enter_above, entries // 2, self.table, self.members, counts)
        sorted_ = min(self.capacity, entries // 2)
        run(k.require_room, max(sorted_, TALLY), counts, entries, self.capacity, self.members, self.device_status.flags, self.tally)
        wp.utils.radix_sort_pairs(self.members, self.slots, sorted_)
        self.cstart.zero_(), self.up.fill_(-1)
        if self.ordered:
            self.down.fill_(-1)
        number = (self.members, self.table, self.slots, self.rows, self.many, self.coordinates, self.member)
        run(k.number_blocks, self.capacity, self.tally, *number)
        links = (self.coordinates, self.table, self.slots, self.around, self.up, self.down)
        run(k.link_blocks, self.capacity, self.tally, *links)

    def grow(self, counts: np.ndarray) -> None:
        """Make room for what the last try counted: a table that got half full becomes twice as large."""
        self.nown, self.nall = int(counts[OWNERS]), int(counts[ENTERED])
        if 2 * self.nall > self.table.shape[0]:
            self.make_table(2 * self.table.shape[0])
        elif self.nall > self.capacity:
            self.make_room(more_room_for(self.nall) if self.capacity else room_for(self.nall))

    def list_cells(self, flags: Any, nodes: Any, totals: Any = None) -> None:
        """Where the cells start, in the order of the blocks if ``totals`` are their sums over the blocks before.

        A block of threads for each: then blocks are listed nearly in their order, and neighbours are read while they are at hand.
        """
        given = self.ends if totals is None else totals
        run_blocks(
            self.k.list_cells, self.capacity, WARP, flags, given, int(totals is not None), self.cstart, self.active,
            self.device_status.both, self.tally, nodes.grounded, self.touching, nodes.grid, nodes.contact,
        )  # fmt: skip

    def count_blocks(self) -> Any:
        """Numbers of particles in the blocks before each, and in all."""
        run(self.k.count_blocks, self.capacity, self.cstart, self.sums)
        wp.utils.array_scan(self.sums, self.sums, inclusive=False)
        return self.sums

    def fit_launches(self, held: int) -> None:
        """Blocks of threads for ``held`` blocks with particles and some more; a step that needs others does them in turn."""
        if not held <= self.launched <= 2 * room_for(held):
            self.launched = min(room_for(room_for(held)), self.capacity)


def first_table(particles: int) -> int:
    """Entries of the first table."""
    return int(max(SMALLEST_TABLE, 1 << (particles // PARTICLES_PER_ENTRY).bit_length()))
