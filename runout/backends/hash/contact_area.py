"""Ground area of the contacts, for laws of friction that use it (:func:`runout.physics.contact.area_share`).

Contacts share the columns of nodes in plan. Blocks are numbered by east, north and height, so that those of a column of blocks
follow each other:

    contacts.columns[b, 0]              first block of the column of block b
    contacts.columns[b, 1 + k]          where the columns of the four blocks that the tile of block b overlaps begin in plan
    contacts.shares[256 slot + 4 n]     weights of all contacts at the four nodes above each other of column n of a block
      --sum over the blocks of a column-->
    contacts.plan[16 first + n]         weights of all contacts in each of the 16 columns of nodes
    columns.moving[16 first + n]        mass and momentum of the column, where drag slows it (runout.backends.hash.column_drag)

The tiles of the blocks give the sums over the nodes above each other at once, by atomic operations; or, in fixed order,
``sum_columns`` reads the nodes.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.groups import BlockGroup, ColumnGroup, ContactGroup, GridGroup, GroundGroup, StatusGroup
from runout.backends.hash.layout import (
    AREAS,
    BASES,
    BLOCKS,
    CELL_LANES,
    DRAGS_AT_ONCE,
    DRAGS_COLUMN,
    HALT,
    SECOND,
    SLOT,
    Tile,
    Vector,
    add_node,
    lane_count,
    node4,
    node_at,
    put_node,
)
from runout.physics.bspline import weights
from runout.physics.contact import area_share, ground_area, largest_share
from runout.physics.tensors import real

COLUMNS = 16  # of nodes in a block
PLAN = 36  # columns of nodes that the particles of a block reach
HALF_PLAN = 24  # those of half a block


def number_columns(status: StatusGroup, blocks: BlockGroup, contacts: ContactGroup):
    """Find the first block of the column of each block."""
    b = wp.tid()
    if b >= status.tally[BLOCKS]:
        return
    first = int(b)
    x = blocks.coordinates[b, 0]
    y = blocks.coordinates[b, 1]
    while first > 0 and blocks.coordinates[wp.max(first - 1, 0), 0] == x and blocks.coordinates[wp.max(first - 1, 0), 1] == y:
        first -= 1
    contacts.columns[b, 0] = first


def number_upper_columns(status: StatusGroup, blocks: BlockGroup, contacts: ContactGroup):
    """Note where the columns of the four blocks begin that the tile of a block overlaps in plan; a thread each."""
    t = wp.tid()
    b = t >> 2
    if b < status.tally[BLOCKS]:
        contacts.columns[b, 1 + (t & 3)] = COLUMNS * contacts.columns[wp.max(blocks.up[b, 2 * (t & 3)], 0), 0]


def _set_all_bases(bases: Tile, blocks: BlockGroup, contacts: ContactGroup, b: int, lane: int):
    """Places in the grid of the eight blocks that the tile of a block overlaps, then those of its four columns in the plan."""
    for q in range((BASES + lane_count() - 1) // lane_count()):
        k = q * lane_count() + lane
        first = blocks.up[b, k & 7] * 64
        if AREAS:
            first = wp.where(k < 8, first, contacts.columns[b, 1 + (k & 3)])
        wp.tile_scatter_masked(bases, wp.min(k, BASES - 1), first, k < BASES)


def sum_columns(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, columns: ColumnGroup
):  # fmt: skip
    """Sum the weights of contacts in each column of nodes, and if drag slows it mass and momentum; a thread each.

    In fixed order; and where drag slows columns in each further substep of a transfer, before the contacts push the nodes.
    """
    t = wp.tid()
    first = t // COLUMNS
    n = t % COLUMNS
    many = status.tally[BLOCKS]
    if status.flags[HALT] != 0 or first >= many or contacts.columns[first, 0] != first:
        return
    total = real(0.0)
    moving = node4()
    b = int(first)
    while b < many and contacts.columns[wp.min(b, many - 1), 0] == first:
        slot = ground.grounded[b]
        if slot >= 0:
            for k in range(4):
                total += contacts.shares[slot * SLOT + 4 * n + k]
        if DRAGS_COLUMN:
            for k in range(4):
                moving += node_at(grid.nodes, 64 * b + 4 * n + k)
        b += 1
    contacts.plan[t] = total
    if DRAGS_AT_ONCE:
        put_node(contacts.column_pushes, t, node4())
    if DRAGS_COLUMN:
        put_node(columns.moving, t, moving)


def _column(bases: Tile, x: int, y: int):
    """Place of a column of nodes, which is counted from the first of a block, 0 to 5, east and north."""
    return bases[8 + ((x >> 2 << 1) | (y >> 2))] + ((x & 3) << 2) + (y & 3)


def _give_weights(contacts: ContactGroup, tile: Tile, bases: Tile, lane: int):
    """Sums over the nodes above each other in the tile of a block: weights to the areas, impulses to what drag slows."""
    for q in range(lane, PLAN, lane_count()):
        s = node4()
        for z in range(6):
            s += tile[6 * q + z]
        if s[0] != real(0.0):
            place = _column(bases, q // 6, q % 6)
            wp.atomic_add(contacts.plan, place, s[0])
            if DRAGS_COLUMN:
                add_node(contacts.column_pushes, place, node4(real(0.0), s[1], s[2], s[3]))


def _give_moving(columns: ColumnGroup, halves: Tile, bases: Tile, lane: int):
    """Mass and momentum of the nodes above each other in the tile of each half of a block to the columns that drag slows.

    A warp has a half.
    """
    for t in range(lane, CELL_LANES, lane_count()):
        if t & 31 < HALF_PLAN:
            q = (t & 31) + (t >> 5) * (PLAN - HALF_PLAN)
            s = node4()
            for z in range(6):
                s += halves[6 * q + z + (t >> 5) * SECOND]
            if s[0] != real(0.0) or s[1] != real(0.0) or s[2] != real(0.0) or s[3] != real(0.0):
                add_node(columns.moving, _column(bases, q // 6, q % 6), s)


def _clear_columns(contacts: ContactGroup, columns: ColumnGroup, b: int, lane: int):
    """Begin the sums over columns of nodes from zero, if block ``b`` is the first of its column."""
    if contacts.columns[b, 0] != b:
        return
    for n in range(lane, COLUMNS, lane_count()):
        contacts.plan[COLUMNS * b + n] = real(0.0)
        if DRAGS_COLUMN:
            put_node(contacts.column_pushes, COLUMNS * b + n, node4())
            put_node(columns.moving, COLUMNS * b + n, node4())


def _weights_in_column(contacts: ContactGroup, bases: Tile, x: int, y: int):
    """Weights of all contacts in a column of nodes, likewise."""
    return contacts.plan[_column(bases, x, y)]


def _area(contacts: ContactGroup, bases: Tile, c: int, f: Vector, upward: Any, h: Vector):
    """Ground area [m2] of a contact at offset ``f`` in a cell of a block, from the ``upward`` part of the normal."""
    x = c >> 4
    y = (c >> 2) & 3
    wx = weights(f[0])
    wy = weights(f[1])
    around = real(0.0)
    for i in range(3):
        for j in range(3):
            around += wx[i] * wy[j] * _weights_in_column(contacts, bases, x + i, y + j)
    largest = largest_share(around)
    shares = real(0.0)
    for i in range(3):
        for j in range(3):
            shares += area_share(wx[i] * wy[j], real(1.0) / _weights_in_column(contacts, bases, x + i, y + j), largest)
    return ground_area(h[0] * h[1], shares, upward)
