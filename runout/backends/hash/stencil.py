"""Nodes of a block's tile: where they are in the grid, what is read from them, and sums over blocks in a fixed order."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.layout import (
    BLOCKS,
    CELL_LANES,
    COUNTED_AT_ONCE,
    GENERAL,
    HALT,
    PADDED,
    TILE,
    WIDE,
    WIDE_X,
    WIDE_Y,
    Ints,
    Nodes,
    Rows,
    Table2,
    Tile,
    Vector,
    node4,
    node_at,
    put_node,
)
from runout.physics.moments import node_velocity
from runout.physics.tensors import real, vec


def _cell_entry(k: int):
    """Where the particles of cell ``k`` are counted: at the start of the next cell."""
    return (k >> 6) * (CELL_LANES + 1) + (k & 63) + 1


def _first_node(c: int):
    """Place in the tile of the first node of cell ``c`` of a block."""
    return (c >> 4) * 36 + ((c >> 2) & 3) * 6 + (c & 3)


def _block(up: Table2, b: int, t: int):
    """Block of node ``t`` of a block's tile."""
    return up[b, ((t // 36) >> 2 << 2) | (((t // 6) % 6) >> 2 << 1) | ((t % 6) >> 2)]


def _local(t: int):
    """Place of node ``t`` of a tile in its block."""
    return (((t // 36) & 3) << 4) | ((((t // 6) % 6) & 3) << 2) | ((t % 6) & 3)


def _node(up: Table2, b: int, t: int):
    """Place in the grid of node ``t`` of a block's tile."""
    return _block(up, b, t) * 64 + _local(t)


def _arms(f: Any):
    """Distances [cells] of the three nodes of an axis from a particle."""
    return vec(-f, real(1.0) - f, real(2.0) - f)


def _contact_node(grid: Nodes, contact: Nodes, grounded: Ints, up: Table2, b: int, t: int, dv: Vector):
    """Velocity [m/s] before the ground pushes, and compliance [1/kg], of node ``t`` of a block's tile; nothing beyond the last."""
    u = node4()
    if t < TILE:
        o = _block(up, b, t)
        g = node_at(grid, o * 64 + _local(t))
        share = contact[grounded[o] * 64 + _local(t)][0]
        if g[0] > real(0.0):
            v = node_velocity(vec(g[1], g[2], g[3]), g[0], dv)
            u = node4(v[0], v[1], v[2], share / g[0])
    return u


def _load(tile: Tile, grid: Nodes, contact: Nodes, grounded: Ints, up: Table2, b: int, lane: int, dv: Vector):
    """Velocity [m/s] and compliance [1/kg] of the nodes that the particles of a block near the ground reach."""
    lanes = wp.block_dim()
    for q in range(PADDED // lanes // 4):
        t = 4 * q * lanes + lane
        v0 = _contact_node(grid, contact, grounded, up, b, t, dv)
        v1 = _contact_node(grid, contact, grounded, up, b, t + lanes, dv)
        v2 = _contact_node(grid, contact, grounded, up, b, t + 2 * lanes, dv)
        v3 = _contact_node(grid, contact, grounded, up, b, t + 3 * lanes, dv)
        wp.tile_scatter_masked(tile, t, v0, True)
        wp.tile_scatter_masked(tile, t + lanes, v1, True)
        wp.tile_scatter_masked(tile, t + 2 * lanes, v2, True)
        wp.tile_scatter_masked(tile, t + 3 * lanes, v3, True)


def _wide_block(around: Table2, b: int, t: int):
    """Block of node ``t`` of the 8 x 8 x 8 around a block."""
    return around[b, (((((t >> 6) & 7) + 3) >> 2) * 9 + ((((t >> 3) & 7) + 3) >> 2) * 3 + (((t & 7) + 3) >> 2)) & 31]


def _wide_node(grid: Nodes, o: int, t: int):
    """Velocity of node ``t`` of the 8 x 8 x 8 around a block; ``o`` is the block that it belongs to, -1 if there is none.

    In a general scene the first number of the node comes last: its mean dilatation by then.
    """
    g = node4()
    if o >= 0:
        g = node_at(grid, o * 64 + (((((t >> 6) + 3) & 3) << 4) | ((((t >> 3) + 3) & 3) << 2) | ((t + 3) & 3)))
    if GENERAL:
        return node4(g[1], g[2], g[3], g[0])
    return node4(g[1], g[2], g[3], real(0.0))


def _wide_place(t: int):
    """Where node ``t`` of the 8 x 8 x 8 around a block goes in the tile."""
    return ((t >> 6) & 7) * WIDE_X + ((t >> 3) & 7) * WIDE_Y + (t & 7)


def _load_wide(tile: Tile, grid: Nodes, around: Table2, b: int, lane: int):
    """Velocity of the nodes that particles reach which have come up to one cell out of a block; eight a lane under way at once."""
    lanes = wp.block_dim()
    for q in range(WIDE // lanes // 8):
        t = 8 * q * lanes + lane
        b0 = _wide_block(around, b, t)
        b1 = _wide_block(around, b, t + lanes)
        b2 = _wide_block(around, b, t + 2 * lanes)
        b3 = _wide_block(around, b, t + 3 * lanes)
        b4 = _wide_block(around, b, t + 4 * lanes)
        b5 = _wide_block(around, b, t + 5 * lanes)
        b6 = _wide_block(around, b, t + 6 * lanes)
        b7 = _wide_block(around, b, t + 7 * lanes)
        u0 = _wide_node(grid, b0, t)
        u1 = _wide_node(grid, b1, t + lanes)
        u2 = _wide_node(grid, b2, t + 2 * lanes)
        u3 = _wide_node(grid, b3, t + 3 * lanes)
        u4 = _wide_node(grid, b4, t + 4 * lanes)
        u5 = _wide_node(grid, b5, t + 5 * lanes)
        u6 = _wide_node(grid, b6, t + 6 * lanes)
        u7 = _wide_node(grid, b7, t + 7 * lanes)
        wp.tile_scatter_masked(tile, _wide_place(t), u0, True)
        wp.tile_scatter_masked(tile, _wide_place(t + lanes), u1, True)
        wp.tile_scatter_masked(tile, _wide_place(t + 2 * lanes), u2, True)
        wp.tile_scatter_masked(tile, _wide_place(t + 3 * lanes), u3, True)
        wp.tile_scatter_masked(tile, _wide_place(t + 4 * lanes), u4, True)
        wp.tile_scatter_masked(tile, _wide_place(t + 5 * lanes), u5, True)
        wp.tile_scatter_masked(tile, _wide_place(t + 6 * lanes), u6, True)
        wp.tile_scatter_masked(tile, _wide_place(t + 7 * lanes), u7, True)


def update_nodes(
    flags: Ints, tally: Ints, member: Ints, clock: Rows, grounded: Ints, contact: Nodes, ends: Ints, grid: Nodes
):  # fmt: skip
    """Momentum of every node to velocity [m/s], after gravity and the impulses of the ground.

    The cells are counted anew from here on, unless F-bar still needs their lists.
    """
    t = wp.tid()
    b = t >> 6
    if flags[HALT] != 0 or b >= tally[BLOCKS]:
        return
    if COUNTED_AT_ONCE:
        ends[_cell_entry(t)] = 0
    g = node_at(grid, t)
    if g[0] > real(0.0):
        s = member[b]
        v = node_velocity(vec(g[1], g[2], g[3]), g[0], vec(clock[s, 1], clock[s, 2], clock[s, 3]))
        if grounded[b] >= 0:
            push = node_at(contact, grounded[b] * 64 + (t & 63))
            if push[0] > real(0.0):
                v = node_velocity(vec(push[1], push[2], push[3]), g[0], v)
        put_node(grid, t, node4(g[0], v[0], v[1], v[2]))


def _sum_arenas(arenas: Nodes, held: Ints, down: Table2, t: int):
    """Sum at a node over the up to eight arenas that overlap it and hold something, in a fixed order."""
    b = t >> 6
    s = node4()
    for q in range(8):
        o = down[b, q]
        x = ((t >> 4) & 3) + (q & 4)
        y = ((t >> 2) & 3) + ((q & 2) << 1)
        z = (t & 3) + ((q & 1) << 2)
        if o >= 0 and x < 6 and y < 6 and z < 6 and held[wp.max(o, 0)] > 0:
            s += node_at(arenas, o * TILE + (x * 6 + y) * 6 + z)
    return s


def note_held(cstart: Table2, held: Ints):
    """Particles of each block, for sums in fixed order."""
    b = wp.tid()
    held[b] = cstart[b, 64] - cstart[b, 0]


def sum_nodes(flags: Ints, arenas: Nodes, held: Ints, down: Table2, grid: Nodes):
    """Mass and momentum of every node, in fixed order."""
    t = wp.tid()
    if flags[HALT] == 0:
        put_node(grid, t, _sum_arenas(arenas, held, down, t))


def sum_contacts(flags: Ints, arenas: Nodes, touching: Ints, down: Table2, grounded: Ints, part: int, contact: Nodes):
    """Weights of the contact particles (``part`` 0) or their impulses (1) at each node near the ground, in fixed order."""
    t = wp.tid()
    slot = grounded[t >> 6]
    if flags[HALT] != 0 or slot < 0:
        return
    s = _sum_arenas(arenas, touching, down, t)
    g = node_at(contact, slot * 64 + (t & 63))
    if part == 0:
        g = node4(s[0], g[1], g[2], g[3])
    else:
        g = node4(g[0], s[1], s[2], s[3])
    put_node(contact, slot * 64 + (t & 63), g)
