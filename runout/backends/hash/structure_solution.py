"""Contact solution beside structures: one impulse per particle that touches, and the sums of impulses and energy.

    tile (shared memory)   6 x 6 x 6 nodes: velocity x, y, z and compliance; later the impulses
    upper, lower           impulses on patch 0 x, y, z | patch 1 | ... | energy taken of scene 0 | scene 1 | ...

Impulses and energy are added as whole numbers, of which each sum has two: exact, and the same in any order.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_solution import (
    HELD,
    HELD_REST,
    _clear,
    _contact_velocity,
    _give_all,
    _hold,
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
    STAMPS,
    STARTS,
    SUBSTEPPED,
    TILE,
    Frictions,
    Tile,
    Vector,
    lane_count,
    node4,
    own_block,
    own_lane,
)
from runout.backends.hash.stencil import _cell_of, _first_node, _load, _scene_of, _set_bases, _set_near_bases
from runout.backends.hash.structure_detection import _given_by_structures
from runout.backends.hash.structure_distance import FIRST_SUM, _cell, _surface
from runout.physics.bspline import weights
from runout.physics.contact import impulse, work
from runout.physics.structures import contact_gap
from runout.physics.substeps import moved_gap
from runout.physics.tensors import i64, real, vec

CARRIED, PARTED = 40, 2.0**40  # so many bits, and units, of a lower sum make one unit of the upper
sum_lanes: Any = None  # sum over the lanes of a warp; the binding puts it in its place


def carry_sums(structures: StructureGroup):
    """Carry what the lower sums hold beyond a unit of the upper ones, which leaves room for the steps to the next sort."""
    t = wp.tid()
    units = structures.lower[t] >> i64(CARRIED)
    structures.upper[t] = structures.upper[t] + units
    structures.lower[t] = structures.lower[t] - (units << i64(CARRIED))


def _book(structures: StructureGroup, s: int, at: int, value: wp.float64):
    """Add to a sum: as whole numbers, whose sum is the same in any order."""
    units = value * structures.units[s]
    whole = wp.floor(units)
    wp.atomic_add(structures.upper, at, wp.int64(whole))
    wp.atomic_add(structures.lower, at, wp.int64(wp.round((units - whole) * wp.float64(PARTED))))


def _book_impulse(structures: StructureGroup, s: int, patch: int, push: Vector):
    """Add the impulse of the mass on a patch, against the ``push`` [N s] of the structure, to its sums."""
    for d in range(3):
        _book(structures, s, 3 * (structures.fields[s, FIRST_SUM] + patch) + d, -wp.float64(push[d]))


def _book_work(structures: StructureGroup, s: int, done: Any, lane: int):
    """Add the energy that structures take from a block to that of its scene; ``done`` [J] is the work on particles of each lane."""
    taken = -sum_lanes(wp.float64(done))
    if lane == 0:
        many = structures.fields.shape[0]
        _book(structures, s, structures.upper.shape[0] - many + s, taken)


def _push_off(
    particles: ParticleGroup, constants: Constants, structures: StructureGroup, friction: Frictions, tile: Tile, s: int,
    cell: wp.vec3i, c: int, p: int, f: Vector, dt: Any, given: Vector,
):  # fmt: skip
    """Work [J] and impulse [N s] of a structure on a particle at offset ``f`` of a cell; the nodes hold the ``given`` part."""
    u, compliance = _contact_velocity(tile, _first_node(c), weights(f[0]), weights(f[1]), weights(f[2]))
    n, apart, patch = _surface(structures, s, cell, f, real(wp.inf))
    basal = friction[structures.first_friction[int(particles.release[p])] + patch]
    if SUBSTEPPED:
        apart = moved_gap(apart, n, _way(particles.rec, p))
    push = impulse(u, n, contact_gap(apart, particles.radius[p]), compliance, basal, dt, given, real(0.0))
    _book_impulse(structures, s, patch, push)
    v = vec(particles.rec[MOMENTUM, p], particles.rec[MOMENTUM + 1, p], particles.rec[MOMENTUM + 2, p]) / particles.rec[MASS, p]
    if SUBSTEPPED:
        v = _velocity_in_place(particles.rec, p)
    return node4(work(push, given, v, u, compliance), push[0], push[1], push[2])


def solve_structure_contacts(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup,
    contacts: ContactGroup, scenes: SceneGroup, constants: Constants, structures: StructureGroup, friction: Frictions,
):  # fmt: skip
    """Compute one impulse per particle that touches a structure, and add its change since the detection to the nodes.

    The impulse is booked on the nearest patch, its work [J] by scene. A thread first owns a particle, then a cell.
    """
    place, lane = wp.tid()
    place, lane = own_block(place), own_lane(lane)
    b = int(ground.standing[place])
    if status.flags[HALT] != 0 or b < 0 or contacts.touching[wp.max(b, 0)] == 0:
        return
    s = _scene_of(blocks, scenes, b)
    dt = scenes.clock[s, 0]
    last, stamp = real((scenes.step_counts[s] - 1) & STAMPS), real(scenes.step_counts[s] & STAMPS)
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
            change = vec(real(0.0), real(0.0), real(0.0))
            f = vec(real(0.0), real(0.0), real(0.0))
            done = node4()
            if n < total:
                c = _cell_of(starts, n)
                p = contacts.pressed[first + n] & NOT_NEGATIVE
                f = vec(particles.rec[OFFSET, p], particles.rec[OFFSET + 1, p], particles.rec[OFFSET + 2, p])
                given = _given_by_structures(structures, particles.number[p], last, dt)
                cell = _cell(blocks, scenes, s, b, c)
                done = _push_off(particles, constants, structures, friction, tile, s, cell, c, p, f, dt, given)
                taken += done[0]
                change = vec(done[1], done[2], done[3]) - given
                structures.forces[particles.number[p]] = node4(stamp, done[1] / dt, done[2] / dt, done[3] / dt)
            _hold(pushes, offsets, n - base, change, f, n < total)
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
