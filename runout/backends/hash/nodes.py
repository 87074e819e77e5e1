"""Nodes: from momentum to velocity, once all impulses of a step are known."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.column_drag import _change_of_column, _work_and_impulse
from runout.backends.hash.contact_area import COLUMNS
from runout.backends.hash.groups import (
    BlockGroup,
    ColumnGroup,
    Constants,
    ContactGroup,
    GridGroup,
    GroundGroup,
    SceneGroup,
    StatusGroup,
)
from runout.backends.hash.layout import (
    BLOCKS,
    CURSOR,
    DRAGS_AT_ONCE,
    DRAGS_COLUMN,
    FIRST,
    HALT,
    NEXT,
    ORDERED,
    PUSHES,
    PUSHES_UP,
    SLOT,
    SUBSTEPPED,
    SUBSTEPS,
    VELOCITIES,
    WAYS,
    Frictions,
    Ints,
    node4,
    node_at,
    put_node,
)
from runout.backends.hash.stencil import _cell_entry, _place_of_begun
from runout.physics.contact import approach_speed
from runout.physics.moments import node_velocity
from runout.physics.tensors import real, vec

note_largest: Any = None  # the largest of each 32 numbers; the binding puts it in its place
pair_at: Any = None  # two numbers that lie beside each other, by one load; likewise
book_four: Any = None  # adds sums over the lanes to four numbers beside each other, likewise


def _slowed(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    friction: Frictions, columns: ColumnGroup, first_release: Ints, releases: int, t: int,
):  # fmt: skip
    """Change of the velocity [m/s] of a node by drag on its column, which the lowest block of the column books."""
    first = contacts.columns[t >> 6, 0]
    place = COLUMNS * first + ((t & 63) >> 2)
    change = node4()
    if ORDERED:
        change = node_at(columns.change, place)
    if DRAGS_AT_ONCE:
        change = _change_of_column(status, blocks, contacts, scenes, constants, friction, columns, first_release, releases, place)
        if first == t >> 6:
            booked = node4()
            if t & 3 == 0:
                booked = _work_and_impulse(columns, place, change)
            book_four(grid.booked, first, 1, booked)
    return vec(change[1], change[2], change[3])


def slow_nodes(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    friction: Frictions, columns: ColumnGroup, first_release: Ints, releases: int,
):  # fmt: skip
    """Change the momentum of the nodes by drag on their columns, for what reads them before ``update_nodes``."""
    t = wp.tid()
    if status.flags[HALT] != 0 or (t >> 6) >= status.tally[BLOCKS]:
        return
    g = node_at(grid.nodes, t)
    dv = _slowed(status, blocks, grid, contacts, scenes, constants, friction, columns, first_release, releases, t)
    put_node(grid.nodes, t, node4(g[0], g[1] + g[0] * dv[0], g[2] + g[0] * dv[1], g[3] + g[0] * dv[2]))


def _close_scene(status: StatusGroup, scenes: SceneGroup, t: int):
    """A step less is left of scene ``t``, and the counts that the next blocks need start from zero.

    What opened the step has read them. A scene with fewer substeps has waited.
    """
    if t < scenes.left.shape[0]:
        scenes.left[t] = wp.max(scenes.left[t] - 1, 0)
        if SUBSTEPPED:
            scenes.clock[t, 0] = wp.abs(scenes.clock[t, 0])
        if t == 0:
            status.tally[CURSOR] = 0
            status.tally[NEXT] = 0


def _motion(grid: GridGroup, t: int, layer: int, turn: int, mass: Any):
    """Velocity [m/s] of a node before substep number ``turn``, and its way [m] before that; the nodes of a layer are so many.

    Those of a node without ``mass`` are not read: most nodes of a thin flow have none.
    """
    motion = node4()
    way = node4()
    if SUBSTEPPED:
        if turn >= FIRST and mass > real(0.0):
            motion = node_at(grid.nodes, t + VELOCITIES * layer)
        if turn > FIRST and mass > real(0.0):
            way = node_at(grid.nodes, t + WAYS * layer)
    return motion, way


def _pushes(contacts: ContactGroup, slot: int, n: int):
    """Change [N s] of the impulses of all contacts on a node since the start of the substep."""
    push = pair_at(contacts.shares, slot * SLOT + PUSHES + 2 * n)
    return node4(real(0.0), push[0], push[1], contacts.shares[slot * SLOT + PUSHES_UP + n])


def _begin_contacts(contacts: ContactGroup, slot: int, n: int, push: Any):
    """Impulses [N s] from which the contacts on a node start in the next substep: those of this one, which changed by ``push``."""
    place = _place_of_begun(contacts, slot) + n
    begun = node_at(contacts.memory, place) + push
    put_node(contacts.memory, place, begun)
    contacts.shares[slot * SLOT + PUSHES + 2 * n] = real(0.0)
    contacts.shares[slot * SLOT + PUSHES + 2 * n + 1] = real(0.0)
    contacts.shares[slot * SLOT + PUSHES_UP + n] = real(0.0)
    return begun


def _begin_substep(
    grid: GridGroup, contacts: ContactGroup, slot: int, t: int, layer: int, turn: int, substeps: int, moving: Any, push: Any,
    way: Any,
):  # fmt: skip
    """Way of a node before its last velocity; if substeps are left, its momentum and impulses with which the next one begins.

    ``moving`` are its mass, above zero, and new velocity.
    """
    if turn > 1 or substeps == 1:
        put_node(grid.nodes, t + WAYS * layer, way)
    if turn < substeps:
        begun = node4()
        if slot >= 0:
            begun = _begin_contacts(contacts, slot, t & 63, push)
        momentum = moving[0] * moving + begun
        put_node(grid.nodes, t, node4(moving[0], momentum[1], momentum[2], momentum[3]))


def update_nodes(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup,
    constants: Constants, friction: Frictions, columns: ColumnGroup, first_release: Ints, releases: int, turn: wp.vec3i,
):  # fmt: skip
    """Momentum of every node to velocity [m/s], after gravity and the impulses of the ground, and the fastest towards the ground.

    ``turn``: number of the substep, most substeps of any scene, and whether drag on the columns of nodes slows. The last one closes
    the transfer: nobody needs the lists of the cells any more, and their counts start from zero.
    """
    t = wp.tid()
    b = t >> 6
    layer = 64 * blocks.up.shape[0]
    g = node_at(grid.nodes, t)  # loaded at once, before it is known whether there is anything to do
    s = blocks.member[b]
    slot = ground.grounded[b]
    slopes = ground.slopes[b]
    closes = turn[0] == turn[1]
    if status.flags[HALT] != 0:
        return
    if closes:
        _close_scene(status, scenes, t)
    if b >= status.tally[BLOCKS]:
        return
    if closes:
        blocks.ends[_cell_entry(t)] = 0
    dt = wp.abs(scenes.clock[s, 0])
    motion, way = _motion(grid, t, layer, turn[0], g[0])
    v = vec(motion[1], motion[2], motion[3])
    if dt > real(0.0) and scenes.clock[s, SUBSTEPS] >= real(turn[0]):
        dv = vec(real(0.0), real(0.0), real(0.0))
        if DRAGS_COLUMN:  # noqa: SIM102 - a constant alone: warp compiles no branch
            if turn[2] != 0:
                dv = _slowed(status, blocks, grid, contacts, scenes, constants, friction, columns, first_release, releases, t)
        if g[0] > real(0.0):
            push = node4()
            v = node_velocity(vec(g[1], g[2], g[3]), g[0], vec(scenes.clock[s, 1], scenes.clock[s, 2], scenes.clock[s, 3]))
            if slot >= 0:
                push = _pushes(contacts, slot, t & 63)
                v = node_velocity(vec(push[1], push[2], push[3]), g[0], v)
            if DRAGS_COLUMN:
                v += dv
            moving = node4(g[0], v[0], v[1], v[2])
            put_node(grid.nodes, t + VELOCITIES * layer, moving)
            if SUBSTEPPED:
                substeps = int(scenes.clock[s, SUBSTEPS])
                _begin_substep(grid, contacts, slot, t, layer, turn[0], substeps, moving, push, way + dt * motion)
    if closes and dt > real(0.0):
        note_largest(contacts.approach_speeds, t, approach_speed(v, slopes[0], slopes[1], slopes[2], slopes[3]))
