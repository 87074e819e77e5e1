"""Drag that slows whole columns of nodes, for laws of friction that want it (:func:`runout.physics.contact.column_slowing`).

    contacts.drags[p]                drag [kg/m] of contact p                                     (contact_solution)
      --spread by weights in plan-->
    columns.block_drags[36 b + q]    drag of the contacts of block b on the 6 x 6 columns of nodes that they reach
      --sum over the blocks around a column, in their order-->
    columns.drag[16 b + n]           drag on column n of the blocks from b on
    columns.moving[16 b + n]         its mass and momentum
      --drag where no contact gives one, by the masses of the 3 x 3 columns around-->
    grid.nodes                       momentum of all nodes of the column
    columns.book[16 b + n]           work and impulse on the column  -->  grid.booked[b]

A column without drag from contacts is in flight (:func:`runout.physics.contact.free_column_drag`). It takes the friction of each
release by its share in the mass of the column.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import COLUMNS
from runout.backends.hash.groups import (
    BlockGroup,
    ColumnGroup,
    Constants,
    ContactGroup,
    GridGroup,
    GroundGroup,
    ParticleGroup,
    SceneGroup,
    StatusGroup,
)
from runout.backends.hash.layout import (
    BLOCKS,
    HALT,
    MASS,
    NOT_NEGATIVE,
    OFFSET,
    PUSHES,
    PUSHES_UP,
    SLOT,
    TOUCHED,
    ZONED,
    Frictions,
    Ints,
    Vector,
    node4,
    node_at,
    put_node,
)
from runout.backends.hash.zones import _kind_of_ground
from runout.physics.bspline import weights
from runout.physics.contact import column_slowing, column_work, covered_share, free_column_drag
from runout.physics.tensors import real, vec

PLAN = 36  # columns of nodes that the contacts of a block reach
WEST, SOUTH, SOUTH_WEST = 4, 10, 1  # of the 27 blocks around one


def _weight(f: Any, i: int):
    """Weight of node ``i`` of the three around offset ``f``; an index that varies would put all three in local memory."""
    w = weights(f)
    return wp.where(i == 0, w[0], wp.where(i == 1, w[1], w[2]))


def sum_drags(status: StatusGroup, particles: ParticleGroup, contacts: ContactGroup, columns: ColumnGroup):
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
    columns.block_drags[PLAN * b + q] = total


def _drag_of(contacts: ContactGroup, columns: ColumnGroup, o: int, x: int, y: int):
    """Drag [kg/m] of the contacts of block ``o``, if there are any, on a column of nodes, which is counted from its first."""
    drag = real(0.0)
    if o >= 0 and x < 6 and y < 6 and contacts.touching[wp.max(o, 0)] > 0:
        drag = columns.block_drags[PLAN * o + 6 * x + y]
    return drag


def _drag_around(blocks: BlockGroup, contacts: ContactGroup, columns: ColumnGroup, b: int, n: int):
    """Drag [kg/m] on column ``n`` of a block by its contacts and those of the blocks west and south."""
    x = n >> 2
    y = n & 3
    drag = _drag_of(contacts, columns, b, x, y)
    drag += _drag_of(contacts, columns, blocks.around[b, SOUTH], x, y + 4)
    drag += _drag_of(contacts, columns, blocks.around[b, WEST], x + 4, y)
    return drag + _drag_of(contacts, columns, blocks.around[b, SOUTH_WEST], x + 4, y + 4)


def _momentum(g: Any, ground: GroundGroup, contacts: ContactGroup, b: int, a: int, dv: Vector):
    """Momentum [kg m/s] of node ``a`` of a block after gravity and the impulses of the ground; ``g`` is the node before."""
    p = vec(g[1] + g[0] * dv[0], g[2] + g[0] * dv[1], g[3] + g[0] * dv[2])
    slot = ground.grounded[b]
    if slot >= 0:
        o = slot * SLOT
        push = vec(contacts.shares[o + PUSHES + 2 * a], contacts.shares[o + PUSHES + 2 * a + 1], contacts.shares[o + PUSHES_UP + a])
        p = p + push
    return p


def number_beside(status: StatusGroup, blocks: BlockGroup, contacts: ContactGroup, columns: ColumnGroup):
    """Find the first blocks of the columns of blocks around each; a thread takes one of nine."""
    t = wp.tid()
    b = t // 9
    q = t % 9
    many = status.tally[BLOCKS]
    if b >= many or contacts.columns[b] != b:
        return
    x = blocks.coordinates[b, 0] + q // 3 - 1
    y = blocks.coordinates[b, 1] + q % 3 - 1
    low = int(0)
    high = int(many)
    while low < high:  # blocks are in the order of x, then y
        middle = (low + high) // 2
        if blocks.coordinates[middle, 0] < x or (blocks.coordinates[middle, 0] == x and blocks.coordinates[middle, 1] < y):
            low = middle + 1
        else:
            high = middle
    found = int(-1)
    if low < many and blocks.coordinates[wp.min(low, many - 1), 0] == x and blocks.coordinates[wp.min(low, many - 1), 1] == y:
        found = low
    columns.beside[b, q] = found


def weigh_releases(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, columns: ColumnGroup, first_release: Ints, releases: int
):
    """Mass that each release in a block gives to the columns of nodes that it reaches; a thread takes one column of one release.

    Before contacts are found: their lists replace that of the cells.
    """
    t = wp.tid()
    b = t // (PLAN * releases)
    r = (t // PLAN) % releases
    q = t % PLAN
    if status.flags[HALT] != 0 or b >= status.tally[BLOCKS]:
        return
    wanted = first_release[blocks.member[b]] + r
    total = real(0.0)
    for c in range(64):
        i = q // 6 - (c >> 4)
        j = q % 6 - ((c >> 2) & 3)
        if i >= 0 and i < 3 and j >= 0 and j < 3:
            for n in range(blocks.cstart[b, c], blocks.cstart[b, c + 1]):
                p = particles.order[n]
                if int(particles.release[p]) == wanted:
                    share = _weight(particles.rec[OFFSET, p], i) * _weight(particles.rec[OFFSET + 1, p], j)
                    total += share * particles.rec[MASS, p]
    columns.masses[t] = total


def sum_moving(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup,
    columns: ColumnGroup,
):  # fmt: skip
    """Mass, momentum and drag of the columns of nodes; a thread takes one column."""
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
        drag += _drag_around(blocks, contacts, columns, b, n)
        for k in range(4):
            g = node_at(grid.nodes, b * 64 + 4 * n + k)
            if g[0] > real(0.0):
                mass += g[0]
                momentum += _momentum(g, ground, contacts, b, 4 * n + k, dv)
        b += 1
    columns.drag[t] = drag
    put_node(columns.moving, t, node4(mass, momentum[0], momentum[1], momentum[2]))


def _mass_beside(columns: ColumnGroup, first: int, x: int, y: int):
    """Mass [kg] of a column of nodes, counted from the first one of the block column ``first``, -1 to 4."""
    other = columns.beside[first, 3 * ((x + 4) >> 2) + ((y + 4) >> 2)]
    mass = real(0.0)
    if other >= 0:
        g = node_at(columns.moving, COLUMNS * wp.max(other, 0) + (((x + 4) & 3) << 2) + ((y + 4) & 3))
        mass = g[0]
    return mass


def _covered_area(columns: ColumnGroup, first: int, n: int, mass: Any, h: Vector):
    """Area [m2] in plan of column ``n``, from the masses around."""
    around = real(0.0)
    squares = real(0.0)
    for i in range(3):
        for j in range(3):
            m = _mass_beside(columns, first, (n >> 2) + i - 1, (n & 3) + j - 1)
            around += m
            squares += m * m
    return h[0] * h[1] * covered_share(mass, around, squares)


def _mass_of_release(
    status: StatusGroup, contacts: ContactGroup, columns: ColumnGroup, first: int, n: int, r: int, releases: int
):
    """Mass [kg] of a release in column ``n`` of the nodes of a block column."""
    many = status.tally[BLOCKS]
    total = real(0.0)
    for q in range(4):
        x = (n >> 2) + 4 * (1 - (q >> 1))
        y = (n & 3) + 4 * (1 - (q & 1))
        other = int(columns.beside[first, 3 * (q >> 1) + (q & 1)])
        b = int(wp.where(other < 0 or x >= 6 or y >= 6, many, other))
        while b < many and contacts.columns[wp.min(b, many - 1)] == other:
            total += columns.masses[PLAN * (releases * b + r) + 6 * x + y]
            b += 1
    return total


def _free_drag(
    status: StatusGroup, blocks: BlockGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    friction: Frictions, columns: ColumnGroup, first: int, n: int, first_release: int, releases: int,
):  # fmt: skip
    """Drag [kg/m] on column ``n`` of a block column in flight."""
    g = node_at(columns.moving, COLUMNS * first + n)
    area = _covered_area(columns, first, n, g[0], constants.h)
    s = blocks.member[first]
    kind = int(0)
    if ZONED:
        x = 4 * blocks.coordinates[first, 0] + (n >> 2)
        y = 4 * blocks.coordinates[first, 1] - scenes.shift[s] + (n & 3)
        kind = _kind_of_ground(scenes, s, x, y, vec(real(0.0), real(0.0), real(0.0)))
    drag = real(0.0)
    total = real(0.0)
    for r in range(releases):
        weight = real(1.0)
        if releases > 1:
            weight = _mass_of_release(status, contacts, columns, first, n, r, releases)
        if weight > real(0.0):
            basal = friction[scenes.first_friction[first_release + r] + kind]
            gravity = real(wp.length(constants.gravity))
            p = vec(g[1], g[2], g[3])
            drag += weight * free_column_drag(g[0], p, area, gravity, scenes.clock[s, 0], basal)
            total += weight
    return wp.where(total > real(0.0), drag / total, real(0.0))


def slow_columns(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    friction: Frictions, columns: ColumnGroup, first_release: Ints, releases: int,
):  # fmt: skip
    """Change the momentum of the nodes by the drag on their columns; a thread takes one column.

    ``first_release`` are the first ones of the scenes; ``releases`` is how many of a scene differ in friction, 1 if none do.
    """
    t = wp.tid()
    first = t // COLUMNS
    n = t % COLUMNS
    many = status.tally[BLOCKS]
    if status.flags[HALT] != 0 or first >= many or contacts.columns[first] != first:
        return
    g = node_at(columns.moving, t)
    mass = g[0]
    momentum = vec(g[1], g[2], g[3])
    change = vec(real(0.0), real(0.0), real(0.0))
    if mass > real(0.0):
        drag = columns.drag[t]
        if drag <= real(0.0):
            r = first_release[blocks.member[first]]
            drag = _free_drag(status, blocks, contacts, scenes, constants, friction, columns, first, n, r, releases)
        change = column_slowing(mass, momentum, drag, scenes.clock[blocks.member[first], 0])
        b = int(first)
        while b < many and contacts.columns[wp.min(b, many - 1)] == first:
            for k in range(4):
                a = node_at(grid.nodes, b * 64 + 4 * n + k)
                m = a[0]
                put_node(grid.nodes, b * 64 + 4 * n + k, a + node4(real(0.0), m * change[0], m * change[1], m * change[2]))
            b += 1
    put_node(
        columns.book, t,
        node4(column_work(mass, momentum, change), mass * change[0], mass * change[1], mass * change[2]),
    )  # fmt: skip


def book_columns(status: StatusGroup, grid: GridGroup, contacts: ContactGroup, columns: ColumnGroup):
    """Book work [J] and impulse [N s] of the drag, in fixed order; a thread takes the columns of a block column."""
    first = wp.tid()
    if status.flags[HALT] != 0 or first >= status.tally[BLOCKS] or contacts.columns[first] != first:
        return
    total = node4()
    for n in range(COLUMNS):
        total += node_at(columns.book, COLUMNS * first + n)
    for k in range(4):
        grid.booked[first, 1 + k] += wp.float64(total[k])
