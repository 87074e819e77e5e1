"""Contact with the ground: finding the particles that touch it, and their weights at the nodes. See :mod:`runout.physics.contact`.

Only particles under a bound of the ground's surface are measured: the candidates, which are listed while arenas are filled. Those
that touch get a row of contacts each. The rows of a *strip* of owners lie one after the other, whichever block they belong to, so
that vectors are full, in the region of the thread that found them; those of block b start at ``place[b]``. Row r has

    contacts[r]                     cell in the block | fx | fy | fz
    measured[r // 16, :, r % 16]    unit normal (3), gap [m], friction, velocity before the step (3) [m/s]
    felt[r]                         compliance [1/kg] and velocity [m/s] that the grid would give, then 0 and the impulse's change
    given[r]                        0 and the impulse [N s] that the nodes hold from the start, then work [J] and impulse [N s]
"""

import numpy as np
from numba import prange

from runout.backends.lanes import (
    constant,
    listed_record_vectors,
    load4,
    local_array,
    prefetch,
    record_vectors,
    row_vectors,
    store,
)
from runout.backends.scan.ground import _ground
from runout.backends.scan.particles_to_grid import (
    PLANE_OF_SHARES,
    ROW_OF_SHARES,
    ROWS,
    SHARED,
    SHARES,
    TAKEN,
    TOUCH,
    _expect_next,
    _fill_arena,
    _leave_arenas,
    _most_of,
    _octant,
    _parts_of,
    _reached_parts,
    _start,
    _strip_of,
    _take_arena,
    _update_block_over_ground,
)
from runout.backends.scan.schedule import STRIP
from runout.backends.scan.stencil import ARENA, _add_weighted, _first_node, _place_of, _weigh_four, local_weights, zeros
from runout.physics.contact import in_contact
from runout.physics.moments import momentum_at
from runout.physics.tensors import real, vec

TILE = 64
ASIDE = 16  # first row of a tile of candidates behind their records
FLOOR, RADIUS, OWN_FRICTION = 19, 23, 24
TOUCHES, FX, FY, FZ = 0, 4, 8, 12
NORMAL, GAP, FRICTION, BEFORE = 0, 3, 4, 5  # rows of what is measured
MEASURED = (1, 2, 3, 5, 6, 7, 9, 10)  # rows of a tile that hold it
local_tile = local_array((32, TILE))
local_aside = local_array((16 * TILE,))
local_list = local_array((TILE,))
load_listed = listed_record_vectors(16)
load_beside, _ = record_vectors(16)
_, store_16_rows = row_vectors(16, TILE)
three_ones = constant([1.0, 1.0, 1.0, 0.0])


def _list_candidates(slots, blocks, rec, listed, first, candidates, b, k, n):
    """Slots and blocks of the next ``n`` candidates from number ``k`` of block ``b`` on; returns what comes next.

    The last one fills the last vector. Their records are asked for.
    """
    for q in range(n):
        while k == candidates[b]:
            b += 1
            k = 0
        p = np.int64(listed[first[b] + k])
        k += 1
        slots[q] = p
        blocks[q] = b
        prefetch(rec, 16 * p)
    for q in range(n, (n + 15) & ~15):
        slots[q] = slots[n - 1]
    return b, k


def _take_candidates(aside, slots, blocks, cell, particle_index, radius, label, tiles, friction, force, n):
    """What the records of candidates do not hold: ground in their columns of cells, level, size and friction."""
    for q in range(n):
        prefetch(force, 4 * np.int64(particle_index[slots[q]]))
    if len(radius) > 1:
        for q in range(n):
            prefetch(radius, particle_index[slots[q]])
    for q in range(n):
        p = slots[q]
        c = np.int64(cell[p])
        o = 36 * np.int64(blocks[q]) + (c >> 4) * 6 + ((c >> 2) & 3)
        r = 16 * q
        store(aside, r, load4(tiles, o))
        store(aside, r + 4, load4(tiles, o + 6))
        store(aside, r + 8, load4(tiles, o + 11))
        aside[r + 3] = real(c & 3)
        aside[r + 7] = radius[particle_index[p]] if len(radius) > 1 else radius[0]
        aside[r + 8] = friction[label[particle_index[p], 0]] if len(friction) > 1 else friction[0]


def _load_candidates(t, rec, aside, slots, groups):
    """Records of listed particles, and what they do not hold, as columns of a tile."""
    for g in range(groups):
        store_16_rows(t, 16 * g, load_listed(rec, slots, 16 * g))
        store_16_rows(t, ASIDE * TILE + 16 * g, load_beside(aside, 256 * g))


def _coefficients(t, q):
    return (
        t[ASIDE, q], t[ASIDE + 1, q], t[ASIDE + 2, q],
        t[ASIDE + 4, q], t[ASIDE + 5, q], t[ASIDE + 6, q],
        t[ASIDE + 9, q], t[ASIDE + 10, q], t[ASIDE + 11, q],
    )  # fmt: skip


def _momentum(t, q):
    """Momentum [kg m/s] of a particle from its record: that at the middle node, and its slopes."""
    return momentum_at(
        vec(t[1, q], t[2, q], t[3, q]),
        vec(t[5, q], t[6, q], t[7, q]),
        vec(t[9, q], t[10, q], t[11, q]),
        vec(t[13, q], t[14, q], t[15, q]),
        vec(t[4, q] - real(1.0), t[8, q] - real(1.0), t[12, q] - real(1.0)),
    )


def _measure(t, n, east, north, dz, dt, band):
    """Whether each column of a tile touches, in row TOUCHES, and what is MEASURED."""
    for q in range(n):
        z = t[FLOOR, q] + t[12, q]
        nx, ny, nz, gap = _ground(_coefficients(t, q), t[4, q], t[8, q], z, t[RADIUS, q], east, north, dz)
        m = real(1.0) / t[0, q]
        px, py, pz = _momentum(t, q)
        vx = px * m
        vy = py * m
        vz = pz * m
        t[TOUCHES, q] = real(1.0) if in_contact(gap, vx * nx + vy * ny + vz * nz, dt, band) else real(0.0)
        t[1, q] = nx
        t[2, q] = ny
        t[3, q] = nz
        t[5, q] = gap
        t[6, q] = t[OWN_FRICTION, q]
        t[7, q] = vx
        t[9, q] = vy
        t[10, q] = vz


def _take_force(given, row, force, w, last, dt):
    """Impulse from which a contact starts: by the force of the step with the stamp ``last``, none if it did not touch then."""
    lasting = dt if force[w, 0] == last else real(0.0)
    given[row, 0] = real(0.0)
    for k in range(1, 4):
        given[row, k] = lasting * force[w, k]


def _keep_touching(
    t, n, slots, blocks, cell, particle_index, force, last, dt, listed, first, contacts, measured, given, row, touching
):
    """Rows from ``row`` on for those of ``n`` candidates that touch; returns what comes next.

    Each writes its row, and the next one writes over it unless it touches: no processor could guess which do.
    """
    for q in range(n):
        p = slots[q]
        b = np.int64(blocks[q])
        contacts[row, 0] = real(cell[p])
        contacts[row, 1] = t[FX, q]
        contacts[row, 2] = t[FY, q]
        contacts[row, 3] = t[FZ, q]
        for k, m in enumerate(MEASURED):
            measured[row >> 4, k, row & 15] = t[m, q]
        _take_force(given, row, force, np.int64(particle_index[p]), last, dt)
        listed[first[b] + touching[b]] = p
        touches = np.int64(t[TOUCHES, q])
        touching[b] += touches
        row += touches
    return row


def _call_up(tiles, planes, cell, b, f, held):
    """Ask for what the contacts of a block need besides its records, while its arena is filled."""
    for o in range(0, 36, 16):
        prefetch(tiles, 36 * b + o)
    for o in range(0, 48, 16):
        prefetch(planes, 48 * b + o)
    for p in range(f, f + held, 64):
        prefetch(cell, p)


def _expect(contacts, measured, given, shares, row, rows, share, blocks):
    """Ask for the memory that the rows of a strip and the shares of its blocks will be written to."""
    for r in range(row, row + rows, 16):
        for o in range(0, 64, 16):
            prefetch(contacts, 4 * r + o)
            prefetch(given, 4 * r + o)
        for o in range(0, 128, 16):
            prefetch(measured, 8 * r + o)
    for o in range(SHARES * share, SHARES * (share + blocks), 16):
        prefetch(shares, o)


def _share_block(shares, base, contacts, given, begins, arenas, a, ready, row, n):
    """Fill an arena with one number a node with the weights of the contacts of a block; returns the parts that they reach.

    If the contact ``begins`` here, the impulses ``given`` are added to the momentum in the arena at place ``a``. The weights of the
    first contact are ``ready``, and at the end those of the row behind the last.
    """
    for o in range(base, base + SHARES - 8, 16):
        store(shares, o, zeros(shares))
    octants = 0
    for r in range(np.uint64(row), np.uint64(row + n)):
        _weigh_four(contacts, (r + np.uint64(1)) * np.uint64(4), ready, _place_of(r + np.uint64(1)))
        w = _place_of(r)
        c = np.int64(contacts[r, 0])
        octants |= 1 << _octant(c)
        o = base + (c >> 4) * PLANE_OF_SHARES + ((c >> 2) & 3) * ROW_OF_SHARES + (c & 3)
        z = load4(ready, w + np.uint64(12)) * three_ones(ready)
        for i in range(3):
            x = ready[w + np.uint64(4 + i)] * z
            for j in range(3):
                s = o + i * PLANE_OF_SHARES + j * ROW_OF_SHARES
                store(shares, s, load4(shares, s) + ready[w + np.uint64(8 + j)] * x)
        if begins:
            _add_weighted(arenas, a + _first_node(c), ready, w, load4(given, r * np.uint64(4)))
    return _parts_of(octants)


def _measure_strip(
    rec, particle_index, radius, label, cell, first, tiles, friction, force, last, dt, h, band, listed, candidates, contacts,
    measured, given, touching, low, total, row,
):  # fmt: skip
    """Rows from ``row`` on of those of the ``total`` candidates of the blocks from ``low`` on that touch."""
    t = local_tile(rec)
    aside = local_aside(rec)
    slots = local_list(listed)
    blocks = local_list(listed)
    b = low
    k = 0
    for done in range(0, total, TILE):
        n = min(TILE, total - done)
        groups = (n + 15) >> 4
        b, k = _list_candidates(slots, blocks, rec, listed, first, candidates, b, k, n)
        _take_candidates(aside, slots, blocks, cell, particle_index, radius, label, tiles, friction, force, n)
        _load_candidates(t, rec, aside, slots, groups)
        _measure(t, np.uint64(16 * groups), h[2] / h[0], h[2] / h[1], h[2], dt, band)
        row = _keep_touching(
            t, n, slots, blocks, cell, particle_index, force, last, dt, listed, first, contacts, measured, given, row, touching
        )


def _fill_strip(
    rec, cell, order, starts, first, giving, tiles, planes, bounds, reach, h, number, arenas, capacity, free, cursors, thread,
    reached, listed, candidates, touching, pressed, low, end, nown,
):  # fmt: skip
    """Fill the arenas of the owners ``low`` to ``end``; returns how many candidates there are, and in how many blocks."""
    total = 0
    blocks = 0
    for b in range(low, end):
        candidates[b] = touching[b] = 0
        reached[b] = pressed[b] = 0
        if giving[b] > 0:
            cut = reach / (bounds[b, 1] * h[2])
            near = real(0.5) - bounds[b, 0] <= cut
            if near:
                _call_up(tiles, planes, cell, b, first[b], giving[b])
            reached[b] = _reached_parts(starts, b)
            number[b] = _take_arena(cursors, thread, capacity, free)
            _expect_next(rec, order, starts, first, giving, bounds, b, nown)
            a = ARENA * np.int64(number[b])
            candidates[b] = _fill_arena(rec, order, starts, first, b, reached[b], arenas, a, near, planes, cut, listed)
            total += candidates[b]
            blocks += candidates[b] > 0
    return total, blocks


def _keep_room(cursors, thread, total, blocks, rows, places):
    """First row and share of a strip, and whether there is room for all that may touch."""
    row = cursors[thread, ROWS]
    share = cursors[thread, SHARED]
    cursors[thread, ROWS] += (total + 15) & ~15
    cursors[thread, SHARED] += blocks
    fits = cursors[thread, ROWS] <= rows and cursors[thread, SHARED] <= places
    return row + thread * rows, share + thread * places, fits


def _share_strip(contacts, given, begins, number, arenas, shares, row, share, low, end, touching, place, sharer, pressed):
    """Weights of the contacts of a strip at the nodes, and their impulses; returns what comes behind the last row and share."""
    ready = local_weights(contacts)
    _weigh_four(contacts, np.uint64(4 * row), ready, _place_of(np.uint64(row)))
    for b in range(low, end):
        place[b] = row
        if touching[b] > 0:
            sharer[b] = share
            a = ARENA * np.int64(number[b])
            pressed[b] = _share_block(shares, SHARES * share, contacts, given, begins, arenas, a, ready, row, touching[b])
            row += touching[b]
            share += 1
    return row, share


def particles_to_nodes_over_ground(
    rec, particle_index, radius, label, cell, order, starts, first, giving, nown, cuts, due, nodes, over, owners, tiles, planes,
    bounds, friction, force, last, begins, reach, dt, h, band, number, arenas, capacity, free, cursors, reached, listed,
    candidates, touching, pressed, contacts, measured, given, rows, shares, places, place, sharer, down, grid, shared, inverse, dv,
):  # fmt: skip
    """Fill the arenas, find the particles that touch the ground while a strip is in cache, and sum the nodes that are due.

    ``reach`` [m] is the distance from the ground beyond which no centre of a particle can touch; ``radius`` has one number where
    all are the same; ``force`` (n, 4) holds forces of the ground behind the stamps of their steps. If the contact ``begins`` here,
    the impulses by the forces of the ``last`` step go to the nodes with the momentum; else :func:`begin_contacts` adds them later.

    Gives the numbers (nown,) of particles that are ``touching``, which are ``listed`` then, the sums of their weights over the
    nodes of each block, its ``shares``, and the parts of these that are ``pressed``. Each thread has ``capacity`` for arenas,
    ``rows`` of contacts and ``places`` for shares, and counts in ``cursors`` (threads, 8) those that it needs, and what touches;
    where one needs more, the result is worth nothing. Returns what a thread needs of each, and the number of those that touch.
    With no owners, ``nown`` = 0, nodes are summed alone.
    """
    _start(cursors)
    for thread in prange(len(cuts) - 1):
        for s in range(_strip_of(cuts[thread]), _strip_of(cuts[thread + 1])):
            low = STRIP * s
            end = min(low + STRIP, nown)
            total, blocks = _fill_strip(
                rec, cell, order, starts, first, giving, tiles, planes, bounds, reach, h, number, arenas, capacity, free, cursors,
                thread, reached, listed, candidates, touching, pressed, low, end, nown,
            )  # fmt: skip
            row, share, fits = _keep_room(cursors, thread, total, blocks, rows, places)
            if total > 0 and fits:
                _expect(contacts, measured, given, shares, row, total, share, blocks)
                _measure_strip(
                    rec, particle_index, radius, label, cell, first, tiles, friction, force, last, dt, h, band, listed,
                    candidates, contacts, measured, given, touching, low, total, row,
                )  # fmt: skip
                behind, after = _share_strip(
                    contacts, given, begins, number, arenas, shares, row, share, low, end, touching, place, sharer, pressed
                )
                cursors[thread, TOUCH] += behind - row
                cursors[thread, ROWS] = ((behind + 15) & ~15) - thread * rows
                cursors[thread, SHARED] = after - thread * places
            for k in range(due[s], due[s + 1]):
                n = np.int64(nodes[k])
                _update_block_over_ground(arenas, number, reached, shares, sharer, pressed, down, n, grid, shared, inverse, dv)
            _leave_arenas(cursors, thread, free, s, over, owners, giving, number)
    total = 0
    for t in range(len(cursors)):
        total += cursors[t, TOUCH]
    return _most_of(cursors, TAKEN), _most_of(cursors, ROWS), _most_of(cursors, SHARED), total


def begin_contacts(contacts, given, place, touching, nown, number, arenas):
    """Add the impulses from which contacts start to the momentum in the arenas of their blocks."""
    for b in prange(nown):
        if touching[b] > 0:
            row = np.uint64(place[b])
            ready = local_weights(contacts)
            for r in range(row, row + np.uint64(touching[b])):
                _weigh_four(contacts, r * np.uint64(4), ready, np.uint64(0))
                a = ARENA * np.int64(number[b]) + _first_node(np.int64(contacts[r, 0]))
                _add_weighted(arenas, a, ready, np.uint64(0), load4(given, r * np.uint64(4)))
