"""Drag that slows whole columns of nodes, for laws of friction that want it (:func:`runout.physics.contact.column_slowing`).

    contacts.drags[p]                drag [kg/m] of contact p                                     (contact_solution)
      --spread by weights in plan-->
    block_drags[36 b + q]            drag of the contacts of block b on the 6 x 6 columns of nodes that they reach
      --sum over the blocks around a column, in their order-->
    grid.nodes                       momentum of all nodes of the column
    column_book[16 b + n]            work and impulse on column n of the blocks from b on  -->  grid.booked[b]
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import COLUMNS
from runout.backends.hash.groups import BlockGroup, ContactGroup, GridGroup, GroundGroup, ParticleGroup, SceneGroup, StatusGroup
from runout.backends.hash.layout import (
    BLOCKS,
    HALT,
    NOT_NEGATIVE,
    OFFSET,
    PUSHES,
    PUSHES_UP,
    SLOT,
    TOUCHED,
    Nodes,
    Reals,
    Vector,
    node4,
    node_at,
    put_node,
)
from runout.physics.bspline import weights
from runout.physics.contact import column_slowing, column_work
from runout.physics.tensors import real, vec

PLAN = 36  # columns of nodes that the contacts of a block reach
WEST, SOUTH, SOUTH_WEST = 4, 10, 1  # of the 27 blocks around one


def _weight(f: Any, i: int):
    """Weight of node ``i`` of the three around offset ``f``; an index that varies would put all three in local memory."""
    w = weights(f)
    return wp.where(i == 0, w[0], wp.where(i == 1, w[1], w[2]))


def sum_drags(status: StatusGroup, particles: ParticleGroup, contacts: ContactGroup, block_drags: Reals):
    """Sum the drag of the contacts of a block in each column of nodes that they reach; a thread takes one column."""
    t = wp.tid()
    row = t // PLAN
    q = t % PLAN
    if status.flags[HALT] != 0 or row >= status.tally[TOUCHED]:
        return
    b = contacts.touched[row, 0]
    total = real(0.0)
    for c in range(64):
        i = q // 6 - (c >> 4)
        j = q % 6 - ((c >> 2) & 3)
        if i >= 0 and i < 3 and j >= 0 and j < 3:
            for n in range(contacts.pressed_start[b, c], contacts.pressed_start[b, c + 1]):
                p = contacts.pressed[n] & NOT_NEGATIVE
                share = _weight(particles.rec[OFFSET, p], i) * _weight(particles.rec[OFFSET + 1, p], j)
                total += share * contacts.drags[p]
    block_drags[PLAN * b + q] = total


def _drag_of(contacts: ContactGroup, block_drags: Reals, o: int, x: int, y: int):
    """Drag [kg/m] of the contacts of block ``o``, if there are any, on a column of nodes, which is counted from its first."""
    drag = real(0.0)
    if o >= 0 and x < 6 and y < 6 and contacts.touching[wp.max(o, 0)] > 0:
        drag = block_drags[PLAN * o + 6 * x + y]
    return drag


def _drag_around(blocks: BlockGroup, contacts: ContactGroup, block_drags: Reals, b: int, n: int):
    """Drag [kg/m] on column ``n`` of a block by its contacts and those of the blocks west and south."""
    x = n >> 2
    y = n & 3
    drag = _drag_of(contacts, block_drags, b, x, y)
    drag += _drag_of(contacts, block_drags, blocks.around[b, SOUTH], x, y + 4)
    drag += _drag_of(contacts, block_drags, blocks.around[b, WEST], x + 4, y)
    return drag + _drag_of(contacts, block_drags, blocks.around[b, SOUTH_WEST], x + 4, y + 4)


def _momentum(g: Any, ground: GroundGroup, contacts: ContactGroup, b: int, a: int, dv: Vector):
    """Momentum [kg m/s] of node ``a`` of a block after gravity and the impulses of the ground; ``g`` is the node before."""
    p = vec(g[1] + g[0] * dv[0], g[2] + g[0] * dv[1], g[3] + g[0] * dv[2])
    slot = ground.grounded[b]
    if slot >= 0:
        o = slot * SLOT
        push = vec(contacts.shares[o + PUSHES + 2 * a], contacts.shares[o + PUSHES + 2 * a + 1], contacts.shares[o + PUSHES_UP + a])
        p = p + push
    return p


def slow_columns(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup,
    block_drags: Reals, column_book: Nodes,
):  # fmt: skip
    """Change the momentum of the nodes by the drag on their columns; a thread takes one column."""
    t = wp.tid()
    first = t // COLUMNS
    n = t % COLUMNS
    many = status.tally[BLOCKS]
    if status.flags[HALT] != 0 or first >= many or contacts.columns[first] != first:
        return
    s = blocks.member[first]
    dv = vec(scenes.clock[s, 1], scenes.clock[s, 2], scenes.clock[s, 3])
    drag = real(0.0)
    mass = real(0.0)
    momentum = vec(real(0.0), real(0.0), real(0.0))
    b = int(first)
    while b < many and contacts.columns[wp.min(b, many - 1)] == first:
        drag += _drag_around(blocks, contacts, block_drags, b, n)
        for k in range(4):
            g = node_at(grid.nodes, b * 64 + 4 * n + k)
            if g[0] > real(0.0):
                mass += g[0]
                momentum += _momentum(g, ground, contacts, b, 4 * n + k, dv)
        b += 1
    change = vec(real(0.0), real(0.0), real(0.0))
    if drag > real(0.0) and mass > real(0.0):
        change = column_slowing(mass, momentum, drag, scenes.clock[s, 0])
        b = int(first)
        while b < many and contacts.columns[wp.min(b, many - 1)] == first:
            for k in range(4):
                g = node_at(grid.nodes, b * 64 + 4 * n + k)
                m = g[0]
                put_node(grid.nodes, b * 64 + 4 * n + k, g + node4(real(0.0), m * change[0], m * change[1], m * change[2]))
            b += 1
    put_node(
        column_book, t,
        node4(column_work(mass, momentum, change), mass * change[0], mass * change[1], mass * change[2]),
    )  # fmt: skip


def book_columns(status: StatusGroup, grid: GridGroup, contacts: ContactGroup, column_book: Nodes):
    """Book work [J] and impulse [N s] of the drag, in fixed order; a thread takes the columns of a block column."""
    first = wp.tid()
    if status.flags[HALT] != 0 or first >= status.tally[BLOCKS] or contacts.columns[first] != first:
        return
    total = node4()
    for n in range(COLUMNS):
        total += node_at(column_book, COLUMNS * first + n)
    for k in range(4):
        grid.booked[first, 1 + k] += wp.float64(total[k])
