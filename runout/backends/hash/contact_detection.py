"""Contact detection: which particles touch the ground, and the sums of their weights at the nodes.

    ground.bounds[place]        highest ground and least upward normal in each of the 16 columns of cells of a block
    ground.tiles[place]         6 x 6 coefficients of the surface
    queue (shared memory)       ring of 256 (particle, cell) that are low enough
    contacts.pressed            particles in contact, cell by cell: the cells of block b start at pressed_start[b, 0 ... 64]
    contacts.shares[256 slot]   | 64 sums of weights | 64 x (impulse east, north) | 64 x impulse upwards |
    contacts.touched            (block, place near the ground) of each block with a contact

A block of threads drops the columns of cells that lie too high, then the particles that do by their height alone, and computes the
gap of the others. Of the particles in contact, weights and the impulses by the forces of the last step go to the nodes.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import _give_weights, _set_all_bases
from runout.backends.hash.contact_solution import HELD, HELD_REST, _around, _clear, _given, _ground, _hold, _number, _spread_all
from runout.backends.hash.groups import (
    BlockGroup,
    Constants,
    ContactGroup,
    GridGroup,
    GroundGroup,
    ParticleGroup,
    SceneGroup,
    Search,
    StatusGroup,
)
from runout.backends.hash.layout import (
    AREAS_AT_ONCE,
    BASES,
    CELL_LANES,
    HALT,
    LASTING,
    MASS,
    MOMENTUM,
    NOT_NEGATIVE,
    OFFSET,
    ORDERED,
    PIECE,
    SLOT,
    STAMPS,
    STARTS,
    TILE,
    TOUCHED,
    Halves,
    Surface,
    Tile,
    Vector,
    add_node,
    lane_count,
    node4,
    own_block,
    own_lane,
)
from runout.backends.hash.stencil import _cell_of, _piece, _place_of_begun, _scene_of, _set_near_bases
from runout.physics.contact import in_contact, reach
from runout.physics.heightfield import height_at
from runout.physics.tensors import dot, real, vec

NEIGHBOURS = 27  # blocks around one, with itself
QUEUED = 256  # particles of a block that wait for their test, at most: a power of two, more than five times the lanes
sum_before: Any = None  # sums over the lanes before a lane, and over all; the binding puts it in its place
max_lanes: Any = None  # the largest of the lanes' numbers, likewise
pair_at: Any = None  # two numbers that lie beside each other, likewise
hits_before: Any = None  # how many of the lanes before a lane hit, and of all, likewise
take_place: Any = None  # adds one to a count and tells what it was, likewise


def _farthest(blocks: BlockGroup, contacts: ContactGroup, constants: Constants, b: int, lane: int, dt: Any, of_all: Any):
    """Distance [m] beyond which no particle of a block is in contact; at most ``of_all``.

    The velocity of a particle is a mean over nodes of the block and the 26 around it. The fastest of these nodes is a bound.
    """
    fastest = real(0.0)
    for q in range((NEIGHBOURS + lane_count() - 1) // lane_count()):
        k = q * lane_count() + lane
        if k < NEIGHBOURS:
            other = blocks.around[b, k]
            if other >= 0:
                both = pair_at(contacts.approach_speeds, 2 * other)
                fastest = wp.max(fastest, wp.max(both[0], both[1]))
    return wp.min(of_all, reach(constants.largest, max_lanes(fastest), dt, constants.band))


def _highest(bounds: Halves, near: int, c: int, h: Vector, far: Any):
    """Largest offset in a cell at which a particle may be within ``far`` [m] of the ground."""
    column = 2 * ((c >> 2) & 15)
    return real(bounds[near, column]) - real(c & 3) + height_at(far, real(bounds[near, column + 1])) / h[2]


def _number_listed(
    blocks: BlockGroup, ground: GroundGroup, constants: Constants, starts: Tile, places: Tile, limits: Tile, b: int, lane: int,
    near: int, far: Any,
):  # fmt: skip
    """Number the particles of the cells that may touch the ground; returns how many they are.

    ``starts`` are the numbers of the first of each cell. Particle n of a cell is at ``places`` + n of the list. Particles of a cell
    with an upward offset above ``limits`` are too high; a cell with a limit below 0.5, the smallest offset, is left out.
    """
    total = int(0)
    ahead = int(blocks.cstart[b, lane])
    end_ahead = int(blocks.cstart[b, lane + 1])
    for q in range(CELL_LANES // lane_count()):
        c = q * lane_count() + lane
        first = int(ahead)
        n = end_ahead - first
        ahead = blocks.cstart[b, (c + lane_count()) & (CELL_LANES - 1)]
        end_ahead = blocks.cstart[b, ((c + lane_count()) & (CELL_LANES - 1)) + 1]
        limit = _highest(ground.bounds, near, c, constants.h, far)
        n = wp.where(limit >= real(0.5), n, 0)
        sums = sum_before(n)
        wp.tile_scatter_masked(limits, c, limit, True)
        wp.tile_scatter_masked(starts, c, total + sums[0], True)
        wp.tile_scatter_masked(places, c, first - total - sums[0], True)
        total += sums[1]
    wp.tile_scatter_masked(starts, CELL_LANES, total, lane == 0)
    return total


def _queue_low(
    particles: ParticleGroup, queue: Tile, end: int, first: int, total: int, starts: Tile, places: Tile, limits: Tile,
    lane: int,
):  # fmt: skip
    """Queue the low particles among the next 4 x 32 from number ``first`` on, with their cells; returns the end of the queue.

    A lane tests four of them, so that four loads overlap.
    """
    lanes = lane_count()
    cells = wp.vec4i()
    listed = wp.vec4i()
    low = wp.vec4i()
    for q in range(4):
        n = wp.min(first + q * lanes + lane, total - 1)
        cells[q] = _cell_of(starts, n)
        listed[q] = particles.order[places[cells[q]] + n] & NOT_NEGATIVE
    for q in range(4):
        low[q] = wp.where(particles.rec[OFFSET + 2, listed[q]] <= limits[cells[q]], 1, 0)
    for q in range(4):
        hit = low[q] != 0 and first + q * lanes + lane < total
        hits = hits_before(hit)
        wp.tile_scatter_masked(queue, (end + hits[0]) & (QUEUED - 1), wp.vec2i(listed[q], cells[q]), hit)
        end += hits[1]
    return end


def _search(place: int, first: int, lane: int, lasting: Any, far: Any):
    """What a thread knows of the block of cells that it searches."""
    search = Search()
    search.place = place
    search.first = first
    search.lane = lane
    search.lasting = lasting
    search.far = far
    return search


def _keep_touching(
    particles: ParticleGroup, ground: GroundGroup, contacts: ContactGroup, constants: Constants, search: Search, queue: Tile,
    begin: int, end: int, counts: Tile, found: int,
):  # fmt: skip
    """Test queued particles, one a lane, and list those that touch the ground behind the ``found`` ones; returns their new number.

    ``counts`` are those of each cell.
    """
    n = begin + search.lane
    c = int(0)
    p = int(0)
    hit = bool(False)
    f = vec(real(0.0), real(0.0), real(0.0))
    if n < end:
        queued = queue[n & (QUEUED - 1)]
        p = queued[0] & NOT_NEGATIVE
        c = queued[1] & (CELL_LANES - 1)
        f = vec(particles.rec[OFFSET, p], particles.rec[OFFSET + 1, p], particles.rec[OFFSET + 2, p])
        size = particles.radius[p]
        normal, gap = _ground(_around(ground.tiles, search.place, c), c & 3, f, size, constants.h)
        hit = in_contact(gap, real(0.0), search.lasting, constants.band)
        if not hit and gap + size <= search.far:  # most touch as they are, or are too far: their velocity is not read
            momentum = vec(particles.rec[MOMENTUM, p], particles.rec[MOMENTUM + 1, p], particles.rec[MOMENTUM + 2, p])
            approach = dot(momentum, normal) / particles.rec[MASS, p]
            hit = in_contact(gap, approach, search.lasting, constants.band)
    hits = hits_before(hit)
    if hit:
        contacts.pressed[search.first + found + hits[0]] = p
    wp.tile_scatter_add(counts, c, 1, hit, True)
    return found + hits[1]


def _note_starts(contacts: ContactGroup, starts: Tile, begin: int, b: int, lane: int):
    """Store where the cells start in the list of particles in contact."""
    for c in range(lane, CELL_LANES, lane_count()):
        contacts.pressed_start[b, c + 1] = begin + starts[c + 1]
    if lane == 0:
        contacts.pressed_start[b, 0] = begin


def _load_given(
    particles: ParticleGroup, contacts: ContactGroup, scenes: SceneGroup, constants: Constants, surface: Surface, pushes: Tile,
    offsets: Tile, begin: int, end: int, lane: int, stamp: Any, dt: Any,
):  # fmt: skip
    """Hold impulses by the forces of the step before, and offsets, of up to HELD particles of the list."""
    for q in range((end - begin + lane_count() - 1) // lane_count()):
        n = q * lane_count() + lane
        p = contacts.pressed[wp.min(begin + n, end - 1)] & NOT_NEGATIVE
        f = vec(particles.rec[OFFSET, p], particles.rec[OFFSET + 1, p], particles.rec[OFFSET + 2, p])
        _hold(pushes, offsets, n, _given(particles, scenes, constants, surface, p, stamp, dt), f, begin + n < end)


def _give_share(grid: GridGroup, contacts: ContactGroup, tile: Tile, bases: Tile, near_bases: Tile, u: int, q: int):
    """Add the sum of weights and the impulse at node ``q`` of piece ``u`` of the tile to the node of the grid."""
    piece = _piece(u, q)
    s = tile[wp.max(piece[2], 0)]
    if piece[2] >= 0 and s[0] != real(0.0):
        wp.atomic_add(contacts.shares, near_bases[piece[0]] + piece[1], s[0])
        if s[1] != real(0.0) or s[2] != real(0.0) or s[3] != real(0.0):
            push = node4(real(0.0), s[1], s[2], s[3])
            add_node(grid.nodes, bases[piece[0]] + piece[1], push)
            begun = _place_of_begun(contacts, near_bases[piece[0]] // SLOT)
            if begun >= 0:
                add_node(contacts.memory, begun + piece[1], push)


def _give_shares(grid: GridGroup, contacts: ContactGroup, tile: Tile, bases: Tile, near_bases: Tile, b: int, lane: int):
    """The same for all nodes, and sums over columns of nodes; for sums in fixed order to the arena of the block."""
    if ORDERED:
        for t in range(lane, TILE, lane_count()):
            grid.arenas[b * TILE + t] = tile[t]
    else:
        for q in range(lane, PIECE, lane_count()):
            for u in range(3):
                _give_share(grid, contacts, tile, bases, near_bases, u, q)
                _give_share(grid, contacts, tile, bases, near_bases, u + 3, q)
            _give_share(grid, contacts, tile, bases, near_bases, 6, q)
    if AREAS_AT_ONCE:
        _give_weights(contacts, tile, bases, lane)


def _give_listed(
    particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, contacts: ContactGroup, scenes: SceneGroup,
    constants: Constants, surface: Surface, tile: Tile, bases: Tile, starts: Tile, counts: Tile, b: int, place: int, first: int,
    found: int, lane: int, stamp: Any,
):  # fmt: skip
    """Note where the cells of a block start in the list of its ``found`` contacts, and add their weights to the nodes.

    Impulses by the forces of the step with this stamp are added to the momentum of the nodes.
    """
    filled = wp.tile_empty(shape=CELL_LANES, dtype=wp.uint8, storage="shared")
    near_bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
    pushes = wp.tile_empty(shape=HELD, dtype=node4, storage="shared")
    offsets = wp.tile_empty(shape=HELD_REST, dtype=real, storage="shared")
    many = _number(starts, filled, counts, lane)
    _note_starts(contacts, starts, first, b, lane)
    _set_all_bases(bases, blocks, contacts, b, lane)
    _set_near_bases(near_bases, ground.near_up, place, lane)
    _clear(tile, node4(), lane)
    dt = scenes.clock[_scene_of(blocks, scenes, b), 0]
    for base in range(0, found, HELD):
        wp.tile_zeros(shape=1, dtype=int, storage="shared")  # waits for lanes still at those before
        last = wp.min(first + found, first + base + HELD)
        _load_given(particles, contacts, scenes, constants, surface, pushes, offsets, first + base, last, lane, stamp, dt)
        _spread_all(tile, pushes, offsets, starts, filled, many, base, lane, True)
    _give_shares(grid, contacts, tile, bases, near_bases, b, lane)


def find_contacts(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup,
    contacts: ContactGroup, scenes: SceneGroup, constants: Constants,
):  # fmt: skip
    """List the particles that touch the ground by cell, and add their weights to the nodes.

    Impulses by the forces of the step before are added to the momentum of the nodes.
    """
    place, lane = wp.tid()
    place, lane = own_block(place), own_lane(lane)
    b = int(ground.standing[place])
    if status.flags[HALT] != 0 or b < 0:
        return
    s = _scene_of(blocks, scenes, b)
    if scenes.clock[s, 0] > real(0.0):
        starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
        counts = wp.tile_zeros(shape=CELL_LANES, dtype=int, storage="shared")
        places = wp.tile_empty(shape=CELL_LANES, dtype=int, storage="shared")
        limits = wp.tile_empty(shape=CELL_LANES, dtype=real, storage="shared")
        queue = wp.tile_empty(shape=QUEUED, dtype=wp.vec2i, storage="shared")
        first = int(blocks.cstart[b, 0])
        lasting = scenes.clock[s, LASTING]
        far = _farthest(blocks, contacts, constants, b, lane, lasting, scenes.clock[s, 4])
        total = _number_listed(blocks, ground, constants, starts, places, limits, b, lane, place, far)
        search = _search(place, first, lane, lasting, far)
        found = int(0)
        head = int(0)
        end = int(0)
        for n in range(0, total, 4 * lane_count()):  # the list of those that touch may be the same memory: it stays behind
            end = _queue_low(particles, queue, end, n, total, starts, places, limits, lane)
            least = wp.where(n + 4 * lane_count() < total, lane_count(), 1)
            while end - head >= least:
                found = _keep_touching(particles, ground, contacts, constants, search, queue, head, end, counts, found)
                head = wp.min(head + lane_count(), end)
        if found > 0:
            turn = int(0)
            if lane == 0:
                turn = take_place(status.tally, TOUCHED)  # all blocks take one: needed only at the end, so that none waits
                contacts.touching[b] = found
                wp.atomic_add(status.contacts, s, found)
            bases = wp.tile_empty(shape=BASES, dtype=int, storage="shared")
            tile = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")
            _give_listed(
                particles, blocks, grid, ground, contacts, scenes, constants, ground, tile, bases, starts, counts, b, place, first,
                found, lane, real((scenes.step_counts[s] - 1) & STAMPS),
            )  # fmt: skip
            if lane == 0:
                contacts.touched[turn, 0] = b
                contacts.touched[turn, 1] = place
