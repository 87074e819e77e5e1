"""Which particles touch the ground, and the sum of their weights at the nodes.

A block first drops columns of cells that lie too high, then particles, by their height alone, and measures what is left.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_solution import HELD, HELD_TWICE, _around, _clear, _given, _ground, _hold, _number
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
    TILE,
    TOUCHED,
    Halves,
    Ints,
    Nodes,
    Real,
    Reals,
    Rows,
    Table2,
    Tile,
    Vector,
    add_node,
    lane_count,
    node4,
    own_block,
    own_lane,
    sums9,
)
from runout.backends.hash.stencil import _cell_of, _first_node, _piece, _scene_of, _set_bases, _set_near_bases
from runout.physics.bspline import weights
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


def _farthest(approach_speeds: Reals, around: Table2, b: int, lane: int, largest: Any, dt: Any, band: Any, of_all: Any):
    """Distance [m] beyond which no particle of a block is in contact: by the fastest that may be here, ``of_all`` at most.

    Its velocity is a mean of those of nodes in the block and in the 26 around it, so that it falls no faster than they do.
    """
    fastest = real(0.0)
    for q in range((NEIGHBOURS + lane_count() - 1) // lane_count()):
        k = q * lane_count() + lane
        if k < NEIGHBOURS:
            other = around[b, k]
            if other >= 0:
                both = pair_at(approach_speeds, 2 * other)
                fastest = wp.max(fastest, wp.max(both[0], both[1]))
    return wp.min(of_all, reach(largest, max_lanes(fastest), dt, band))


def _highest(bounds: Halves, near: int, c: int, h: Vector, far: Any):
    """Largest offset in a cell at which a particle may be within ``far`` [m] of the ground."""
    column = 2 * ((c >> 2) & 15)
    return real(bounds[near, column]) - real(c & 3) + height_at(far, real(bounds[near, column + 1])) / h[2]


def _number_listed(
    starts: Tile, places: Tile, limits: Tile, cstart: Table2, b: int, lane: int, bounds: Halves, near: int, h: Vector, far: Any
):
    """Number of the first particle of each cell among those of a block that may touch the ground, and of all.

    Add its number to that of ``places`` for its cell and get a particle's place in the list. At offsets above ``limits`` none of a
    cell touches; the lowest is a half.
    """
    total = int(0)
    ahead = int(cstart[b, lane])
    end_ahead = int(cstart[b, lane + 1])
    for q in range(CELL_LANES // lane_count()):
        c = q * lane_count() + lane
        first = int(ahead)
        n = end_ahead - first
        ahead = cstart[b, (c + lane_count()) & (CELL_LANES - 1)]
        end_ahead = cstart[b, ((c + lane_count()) & (CELL_LANES - 1)) + 1]
        limit = _highest(bounds, near, c, h, far)
        n = wp.where(limit >= real(0.5), n, 0)
        sums = sum_before(n)
        wp.tile_scatter_masked(limits, c, limit, True)
        wp.tile_scatter_masked(starts, c, total + sums[0], True)
        wp.tile_scatter_masked(places, c, first - total - sums[0], True)
        total += sums[1]
    wp.tile_scatter_masked(starts, CELL_LANES, total, lane == 0)
    return total


def _queue_low(
    queue: Tile, end: int, first: int, total: int, starts: Tile, places: Tile, limits: Tile, rec: Rows, order: Ints, lane: int
):
    """Queue those of the listed particles from number ``first`` on that lie low enough, with their cells; returns its new end.

    A lane has four of them, which wait for memory together.
    """
    lanes = lane_count()
    cells = wp.vec4i()
    listed = wp.vec4i()
    low = wp.vec4i()
    for q in range(4):
        n = wp.min(first + q * lanes + lane, total - 1)
        cells[q] = _cell_of(starts, n)
        listed[q] = order[places[cells[q]] + n] & NOT_NEGATIVE
    for q in range(4):
        low[q] = wp.where(rec[OFFSET + 2, listed[q]] <= limits[cells[q]], 1, 0)
    for q in range(4):
        hit = low[q] != 0 and first + q * lanes + lane < total
        hits = hits_before(hit)
        wp.tile_scatter_masked(queue, (end + hits[0]) & (QUEUED - 1), wp.vec2i(listed[q], cells[q]), hit)
        end += hits[1]
    return end


def _keep_touching(
    queue: Tile, begin: int, end: int, counts: Tile, found: int, rec: Rows, radius: Reals, lane: int, tiles: Rows,
    near: int, h: Vector, dt: Any, band: Any, far: Any, pressed: Ints, pressed_begin: int,
):  # fmt: skip
    """List those that touch the ground of particles in a queue, one a lane; ``found`` before. Returns how many are found then.

    ``counts`` are told how many a cell has.
    """
    n = begin + lane
    c = int(0)
    p = int(0)
    hit = bool(False)
    f = vec(real(0.0), real(0.0), real(0.0))
    if n < end:
        queued = queue[n & (QUEUED - 1)]
        p = queued[0] & NOT_NEGATIVE
        c = queued[1] & (CELL_LANES - 1)
        f = vec(rec[OFFSET, p], rec[OFFSET + 1, p], rec[OFFSET + 2, p])
        size = radius[p]
        normal, gap = _ground(_around(tiles, near, c), c & 3, f, size, h)
        hit = in_contact(gap, real(0.0), dt, band)
        if not hit and gap + size <= far:  # most touch as they are, or are too far: their velocity is not read
            approach = dot(vec(rec[MOMENTUM, p], rec[MOMENTUM + 1, p], rec[MOMENTUM + 2, p]), normal) / rec[MASS, p]
            hit = in_contact(gap, approach, dt, band)
    hits = hits_before(hit)
    if hit:
        pressed[pressed_begin + found + hits[0]] = p
    wp.tile_scatter_add(counts, c, 1, hit, True)
    return found + hits[1]


def _note_starts(starts: Tile, pressed_start: Table2, begin: int, b: int, lane: int):
    """Where the particles of each cell that touch the ground start in their list."""
    for c in range(lane, CELL_LANES, lane_count()):
        pressed_start[b, c + 1] = begin + starts[c + 1]
    if lane == 0:
        pressed_start[b, 0] = begin


def _load_given(
    pushes: Tile, offsets: Tile, rec: Rows, number: Ints, forces: Nodes, pressed: Ints, begin: int, end: int, lane: int,
    stamp: Any, dt: Any,
):  # fmt: skip
    """Impulses by the forces of the step before, and offsets, of the particles at some places of the list: HELD at most."""
    for q in range((end - begin + lane_count() - 1) // lane_count()):
        n = q * lane_count() + lane
        p = pressed[wp.min(begin + n, end - 1)] & NOT_NEGATIVE
        f = vec(rec[OFFSET, p], rec[OFFSET + 1, p], rec[OFFSET + 2, p])
        _hold(pushes, offsets, n, _given(forces, number[p], stamp, dt), f, begin + n < end)


def _add_shares(tile: Tile, pushes: Tile, offsets: Tile, starts: Tile, c: int, base: int, mine: bool):
    """Weights of the contact particles of a cell, and their given impulses, to its 27 nodes, nine at a time."""
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
                for k in range(3):
                    w = share * wz[k]
                    acc[j * 3 + k, 0] += w
                    for d in range(3):
                        acc[j * 3 + k, d + 1] += w * push[d]
        for j in range(3):
            for k in range(3):
                s = node4(acc[j * 3 + k, 0], acc[j * 3 + k, 1], acc[j * 3 + k, 2], acc[j * 3 + k, 3])
                wp.tile_scatter_add(tile, first + (i * 6 + j) * 6 + k, s, mine, False)


def _give_share(tile: Tile, shares: Reals, grid: Nodes, bases: Tile, near_bases: Tile, u: int, q: int):
    """Sum of weights and impulse at a node of the tile, number ``q`` of its piece ``u``, to the node of the grid."""
    piece = _piece(u, q)
    s = tile[wp.max(piece[2], 0)]
    if piece[2] >= 0 and s[0] != real(0.0):
        wp.atomic_add(shares, near_bases[piece[0]] + piece[1], s[0])
        if s[1] != real(0.0) or s[2] != real(0.0) or s[3] != real(0.0):
            add_node(grid, bases[piece[0]] + piece[1], node4(real(0.0), s[1], s[2], s[3]))


def _give_shares(tile: Tile, arenas: Nodes, shares: Reals, grid: Nodes, bases: Tile, near_bases: Tile, b: int, lane: int):
    """The same for all nodes; for sums in fixed order to the arena of the block."""
    if ORDERED:
        for t in range(lane, TILE, lane_count()):
            arenas[b * TILE + t] = tile[t]
    else:
        for q in range(lane, PIECE, lane_count()):
            for u in range(3):
                _give_share(tile, shares, grid, bases, near_bases, u, q)
                _give_share(tile, shares, grid, bases, near_bases, u + 3, q)
            _give_share(tile, shares, grid, bases, near_bases, 6, q)


def find_contacts(
    rec: Rows, radius: Reals, order: Ints, cstart: Table2, flags: Ints, tally: Ints, standing: Ints, member: Ints,
    clock: Rows, tiles: Rows, bounds: Halves, h: Vector, band: Real, largest: Real, around: Table2, approach_speeds: Reals,
    touching: Ints, touched: Table2, contacts: Ints, near_up: Table2, shares: Reals, arenas: Nodes, pressed: Ints,
    pressed_start: Table2, number: Ints, forces: Nodes, up: Table2, step_counts: Ints, grid: Nodes,
):  # fmt: skip
    """Which particles touch the ground, and the sum of their weights at the nodes.

    They are listed by cell. ``shares`` are those sums. Impulses by the forces of the step before go to the momentum of the nodes.
    """
    place, lane = wp.tid()
    place, lane = own_block(place), own_lane(lane)
    b = int(standing[place])
    if flags[HALT] != 0 or b < 0:
        return
    s = _scene_of(member, b, clock)
    if clock[s, 0] > real(0.0):
        starts = wp.tile_empty(shape=STARTS, dtype=int, storage="shared")
        counts = wp.tile_zeros(shape=CELL_LANES, dtype=int, storage="shared")
        filled = wp.tile_empty(shape=CELL_LANES, dtype=wp.uint8, storage="shared")
        places = wp.tile_empty(shape=CELL_LANES, dtype=int, storage="shared")
        limits = wp.tile_empty(shape=CELL_LANES, dtype=real, storage="shared")
        queue = wp.tile_empty(shape=QUEUED, dtype=wp.vec2i, storage="shared")
        first = int(cstart[b, 0])
        far = _farthest(approach_speeds, around, b, lane, largest, clock[s, 0], band, clock[s, 4])
        total = _number_listed(starts, places, limits, cstart, b, lane, bounds, place, h, far)
        found = int(0)
        head = int(0)
        end = int(0)
        for n in range(0, total, 4 * lane_count()):  # the list of those that touch may be the same memory: it stays behind
            end = _queue_low(queue, end, n, total, starts, places, limits, rec, order, lane)
            least = wp.where(n + 4 * lane_count() < total, lane_count(), 1)
            while end - head >= least:
                found = _keep_touching(
                    queue, head, end, counts, found, rec, radius, lane, tiles, place, h, clock[s, 0], band,
                    far, pressed, first,
                )  # fmt: skip
                head = wp.min(head + lane_count(), end)
        if found > 0:
            many = _number(starts, filled, counts, lane)
            _note_starts(starts, pressed_start, first, b, lane)
            turn = int(0)
            if lane == 0:
                turn = take_place(tally, TOUCHED)  # all blocks take one: needed only at the end, so that none waits
                touching[b] = found
                wp.atomic_add(contacts, s, found)
            bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
            near_bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
            tile = wp.tile_empty(shape=TILE, dtype=node4, storage="shared")
            pushes = wp.tile_empty(shape=HELD, dtype=node4, storage="shared")
            offsets = wp.tile_empty(shape=HELD_TWICE, dtype=real, storage="shared")
            _set_bases(bases, up, b, lane)
            _set_near_bases(near_bases, near_up, place, lane)
            _clear(tile, node4(), lane)
            stamp = real((step_counts[s] - 1) & STAMPS)
            for base in range(0, found, HELD):
                wp.tile_zeros(shape=1, dtype=int, storage="shared")  # waits for lanes still at those before
                last = wp.min(first + found, first + base + HELD)
                _load_given(pushes, offsets, rec, number, forces, pressed, first + base, last, lane, stamp, clock[s, 0])
                for turns in range((many + lane_count() - 1) // lane_count()):
                    mine = turns * lane_count() + lane
                    _add_shares(tile, pushes, offsets, starts, int(filled[wp.min(mine, many - 1)]), base, mine < many)
            _give_shares(tile, arenas, shares, grid, bases, near_bases, b, lane)
            if lane == 0:
                touched[turn, 0] = b
                touched[turn, 1] = place
