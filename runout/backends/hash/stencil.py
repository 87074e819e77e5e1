"""Nodes of a block's tile: where they are in the grid, what is read from them, and sums over blocks in a fixed order."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.groups import BlockGroup, ContactGroup, GridGroup, GroundGroup, SceneGroup, StatusGroup
from runout.backends.hash.layout import (
    CELL_LANES,
    HALT,
    HALVES,
    ORDERED,
    PIECE,
    PUSHES,
    PUSHES_UP,
    SECOND,
    SLOT,
    TILE,
    WIDE_PLAN,
    WIDE_X,
    WIDE_Y,
    Ints,
    Nodes,
    Table2,
    Tile,
    Vector,
    add_node,
    lane_count,
    node4,
    node_at,
    put_node,
)
from runout.physics.moments import node_velocity
from runout.physics.tensors import real, vec

add_in: Any = None  # adds to a number of a tile; the binding puts it in its place
meet: Any = None  # the lanes of a block wait for each other, likewise
meet_warp: Any = None  # those of a warp, likewise
stage_node: Any = None  # begins to copy a node to a tile, likewise
pair_at: Any = None  # two numbers that lie beside each other, by one load; the binding puts it in its place


def _cell_entry(k: int):
    """Where the particles of cell ``k`` are counted: at the start of the next cell."""
    return (k >> 6) * (CELL_LANES + 1) + (k & 63) + 1


def _scene_of(blocks: BlockGroup, scenes: SceneGroup, b: int):
    """Scene of a block; nothing is read if there is only one."""
    s = int(0)
    if scenes.clock.shape[0] > 1:
        s = blocks.member[b]
    return s


def _place_of_begun(contacts: ContactGroup, slot: int):
    """Where the impulses of a slot from which contacts start lie in ``contacts.memory``; -1 if transfers have one substep."""
    behind = contacts.shares.shape[0] >> 2
    return wp.where(contacts.memory.shape[0] > behind, behind + slot * CELL_LANES, -1)


def _first_node(c: int):
    """Place in the tile of the first node of cell ``c`` of a block."""
    return (c >> 4) * 36 + ((c >> 2) & 3) * 6 + (c & 3)


def _set_bases(bases: Tile, up: Table2, b: int, lane: int):
    """Places in the grid of the first nodes of the eight blocks that the tile of a block overlaps."""
    for q in range((8 + lane_count() - 1) // lane_count()):
        k = q * lane_count() + lane
        wp.tile_scatter_masked(bases, k & 7, up[b, k & 7] * 64, k < 8)


def _set_near_bases(bases: Tile, near_up: Table2, place: int, lane: int):
    """Places in ``shares`` of the numbers of these eight blocks, for the block at a place near the ground."""
    for q in range((8 + lane_count() - 1) // lane_count()):
        k = q * lane_count() + lane
        wp.tile_scatter_masked(bases, k & 7, near_up[place, k & 7], k < 8)


def _node(bases: Tile, t: int):
    """Place of node ``t`` of a block's tile, by the ``bases`` of the blocks that it meets."""
    x = t // 36
    y = (t // 6) % 6
    z = t % 6
    return bases[((x >> 2 << 2) | (y >> 2 << 1) | (z >> 2)) & 7] + (((x & 3) << 4) | ((y & 3) << 2) | (z & 3))


def _cell_of(starts: Tile, n: int):
    """Cell that holds number ``n`` of some particles of a block: the last whose start is not beyond it."""
    c = int(0)
    for q in range(6):
        further = c + (32 >> q)
        if starts[further] <= n:
            c = further
    return c


def _cell_of_lane(lane: int):
    """Cell that a lane sums; eight lanes in a row have two cells of each of four columns: their nodes lie in different banks."""
    return (lane & 49) | ((lane & 6) << 1) | ((lane & 8) >> 2)


def _add_cell(halves: Tile, c: int, behind: int, acc: Any):
    """Sums (27, 4) of cell ``c`` to the tile of its half of the block; the tiles lie ``behind`` the first by so many nodes.

    A warp has the 32 cells of a half, and a tile of its own for the 4 x 6 x 6 nodes that they reach: no warp waits for another.
    """
    first = _first_node(c) + SECOND * (c >> 5) + behind
    for i in range(3):
        for j in range(3):
            for k in range(3):
                n = (i * 3 + j) * 3 + k
                add_in(halves, first + (i * 6 + j) * 6 + k, node4(acc[n, 0], acc[n, 1], acc[n, 2], acc[n, 3]))
                meet_warp()


def _of_halves(halves: Tile, t: int, behind: int):
    """Sum at node ``t`` of a block over the tiles of its halves."""
    g = node4()
    if t < TILE - SECOND:
        g = node4(halves[t + behind])
    if t >= SECOND:
        g += halves[t + SECOND + behind]
    return g


def _give_tile(halves: Tile, parts: int, arenas: Nodes, nodes: Nodes, bases: Tile, b: int, lane: int):
    """Sums at the nodes of the tiles of both halves to the nodes of the grid; in fixed order, only to the arena of the block.

    There are two ``parts`` of such tiles, or one.
    """
    meet()
    for t in range(lane, TILE, lane_count()):
        g = _of_halves(halves, t, 0)
        if parts > 1:
            g += _of_halves(halves, t, HALVES)
        if ORDERED:
            arenas[b * TILE + t] = g
        elif g[0] != real(0.0) or g[1] != real(0.0) or g[2] != real(0.0) or g[3] != real(0.0):
            add_node(nodes, _node(bases, t), g)


def _arms(f: Any):
    """Distances [cells] of the three nodes of an axis from a particle."""
    return vec(-f, real(1.0) - f, real(2.0) - f)


def _contact_node(g: Any, share: Any, dv: Vector):
    """Velocity [m/s] before the ground pushes, and compliance [1/kg], of a node that has mass."""
    u = node4()
    if g[0] > real(0.0):
        v = node_velocity(vec(g[1], g[2], g[3]), g[0], dv)
        u = node4(v[0], v[1], v[2], share / g[0])
    return u


def _piece(u: int, q: int):
    """Node ``q`` of piece ``u`` of a block's tile: which of the eight blocks holds it, its number there, and its place in the tile.

    Of the 216 nodes 64 lie in the block itself, 32 in each of three neighbours, 16 in three and 8 in the last: six pieces of 32
    and one of 24. The last eight of that are none: place -1.
    """
    x = q >> 3
    y = (q >> 2) & 1
    z = q & 3
    k = int(2)
    if u < 3:
        x = (q >> 4) + wp.where(u == 1, 2, 0)
        y = (q >> 2) & 3
        k = wp.where(u == 2, 4, 0)
    if u == 4:
        y = (q >> 1) & 3
        z = q & 1
        k = 1
    if u == 5:
        x = (q >> 3) & 1
        k = 6
        if q >= 16:
            y = (q >> 1) & 3
            z = q & 1
            k = 5
    if u == 6:
        x = wp.where(q < 16, q >> 2, (q >> 2) & 1)
        y = (q >> 1) & 1
        z = q & 1
        k = wp.where(q < 16, 3, 7)
    t = (x + (k & 4)) * 36 + (y + 2 * (k & 2)) * 6 + z + 4 * (k & 1)
    return wp.vec3i(k, x * 16 + y * 4 + z, wp.where(u == 6 and q >= 24, -1, t))


def _node_if(share: Any, grid: Nodes, node: int):
    """A node that has a share in contact; nothing for one that has none."""
    g = node4()
    if share > real(0.0):
        g = node_at(grid, node)
    return g


def _load(grid: GridGroup, contacts: ContactGroup, tile: Tile, bases: Tile, near: Tile, lane: int, dv: Vector):
    """Velocity [m/s] and compliance [1/kg] of the nodes that particles of a block in contact reach.

    A lane loads four nodes at once, then three.
    """
    for turn in range(PIECE // lane_count()):
        q = turn * lane_count() + lane
        a0 = _piece(0, q)
        a1 = _piece(1, q)
        a2 = _piece(2, q)
        a3 = _piece(3, q)
        a4 = _piece(4, q)
        a5 = _piece(5, q)
        a6 = _piece(6, q)
        s0 = contacts.shares[near[a0[0]] + a0[1]]
        s1 = contacts.shares[near[a1[0]] + a1[1]]
        s2 = contacts.shares[near[a2[0]] + a2[1]]
        s3 = contacts.shares[near[a3[0]] + a3[1]]
        s4 = contacts.shares[near[a4[0]] + a4[1]]
        s5 = contacts.shares[near[a5[0]] + a5[1]]
        s6 = contacts.shares[near[a6[0]] + a6[1]]
        g0 = _node_if(s0, grid.nodes, bases[a0[0]] + a0[1])
        g1 = _node_if(s1, grid.nodes, bases[a1[0]] + a1[1])
        g2 = _node_if(s2, grid.nodes, bases[a2[0]] + a2[1])
        g3 = _node_if(s3, grid.nodes, bases[a3[0]] + a3[1])
        wp.tile_scatter_masked(tile, a0[2], _contact_node(g0, s0, dv), True)
        wp.tile_scatter_masked(tile, a1[2], _contact_node(g1, s1, dv), True)
        wp.tile_scatter_masked(tile, a2[2], _contact_node(g2, s2, dv), True)
        wp.tile_scatter_masked(tile, a3[2], _contact_node(g3, s3, dv), True)
        g4 = _node_if(s4, grid.nodes, bases[a4[0]] + a4[1])
        g5 = _node_if(s5, grid.nodes, bases[a5[0]] + a5[1])
        g6 = _node_if(s6, grid.nodes, bases[a6[0]] + a6[1])
        wp.tile_scatter_masked(tile, a4[2], _contact_node(g4, s4, dv), True)
        wp.tile_scatter_masked(tile, a5[2], _contact_node(g5, s5, dv), True)
        wp.tile_scatter_masked(tile, a6[2], _contact_node(g6, s6, dv), a6[2] >= 0)


def _wide_block(around: Table2, b: int, t: int):
    """Block of node ``t`` of the 8 x 8 x 8 around a block."""
    return around[b, (((((t >> 6) & 7) + 3) >> 2) * 9 + ((((t >> 3) & 7) + 3) >> 2) * 3 + (((t & 7) + 3) >> 2)) & 31]


def _wide_node(grid: Nodes, o: int, t: int):
    """Node ``t`` of the 8 x 8 x 8 around a block; ``o`` is the block that it belongs to, -1 if there is none."""
    g = node4()
    if o >= 0:
        g = node_at(grid, o * 64 + (((((t >> 6) + 3) & 3) << 4) | ((((t >> 3) + 3) & 3) << 2) | ((t + 3) & 3)))
    return g


def _wide_place(t: int):
    """Where node ``t`` of the 8 x 8 x 8 around a block goes in the tile."""
    return ((t >> 6) & 7) * WIDE_X + ((t >> 3) & 7) * WIDE_Y + (t & 7)


def _node_of(o: int, n: int):
    """Place in the grid of node ``n`` of block ``o``, negative if there is no such block."""
    return wp.where(o < 0, -1, o * 64 + n)


def _load_wide(tile: Tile, grid: Nodes, around: Table2, b: int, lane: int, layer: int):
    """Begin to copy the numbers of a ``layer`` of the 8 x 8 x 8 nodes that particles up to one cell outside of a block reach.

    A lane takes eight from west to east, in a loop whose length the compiler does not know: it would keep places of the tile in
    registers, and others out of them.
    """
    for t in range(lane, WIDE_PLAN, wp.block_dim()):
        q = (((t >> 3) + 3) >> 2) * 3 + (((t & 7) + 3) >> 2)
        n = ((((t >> 3) + 3) & 3) << 2 | ((t + 3) & 3)) + 64 * layer * around.shape[0]
        west = int(around[b, q])
        own = int(around[b, q + 9])
        east = int(around[b, q + 18])
        place = _wide_place(t)
        stage_node(tile, place, grid, _node_of(west, 48 + n))
        stage_node(tile, place + WIDE_X, grid, _node_of(own, n))
        stage_node(tile, place + 2 * WIDE_X, grid, _node_of(own, 16 + n))
        stage_node(tile, place + 3 * WIDE_X, grid, _node_of(own, 32 + n))
        stage_node(tile, place + 4 * WIDE_X, grid, _node_of(own, 48 + n))
        stage_node(tile, place + 5 * WIDE_X, grid, _node_of(east, n))
        stage_node(tile, place + 6 * WIDE_X, grid, _node_of(east, 16 + n))
        stage_node(tile, place + 7 * WIDE_X, grid, _node_of(east, 32 + n))


def _sum_arenas(blocks: BlockGroup, grid: GridGroup, held: Ints, t: int):
    """Sum at a node over the up to eight arenas that overlap it and hold something, in a fixed order."""
    b = t >> 6
    s = node4()
    for q in range(8):
        o = blocks.down[b, q]
        x = ((t >> 4) & 3) + (q & 4)
        y = ((t >> 2) & 3) + ((q & 2) << 1)
        z = (t & 3) + ((q & 1) << 2)
        if o >= 0 and x < 6 and y < 6 and z < 6 and held[wp.max(o, 0)] > 0:
            s += node_at(grid.arenas, o * TILE + (x * 6 + y) * 6 + z)
    return s


def note_held(blocks: BlockGroup, grid: GridGroup):
    """Particles of each block, for sums in fixed order."""
    b = wp.tid()
    grid.held[b] = blocks.cstart[b, 64] - blocks.cstart[b, 0]


def sum_nodes(status: StatusGroup, blocks: BlockGroup, grid: GridGroup):
    """Mass and momentum of every node, in fixed order."""
    t = wp.tid()
    if status.flags[HALT] == 0:
        put_node(grid.nodes, t, _sum_arenas(blocks, grid, grid.held, t))


def sum_contacts(status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, part: int):
    """Sums over the contact particles at each node near the ground, in fixed order.

    Of their weights and of the impulses that the nodes hold from the start (``part`` 0), or of what is added to these (1).
    """
    t = wp.tid()
    slot = ground.grounded[t >> 6]
    if status.flags[HALT] != 0 or slot < 0:
        return
    s = _sum_arenas(blocks, grid, contacts.touching, t)
    if part == 0:
        contacts.shares[slot * SLOT + (t & 63)] = s[0]
        push = node4(real(0.0), s[1], s[2], s[3])
        put_node(grid.nodes, t, node_at(grid.nodes, t) + push)
        begun = _place_of_begun(contacts, slot)
        if begun >= 0:
            put_node(contacts.memory, begun + (t & 63), push)
    else:
        contacts.shares[slot * SLOT + PUSHES + 2 * (t & 63)] = s[1]
        contacts.shares[slot * SLOT + PUSHES + 2 * (t & 63) + 1] = s[2]
        contacts.shares[slot * SLOT + PUSHES_UP + (t & 63)] = s[3]
