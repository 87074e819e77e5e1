"""Contact solution: one impulse of a surface per particle in contact, spread to the nodes.

    tile (shared memory)   6 x 6 x 6 nodes: velocity x, y, z and compliance; later the impulses
    pushes, offsets        64 particles at a time: impulse and offset x; offsets y, then offsets z, then drag if columns take it
    forces[p]              stamp of the step of the last contact | force of the surface x, y, z [N]
    contacts.shares        impulses by node, as in contact_detection
    contacts.column_pushes drag and impulses by column of nodes, if columns take drag: see column_drag

The surface is the ground or, where kernels are compiled for these, that of structures. The two differ in the normal and the gap
of a particle, in its friction, in what is booked, and in the blocks that are solved.

A thread computes the impulse of one particle, starting from the force of the step before. Then a thread owns a cell and adds the
changes of the impulses of its particles to the 27 nodes.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import PLAN, _area, _column, _set_all_bases
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
    StructureGroup,
)
from runout.backends.hash.layout import (
    AFFINE,
    AREAS,
    BASES,
    CELL_LANES,
    DRAGS_COLUMN,
    HALT,
    LASTING,
    LIMITS_START,
    MASS,
    MOMENTUM,
    NO_STEP,
    NOT_NEGATIVE,
    OFFSET,
    ORDERED,
    PIECE,
    PUSHES,
    PUSHES_UP,
    STAMPS,
    STARTS,
    STARTS_DIFFER,
    STRUCTURED,
    SUBSTEPPED,
    TILE,
    TOUCHED,
    WET,
    ZONED,
    Frictions,
    Nodes,
    Reals,
    Rows,
    Surface,
    Tile,
    Vector,
    add_node,
    lane_count,
    node4,
    own_block,
    own_lane,
    sums9,
)
from runout.backends.hash.pore_pressure import _effective
from runout.backends.hash.stencil import _cell_of, _first_node, _load, _piece, _scene_of, _set_near_bases
from runout.backends.hash.structure_surface import _book_impulse, _book_work, _cell, _surface
from runout.backends.hash.zones import _kind_of_ground
from runout.physics.bspline import weights
from runout.physics.contact import column_drag, effective_impulse, fastest_start, impulse, started_time, work
from runout.physics.heightfield import distance, surface_at, upward_normal
from runout.physics.structures import contact_gap, entry_velocity, stopping_impulse
from runout.physics.substeps import moved_gap, time_ahead
from runout.physics.tensors import dot, real, tens, vec

HELD = 64  # contact particles of a block whose impulses or offsets are held at once
HELD_REST = 2 * HELD  # the rest of what is held of them; the binding adds HELD where their drag is held too
sum_before: Any = None  # sums over the lanes before a lane, and over all; the binding puts it in its place
add_pair: Any = None  # adds two numbers that lie beside each other; the binding puts it in its place
hits_before: Any = None  # how many of the lanes before a lane hit, and of all, likewise
book_four: Any = None  # adds sums over the lanes to four numbers beside each other, likewise
BELOW, FILLED = 2**20 - 1, 20  # a sum of particles lies in these bits, and one of cells from this bit on


def _around(tiles: Rows, near: int, c: int):
    """Nine coefficients of the surface under a cell of a block, from the 6 x 6 at place ``near``."""
    o = (c >> 4) * 6 + ((c >> 2) & 3)
    return tens(
        tiles[near, o], tiles[near, o + 1], tiles[near, o + 2], tiles[near, o + 6], tiles[near, o + 7], tiles[near, o + 8],
        tiles[near, o + 12], tiles[near, o + 13], tiles[near, o + 14],
    )  # fmt: skip


def _ground(around: Any, z: int, f: Vector, radius: Any, h: Vector):
    """Unit normal and gap [m] of a particle at offset ``f`` in a cell whose nine coefficients and lowest node ``z`` are given."""
    e = surface_at(around, f[0], f[1])
    n = upward_normal(e[1] * h[2] / h[0], e[2] * h[2] / h[1])
    return n, distance((real(z) + f[2] - e[0]) * h[2], n[2]) - radius


def _number(starts: Tile, filled: Tile, counts: Tile, lane: int):
    """Sums of ``counts`` before each cell to ``starts``; ``filled`` lists the cells that have any; returns how many these are."""
    total = int(0)
    for q in range(CELL_LANES // lane_count()):
        c = q * lane_count() + lane
        n = int(counts[c])
        sums = sum_before(n + (wp.min(n, 1) << FILLED))
        before = total + sums[0]
        wp.tile_scatter_masked(starts, c, before & BELOW, True)
        wp.tile_scatter_masked(filled, before >> FILLED, wp.uint8(c), n > 0)
        total += sums[1]
    wp.tile_scatter_masked(starts, CELL_LANES, total & BELOW, lane == 0)
    return total >> FILLED


def _number_pressed(contacts: ContactGroup, starts: Tile, filled: Tile, b: int, lane: int):
    """The same for cells whose particles are listed already."""
    first = contacts.pressed_start[b, 0]
    many = int(0)
    for q in range(CELL_LANES // lane_count()):
        c = q * lane_count() + lane
        begin = contacts.pressed_start[b, c]
        last = contacts.pressed_start[b, c + 1]
        hits = hits_before(last > begin)
        wp.tile_scatter_masked(starts, c, begin - first, True)
        wp.tile_scatter_masked(filled, many + hits[0], wp.uint8(c), last > begin)
        many += hits[1]
    wp.tile_scatter_masked(starts, CELL_LANES, contacts.pressed_start[b, CELL_LANES] - first, lane == 0)
    return many


def _contact_velocity(tile: Tile, first: int, wx: Any, wy: Any, wz: Any):
    """Velocity that a particle would receive, and its lumped compliance [1/kg]."""
    u = node4()
    for i in range(3):
        for j in range(3):
            s = node4()
            for k in range(3):
                s += wz[k] * tile[first + (i * 6 + j) * 6 + k]
            u += (wx[i] * wy[j]) * s
    return vec(u[0], u[1], u[2]), u[3]


def _kind_in_cell(blocks: BlockGroup, scenes: SceneGroup, scene: int, b: int, c: int, f: Vector):
    """Kind of ground at offset ``f`` in a cell of a block."""
    x = 4 * blocks.coordinates[b, 0] + (c >> 4)
    y = 4 * blocks.coordinates[b, 1] - scenes.shift[scene] + ((c >> 2) & 3)
    return _kind_of_ground(scenes, scene, x, y, f)


def _record_of_friction(
    particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, constants: Constants, s: int, b: int, c: int, p: int,
    f: Vector,
):  # fmt: skip
    """Record of the friction of a particle of scene ``s`` at offset ``f`` in a cell of a block."""
    record = wp.max(constants.only, 0)
    if constants.only < 0:
        record = int(particles.release[p])
    if ZONED:
        record = scenes.of_friction[record, 0] + _kind_in_cell(blocks, scenes, s, b, c, f)
    return record


def _way(rec: Rows, p: int):
    """Way [m] of a particle since the start of the transfer, which a substep leaves in the place of the affine matrix."""
    return vec(rec[AFFINE, p], rec[AFFINE + 1, p], rec[AFFINE + 2, p])


def _velocity(rec: Rows, p: int):
    """Velocity [m/s] of a particle at the start of the step."""
    m = rec[MASS, p]
    return vec(rec[MOMENTUM, p] / m, rec[MOMENTUM + 1, p] / m, rec[MOMENTUM + 2, p] / m)


def _velocity_in_place(rec: Rows, p: int):
    """Velocity [m/s] of a particle at the start of a substep, likewise."""
    return vec(rec[AFFINE + 3, p], rec[AFFINE + 4, p], rec[AFFINE + 5, p])


def _way_ahead(rec: Rows, p: int, ahead: Any):
    """Way [m] of a particle from the start of a transfer in a time ``ahead`` [s]."""
    m = rec[MASS, p]
    return vec(ahead * rec[MOMENTUM, p] / m, ahead * rec[MOMENTUM + 1, p] / m, ahead * rec[MOMENTUM + 2, p] / m)


def _moved(f: Vector, way: Vector, h: Vector):
    """Offset in a cell at the end of a ``way`` [m] from the offset ``f``; it may leave the cell."""
    return vec(f[0] + way[0] / h[0], f[1] + way[1] / h[1], f[2] + way[2] / h[2])


def _surface_at(
    blocks: BlockGroup, scenes: SceneGroup, constants: Constants, surface: Surface, s: int, b: int, near: int, c: int, f: Vector,
    way: Vector, radius: Any,
):  # fmt: skip
    """Normal of the surface and gap [m] of a particle at offset ``f`` in a cell; of structures the distance, and the patch.

    The ground is that at the end of a ``way`` [m] from the start of the transfer.
    """
    patch = int(0)
    if STRUCTURED:
        n, gap, patch = _surface(surface, s, _cell(blocks, scenes, s, b, c), f, real(wp.inf))
    else:
        n, gap = _ground(_around(surface.tiles, near, c), c & 3, _moved(f, way, constants.h), radius, constants.h)
        gap = moved_gap(gap, n, -way)
    return n, gap, patch


def _push_of_structure(
    particles: ParticleGroup, constants: Constants, structures: StructureGroup, friction: Frictions, p: int, patch: int, u: Vector,
    n: Vector, apart: Any, compliance: Any, dt: Any, given: Vector, entering: int,
):  # fmt: skip
    """Impulse [N s] of a patch on a particle at a distance ``apart`` [m]; if it is ``entering``, the one that stops it before."""
    push = vec(real(0.0), real(0.0), real(0.0))
    if entering != 0:
        size = stopping_impulse(dot(u, n), entry_velocity(apart, dt, constants.band), compliance)
        push = vec(size * n[0], size * n[1], size * n[2])
    else:
        basal = friction[structures.first_friction[int(particles.release[p])] + patch]
        push = impulse(u, n, contact_gap(apart, particles.radius[p]), compliance, basal, dt, given, real(0.0))
    return push


def _push(
    particles: ParticleGroup, blocks: BlockGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    surface: Surface, friction: Frictions, pores: PoreGroup, tile: Tile, bases: Tile, s: int, b: int, near: int, c: int, p: int,
    f: Vector, dt: Any, given: Vector, entering: int,
):  # fmt: skip
    """Work [J] and impulse [N s] of the surface on a particle of a cell at offset ``f``, and drag [kg/m] on the columns around.

    The nodes hold the ``given`` part of the impulse. Structures book the impulse on the nearest patch.
    """
    u, compliance = _contact_velocity(tile, _first_node(c), weights(f[0]), weights(f[1]), weights(f[2]))
    way = _way_ahead(particles.rec, p, time_ahead(scenes.clock[s, LASTING], dt))
    n, gap, patch = _surface_at(blocks, scenes, constants, surface, s, b, near, c, f, way, particles.radius[p])
    area = real(0.0)
    if AREAS:
        area = _area(contacts, bases, c, f, n[2], constants.h)
    if SUBSTEPPED:
        gap = moved_gap(gap, n, _way(particles.rec, p))
    push = vec(real(0.0), real(0.0), real(0.0))
    drag = real(0.0)
    if STRUCTURED:
        push = _push_of_structure(particles, constants, surface, friction, p, patch, u, n, gap, compliance, dt, given, entering)
        _book_impulse(surface, s, patch, push)
    else:
        basal = friction[_record_of_friction(particles, blocks, scenes, constants, s, b, c, p, _moved(f, way, constants.h))]
        if WET:
            effective, _share = _effective(particles, pores, p, b, c, dt)
            push = effective_impulse(u, n, gap, compliance, basal, dt, given, area, effective)
        else:
            push = impulse(u, n, gap, compliance, basal, dt, given, area)
        if DRAGS_COLUMN:
            drag = column_drag(push, u, n, area, compliance, real(wp.length(constants.gravity)), dt, basal)
    before = _velocity_in_place(particles.rec, p) if SUBSTEPPED else _velocity(particles.rec, p)
    return node4(work(push, given, before, u, compliance), push[0], push[1], push[2]), drag


def _limits_start(particles: ParticleGroup, scenes: SceneGroup, constants: Constants, p: int):
    """Whether a particle starts from no force of the step before if it is too fast (:data:`LIMITS_START`)."""
    if STARTS_DIFFER:
        release = constants.only
        if release < 0:
            release = int(particles.release[p])
        return scenes.of_friction[release, 1] != 0
    return True


def _given(particles: ParticleGroup, scenes: SceneGroup, constants: Constants, surface: Surface, p: int, stamp: Any, dt: Any):
    """Impulse [N s] by the force of the step with this stamp; none if a particle did not touch then or is too fast."""
    n = particles.number[p]
    last = surface.forces[n] if STRUCTURED else particles.forces[n]
    lasting = wp.where(last[0] == stamp, dt, real(0.0))
    if LIMITS_START and _limits_start(particles, scenes, constants, p):
        v = _velocity(particles.rec, p)
        h, gravity = constants.h, real(wp.length(constants.gravity))
        lasting = wp.min(lasting, started_time(v, fastest_start(wp.min(h[0], wp.min(h[1], h[2])), gravity, dt), dt))
    return vec(lasting * last[1], lasting * last[2], lasting * last[3])


def _keep_force(particles: ParticleGroup, surface: Surface, p: int, stamp: Any, push: Any, dt: Any, entering: int):
    """Note the force of the surface on a particle in the step with this stamp, from work and impulse; none that stops it."""
    force = node4(stamp, push[1] / dt, push[2] / dt, push[3] / dt)
    if STRUCTURED:
        if entering == 0:
            surface.forces[particles.number[p]] = force
    else:
        particles.forces[particles.number[p]] = force


def _clear(tile: Tile, nothing: Any, lane: int):
    """Set all nodes of a tile to ``nothing``."""
    for q in range((TILE + lane_count() - 1) // lane_count()):
        t = q * lane_count() + lane
        wp.tile_scatter_masked(tile, wp.min(t, TILE - 1), nothing, t < TILE)


def _hold(pushes: Tile, offsets: Tile, place: int, push: Vector, f: Vector, there: bool):
    """Hold impulse and offset of a contact particle for :func:`_spread`, if it is ``there``."""
    wp.tile_scatter_masked(pushes, place, node4(push[0], push[1], push[2], f[0]), there)
    wp.tile_scatter_masked(offsets, place, f[1], there)
    wp.tile_scatter_masked(offsets, HELD + place, f[2], there)


def _spread(tile: Tile, pushes: Tile, offsets: Tile, starts: Tile, c: int, base: int, mine: bool, weighed: bool):
    """Impulses of the contact particles of a cell to its 27 nodes, nine at a time; none if the cell is not ``mine``.

    If ``weighed``, their weights too, as the first number of a node; the caller gives a constant. Else that number is free: the
    lowest of three nodes above each other takes the drag on their column there. ``pushes`` holds the impulses of the particles from
    number ``base`` on and their offsets along x, ``offsets`` those along y, then z, then their drag.
    """
    begin = wp.max(int(starts[c]), base)
    end = wp.where(mine, wp.min(int(starts[c + 1]), base + HELD), begin)
    first = _first_node(c)
    for i in range(3):
        acc = sums9()
        for t in range(begin, end):
            push = pushes[t - base]
            wx = weights(push[3])
            wy = weights(offsets[t - base])
            wz = weights(offsets[HELD + t - base])
            for j in range(3):
                share = wx[i] * wy[j]
                plan = vec(share * push[0], share * push[1], share * push[2])
                if DRAGS_COLUMN and not weighed:  # the weights along z add up to one
                    acc[j * 3, 0] += share * offsets[2 * HELD + t - base]
                for k in range(3):
                    if weighed:
                        w = share * wz[k]
                        acc[j * 3 + k, 0] += w
                        for d in range(3):
                            acc[j * 3 + k, d + 1] += w * push[d]
                    else:
                        for d in range(3):
                            acc[j * 3 + k, d + 1] += wz[k] * plan[d]
        for j in range(3):
            for k in range(3):
                s = node4(acc[j * 3 + k, 0], acc[j * 3 + k, 1], acc[j * 3 + k, 2], acc[j * 3 + k, 3])
                wp.tile_scatter_add(tile, first + (i * 6 + j) * 6 + k, s, mine, False)


def _spread_all(
    tile: Tile, pushes: Tile, offsets: Tile, starts: Tile, filled: Tile, many: int, base: int, lane: int, weighed: bool
):  # fmt: skip
    """The same for all cells that have contacts, which are ``many``; a lane takes one at a time."""
    for turn in range((many + lane_count() - 1) // lane_count()):
        mine = turn * lane_count() + lane
        _spread(tile, pushes, offsets, starts, int(filled[wp.min(mine, many - 1)]), base, mine < many, weighed)


def _put(arenas: Nodes, place: int, push: Any, base: int):
    """Add the impulse at a node to the arena of the block; the first round replaces what an earlier step left there."""
    s = node4(push)
    if base > 0:
        s += arenas[place]
    arenas[place] = s


def _give_columns(contacts: ContactGroup, tile: Tile, bases: Tile, b: int, lane: int, base: int):
    """Sums over the nodes above each other in the tile of block ``b``, if drag slows columns: to these or, in fixed order, kept."""
    if DRAGS_COLUMN:
        for q in range(lane, PLAN, lane_count()):
            s = node4()
            for z in range(6):
                s += tile[6 * q + z]
            if ORDERED:
                _put(contacts.column_pushes, PLAN * b + q, s, base)
            elif s[0] != real(0.0) or s[1] != real(0.0) or s[2] != real(0.0) or s[3] != real(0.0):
                add_node(contacts.column_pushes, _column(bases, q // 6, q % 6), s)


def _give(tile: Tile, shares: Reals, bases: Tile, u: int, q: int):
    """Add the impulse at node ``q`` of piece ``u`` of the tile to the node of the grid."""
    piece = _piece(u, q)
    s = tile[wp.max(piece[2], 0)]
    if piece[2] >= 0 and (s[1] != real(0.0) or s[2] != real(0.0) or s[3] != real(0.0)):
        add_pair(shares, bases[piece[0]] + PUSHES + 2 * piece[1], s[1], s[2])
        wp.atomic_add(shares, bases[piece[0]] + PUSHES_UP + piece[1], s[3])


def _give_changes(grid: GridGroup, contacts: ContactGroup, tile: Tile, near_bases: Tile, b: int, lane: int, base: int):
    """Changes of the impulses in the tile of block ``b`` to the nodes; in fixed order to the arena of the block."""
    if ORDERED:
        for t in range(lane, TILE, lane_count()):
            _put(grid.arenas, b * TILE + t, tile[t], base)
    else:
        for q in range(lane, PIECE, lane_count()):
            for u in range(3):
                _give(tile, contacts.shares, near_bases, u, q)
                _give(tile, contacts.shares, near_bases, u + 3, q)
            _give(tile, contacts.shares, near_bases, 6, q)


def _block_in_contact(
    status: StatusGroup, blocks: BlockGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup, place: int
):  # fmt: skip
    """Block with contacts that a block of threads solves, -1 if there is none, and the place of the block near the surface.

    Blocks of scenes that wait in a further substep are left out.
    """
    b = int(-1)
    near = int(place)
    if STRUCTURED:
        b = ground.standing[place]
        if contacts.touching[wp.max(b, 0)] == 0:
            b = -1
    else:
        row = status.tally[TOUCHED] - 1 - place  # blocks found last are still in the L2 cache
        if row >= 0:
            b = contacts.touched[row, 0]
            near = contacts.touched[row, 1]
    if SUBSTEPPED:  # noqa: SIM102 - a constant alone: warp compiles no branch
        if scenes.clock[_scene_of(blocks, scenes, wp.max(b, 0)), 0] <= real(0.0):
            b = -1
    return b, near


def solve_contacts(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup,
    contacts: ContactGroup, scenes: SceneGroup, constants: Constants, surface: Surface, friction: Frictions, pores: PoreGroup,
    entering: int,
):  # fmt: skip
    """Compute one impulse per contact particle, and add its change since the detection to the nodes.

    Work [J] and impulse [N s] of the ground are booked by block, those of structures by scene and patch; these also stop particles
    that are ``entering``.

    A thread first owns a particle and finds its impulse, then a cell and adds up those of its particles.
    """
    begin, lane = wp.tid()
    begin, lane = own_block(begin), own_lane(lane)
    b, place = _block_in_contact(status, blocks, ground, contacts, scenes, begin)
    if status.flags[HALT] != 0 or b < 0:
        return
    s = _scene_of(blocks, scenes, b)
    dt = scenes.clock[s, 0]
    last, stamp = real((scenes.step_counts[s] - 1) & STAMPS), real(scenes.step_counts[s] & STAMPS)
    if STRUCTURED:  # noqa: SIM102 - a constant alone: warp compiles no branch
        if entering != 0:
            last = real(NO_STEP)
    starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
    tile = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")  # velocities first, then impulses
    bases = wp.tile_empty(shape=BASES, dtype=int, storage="shared")
    near_bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
    _set_all_bases(bases, blocks, contacts, b, lane)
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
        ahead = int(contacts.pressed[first + wp.min(base + lane, total - 1)])
        _load(grid, contacts, tile, bases, near_bases, lane, dv)
        done = node4()
        for q in range((wp.min(total - base, HELD) + lane_count() - 1) // lane_count()):
            n = base + q * lane_count() + lane
            change = vec(real(0.0), real(0.0), real(0.0))
            f = vec(real(0.0), real(0.0), real(0.0))
            drag = real(0.0)
            if n < total:
                c = _cell_of(starts, n)
                p = ahead & NOT_NEGATIVE
                ahead = contacts.pressed[first + wp.min(n + lane_count(), total - 1)]
                f = vec(particles.rec[OFFSET, p], particles.rec[OFFSET + 1, p], particles.rec[OFFSET + 2, p])
                given = _given(particles, scenes, constants, surface, p, last, dt)
                push, drag = _push(
                    particles, blocks, contacts, scenes, constants, surface, friction, pores, tile, bases, s, b, place, c, p, f,
                    dt, given, entering,
                )  # fmt: skip
                done += push
                change = vec(push[1], push[2], push[3]) - given
                _keep_force(particles, surface, p, stamp, push, dt, entering)
            _hold(pushes, offsets, n - base, change, f, n < total)
            if DRAGS_COLUMN:
                wp.tile_scatter_masked(offsets, 2 * HELD + n - base, drag, n < total)
        if STRUCTURED:
            _book_work(surface, s, done[0], lane)
        else:
            book_four(grid.booked, b, 1, done)
        _clear(tile, node4(), lane)
        _spread_all(tile, pushes, offsets, starts, filled, many, base, lane, False)
        _give_columns(contacts, tile, bases, b, lane, base)
        _give_changes(grid, contacts, tile, near_bases, b, lane, base)
