"""Further substeps of a transfer: particles strain in place, and their stress pushes the nodes (:mod:`runout.physics.substeps`).

    grid.nodes   | velocity of each node | its way since the start of the transfer | impulses of the new stress |     three layers
                 in fixed order the impulses lie in the arenas
    record       strain, history: replaced; of particles in contact way and velocity in the place of the affine matrix
    held         (shared memory) offset and columns of the impulse of up to MANY particles of a block

    --strain_in_place--> impulses --resume_nodes--> mass and momentum --contact, as in the first substep--> velocity

A thread first owns a particle, then a cell. Lists, weights and masses of the nodes stay, and so do the contacts with the ground:
their list, the sums of their weights and their areas. The nodes hold the impulses from which these contacts start, since particles
keep their weights: the sum of the impulses of the substep before. Contacts with structures are found anew, from records that have
not changed. Where the scenes of a batch have different numbers of substeps, the time step of one that waits is negative in the
clock.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.deform import _slopes, _strain_in_place
from runout.backends.hash.grid_to_particles import _release_at
from runout.backends.hash.groups import (
    BlockGroup,
    Constants,
    ContactGroup,
    GridGroup,
    GroundGroup,
    ParticleGroup,
    PoreGroup,
    SceneGroup,
    StatusGroup,
)
from runout.backends.hash.layout import (
    ACTIVE,
    AFFINE,
    BLOCKS,
    CELL_LANES,
    HALT,
    HALVES,
    MANY,
    NOT_NEGATIVE,
    ORDERED,
    PUSHES,
    PUSHES_UP,
    SLOT,
    SUBSTEPS,
    TILE,
    WARP,
    Ints,
    Materials,
    Tile,
    Vector,
    lane_count,
    node4,
    node_at,
    put_node,
)
from runout.backends.hash.particles_to_grid import _sum_cell
from runout.backends.hash.pore_pressure import _drained
from runout.backends.hash.shared_memory import ROOM
from runout.backends.hash.stencil import _add_cell, _first_node, _give_tile, _node, _place_of_begun, _set_bases, _sum_arenas
from runout.physics.tensors import real

OF_MANY = 12 * MANY  # numbers that are held of the particles whose impulses are held at once
FIRST = 2  # the first of the further substeps

put_in: Any = None  # puts a number in its place in a tile; the binding puts it in its place
stage: Any = None  # begins to copy what is needed of a record to shared memory, likewise
stage_node: Any = None  # begins to copy a node to a tile, likewise
come: Any = None  # a lane waits for its own copies, likewise
pair_at: Any = None  # two numbers that lie beside each other, by one load; likewise
arrive: Any = None  # waits for copies to shared memory, likewise
meet: Any = None  # the lanes of a block wait for each other, likewise
sum_lanes: Any = None  # sum over the lanes of a warp, likewise
book: Any = None  # adds to a number that no other thread adds to, likewise


def _open_substep(scenes: SceneGroup, s: int, turn: int):
    """Open a further substep of a scene in the clock, which other threads of the launch do not read."""
    if scenes.left[s] > 0:
        dt = real(scenes.steps[s])
        if scenes.clock[s, SUBSTEPS] < real(turn):
            dt = -dt
        scenes.clock[s, 0] = dt


def _load_motion(velocities: Tile, ways: Tile, grid: GridGroup, blocks: BlockGroup, bases: Tile, lane: int, turn: int):
    """Copy velocity and way of the nodes that the particles of a block reach; ways are none in the first further substep."""
    layer = 64 * blocks.up.shape[0]
    for t in range(lane, TILE, lane_count()):
        node = _node(bases, t)
        stage_node(velocities, t, grid.nodes, node)
        if turn > FIRST:
            stage_node(ways, t, grid.nodes, node + layer)
    arrive()


def _touches_something(contacts: ContactGroup, beside: Ints, b: int, c: int):
    """Whether a particle of a cell may be in contact: contacts read its way and its velocity."""
    near = contacts.touching[b] > 0 and contacts.pressed_start[b, c + 1] > contacts.pressed_start[b, c]
    if beside.shape[0] > 0:
        near = near or beside[b] >= 0
    return near


def _keep_motion(particles: ParticleGroup, p: int, way: Vector, v: Vector):
    """Way [m] and velocity [m/s] of a particle in contact to the place of its affine matrix."""
    for d in range(3):
        particles.rec[AFFINE + d, p] = way[d]
        particles.rec[AFFINE + 3 + d, p] = v[d]


def _hold_push(held: Tile, place: int, f: Vector, push: Any):
    """Hold offset and columns of the impulse of a particle."""
    for d in range(3):
        put_in(held, d * MANY + place, f[d])
    for d in range(9):
        put_in(held, (3 + d) * MANY + place, push[d])


def _strain_some(
    particles: ParticleGroup, contacts: ContactGroup, constants: Constants, mats: Materials, beside: Ints, room: Tile,
    pores: PoreGroup, velocities: Tile, ways: Tile, held: Tile, b: int, begin: int, end: int, lane: int, dt: Any, gone: int,
):  # fmt: skip
    """Strain the particles at some places of the list, and hold their impulses; returns the energy [J] that they lose."""
    slopes = _slopes(dt, constants.h)
    of_way = _slopes(real(1.0), constants.h)
    lost = wp.float64(0.0)
    ahead = int(particles.order[wp.min(begin + lane, end - 1)] & NOT_NEGATIVE)
    if begin + lane < end:
        stage(room, particles.rec, ahead, 0, lane)
    turn = int(0)
    for n in range(begin + lane, end, lane_count()):
        p = ahead & NOT_NEGATIVE
        ahead = particles.order[wp.min(n + lane_count(), end - 1)] & NOT_NEGATIVE
        c = particles.key[p] & 63
        effective = _drained(particles, pores, p, 64 * b + c, dt)
        mat = mats[_release_at(particles, constants, p)]
        come()
        staged = (turn & 1) * (ROOM // 2) + lane
        turn += 1
        if n + lane_count() < end:
            stage(room, particles.rec, ahead, turn, lane)
        f, v, way, push, work = _strain_in_place(
            particles.rec, p, room, staged, velocities, ways, _first_node(c), mat, slopes, of_way, gone, effective
        )
        _hold_push(held, n - begin, f, push)
        lost += wp.float64(work)
        if _touches_something(contacts, beside, b, c):
            _keep_motion(particles, p, way + dt * v, v)
    return lost


def strain_in_place(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, contacts: ContactGroup, scenes: SceneGroup,
    constants: Constants, mats: Materials, pores: PoreGroup, beside: Ints, turn: int, launched: int,
):  # fmt: skip
    """Law of the particles in substep number ``turn``, and the impulses of their new stress on the nodes.

    In fixed order, each block only fills its own arena. ``beside`` are the slots of blocks that structures reach, -1 for others;
    empty without structures. One more block of threads than ``launched`` opens the substep meanwhile.
    """
    begin, lane = wp.tid()
    if status.flags[HALT] != 0:
        return
    if begin == launched:
        for s in range(lane, scenes.left.shape[0], lane_count()):
            _open_substep(scenes, s, turn)
        return
    for a in range(begin, status.tally[ACTIVE], launched):
        b = blocks.active[a] & NOT_NEGATIVE
        s = blocks.member[b] & NOT_NEGATIVE
        if scenes.left[s] > 0 and scenes.clock[s, SUBSTEPS] >= real(turn):
            meet()  # lanes still at the block before
            bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
            _set_bases(bases, blocks.up, b, lane)
            velocities = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")
            ways = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")
            room = wp.tile_empty(shape=ROOM, dtype=real, storage="shared")
            held = wp.tile_empty(shape=OF_MANY, dtype=real, storage="shared")
            halves = wp.tile_zeros(shape=HALVES, dtype=node4, storage="shared")
            _load_motion(velocities, ways, grid, blocks, bases, lane, turn)
            last = blocks.cstart[b, CELL_LANES]
            lost = wp.float64(0.0)
            for first in range(blocks.cstart[b, 0], last, MANY):
                end = wp.min(first + MANY, last)
                lost += _strain_some(
                    particles, contacts, constants, mats, beside, room, pores, velocities, ways, held, b, first, end, lane,
                    scenes.steps[s], turn - FIRST,
                )  # fmt: skip
                meet()
                for c in range(lane, CELL_LANES, lane_count()):
                    begins = wp.max(blocks.cstart[b, c], first) - first
                    acc = _sum_cell(held, particles.order, begins, wp.min(blocks.cstart[b, c + 1], end) - first)
                    _add_cell(halves, c, acc)
                meet()
            _give_tile(halves, grid.arenas, grid.nodes, bases, b, lane, 2 * 64 * blocks.up.shape[0])
            all_lost = sum_lanes(lost)
            if lane % WARP == 0:
                book(grid.booked, b, 5 * (lane // WARP), all_lost)


def _begun(contacts: ContactGroup, slot: int, n: int):
    """Impulses [N s] of all contacts on a node in the substep before, from which they start in this one."""
    push = pair_at(contacts.shares, slot * SLOT + PUSHES + 2 * n)
    up = contacts.shares[slot * SLOT + PUSHES_UP + n]
    return node_at(contacts.memory, _place_of_begun(contacts, slot) + n) + node4(real(0.0), push[0], push[1], up)


def _begin_contacts(contacts: ContactGroup, slot: int, n: int, push: Any):
    """Let the contacts on a node start from these impulses [N s]."""
    put_node(contacts.memory, _place_of_begun(contacts, slot) + n, push)
    contacts.shares[slot * SLOT + PUSHES + 2 * n] = real(0.0)
    contacts.shares[slot * SLOT + PUSHES + 2 * n + 1] = real(0.0)
    contacts.shares[slot * SLOT + PUSHES_UP + n] = real(0.0)


def resume_nodes(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup,
    turn: int,
):  # fmt: skip
    """Momentum of the nodes with the impulses of the new stress and of the contacts, and their way so far, in substep ``turn``."""
    t = wp.tid()
    b = t >> 6
    layer = 64 * blocks.up.shape[0]
    g = node_at(grid.nodes, t)  # all is loaded at once, before it is known whether there is anything to do
    push = node4()
    if not ORDERED:
        push = node_at(grid.nodes, t + 2 * layer)
    way = node4()
    if turn > FIRST:
        way = node_at(grid.nodes, t + layer)
    slot = ground.grounded[b]
    s = blocks.member[b]
    if status.flags[HALT] != 0:
        return
    if t < scenes.left.shape[0] and scenes.clock[t, 0] > real(0.0):
        scenes.step_counts[t] = scenes.step_counts[t] + 1
    if b >= status.tally[BLOCKS]:
        return
    if g[0] > real(0.0):
        begun = node4()
        if slot >= 0:
            begun = _begun(contacts, slot, t & 63)
        dt = scenes.clock[s, 0]
        if dt > real(0.0):
            way += dt * g
            if ORDERED:
                push = _sum_arenas(blocks, grid, grid.held, t)
            else:
                put_node(grid.nodes, t + 2 * layer, node4())
            if slot >= 0:
                push += begun
                _begin_contacts(contacts, slot, t & 63, begun)
            put_node(grid.nodes, t, node4(g[0], g[0] * g[1] + push[1], g[0] * g[2] + push[2], g[0] * g[3] + push[3]))
        put_node(grid.nodes, t + layer, way)
