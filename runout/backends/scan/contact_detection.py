"""Phase "contact detection": the particles that touch the ground, and their weights at the nodes (:mod:`runout.physics.contact`).

A particle below a bound of the surface of the ground is a candidate; candidates are listed while arenas are filled. They are
measured in tiles of 64, and those that touch get a row each. The rows of a strip of 16 owners follow each other without gaps, in
the part of the arrays that belongs to the thread; the rows of block b start at ``place[b]``.

    rows[r]                         cell in the block | fx | fy | fz
    measured[r // 16, :, r % 16]    nx | ny | nz | gap [m] | friction or row of its record | vx | vy | vz [m/s], before the step
    felt[r]                         compliance [1/kg] | velocity [m/s] that the grid gives; later 0 | change of the impulse
    given[r]                        0, later ground area [m2], then work [J] | impulse [N s], first what the nodes hold already

    thread 0: strip 0 | strip 2 | ...  free rows  |  thread 1: strip 5 | ...  free rows  |

    shares[sharer[b]]               6 x 6 x 6 nodes of block b, one number each: sum of the weights of its contacts
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
from runout.physics.contact import in_contact, started_time
from runout.physics.moments import momentum_at
from runout.physics.substeps import moved_gap
from runout.physics.tensors import real, vec

TILE = 64
ASIDE = 16  # first row of a tile of candidates after those of the records
FLOOR, RADIUS, OWN_FRICTION = 19, 23, 24
STARTS_DIFFER = False  # whether masses differ in the speed up to which contacts start from a force; the binding decides
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


def _list_candidates(slots, owners, rec, listed, first, candidates, b, k, n):
    """List slots and owners of ``n`` candidates from candidate ``k`` of block ``b`` on; returns block and number of the next one.

    The last candidate fills the last vector. The records are prefetched.
    """
    for q in range(n):
        while k == candidates[b]:
            b += 1
            k = 0
        p = np.int64(listed[first[b] + k])
        k += 1
        slots[q] = p
        owners[q] = b
        prefetch(rec, 16 * p)
    for q in range(n, (n + 15) & ~15):
        slots[q] = slots[n - 1]
    return b, k


def _take_candidates(aside, slots, owners, particles, tiles, friction, n):
    """Collect what the records of candidates do not hold: coefficients of the ground, level of the cell, radius and friction."""
    cell, particle_index, radius, label = particles.cell, particles.particle_index, particles.radius, particles.label
    if len(radius) > 1:
        for q in range(n):
            prefetch(radius, particle_index[slots[q]])
    for q in range(n):
        p = slots[q]
        c = np.int64(cell[p])
        o = 36 * np.int64(owners[q]) + (c >> 4) * 6 + ((c >> 2) & 3)
        r = 16 * q
        store(aside, r, load4(tiles, o))
        store(aside, r + 4, load4(tiles, o + 6))
        store(aside, r + 8, load4(tiles, o + 11))
        aside[r + 3] = real(c & 3)
        aside[r + 7] = radius[particle_index[p]] if len(radius) > 1 else radius[0]
        aside[r + 8] = friction[label[particle_index[p], 0]] if len(friction) > 1 else friction[0]


def _load_candidates(t, rec, aside, slots, groups):
    """Transpose the records of listed particles, and what is ``aside``, into the columns of a tile."""
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
    """Fill the rows of a tile with the measurements of each column; row TOUCHES is 1 where the particle touches the ground."""
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


def _look_ahead(t, n, h, ahead):
    """Replace normals and gaps in a tile by those of the ground where particles are after a time ``ahead`` [s].

    The gaps are distances from the tangent planes there. The ground is that of the cell in which a particle begins.
    """
    for q in range(n):
        x = ahead * t[7, q]
        y = ahead * t[9, q]
        z = ahead * t[10, q]
        up = t[FLOOR, q] + t[12, q] + z / h[2]
        fx = t[4, q] + x / h[0]
        fy = t[8, q] + y / h[1]
        nx, ny, nz, gap = _ground(_coefficients(t, q), fx, fy, up, t[RADIUS, q], h[2] / h[0], h[2] / h[1], h[2])
        t[1, q] = nx
        t[2, q] = ny
        t[3, q] = nz
        t[5, q] = moved_gap(gap, vec(nx, ny, nz), vec(-x, -y, -z))


def _fastest_start(search, friction):
    """Speed [m/s] up to which a contact starts from the force of the step before; ``friction`` is what it holds of its law."""
    if STARTS_DIFFER:
        return search.fastest[np.int64(friction)]
    return search.fastest


def _take_force(given, row, force, w, search, v, friction, dt):
    """Set the impulse from which a contact starts: by the force of the step before, 0 if it did not touch then or is too fast."""
    lasting = started_time(v, _fastest_start(search, friction), dt) if force[w, 0] == search.last else real(0.0)
    given[row, 0] = real(0.0)
    for k in range(1, 4):
        given[row, k] = lasting * force[w, k]


def _list_touching(hits, t, n, slots, particles):
    """List the columns, of ``n``, that touch, and prefetch the forces of their particles; returns their number.

    Each candidate is listed, and the next one overwrites it unless the candidate touches. This has no branch, which processors
    could not predict.
    """
    count = np.int64(0)
    for q in range(n):
        hits[count] = q
        count += np.int64(t[TOUCHES, q])
    for k in range(count):
        prefetch(particles.force, 4 * np.int64(particles.particle_index[slots[hits[k]]]))
    return count


def _keep_touching(t, hits, count, slots, owners, particles, first, contacts, search, dt, row):
    """Write rows from ``row`` on for the ``count`` candidates that touch, whose columns are ``hits``; returns the row after."""
    cell, particle_index, listed, force = particles.cell, particles.particle_index, particles.listed, particles.force
    rows, measured, given, touching = contacts.rows, contacts.measured, contacts.given, contacts.touching
    for i in range(count):
        q = np.int64(hits[i])
        p = slots[q]
        b = np.int64(owners[q])
        rows[row, 0] = real(cell[p])
        rows[row, 1] = t[FX, q]
        rows[row, 2] = t[FY, q]
        rows[row, 3] = t[FZ, q]
        for k, m in enumerate(MEASURED):
            measured[row >> 4, k, row & 15] = t[m, q]
        _take_force(given, row, force, np.int64(particle_index[p]), search, vec(t[7, q], t[9, q], t[10, q]), t[6, q], dt)
        listed[first[b] + touching[b]] = p
        touching[b] += 1
        row += 1
    return row


def _call_up(tiles, planes, cell, b, f, held):
    """Prefetch what the contacts of a block need besides its records, while its arena is filled."""
    for o in range(0, 36, 16):
        prefetch(tiles, 36 * b + o)
    for o in range(0, 48, 16):
        prefetch(planes, 48 * b + o)
    for p in range(f, f + held, 64):
        prefetch(cell, p)


def _expect(contacts, row, total, share, owners):
    """Prefetch the memory to which ``total`` rows of a strip from ``row`` on, and the shares of its owners, will be written."""
    for r in range(row, row + total, 16):
        for o in range(0, 64, 16):
            prefetch(contacts.rows, 4 * r + o)
            prefetch(contacts.given, 4 * r + o)
        for o in range(0, 128, 16):
            prefetch(contacts.measured, 8 * r + o)
    for o in range(SHARES * share, SHARES * (share + owners), 16):
        prefetch(contacts.shares, o)


def _share_block(contacts, base, arenas, a, ready, row, n):
    """Sum the weights of the ``n`` contacts of a block at its nodes, in the share from ``base`` on; returns the parts they reach.

    The impulses ``given``, from which contacts start, are added to the momentum in the arena at place ``a``. The weights of the
    first contact are ``ready``; at the end, those of the row after the last.
    """
    shares, rows, given = contacts.shares, contacts.rows, contacts.given
    for o in range(base, base + SHARES - 8, 16):
        store(shares, o, zeros(shares))
    octants = 0
    for r in range(np.uint64(row), np.uint64(row + n)):
        _weigh_four(rows, (r + np.uint64(1)) * np.uint64(4), ready, _place_of(r + np.uint64(1)))
        w = _place_of(r)
        c = np.int64(rows[r, 0])
        octants |= 1 << _octant(c)
        o = base + (c >> 4) * PLANE_OF_SHARES + ((c >> 2) & 3) * ROW_OF_SHARES + (c & 3)
        z = load4(ready, w + np.uint64(12)) * three_ones(ready)
        for i in range(3):
            x = ready[w + np.uint64(4 + i)] * z
            for j in range(3):
                s = o + i * PLANE_OF_SHARES + j * ROW_OF_SHARES
                store(shares, s, load4(shares, s) + ready[w + np.uint64(8 + j)] * x)
        _add_weighted(arenas, a + _first_node(c), ready, w, load4(given, r * np.uint64(4)))
    return _parts_of(octants)


def _measure_strip(particles, first, contacts, tiles, constants, search, dt, low, total, row):
    """Write the contact rows, from ``row`` on, of the candidates that touch: of ``total`` in the owners from ``low`` on."""
    rec, listed, h = particles.rec, particles.listed, constants.h
    t = local_tile(rec)
    aside = local_aside(rec)
    slots = local_list(listed)
    owners = local_list(listed)
    hits = local_list(listed)
    b = low
    k = np.int64(0)
    for done in range(0, total, TILE):
        n = min(TILE, total - done)
        groups = (n + 15) >> 4
        b, k = _list_candidates(slots, owners, rec, listed, first, contacts.candidates, b, k, n)
        _take_candidates(aside, slots, owners, particles, tiles, constants.friction, n)
        _load_candidates(t, rec, aside, slots, groups)
        _measure(t, np.uint64(16 * groups), h[2] / h[0], h[2] / h[1], h[2], search.lasting, search.band)
        if search.ahead > real(0.0):
            _look_ahead(t, np.uint64(16 * groups), h, search.ahead)
        count = _list_touching(hits, t, n, slots, particles)
        row = _keep_touching(t, hits, count, slots, owners, particles, first, contacts, search, dt, row)


def _fill_strip(particles, blocks, arenas, contacts, ground, reach, h, thread, low, end, nown):
    """Fill the arenas of the owners ``low`` to ``end``; returns the number of candidates, and of the owners that have any."""
    rec, order, starts, first, held = particles.rec, particles.order, blocks.starts, blocks.first, blocks.held
    reached, number, bounds, planes = arenas.reached, arenas.number, ground.bounds, ground.planes
    candidates = contacts.candidates
    total = 0
    owners = 0
    for b in range(low, end):
        candidates[b] = contacts.touching[b] = 0
        reached[b] = contacts.pressed[b] = 0
        if held[b] > 0:
            cut = reach / (bounds[b, 1] * h[2])
            near = real(0.5) - bounds[b, 0] <= cut
            if near:
                _call_up(ground.tiles, planes, particles.cell, b, first[b], held[b])
            reached[b] = _reached_parts(starts, b)
            number[b] = _take_arena(arenas.cursors, thread, arenas.free)
            _expect_next(rec, order, starts, first, held, bounds, b, nown)
            a = ARENA * np.int64(number[b])
            n = _fill_arena(rec, order, starts, first, b, reached[b], arenas.values, a, near, planes, cut, particles.listed)
            candidates[b] = n
            total += n
            owners += n > 0
    return total, owners


def _rows_of_thread(contacts, threads):
    """Rows of contacts that each thread has."""
    return (len(contacts.felt) // threads) & ~15


def _shares_of_thread(contacts, threads):
    """Places for shares that each thread has."""
    return max(len(contacts.shares) - 1, 0) // threads


def _keep_room(cursors, thread, total, owners, rows, places):
    """First row and share of a strip, and whether the thread has room for all that may touch."""
    row = cursors[thread, ROWS]
    share = cursors[thread, SHARED]
    cursors[thread, ROWS] += (total + 15) & ~15
    cursors[thread, SHARED] += owners
    fits = cursors[thread, ROWS] <= rows and cursors[thread, SHARED] <= places
    return row + thread * rows, share + thread * places, fits


def _share_strip(contacts, arenas, row, share, low, end):
    """Sum the weights of the contacts of a strip at the nodes, and add their impulses; returns the next free row and share."""
    rows, touching = contacts.rows, contacts.touching
    ready = local_weights(rows)
    _weigh_four(rows, np.uint64(4 * row), ready, _place_of(np.uint64(row)))
    for b in range(low, end):
        contacts.place[b] = row
        if touching[b] > 0:
            contacts.sharer[b] = share
            a = ARENA * np.int64(arenas.number[b])
            contacts.pressed[b] = _share_block(contacts, SHARES * share, arenas.values, a, ready, row, touching[b])
            row += touching[b]
            share += 1
    return row, share


def particles_to_nodes_over_ground(particles, blocks, schedule, arenas, contacts, ground, grid, columns, constants, search, dt):
    """Fill the arenas, find the particles that touch the ground, and sum the nodes that are due.

    Each strip of owners is searched for contacts while it is in the cache. Fills the ``contacts`` but for the velocities that
    the grid gives. Returns the numbers of arenas, rows and shares that a thread needs, and the number of particles that touch;
    if a thread has less of one of these, the result is invalid.
    """
    cursors = arenas.cursors
    rows = _rows_of_thread(contacts, len(cursors))
    places = _shares_of_thread(contacts, len(cursors))
    _start(cursors)
    for cut in prange(len(schedule.cuts) - 1):
        thread = np.uint64(cut)
        for s in range(_strip_of(schedule.cuts[thread]), _strip_of(schedule.cuts[thread + 1])):
            low = STRIP * s
            end = min(low + STRIP, schedule.nown)
            total, owners = _fill_strip(
                particles, blocks, arenas, contacts, ground, search.reach, constants.h, thread, low, end, schedule.nown
            )
            row, share, fits = _keep_room(cursors, thread, total, owners, rows, places)
            if total > 0 and fits:
                _expect(contacts, row, total, share, owners)
                _measure_strip(particles, blocks.first, contacts, ground.tiles, constants, search, dt, low, total, row)
                next_row, next_share = _share_strip(contacts, arenas, row, share, low, end)
                cursors[thread, TOUCH] += next_row - row
                cursors[thread, ROWS] = ((next_row + 15) & ~15) - thread * rows
                cursors[thread, SHARED] = next_share - thread * places
            for k in range(schedule.due[s], schedule.due[s + 1]):
                _update_block_over_ground(arenas, contacts, grid, columns, blocks.down, np.int64(schedule.nodes[k]), constants.dv)
            _leave_arenas(schedule, arenas, thread, s, blocks.held, arenas.number)
    total = 0
    for t in range(len(cursors)):
        total += cursors[t, TOUCH]
    return _most_of(cursors, TAKEN), _most_of(cursors, ROWS), _most_of(cursors, SHARED), total
