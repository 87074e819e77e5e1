"""Contact detection beside structures: which particles touch one, and the sums of their weights at the nodes.

    ground impulses --settle--> momentum of the nodes --find--> list and weights
                    --solve--> impulses --settle--> momentum --find entering--> marks in the list, their weights
                    --stop entering--> more impulses --settle--> momentum

    ground.standing[place]   block beside a structure       structures.forces[p]   as particles.forces, of the structures
    contacts                 list and sums as in contact_detection; arrays of their own

The groups of blocks and contacts are those of the ground in form, without a surface. The nodes hold the impulses of the ground
before those of structures begin.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_detection import _give_shares, _note_starts
from runout.backends.hash.contact_solution import HELD, HELD_REST, _clear, _hold, _number, _spread
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
    BLOCKS,
    CELL_LANES,
    HALT,
    LASTING,
    MASS,
    MOMENTUM,
    NOT_NEGATIVE,
    OFFSET,
    PUSHES,
    PUSHES_UP,
    SLOT,
    STAMPS,
    STARTS,
    TILE,
    Ints,
    Tile,
    lane_count,
    node4,
    node_at,
    own_block,
    own_lane,
    put_node,
)
from runout.backends.hash.stencil import _cell_of, _scene_of, _set_bases, _set_near_bases
from runout.backends.hash.structure_distance import _cell, _surface
from runout.physics.contact import in_contact, reach
from runout.physics.structures import contact_gap
from runout.physics.tensors import dot, real, vec

hits_before: Any = None  # how many of the lanes before a lane hit, and of all; the binding puts it in its place


def settle_impulses(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, reached: Ints,
    ended: int,
):  # fmt: skip
    """Add the impulses of contacts to the nodes that structures reach (``reached`` >= 0), and clear the sums there.

    If contact has ``ended``, no block touches any more.
    """
    t = wp.tid()
    b = t >> 6
    if status.flags[HALT] != 0 or b >= status.tally[BLOCKS]:
        return
    slot = ground.grounded[b]
    if slot < 0 or reached[b] < 0:
        return
    n = t & 63
    east = slot * SLOT + PUSHES + 2 * n
    up = slot * SLOT + PUSHES_UP + n
    push = node4(real(0.0), contacts.shares[east], contacts.shares[east + 1], contacts.shares[up])
    put_node(grid.nodes, t, node_at(grid.nodes, t) + push)
    contacts.shares[slot * SLOT + n] = real(0.0)
    contacts.shares[east] = real(0.0)
    contacts.shares[east + 1] = real(0.0)
    contacts.shares[up] = real(0.0)
    if n == 0 and ended != 0:
        contacts.touching[b] = 0


def _touches(
    particles: ParticleGroup, constants: Constants, structures: StructureGroup, s: int, cell: wp.vec3i, p: int, dt: Any
):  # fmt: skip
    """Whether a particle touches a structure within ``dt`` [s]."""
    rec = particles.rec
    v = vec(rec[MOMENTUM, p], rec[MOMENTUM + 1, p], rec[MOMENTUM + 2, p]) / rec[MASS, p]
    far = reach(particles.radius[p], wp.sqrt(dot(v, v)), dt, constants.band)
    n, apart, _patch = _surface(structures, s, cell, vec(rec[OFFSET, p], rec[OFFSET + 1, p], rec[OFFSET + 2, p]), far)
    return in_contact(contact_gap(apart, particles.radius[p]), dot(v, n), dt, constants.band)


def _given_by_structures(structures: StructureGroup, n: int, stamp: Any, dt: Any):
    """Impulse [N s] by the force of the step with this stamp on the particle that was loaded as number ``n``."""
    last = structures.forces[n]
    lasting = wp.where(last[0] == stamp, dt, real(0.0))
    return vec(lasting * last[1], lasting * last[2], lasting * last[3])


def _load_given_by_structures(
    particles: ParticleGroup, contacts: ContactGroup, structures: StructureGroup, pushes: Tile, offsets: Tile, begin: int, end: int,
    lane: int, stamp: Any, dt: Any,
):  # fmt: skip
    """Hold impulses by the forces of the step before, and offsets, of up to HELD particles of the list."""
    for q in range((end - begin + lane_count() - 1) // lane_count()):
        n = q * lane_count() + lane
        p = contacts.pressed[wp.min(begin + n, end - 1)] & NOT_NEGATIVE
        f = vec(particles.rec[OFFSET, p], particles.rec[OFFSET + 1, p], particles.rec[OFFSET + 2, p])
        _hold(pushes, offsets, n, _given_by_structures(structures, particles.number[p], stamp, dt), f, begin + n < end)


def _list_touching(
    particles: ParticleGroup, blocks: BlockGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
    structures: StructureGroup, starts: Tile, counts: Tile, s: int, b: int, lane: int, dt: Any,
):  # fmt: skip
    """List the particles of a block that touch a structure, and count them by cell; returns how many they are."""
    first = int(blocks.cstart[b, 0])
    for q in range((STARTS + lane_count() - 1) // lane_count()):
        c = q * lane_count() + lane
        wp.tile_scatter_masked(starts, wp.min(c, CELL_LANES), blocks.cstart[b, wp.min(c, CELL_LANES)] - first, c < STARTS)
    total = int(starts[CELL_LANES])
    found = int(0)
    for base in range(0, total, lane_count()):
        n = wp.min(base + lane, total - 1)
        c = _cell_of(starts, n)
        p = particles.order[first + n] & NOT_NEGATIVE
        hit = base + lane < total and _touches(particles, constants, structures, s, _cell(blocks, scenes, s, b, c), p, dt)
        hits = hits_before(hit)
        if hit:
            contacts.pressed[first + found + hits[0]] = p  # the list may be the same memory: it stays behind
        wp.tile_scatter_add(counts, c, 1, hit, True)
        found += hits[1]
    return found


def find_structure_contacts(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup,
    contacts: ContactGroup, scenes: SceneGroup, constants: Constants, structures: StructureGroup,
):  # fmt: skip
    """List the particles that touch a structure by cell, and add their weights to the nodes.

    Impulses by the forces of the step before are added to the momentum of the nodes.
    """
    place, lane = wp.tid()
    place, lane = own_block(place), own_lane(lane)
    b = int(ground.standing[place])
    if status.flags[HALT] != 0 or b < 0:
        return
    s = _scene_of(blocks, scenes, b)
    dt = scenes.clock[s, 0]
    if dt > real(0.0):
        starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
        counts = wp.tile_zeros(shape=CELL_LANES, dtype=int, storage="shared")
        first = int(blocks.cstart[b, 0])
        lasting = scenes.clock[s, LASTING]
        found = _list_touching(particles, blocks, contacts, scenes, constants, structures, starts, counts, s, b, lane, lasting)
        if found > 0:
            filled = wp.tile_empty(shape=CELL_LANES, dtype=wp.uint8, storage="shared")
            many = _number(starts, filled, counts, lane)
            _note_starts(contacts, starts, first, b, lane)
            if lane == 0:
                contacts.touching[b] = found
            bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
            near_bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
            tile = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")
            pushes = wp.tile_empty(shape=HELD, dtype=node4, storage="shared")
            offsets = wp.tile_empty(shape=HELD_REST, dtype=real, storage="shared")
            _set_bases(bases, blocks.up, b, lane)
            _set_near_bases(near_bases, ground.near_up, place, lane)
            _clear(tile, node4(), lane)
            stamp = real((scenes.step_counts[s] - 1) & STAMPS)
            for base in range(0, found, HELD):
                wp.tile_zeros(shape=1, dtype=int, storage="shared")  # waits for lanes still at those before
                last = wp.min(first + found, first + base + HELD)
                _load_given_by_structures(
                    particles, contacts, structures, pushes, offsets, first + base, last, lane, stamp, dt
                )  # fmt: skip
                for turns in range((many + lane_count() - 1) // lane_count()):
                    mine = turns * lane_count() + lane
                    _spread(tile, pushes, offsets, starts, int(filled[wp.min(mine, many - 1)]), base, mine < many, True)
            _give_shares(grid, contacts, tile, bases, near_bases, b, lane)
