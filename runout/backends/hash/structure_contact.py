"""Contact with structures: lists of the particles that touch one, then of those that would still enter, with the nodes between.

    ground impulses --settle--> momentum of the nodes --find--> list and weights --solve--> impulses
                    --settle--> momentum --find entering--> shorter list and its weights --solve--> more impulses
                    --settle--> momentum

    ground.standing[place]   block beside a structure       structures.forces[p]   as particles.forces, of the structures
    contacts                 list and sums as in contact_detection; arrays of their own

The groups of blocks and contacts are those of the ground in form, without a surface, and ``contact_solution`` solves for the
impulses. The nodes hold the impulses of the ground before those of structures begin.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import _set_all_bases
from runout.backends.hash.contact_detection import _give_listed
from runout.backends.hash.contact_solution import _contact_velocity, _way
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
    BASES,
    BLOCKS,
    CELL_LANES,
    HALT,
    LASTING,
    MASS,
    MOMENTUM,
    NO_STEP,
    NOT_NEGATIVE,
    OFFSET,
    PUSHES,
    PUSHES_UP,
    SLOT,
    STAMPS,
    STARTS,
    SUBSTEPPED,
    TILE,
    Ints,
    Table2,
    Tile,
    Vector,
    lane_count,
    node4,
    node_at,
    own_block,
    own_lane,
    put_node,
)
from runout.backends.hash.stencil import _cell_of, _contact_node, _first_node, _node, _place_of_begun, _scene_of
from runout.backends.hash.structure_surface import _cell, _surface
from runout.physics.bspline import weights
from runout.physics.contact import in_contact, reach
from runout.physics.structures import contact_gap, entry_velocity
from runout.physics.substeps import moved_gap
from runout.physics.tensors import dot, real, vec

hits_before: Any = None  # how many of the lanes before a lane hit, and of all; the binding puts it in its place


def settle_impulses(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup,
    reached: Ints, ended: int,
):  # fmt: skip
    """Add the impulses of contacts to the nodes that structures reach (``reached`` >= 0), and clear the sums there.

    If contact has ``ended``, no block touches any more. With substeps, the weights of contacts with the ground stay, and the
    contacts of the next substep start from the impulses. The nodes of a scene that waits have taken theirs.
    """
    t = wp.tid()
    b = t >> 6
    if status.flags[HALT] != 0 or b >= status.tally[BLOCKS]:
        return
    slot = ground.grounded[b]
    if slot < 0 or reached[b] < 0 or scenes.clock[_scene_of(blocks, scenes, b), 0] <= real(0.0):
        return
    n = t & 63
    east = slot * SLOT + PUSHES + 2 * n
    up = slot * SLOT + PUSHES_UP + n
    push = node4(real(0.0), contacts.shares[east], contacts.shares[east + 1], contacts.shares[up])
    put_node(grid.nodes, t, node_at(grid.nodes, t) + push)
    begun = _place_of_begun(contacts, slot)
    if begun >= 0:
        put_node(contacts.memory, begun + n, node_at(contacts.memory, begun + n) + push)
    else:
        contacts.shares[slot * SLOT + n] = real(0.0)
    contacts.shares[east] = real(0.0)
    contacts.shares[east + 1] = real(0.0)
    contacts.shares[up] = real(0.0)
    if n == 0 and ended != 0:
        contacts.touching[b] = 0


def _is_in_contact(
    particles: ParticleGroup, scenes: SceneGroup, constants: Constants, structures: StructureGroup, tile: Tile, s: int,
    cell: wp.vec3i, c: int, p: int, entering: int,
):  # fmt: skip
    """Whether a particle touches a structure within the transfer, or if ``entering`` its centre would come in within the step.

    The first by its own velocity, the second by those of the nodes in a tile.
    """
    rec = particles.rec
    f = vec(rec[OFFSET, p], rec[OFFSET + 1, p], rec[OFFSET + 2, p])
    lasting = scenes.clock[s, LASTING]
    v = vec(real(0.0), real(0.0), real(0.0))
    far = real(wp.inf)
    if entering != 0:
        v, _compliance = _contact_velocity(tile, _first_node(c), weights(f[0]), weights(f[1]), weights(f[2]))
    else:
        v = vec(rec[MOMENTUM, p], rec[MOMENTUM + 1, p], rec[MOMENTUM + 2, p]) / rec[MASS, p]
        far = reach(particles.radius[p], wp.sqrt(dot(v, v)), lasting, constants.band)
    n, apart, _patch = _surface(structures, s, cell, f, far)
    touches = in_contact(contact_gap(apart, particles.radius[p]), dot(v, n), lasting, constants.band)
    if entering != 0:
        if SUBSTEPPED:
            apart = moved_gap(apart, n, _way(rec, p))
        touches = dot(v, n) < entry_velocity(apart, scenes.clock[s, 0], constants.band)
    return touches


def _load_velocities(grid: GridGroup, tile: Tile, bases: Tile, lane: int, dv: Vector):
    """Velocity [m/s] of all nodes that particles of a block reach."""
    for q in range((TILE + lane_count() - 1) // lane_count()):
        t = wp.min(q * lane_count() + lane, TILE - 1)
        u = _contact_node(node_at(grid.nodes, _node(bases, t)), real(0.0), dv)
        wp.tile_scatter_masked(tile, t, u, q * lane_count() + lane < TILE)


def _load_starts(starts: Tile, cell_starts: Table2, b: int, lane: int):
    """Where the cells of a block start among its particles in a list."""
    for q in range((STARTS + lane_count() - 1) // lane_count()):
        c = q * lane_count() + lane
        start = cell_starts[b, wp.min(c, CELL_LANES)] - cell_starts[b, 0]
        wp.tile_scatter_masked(starts, wp.min(c, CELL_LANES), start, c < STARTS)


def _list_contacts(
    particles: ParticleGroup, blocks: BlockGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    structures: StructureGroup, tile: Tile, starts: Tile, counts: Tile, s: int, b: int, first: int, lane: int, entering: int,
):  # fmt: skip
    """List the particles of a block that touch a structure, or those of them that would enter; returns how many they are.

    ``counts`` are those of each cell. The list may be the memory of the one that is read: it stays behind.
    """
    total = int(starts[CELL_LANES])
    found = int(0)
    for base in range(0, total, lane_count()):
        n = wp.min(base + lane, total - 1)
        c = _cell_of(starts, n)
        p = int(0)
        if entering != 0:
            p = contacts.pressed[first + n] & NOT_NEGATIVE
        else:
            p = particles.order[first + n] & NOT_NEGATIVE
        cell = _cell(blocks, scenes, s, b, c)
        hit = _is_in_contact(particles, scenes, constants, structures, tile, s, cell, c, p, entering) and base + lane < total
        hits = hits_before(hit)
        if hit:
            contacts.pressed[first + found + hits[0]] = p
        wp.tile_scatter_add(counts, c, 1, hit, True)
        found += hits[1]
    return found


def find_structure_contacts(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup,
    contacts: ContactGroup, scenes: SceneGroup, constants: Constants, structures: StructureGroup, entering: int,
):  # fmt: skip
    """List by cell the particles that touch a structure, or if ``entering`` those in the list that would still enter one.

    Their weights are added to the nodes, and the impulses by the forces of the step before to the momentum of the nodes. A particle
    that would enter has its impulse already.
    """
    place, lane = wp.tid()
    place, lane = own_block(place), own_lane(lane)
    b = int(ground.standing[place])
    if status.flags[HALT] != 0 or b < 0 or (entering != 0 and contacts.touching[wp.max(b, 0)] == 0):
        return
    s = _scene_of(blocks, scenes, b)
    if scenes.clock[s, 0] > real(0.0):
        starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
        counts = wp.tile_zeros(shape=CELL_LANES, dtype=int, storage="shared")
        bases = wp.tile_empty(shape=BASES, dtype=int, storage="shared")
        tile = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")  # velocities first, then weights
        first = int(blocks.cstart[b, 0])
        stamp = real((scenes.step_counts[s] - 1) & STAMPS)
        if entering != 0:
            first = contacts.pressed_start[b, 0]
            stamp = real(NO_STEP)
            _load_starts(starts, contacts.pressed_start, b, lane)
            _set_all_bases(bases, blocks, contacts, b, lane)
            _load_velocities(grid, tile, bases, lane, vec(scenes.clock[s, 1], scenes.clock[s, 2], scenes.clock[s, 3]))
        else:
            _load_starts(starts, blocks.cstart, b, lane)
        found = _list_contacts(
            particles, blocks, contacts, scenes, constants, structures, tile, starts, counts, s, b, first, lane, entering
        )
        if lane == 0:
            contacts.touching[b] = found
        if found > 0:
            _give_listed(
                particles, blocks, grid, ground, contacts, scenes, constants, structures, tile, bases, starts, counts, b, place,
                first, found, lane, stamp,
            )  # fmt: skip
