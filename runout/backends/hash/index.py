"""Sparse index: an open-addressing table of block keys, compact blocks, their neighbours and the particles of each cell.

A table entry holds key + 1, zero where it is free; collisions go to the next entry. Blocks are numbered in the order of
their keys, so that their numbers do not depend on which thread came first. A block *holds* particles if its eight
neighbours upwards exist; particles enter no other.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, TypeAlias

import warp as wp

from runout.physics.blocks import block_key, block_of, key_x, key_y, key_z, local_index, mixed
from runout.physics.bspline import first_node
from runout.physics.tensors import i64

wp.config.log_level = max(wp.config.log_level, wp.LOG_ERROR)  # no banner, and no warning where a machine has no GPU

# types of kernel arguments; the binding puts the compiler's in their place
Rows: TypeAlias = Any
Reals: TypeAlias = Any
Real: TypeAlias = Any
Nodes: TypeAlias = Any
Vectors: TypeAlias = Any
Vector: TypeAlias = Any
Table: TypeAlias = Any
Keys: TypeAlias = Any
Ints: TypeAlias = Any
Flags: TypeAlias = Any
Table2: TypeAlias = Any
Bytes: TypeAlias = Any
Shorts: TypeAlias = Any
Doubles: TypeAlias = Any
Doubles2: TypeAlias = Any
Longs: TypeAlias = Any
Materials: TypeAlias = Any
Tile: TypeAlias = Any

ORDERED = False  # sums in fixed order; the binding decides
MARGIN = 2  # cells around a particle whose blocks are there; at most 2, so that they are at most eight
OFFSET = 4  # row of the first offset, see :mod:`runout.backends.hash.transfer`
HALT, PENDING, STEPS, CURSOR, CONTACTS = range(5)  # flags on the device
LEFT_INDEX, UNSTABLE = 1, 2  # why a batch halts
CELL_LANES, PARTICLE_LANES = 64, 128  # threads of a block where one owns a cell, or a particle
SMALLEST_TABLE = 1024  # entries
PARTICLES_PER_ENTRY = 32  # of the first table; it grows when it is half full


def run(kernel: Any, dim: int | tuple[int, int], *arguments: Any) -> None:
    """Launch a kernel on the device of the scope, if there is anything to do."""
    if dim:
        wp.launch(kernel, dim=dim, inputs=list(arguments), block_dim=PARTICLE_LANES)


def run_blocks(kernel: Any, blocks: int, lanes: int, *arguments: Any) -> None:
    """Launch a kernel with ``lanes`` threads for each block on the device of the scope."""
    if blocks:
        wp.launch_tiled(kernel, dim=blocks, inputs=list(arguments), block_dim=lanes)


def bytes_of(*holders: Any) -> int:
    """Size [byte] of the device arrays that objects hold; what shares memory counts once."""
    arrays = [a for holder in holders for a in vars(holder).values() if isinstance(a, wp.array)]
    return sum({a.ptr: a.capacity for a in arrays if a.ptr}.values())


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
    """Enter the blocks that a particle may reach by moving up to ``MARGIN`` cells."""
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


def enter_present(rec: Rows, key: Ints, coordinates: Table2, table: Table, members: Keys, count: Ints):
    """Enter the blocks around the particles as they are now."""
    p = wp.tid()
    if key[p] >= 0:
        x = _present(rec, key, coordinates, p, 0)
        y = _present(rec, key, coordinates, p, 1)
        z = _present(rec, key, coordinates, p, 2)
        _enter_around(x, y, z, table, members, count)


def enter_above(table: Table, members: Keys, count: Ints):
    """Enter the seven neighbours upwards of a block: they hold its further nodes."""
    m = wp.tid()
    key = members[m]
    for q in range(1, 8):
        x = int(key_x(key)) + (q >> 2)
        y = int(key_y(key)) + ((q >> 1) & 1)
        _enter(table, members, count, block_key(x, y, int(key_z(key)) + (q & 1)))


def number_blocks(members: Keys, table: Table, slots: Ints, coordinates: Table2):
    """Number the entered keys by their order, and note their coordinates."""
    b = wp.tid()
    key = members[b]
    mask = table.shape[0] - 1
    place = int(mixed(key)) & mask
    while table[place] != wp.uint64(key + i64(1)):
        place = (place + 1) & mask
    slots[place] = b
    coordinates[b, 0] = int(key_x(key))
    coordinates[b, 1] = int(key_y(key))
    coordinates[b, 2] = int(key_z(key))


def link_blocks(coordinates: Table2, table: Table, slots: Ints, up: Table2, down: Table2):
    """Blocks upwards, the first of them -1 if any is missing; and downwards, -1 where there is none."""
    b = wp.tid()
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


def number_given(node: Table2, table: Table, slots: Ints, key: Ints, rank: Ints, count: Ints):
    """Cell number of given first nodes (n, 3), and the rank of each in its cell."""
    p = wp.tid()
    x = node[p, 0]
    y = node[p, 1]
    z = node[p, 2]
    k = _slot(table, slots, block_key(block_of(x), block_of(y), block_of(z))) * 64 + local_index(x, y, z)
    key[p] = k
    rank[p] = wp.atomic_add(count, k, 1)


def number_present(rec: Rows, old: Table2, table: Table, slots: Ints, key: Ints, rank: Ints, count: Ints):
    """Cell number of the particles in a new index; offsets come back into their cell."""
    p = wp.tid()
    if key[p] < 0:
        return
    x = _present(rec, key, old, p, 0)
    y = _present(rec, key, old, p, 1)
    z = _present(rec, key, old, p, 2)
    for d in range(3):
        f = rec[OFFSET + d, p]
        rec[OFFSET + d, p] = f - wp.floor(f - type(f)(0.5))
    k = _slot(table, slots, block_key(block_of(x), block_of(y), block_of(z))) * 64 + local_index(x, y, z)
    key[p] = k
    rank[p] = wp.atomic_add(count, k, 1)


def count_blocks(count: Ints, totals: Ints):
    """Particles of each block."""
    b = wp.tid()
    total = int(0)
    for c in range(64):
        total += count[b * 64 + c]
    totals[b] = total


def count_occupied(cstart: Table2, number: Ints):
    """Number of blocks that hold particles."""
    b = wp.tid()
    if cstart[b, 64] > cstart[b, 0]:
        wp.atomic_add(number, 0, 1)


def _start_cells(b: int, first: int, count: Ints, cstart: Table2):
    """Places of the first particles of a block's cells, from ``first`` on; the counts return to zero."""
    place = int(first)
    for c in range(64):
        cstart[b, c] = place
        place += count[b * 64 + c]
        count[b * 64 + c] = 0
    cstart[b, 64] = place


def start_cells_by_block(totals: Ints, count: Ints, cstart: Table2):
    """Places of the cells in the order of the blocks; ``totals`` are the sums over the blocks before."""
    b = wp.tid()
    _start_cells(b, totals[b], count, cstart)


def start_cells(flags: Flags, count: Ints, cstart: Table2):
    """Places of the cells after a step: each block takes the next free stretch, in no fixed order."""
    b = wp.tid()
    if flags[HALT] != 0:
        return
    total = int(0)
    for c in range(64):
        total += count[b * 64 + c]
    _start_cells(b, wp.atomic_add(flags, CURSOR, total), count, cstart)


def place_particles(flags: Flags, key: Ints, rank: Ints, cstart: Table2, order: Ints):
    """List the particles of each cell."""
    p = wp.tid()
    k = key[p]
    if flags[HALT] == 0 and k >= 0:
        order[cstart[k >> 6, k & 63] + rank[p]] = p


def sort_cells(flags: Flags, cstart: Table2, order: Ints):
    """Bring the particles of each cell into the order of their numbers: atomic ranks come in any order."""
    t = wp.tid()
    if flags[HALT] != 0:
        return
    first = cstart[t >> 6, t & 63]
    for i in range(first + 1, cstart[t >> 6, (t & 63) + 1]):
        p = order[i]
        j = int(i)
        while j > first and order[wp.max(j - 1, first)] > p:
            order[j] = order[j - 1]
            j = j - 1
        order[j] = p


def gather_reals(source: Reals, order: Ints, target: Reals):
    """Numbers in the order of the cells."""
    t = wp.tid()
    target[t] = source[order[t]]


def gather_ints(source: Ints, order: Ints, target: Ints):
    """Integers in the order of the cells."""
    t = wp.tid()
    target[t] = source[order[t]]


def gather_shorts(source: Shorts, order: Ints, target: Shorts):
    """Small integers in the order of the cells."""
    t = wp.tid()
    target[t] = source[order[t]]


def count_up(numbers: Ints, n: int, beyond: Ints):
    """The numbers 0, 1, ... ; places from ``n`` on hold no particle: ``beyond`` becomes -1 there."""
    t = wp.tid()
    numbers[t] = t
    if t >= n:
        beyond[t] = -1


class Index:
    """The table and its blocks, on the device of the scope in which it is made.

    Attributes
    ----------
    nown, nall : int
        Blocks that may hold particles; all blocks.
    room : int
        Blocks that the arrays have room for; kernels run over all of them, so that a captured graph stays valid.
    generation : int
        Counts how often arrays were made anew.
    coordinates : (room, 3) int32
    up, down : (room, 8) int32
        Blocks at the block itself and one step up (down) in each axis, -1 where there is none.
    cstart : (room, 65) int32
        Places in the list of particles where the cells of a block start and the last ends.
    count : (64 room,) int32
        Particles that have entered each cell in this step.
    """

    def __init__(self, kernels: SimpleNamespace, particles: int, ordered: bool):
        self.k, self.ordered = kernels, ordered
        self.nown = self.nall = self.room = self.generation = 0
        self._make_table(first_table(particles))
        self._make_room(0)

    def _make_table(self, entries: int) -> None:
        self.generation += 1
        self.table = wp.zeros(entries, dtype=wp.uint64)
        self.slots = wp.zeros(entries, dtype=wp.int32)
        self.members = wp.zeros(entries, dtype=wp.int64)
        self.entered = wp.zeros(1, dtype=wp.int32)

    def _make_room(self, blocks: int) -> None:
        self.generation += 1
        self.room = blocks
        shapes = ((blocks, 3), (blocks, 8), (blocks * self.ordered, 8), (blocks, 65))
        self.coordinates, self.up, self.down, self.cstart = (wp.zeros(shape, dtype=wp.int32) for shape in shapes)
        self.count = wp.zeros(blocks * 64, dtype=wp.int32)

    def find_blocks(self, enter: Callable[[Index], None]) -> None:
        """Enter blocks by ``enter``, and number and link them.

        A table that gets half full is made four times as large, and everything is entered again.
        """
        while not self._entered(enter):
            self._make_table(4 * self.table.shape[0])
        wp.utils.radix_sort_pairs(self.members, wp.zeros(2 * self.nall, dtype=wp.int32), self.nall)
        if self.nall > self.room:
            self._make_room(room_for(self.nall))
        self.cstart.zero_(), self.count.zero_(), self.up.fill_(-1)
        if self.ordered:
            self.down.fill_(-1)
        run(self.k.number_blocks, self.nall, self.members, self.table, self.slots, self.coordinates)
        run(self.k.link_blocks, self.nall, self.coordinates, self.table, self.slots, self.up, self.down)

    def _entered(self, enter: Callable[[Index], None]) -> bool:
        self.table.zero_(), self.entered.zero_()
        enter(self)
        self.nown = int(self.entered.numpy()[0])
        if 2 * self.nown > self.table.shape[0]:
            return False
        run(self.k.enter_above, self.nown, self.table, self.members, self.entered)
        self.nall = int(self.entered.numpy()[0])
        return 2 * self.nall <= self.table.shape[0]

    def start_cells(self) -> int:
        """Places of the cells in the order of the blocks, from the counts; returns the number of particles."""
        totals = wp.zeros(self.room + 1, dtype=wp.int32)
        run(self.k.count_blocks, self.room, self.count, totals)
        wp.utils.array_scan(totals, totals, inclusive=False)
        run(self.k.start_cells_by_block, self.room, totals, self.count, self.cstart)
        return int(totals[self.room :].numpy()[0])

    def occupied(self) -> int:
        """Blocks that hold particles now."""
        number = wp.zeros(1, dtype=wp.int32)
        run(self.k.count_occupied, self.room, self.cstart, number)
        return int(number.numpy()[0])


def first_table(particles: int) -> int:
    """Entries of the first table."""
    return int(max(SMALLEST_TABLE, 1 << (particles // PARTICLES_PER_ENTRY).bit_length()))


def room_for(blocks: int) -> int:
    """Blocks that the arrays get room for when ``blocks`` are needed."""
    return blocks + blocks // 4 + 8
