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
    HALT,
    NEXT,
    ORDERED,
    PUSHES,
    PUSHES_UP,
    SLOT,
    Frictions,
    Ints,
    node4,
    node_at,
    put_node,
)
from runout.backends.hash.stencil import _cell_entry
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

    What opened the step has read them.
    """
    if t < scenes.left.shape[0]:
        scenes.left[t] = wp.max(scenes.left[t] - 1, 0)
        if t == 0:
            status.tally[CURSOR] = 0
            status.tally[NEXT] = 0


def _velocity_of_node(contacts: ContactGroup, scenes: SceneGroup, g: Any, s: int, slot: int, n: int):
    """Velocity [m/s] of a node with mass and momentum ``g`` after gravity and the impulses of the ground.

    And how much these impulses [N s] have changed since the start of the substep.
    """
    push = node4()
    v = node_velocity(vec(g[1], g[2], g[3]), g[0], vec(scenes.clock[s, 1], scenes.clock[s, 2], scenes.clock[s, 3]))
    if slot >= 0:
        in_plan = pair_at(contacts.shares, slot * SLOT + PUSHES + 2 * n)
        push = node4(real(0.0), in_plan[0], in_plan[1], contacts.shares[slot * SLOT + PUSHES_UP + n])
        v = node_velocity(vec(push[1], push[2], push[3]), g[0], v)
    return v, push


def update_nodes(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup,
    constants: Constants, friction: Frictions, columns: ColumnGroup, first_release: Ints, releases: int, slowing: int,
):  # fmt: skip
    """Momentum of every node to velocity [m/s], after gravity and the impulses of the ground, and the fastest towards the ground.

    If ``slowing``, also after drag on the columns of nodes. Nobody needs the lists of the cells any more: their counts start from
    zero.
    """
    t = wp.tid()
    b = t >> 6
    g = node_at(grid.nodes, t)  # loaded at once, before it is known whether there is anything to do
    s = blocks.member[b]
    slot = ground.grounded[b]
    slopes = ground.slopes[b]
    if status.flags[HALT] != 0:
        return
    _close_scene(status, scenes, t)
    if b >= status.tally[BLOCKS]:
        return
    blocks.ends[_cell_entry(t)] = 0
    v = vec(real(0.0), real(0.0), real(0.0))
    dv = vec(real(0.0), real(0.0), real(0.0))
    if DRAGS_COLUMN:  # noqa: SIM102 - a constant alone: warp compiles no branch
        if slowing != 0:
            dv = _slowed(status, blocks, grid, contacts, scenes, constants, friction, columns, first_release, releases, t)
    if g[0] > real(0.0):
        v, _push = _velocity_of_node(contacts, scenes, g, s, slot, t & 63)
        if DRAGS_COLUMN:
            v += dv
        put_node(grid.nodes, t, node4(g[0], v[0], v[1], v[2]))
    if scenes.clock[s, 0] > real(0.0):
        note_largest(contacts.approach_speeds, t, approach_speed(v, slopes[0], slopes[1], slopes[2], slopes[3]))
