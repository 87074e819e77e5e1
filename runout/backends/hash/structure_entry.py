"""Particles that would still enter a structure after the impulses of contact: a second impulse stops them.

contacts.pressed    particles that touch --those that would enter move to the front--> particles that would enter
contacts.shares     sums of their weights: their compliance is that of these few alone
contacts.touching   how many of them a block has
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_detection import _give_shares, _note_starts
from runout.backends.hash.contact_solution import (
    HELD,
    HELD_REST,
    _clear,
    _contact_velocity,
    _give_all,
    _hold,
    _number,
    _number_pressed,
    _put,
    _spread,
    _velocity_in_place,
    _way,
)
from runout.backends.hash.groups import (
    BlockGroup,
    Constants,
    ContactGroup,
    GridGroup,
    GroundGroup,
    ParticleGroup,
    SceneGroup,
    StatusGroup,
    StructureGroup,
)
from runout.backends.hash.layout import (
    CELL_LANES,
    HALT,
    MASS,
    MOMENTUM,
    NOT_NEGATIVE,
    OFFSET,
    ORDERED,
    PIECE,
    STARTS,
    SUBSTEPPED,
    TILE,
    Tile,
    Vector,
    lane_count,
    node4,
    node_at,
    own_block,
    own_lane,
)
from runout.backends.hash.stencil import (
    _cell_of,
    _contact_node,
    _first_node,
    _load,
    _node,
    _scene_of,
    _set_bases,
    _set_near_bases,
)
from runout.backends.hash.structure_detection import _load_given_by_structures
from runout.backends.hash.structure_distance import _cell, _surface
from runout.backends.hash.structure_solution import _book_impulse, _book_work
from runout.physics.bspline import weights
from runout.physics.contact import work
from runout.physics.structures import entry_velocity, stopping_impulse
from runout.physics.substeps import moved_gap
from runout.physics.tensors import dot, real, vec

NO_STEP = -1.0  # stamp of no step: no impulse is given from before
hits_before: Any = None  # how many of the lanes before a lane hit, and of all; the binding puts it in its place


def _load_velocities(grid: GridGroup, tile: Tile, bases: Tile, lane: int, dv: Vector):
    """Velocity [m/s] of all nodes that particles of a block reach."""
    for q in range((TILE + lane_count() - 1) // lane_count()):
        t = wp.min(q * lane_count() + lane, TILE - 1)
        u = _contact_node(node_at(grid.nodes, _node(bases, t)), real(0.0), dv)
        wp.tile_scatter_masked(tile, t, u, q * lane_count() + lane < TILE)


def _would_enter(
    particles: ParticleGroup, constants: Constants, structures: StructureGroup, tile: Tile, s: int, cell: wp.vec3i, c: int, p: int,
    dt: Any,
):  # fmt: skip
    """Whether the centre of a particle would come into a structure within the step."""
    f = vec(particles.rec[OFFSET, p], particles.rec[OFFSET + 1, p], particles.rec[OFFSET + 2, p])
    u, _compliance = _contact_velocity(tile, _first_node(c), weights(f[0]), weights(f[1]), weights(f[2]))
    n, apart, _patch = _surface(structures, s, cell, f, real(wp.inf))
    if SUBSTEPPED:
        apart = moved_gap(apart, n, _way(particles.rec, p))
    return dot(u, n) < entry_velocity(apart, dt, constants.band)


def _keep_entering(
    particles: ParticleGroup, blocks: BlockGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    structures: StructureGroup, tile: Tile, starts: Tile, counts: Tile, s: int, b: int, lane: int, dt: Any,
):  # fmt: skip
    """Move the contacts of a block that would enter to the front of its list, and count them by cell; returns how many."""
    first = int(contacts.pressed_start[b, 0])
    total = int(starts[CELL_LANES])
    found = int(0)
    for base in range(0, total, lane_count()):
        n = wp.min(base + lane, total - 1)
        c = _cell_of(starts, n)
        p = contacts.pressed[first + n] & NOT_NEGATIVE
        cell = _cell(blocks, scenes, s, b, c)
        hit = base + lane < total and _would_enter(particles, constants, structures, tile, s, cell, c, p, dt)
        hits = hits_before(hit)
        if hit:
            contacts.pressed[first + found + hits[0]] = p
        wp.tile_scatter_add(counts, c, 1, hit, True)
        found += hits[1]
    return found


def find_entering(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup,
    contacts: ContactGroup, scenes: SceneGroup, constants: Constants, structures: StructureGroup,
):  # fmt: skip
    """Keep in the list the contacts that would still enter a structure, and add their weights to the nodes."""
    place, lane = wp.tid()
    place, lane = own_block(place), own_lane(lane)
    b = int(ground.standing[place])
    if status.flags[HALT] != 0 or b < 0 or contacts.touching[wp.max(b, 0)] == 0:
        return
    s = _scene_of(blocks, scenes, b)
    dt = scenes.clock[s, 0]
    starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
    counts = wp.tile_zeros(shape=CELL_LANES, dtype=int, storage="shared")
    filled = wp.tile_empty(shape=CELL_LANES, dtype=wp.uint8, storage="shared")
    tile = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")  # velocities first, then weights
    bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
    _set_bases(bases, blocks.up, b, lane)
    first = int(contacts.pressed_start[b, 0])
    many = _number_pressed(contacts, starts, filled, b, lane)
    _load_velocities(grid, tile, bases, lane, vec(scenes.clock[s, 1], scenes.clock[s, 2], scenes.clock[s, 3]))
    found = _keep_entering(particles, blocks, contacts, scenes, constants, structures, tile, starts, counts, s, b, lane, dt)
    if lane == 0:
        contacts.touching[b] = found
    if found > 0:
        many = _number(starts, filled, counts, lane)
        _note_starts(contacts, starts, first, b, lane)
        near_bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
        pushes = wp.tile_empty(shape=HELD, dtype=node4, storage="shared")
        offsets = wp.tile_empty(shape=HELD_REST, dtype=real, storage="shared")
        _set_near_bases(near_bases, ground.near_up, place, lane)
        _clear(tile, node4(), lane)
        for base in range(0, found, HELD):
            wp.tile_zeros(shape=1, dtype=int, storage="shared")  # waits for lanes still at those before
            last = wp.min(first + found, first + base + HELD)
            _load_given_by_structures(
                particles, contacts, structures, pushes, offsets, first + base, last, lane, real(NO_STEP), dt
            )  # fmt: skip
            for turns in range((many + lane_count() - 1) // lane_count()):
                mine = turns * lane_count() + lane
                _spread(tile, pushes, offsets, starts, int(filled[wp.min(mine, many - 1)]), base, mine < many, True)
        _give_shares(grid, contacts, tile, bases, near_bases, b, lane)


def _stop(
    particles: ParticleGroup, constants: Constants, structures: StructureGroup, tile: Tile, s: int, cell: wp.vec3i, c: int, p: int,
    f: Vector, dt: Any,
):  # fmt: skip
    """Work [J] and impulse [N s] that stop a particle before it enters."""
    u, compliance = _contact_velocity(tile, _first_node(c), weights(f[0]), weights(f[1]), weights(f[2]))
    n, apart, patch = _surface(structures, s, cell, f, real(wp.inf))
    if SUBSTEPPED:
        apart = moved_gap(apart, n, _way(particles.rec, p))
    size = stopping_impulse(dot(u, n), entry_velocity(apart, dt, constants.band), compliance)
    push = vec(size * n[0], size * n[1], size * n[2])
    _book_impulse(structures, s, patch, push)
    v = vec(particles.rec[MOMENTUM, p], particles.rec[MOMENTUM + 1, p], particles.rec[MOMENTUM + 2, p]) / particles.rec[MASS, p]
    if SUBSTEPPED:
        v = _velocity_in_place(particles.rec, p)
    return node4(work(push, vec(real(0.0), real(0.0), real(0.0)), v, u, compliance), push[0], push[1], push[2])


def stop_entering(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup,
    contacts: ContactGroup, scenes: SceneGroup, constants: Constants, structures: StructureGroup,
):  # fmt: skip
    """Compute one impulse per particle that would enter a structure, and add it to the nodes."""
    place, lane = wp.tid()
    place, lane = own_block(place), own_lane(lane)
    b = int(ground.standing[place])
    if status.flags[HALT] != 0 or b < 0 or contacts.touching[wp.max(b, 0)] == 0:
        return
    s = _scene_of(blocks, scenes, b)
    dt = scenes.clock[s, 0]
    starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
    tile = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")  # velocities first, then impulses
    bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
    near_bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
    _set_bases(bases, blocks.up, b, lane)
    _set_near_bases(near_bases, ground.near_up, place, lane)
    dv = vec(scenes.clock[s, 1], scenes.clock[s, 2], scenes.clock[s, 3])
    first = int(contacts.pressed_start[b, 0])
    filled = wp.tile_empty(shape=CELL_LANES, dtype=wp.uint8, storage="shared")
    many = _number_pressed(contacts, starts, filled, b, lane)
    total = int(starts[CELL_LANES])
    pushes = wp.tile_empty(shape=HELD, dtype=node4, storage="shared")
    offsets = wp.tile_empty(shape=HELD_REST, dtype=real, storage="shared")
    for base in range(0, total, HELD):
        wp.tile_zeros(shape=1, dtype=int, storage="shared")  # waits for lanes still at those before
        _load(grid, contacts, tile, bases, near_bases, lane, dv)
        taken = real(0.0)
        for q in range((wp.min(total - base, HELD) + lane_count() - 1) // lane_count()):
            n = base + q * lane_count() + lane
            f = vec(real(0.0), real(0.0), real(0.0))
            done = node4()
            if n < total:
                c = _cell_of(starts, n)
                p = contacts.pressed[first + n] & NOT_NEGATIVE
                f = vec(particles.rec[OFFSET, p], particles.rec[OFFSET + 1, p], particles.rec[OFFSET + 2, p])
                done = _stop(particles, constants, structures, tile, s, _cell(blocks, scenes, s, b, c), c, p, f, dt)
                taken += done[0]
            _hold(pushes, offsets, n - base, vec(done[1], done[2], done[3]), f, n < total)
        _book_work(structures, s, taken, lane)
        _clear(tile, node4(), lane)
        for turn in range((many + lane_count() - 1) // lane_count()):
            mine = turn * lane_count() + lane
            _spread(tile, pushes, offsets, starts, int(filled[wp.min(mine, many - 1)]), base, mine < many, False)
        if ORDERED:
            for t in range(lane, TILE, lane_count()):
                _put(grid.arenas, b * TILE + t, tile[t], base)
        else:
            for q in range(lane, PIECE, lane_count()):
                _give_all(tile, contacts.shares, near_bases, q)
