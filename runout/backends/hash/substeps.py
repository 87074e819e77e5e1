"""Further substeps of a transfer: particles strain in place, and their stress pushes the nodes (:mod:`runout.physics.substeps`).

    grid.nodes   | mass and momentum of each node | its way since the start of the transfer | its velocity |     three layers
    record       strain, history: replaced; of particles in contact way and velocity in the place of the affine matrix
    held         (shared memory) record of up to MANY particles of a block; then offset and columns of the impulse in its place

     numbers of a particle    0 | 1-3 offset | 4-9 strain | 10 history | 11 volume
                              0, 4-11 columns of the impulse | 1-3 offset

    velocity --strain_in_place--> impulses of the new stress, added to the momentum --contact, as in the first substep--> momentum
             --end_substep--> velocity, way, and momentum with the impulses from which contacts start in the next substep

A thread first owns a particle, then a part of a cell. Lists, weights and masses of the nodes stay, and so do the contacts with the
ground: their list, the sums of their weights and their areas. The nodes hold the impulses from which these contacts start, since
particles keep their weights: the sum of the impulses of the substep before. Contacts with structures are found anew, from records
that have not changed. Where the scenes of a batch have different numbers of substeps, the time step of one that waits is negative
in the clock. A node without mass keeps velocity and way of an earlier transfer of its scene, which have weight zero; a sort clears
them.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.deform import _slopes, _strain_in_place
from runout.backends.hash.grid_to_particles import _release_at
from runout.backends.hash.groups import (
    BlockGroup,
    ColumnGroup,
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
    AT_ONCE,
    BLOCKS,
    CELL_LANES,
    DRAGS_COLUMN,
    FIRST,
    HALT,
    HALVES,
    MANY,
    NOT_NEGATIVE,
    PARTICLE_LANES,
    PARTS,
    PITCH,
    PUSHES,
    PUSHES_UP,
    SLOT,
    SUBSTEPS,
    TILE,
    VELOCITIES,
    WARP,
    WAYS,
    Frictions,
    Ints,
    Materials,
    Tile,
    Vector,
    lane_count,
    node4,
    node_at,
    put_node,
)
from runout.backends.hash.nodes import _close_scene, _slowed, _velocity_of_node
from runout.backends.hash.particles_to_grid import _held_place, _sum_cell
from runout.backends.hash.pore_pressure import _drained
from runout.backends.hash.stencil import (
    _add_cell,
    _cell_entry,
    _cell_of_lane,
    _first_node,
    _give_tile,
    _node,
    _place_of_begun,
    _set_bases,
    _sum_arenas,
)
from runout.physics.contact import approach_speed
from runout.physics.tensors import real, vec

OF_MANY = 12 * PITCH  # numbers that are held of the particles whose impulses are held at once
ALL_HALVES = PARTS * HALVES  # nodes of the tiles to which the threads add
WARPS = PARTICLE_LANES // WARP  # of a block of threads

put_in: Any = None  # puts a number in its place in a tile; the binding puts it in its place
stage: Any = None  # begins to copy what is needed of a record to shared memory, likewise
stage_node: Any = None  # begins to copy a node to a tile, likewise
loaded_here: Any = None  # a number whose load starts here, likewise
come: Any = None  # a lane waits for its own copies, likewise
arrive: Any = None  # waits for copies to shared memory, likewise
meet: Any = None  # the lanes of a block wait for each other, likewise
sum_lanes: Any = None  # sum over the lanes of a warp, likewise
book: Any = None  # adds to a number that no other thread adds to, likewise
note_largest: Any = None  # the largest of each 32 numbers, likewise


def _open_substep(scenes: SceneGroup, s: int, turn: int):
    """Open a further substep of a scene in the clock, which other threads of the launch do not read."""
    if scenes.left[s] > 0:
        dt = real(scenes.steps[s])
        if scenes.clock[s, SUBSTEPS] < real(turn):
            dt = -dt
        else:
            scenes.step_counts[s] = scenes.step_counts[s] + 1
        scenes.clock[s, 0] = dt


def _load_motion(velocities: Tile, ways: Tile, grid: GridGroup, blocks: BlockGroup, bases: Tile, lane: int, turn: int):
    """Copy velocity and way of the nodes that the particles of a block reach; ways are none in the first further substep."""
    layer = 64 * blocks.up.shape[0]
    for t in range(lane, TILE, lane_count()):
        node = _node(bases, t)
        stage_node(velocities, t, grid.nodes, node + VELOCITIES * layer)
        if turn > FIRST:
            stage_node(ways, t, grid.nodes, node + WAYS * layer)
    arrive()


def _is_touched(contacts: ContactGroup, beside: Ints, b: int):
    """Whether particles of a block may be in contact with the ground, and with structures: contacts read their way and velocity."""
    beside_some = False
    if beside.shape[0] > 0:
        beside_some = beside[b] >= 0
    return contacts.touching[b] > 0, beside_some


def _keep_motion(particles: ParticleGroup, p: int, way: Vector, v: Vector):
    """Way [m] and velocity [m/s] of a particle in contact to the place of its affine matrix."""
    for d in range(3):
        particles.rec[AFFINE + d, p] = way[d]
        particles.rec[AFFINE + 3 + d, p] = v[d]


def _listed(particles: ParticleGroup, first: int, end: int):
    """The next four particles of a lane in the list, from place ``first`` on."""
    listed = wp.vec4i()
    for q in range(AT_ONCE):
        listed[q] = loaded_here(particles.order[wp.max(wp.min(first + q * lane_count(), end - 1), 0)]) & NOT_NEGATIVE
    return listed


def _stage_some(particles: ParticleGroup, held: Tile, listed: wp.vec4i, begin: int, end: int, lane: int):
    """Begin to copy the records of the particles at some places of the list, of which ``listed`` are the first of the lane."""
    for first in range(begin + lane, end, AT_ONCE * lane_count()):
        if first >= begin + AT_ONCE * lane_count():
            listed = _listed(particles, first, end)
        for q in range(AT_ONCE):
            n = first + q * lane_count()
            if n < end:
                stage(held, particles.rec, listed[q], _held_place(n - begin), PITCH, 1)


def _hold_push(held: Tile, place: int, push: Any):
    """Hold columns of the impulse of a particle in the place of its record, beside its offset."""
    put_in(held, place, push[0])
    for d in range(1, 9):
        put_in(held, place + (3 + d) * PITCH, push[d])


def _strain_some(
    particles: ParticleGroup, contacts: ContactGroup, constants: Constants, mats: Materials, beside: Ints,
    pores: PoreGroup, velocities: Tile, ways: Tile, held: Tile, b: int, places: wp.vec2i, lane: int, dt: Any, gone: int,
    first: wp.vec2i,
):  # fmt: skip
    """Strain the particles at some places of the list, and hold their impulses; returns the energy [J] that they lose.

    ``places`` are the first one and the one after the last, ``first`` is the first particle of the lane and its key.
    """
    begin, end = places[0], places[1]
    ahead, key_ahead = first[0], first[1]
    slopes = _slopes(dt, constants.h)
    of_way = _slopes(real(1.0), constants.h)
    lost = wp.float64(0.0)
    grounded, beside_some = _is_touched(contacts, beside, b)
    come()
    for n in range(begin + lane, end, lane_count()):
        p = ahead & NOT_NEGATIVE
        c = key_ahead & 63
        ahead = particles.order[wp.min(n + lane_count(), end - 1)] & NOT_NEGATIVE
        key_ahead = particles.key[ahead]
        before, behind = loaded_here(contacts.pressed_start[b, c]), loaded_here(contacts.pressed_start[b, c + 1])
        effective = _drained(particles, pores, p, 64 * b + c, dt)
        mat = mats[_release_at(particles, constants, p)]
        place = _held_place(n - begin)
        v, way, push, work = _strain_in_place(
            particles.rec, p, held, place, velocities, ways, _first_node(c), mat, slopes, of_way, gone, effective
        )
        _hold_push(held, place, push)
        lost += wp.float64(work)
        if (grounded and behind > before) or beside_some:
            _keep_motion(particles, p, way + dt * v, v)
    return lost


def _clear_sums(halves: Tile, losses: Tile, lane: int):
    """Set sums in shared memory to zero; the lanes meet later."""
    for t in range(lane, ALL_HALVES, lane_count()):
        put_in(halves, t, node4())
    for w in range(lane, WARPS, lane_count()):
        put_in(losses, w, wp.float64(0.0))


def _sum_some(blocks: BlockGroup, particles: ParticleGroup, held: Tile, halves: Tile, b: int, first: int, end: int, lane: int):
    """Sum the impulses of the particles at some places of the list in the tiles of the halves; a thread sums a part of a cell."""
    for q in range(lane, PARTS * CELL_LANES, lane_count()):
        c = _cell_of_lane(q & 63)
        begins = wp.max(blocks.cstart[b, c], first) - first + (q >> 6)
        acc = _sum_cell(held, particles.order, begins, wp.min(blocks.cstart[b, c + 1], end) - first, PARTS)
        _add_cell(halves, c, HALVES * (q >> 6), acc)


def strain_in_place(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, contacts: ContactGroup, scenes: SceneGroup,
    constants: Constants, mats: Materials, pores: PoreGroup, beside: Ints, turn: int, launched: int,
):  # fmt: skip
    """Law of the particles in substep number ``turn``, and the impulses of their new stress to the momentum of the nodes.

    In fixed order, each block only fills its own arena. ``beside`` are the slots of blocks that structures reach, -1 for others;
    empty without structures. One more block of threads than ``launched`` opens the substep meanwhile.
    """
    begin, lane = wp.tid()
    b = loaded_here(blocks.active[wp.min(begin, blocks.active.shape[0] - 1)])
    active = loaded_here(status.tally[ACTIVE])
    if status.flags[HALT] != 0:
        return
    if begin == launched:
        for s in range(lane, scenes.left.shape[0], lane_count()):
            _open_substep(scenes, s, turn)
        return
    for a in range(begin, active, launched):
        b = b & NOT_NEGATIVE
        start = loaded_here(blocks.cstart[b, 0])
        last = loaded_here(blocks.cstart[b, CELL_LANES])
        s = loaded_here(blocks.member[b]) & NOT_NEGATIVE
        listed = _listed(particles, start + lane, wp.min(start + MANY, last))
        left = loaded_here(scenes.left[s])
        goes_on = scenes.clock[s, SUBSTEPS] >= real(turn)
        meet()  # lanes still at the block before
        bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
        _set_bases(bases, blocks.up, b, lane)
        if left > 0 and goes_on:
            velocities = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")
            ways = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")
            held = wp.tile_empty(shape=OF_MANY, dtype=real, storage="shared")
            halves = wp.tile_empty(shape=ALL_HALVES, dtype=node4, storage="shared")
            losses = wp.tile_empty(shape=WARPS, dtype=wp.float64, storage="shared")
            _clear_sums(halves, losses, lane)
            dt, lost = real(scenes.steps[s]), wp.float64(0.0)
            for first in range(start, last, MANY):
                end = wp.min(first + MANY, last)
                if first > start:
                    meet()  # lanes still at the sums
                    listed = _listed(particles, first + lane, end)
                _stage_some(particles, held, listed, first, end, lane)
                key = int(particles.key[listed[0]])
                if first == start:
                    _load_motion(velocities, ways, grid, blocks, bases, lane, turn)
                lost += _strain_some(
                    particles, contacts, constants, mats, beside, pores, velocities, ways, held, b, wp.vec2i(first, end), lane,
                    dt, turn - FIRST, wp.vec2i(listed[0], key),
                )  # fmt: skip
                meet()
                _sum_some(blocks, particles, held, halves, b, first, end, lane)
            all_lost = sum_lanes(lost)
            if lane % WARP == 0:
                put_in(losses, lane // WARP, all_lost)
            _give_tile(halves, PARTS, grid.arenas, grid.nodes, bases, b, lane)
            if lane == 0:
                book(grid.booked, b, 0, losses[0] + losses[1] + losses[2] + losses[3])
        b = int(blocks.active[wp.min(a + launched, blocks.active.shape[0] - 1)])


def resume_nodes(status: StatusGroup, blocks: BlockGroup, grid: GridGroup, scenes: SceneGroup):
    """Impulses of the new stress to the momentum of the nodes, in fixed order."""
    t = wp.tid()
    b = t >> 6
    if status.flags[HALT] != 0 or b >= status.tally[BLOCKS]:
        return
    if scenes.clock[blocks.member[b], 0] > real(0.0):
        put_node(grid.nodes, t, node_at(grid.nodes, t) + _sum_arenas(blocks, grid, grid.held, t))


def _motion(grid: GridGroup, t: int, layer: int, turn: int, mass: Any):
    """Velocity [m/s] of a node before substep number ``turn``, and its way [m] before that; the nodes of a layer are so many.

    Those of a node without ``mass`` are not read: most nodes of a thin flow have none.
    """
    motion = node4()
    way = node4()
    if turn >= FIRST and mass > real(0.0):
        motion = node_at(grid.nodes, t + VELOCITIES * layer)
    if turn > FIRST and mass > real(0.0):
        way = node_at(grid.nodes, t + WAYS * layer)
    return motion, way


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


def _close_transfer(status: StatusGroup, scenes: SceneGroup, t: int):
    """As ``_close_scene`` of ``nodes``; a scene with fewer substeps has waited."""
    _close_scene(status, scenes, t)
    if t < scenes.left.shape[0]:
        scenes.clock[t, 0] = wp.abs(scenes.clock[t, 0])


def end_substep(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup,
    constants: Constants, friction: Frictions, columns: ColumnGroup, first_release: Ints, releases: int, turn: wp.vec3i,
):  # fmt: skip
    """As ``update_nodes`` of ``nodes`` in each substep of a transfer of several; what the next substep begins with, too.

    ``turn``: number of the substep, most substeps of any scene, and whether drag on the columns of nodes slows. The last one closes
    the transfer.
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
        _close_transfer(status, scenes, t)
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
            v, push = _velocity_of_node(contacts, scenes, g, s, slot, t & 63)
            if DRAGS_COLUMN:
                v += dv
            moving = node4(g[0], v[0], v[1], v[2])
            put_node(grid.nodes, t + VELOCITIES * layer, moving)
            substeps = int(scenes.clock[s, SUBSTEPS])
            _begin_substep(grid, contacts, slot, t, layer, turn[0], substeps, moving, push, way + dt * motion)
    if closes and dt > real(0.0):
        note_largest(contacts.approach_speeds, t, approach_speed(v, slopes[0], slopes[1], slopes[2], slopes[3]))
