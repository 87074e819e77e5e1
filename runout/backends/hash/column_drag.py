"""Drag that slows whole columns of nodes, for laws of friction that want it (:func:`runout.physics.contact.column_slowing`).

    columns.moving[16 b + n]          mass and momentum of column n of the nodes of the blocks from b on     (particles_to_grid)
    contacts.column_pushes[16 b + n]  drag and impulses of the contacts on the column      (contact_detection, contact_solution)
      --momentum after gravity and impulses; drag by the contacts, where none gives one by the masses of the 3 x 3 columns around-->
    change of velocity of the column, which each of its nodes takes; work and impulse to grid.booked[b]                  (nodes)

For sums in fixed order ``contact_area`` sums up the columns, contacts.column_pushes[36 b + q] are those of block b on the 6 x 6
columns that they reach, and a launch of its own finds columns.change[16 b + n].

A column without drag from contacts is in flight (:func:`runout.physics.contact.free_column_drag`). It takes the friction of each
release by its share in the mass of the column.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import COLUMNS, PLAN
from runout.backends.hash.groups import (
    BlockGroup,
    ColumnGroup,
    Constants,
    ContactGroup,
    GridGroup,
    ParticleGroup,
    SceneGroup,
    StatusGroup,
)
from runout.backends.hash.layout import (
    BLOCKS,
    DRAGS_AT_ONCE,
    HALT,
    MASS,
    OFFSET,
    ORDERED,
    ZONED,
    Frictions,
    Ints,
    Vector,
    lane_count,
    node4,
    node_at,
    own_block,
    own_lane,
    put_node,
)
from runout.backends.hash.stencil import _scene_of
from runout.backends.hash.zones import _kind_of_ground
from runout.physics.bspline import weights
from runout.physics.contact import column_slowing, column_work, covered_share, free_column_drag
from runout.physics.tensors import real, vec

WEST, SOUTH, SOUTH_WEST = 4, 10, 1  # of the 27 blocks around one
book_four: Any = None  # adds sums over the lanes to four numbers beside each other; the binding puts it in its place


def _weight(f: Any, i: int):
    """Weight of node ``i`` of the three around offset ``f``; an index that varies would put all three in local memory."""
    w = weights(f)
    return wp.where(i == 0, w[0], wp.where(i == 1, w[1], w[2]))


def _pushes_of(contacts: ContactGroup, o: int, x: int, y: int):
    """Drag and impulse of the contacts of block ``o``, if there are any, on a column of nodes, which is counted from its first."""
    pushes = node4()
    if o >= 0 and x < 6 and y < 6 and contacts.touching[wp.max(o, 0)] > 0:
        pushes = node_at(contacts.column_pushes, PLAN * wp.max(o, 0) + 6 * x + y)
    return pushes


def _pushes_on(status: StatusGroup, blocks: BlockGroup, contacts: ContactGroup, first: int, n: int):
    """Drag [kg/m] and impulse [N s] on column ``n`` of a block column by contacts of its blocks and of those west and south."""
    x = n >> 2
    y = n & 3
    many = status.tally[BLOCKS]
    pushes = node4()
    b = int(first)
    while b < many and contacts.columns[wp.min(b, many - 1), 0] == first:
        pushes += _pushes_of(contacts, b, x, y)
        pushes += _pushes_of(contacts, blocks.around[b, SOUTH], x, y + 4)
        pushes += _pushes_of(contacts, blocks.around[b, WEST], x + 4, y)
        pushes += _pushes_of(contacts, blocks.around[b, SOUTH_WEST], x + 4, y + 4)
        b += 1
    return pushes


def number_beside(status: StatusGroup, blocks: BlockGroup, contacts: ContactGroup, columns: ColumnGroup):
    """Find the first blocks of the columns of blocks around each; a thread takes one of nine."""
    t = wp.tid()
    b = t // 9
    q = t % 9
    many = status.tally[BLOCKS]
    if b >= many or contacts.columns[b, 0] != b:
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


def _mass_of_release(status: StatusGroup, contacts: ContactGroup, columns: ColumnGroup, first: int, n: int, r: int, releases: int):
    """Mass [kg] of a release in column ``n`` of the nodes of a block column."""
    many = status.tally[BLOCKS]
    total = real(0.0)
    for q in range(4):
        x = (n >> 2) + 4 * (1 - (q >> 1))
        y = (n & 3) + 4 * (1 - (q & 1))
        other = int(columns.beside[first, 3 * (q >> 1) + (q & 1)])
        b = int(wp.where(other < 0 or x >= 6 or y >= 6, many, other))
        while b < many and contacts.columns[wp.min(b, many - 1), 0] == other:
            total += columns.masses[PLAN * (releases * b + r) + 6 * x + y]
            b += 1
    return total


def _free_drag(
    status: StatusGroup, blocks: BlockGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    friction: Frictions, columns: ColumnGroup, first: int, n: int, mass: Any, p: Vector, area: Any, first_release: int,
    releases: int,
):  # fmt: skip
    """Drag [kg/m] on column ``n`` of a block column in flight, with momentum ``p`` over an ``area``."""
    s = _scene_of(blocks, scenes, first)
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
            basal = friction[scenes.of_friction[first_release + r, 0] + kind]
            gravity = real(wp.length(constants.gravity))
            drag += weight * free_column_drag(mass, p, area, gravity, scenes.clock[s, 0], basal)
            total += weight
    return wp.where(total > real(0.0), drag / total, real(0.0))


def _change_of_column(
    status: StatusGroup, blocks: BlockGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    friction: Frictions, columns: ColumnGroup, first_release: Ints, releases: int, place: int,
):  # fmt: skip
    """Work [J] of the drag on the column of nodes at a place of ``columns.moving``, and change of the velocity [m/s]."""
    first = place // COLUMNS
    n = place % COLUMNS
    g = node_at(columns.moving, place)
    mass = g[0]
    result = node4()
    s = _scene_of(blocks, scenes, first)
    if mass > real(0.0) and scenes.clock[s, 0] > real(0.0):
        pushes = node4()
        if ORDERED:
            pushes = _pushes_on(status, blocks, contacts, first, n)
        if DRAGS_AT_ONCE:
            pushes = node_at(contacts.column_pushes, place)
        dv = vec(scenes.clock[s, 1], scenes.clock[s, 2], scenes.clock[s, 3])
        p = vec(g[1], g[2], g[3]) + mass * dv + vec(pushes[1], pushes[2], pushes[3])
        drag = pushes[0]
        if drag <= real(0.0):
            area = _covered_area(columns, first, n, mass, constants.h)
            drag = _free_drag(
                status, blocks, contacts, scenes, constants, friction, columns, first, n, mass, p, area, first_release[s], releases
            )
        change = column_slowing(mass, p, drag, scenes.clock[s, 0])
        result = node4(column_work(mass, p, change), change[0], change[1], change[2])
    return result


def _work_and_impulse(columns: ColumnGroup, place: int, change: Any):
    """Work [J] and impulse [N s] of the drag on a column of nodes, whose velocity it changes."""
    mass = columns.moving[place][0]
    return node4(change[0], mass * change[1], mass * change[2], mass * change[3])


def slow_columns(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    friction: Frictions, columns: ColumnGroup, first_release: Ints, releases: int,
):  # fmt: skip
    """Find in fixed order by how much the drag on the columns of nodes changes their velocity, and book its work and impulse.

    A warp takes a block column, a lane a column of nodes. ``first_release`` are the first ones of the scenes; ``releases`` is how
    many of a scene differ in friction, 1 if none do.
    """
    first, lane = wp.tid()
    first, lane = own_block(first), own_lane(lane)
    if status.flags[HALT] != 0 or first >= status.tally[BLOCKS] or contacts.columns[first, 0] != first:
        return
    booked = node4()
    for n in range(lane, COLUMNS, lane_count()):
        place = COLUMNS * first + n
        change = _change_of_column(status, blocks, contacts, scenes, constants, friction, columns, first_release, releases, place)
        booked += _work_and_impulse(columns, place, change)
        put_node(columns.change, place, change)
    book_four(grid.booked, first, 1, booked)
