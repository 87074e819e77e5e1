"""Phase "contact solution": the impulses of the ground on particles, and through them on nodes (:mod:`runout.physics.contact`).

The rows of contacts are those of :mod:`runout.backends.scan.contact_detection`. They get ground areas from the columns of
:mod:`runout.backends.scan.contact_area` where the law of friction uses them. The nodes already hold the impulses ``given``;
they get the differences from these.

    grid.nodes --gather--> felt[r]     compliance | velocity                and columns --gather--> given[r, 0]     area
    felt, measured, given --impulse--> felt[r]     drag | change of the impulse     given[r]    work | impulse
    felt --scatter--> arenas.values[lent[b]]    drag | change of the impulse  --sum, times inverse mass--> grid.nodes

The drag is 0 unless it slows whole columns.

Contacts are solved in tiles of 16 rows: column q of a tile is row 16 g + q, so that one vector holds one number of 16 contacts.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import in_double, load4, load16, local_array, record_vectors, row_vectors, store
from runout.backends.scan.contact_area import _area, _load_plan, local_plan
from runout.backends.scan.contact_detection import BEFORE, FRICTION, GAP, NORMAL
from runout.backends.scan.particles_to_grid import _leave_arenas, _push_block, _start, _strip_of, _take_arena, four_zeros
from runout.backends.scan.pore_pressure import _note_pores, _share_of_contacts
from runout.backends.scan.schedule import STRIP
from runout.backends.scan.stencil import (
    ARENA,
    EVERY,
    _add_weighted,
    _clear,
    _expect_nodes,
    _first_node,
    _load_nodes,
    _load_rows,
    _next_filled,
    _place_of,
    _weigh_four,
    even_groups,
    first_group,
    local_nodes,
    local_weights,
    odd_groups,
    second_group,
    weights_of_z,
)
from runout.physics.contact import column_drag, effective_impulse, impulse, work
from runout.physics.tensors import real, vec

ONE_NUMBER = True  # whether a contact holds the friction itself, not the row of a record; the binding decides, and these five
WET = False  # whether particles have pore pressure
USES_AREA = False  # whether the law of friction uses ground areas
DRAGS_COLUMN = False  # whether drag slows whole columns (column_drag.py)
record = None  # makes a record of the numbers of a law of friction
local_columns = local_array((4, 16))
local_effective = local_array((16,))
load_felt, store_felt = record_vectors(4)
load_4_rows, store_4_rows = row_vectors(4, 16)


def _weighted_mean(ready, w, rows):
    """Weighted mean of the four nodal numbers at the contact whose weights are at place ``w``."""
    g00, g01, g02, g10, g11, g12, g20, g21, g22 = rows
    x0 = ready[w + np.uint64(4)]
    x1 = ready[w + np.uint64(5)]
    x2 = ready[w + np.uint64(6)]
    c0 = x0 * g00 + x1 * g10 + x2 * g20
    c1 = x0 * g01 + x1 * g11 + x2 * g21
    c2 = x0 * g02 + x1 * g12 + x2 * g22
    s = ready[w + np.uint64(8)] * c0 + ready[w + np.uint64(9)] * c1 + ready[w + np.uint64(10)] * c2
    s = s * weights_of_z(load16(ready, w))
    s = even_groups(s, s) + odd_groups(s, s)
    return first_group(s) + second_group(s)


def _meet_grid(contacts, ready, nodes, plan, columns, row, n):
    """Compliance and velocity that the grid would give to each contact of a block; ``ready`` are the weights of the first.

    Where the law uses it, the ground area of the contact from the ``plan`` of the block too.
    """
    rows, felt, measured, given = contacts.rows, contacts.felt, contacts.measured, contacts.given
    for r in range(np.uint64(row), np.uint64(row + n)):
        _weigh_four(rows, (r + np.uint64(1)) * np.uint64(4), ready, _place_of(r + np.uint64(1)))
        cell = np.int64(rows[r, 0])
        around = _load_rows(nodes, _first_node(cell))
        store(felt, r * np.uint64(4), _weighted_mean(ready, _place_of(r), around))
        if USES_AREA:
            upward = measured[r >> np.uint64(4), NORMAL + 2, r & np.uint64(15)]
            given[r, 0] = _area(plan, cell, ready, _place_of(r), columns.plan_area, upward)


def _basal(number, table):
    """Record of a contact's friction from what the contact holds: the number of the law, or a row of the table of records."""
    if ONE_NUMBER:
        return record(number)
    return table[np.int64(number)]


def _push(t, begun, measured, table, columns, effective, g, dt):
    """Replace what 16 contacts feel by drag and change of the impulse, and area and impulses ``begun`` by work and impulse.

    ``effective`` (16,) is the share of their normal impulses that grains carry.
    """
    for q in range(np.uint64(16)):
        compliance = t[0, q]
        u = vec(t[1, q], t[2, q], t[3, q])
        normal = vec(measured[g, NORMAL, q], measured[g, NORMAL + 1, q], measured[g, NORMAL + 2, q])
        before = vec(measured[g, BEFORE, q], measured[g, BEFORE + 1, q], measured[g, BEFORE + 2, q])
        given = vec(begun[1, q], begun[2, q], begun[3, q])
        basal = _basal(measured[g, FRICTION, q], table)
        if WET:
            push = effective_impulse(u, normal, measured[g, GAP, q], compliance, basal, dt, given, begun[0, q], effective[q])
        else:
            push = impulse(u, normal, measured[g, GAP, q], compliance, basal, dt, given, begun[0, q])
        t[0, q] = real(0.0)
        if DRAGS_COLUMN:
            t[0, q] = column_drag(push, u, normal, begun[0, q], compliance, columns.gravity, dt, basal)
        t[1, q] = push[0] - given[0]
        t[2, q] = push[1] - given[1]
        t[3, q] = push[2] - given[2]
        begun[0, q] = work(push, given, before, u, compliance)
        begun[1, q] = push[0]
        begun[2, q] = push[1]
        begun[3, q] = push[2]


def _keep_forces(given, row, n, particles, f, stamp, dt):
    """Note the forces of the ground on the ``n`` contacts of a block, which are listed from place ``f`` on."""
    force = particles.force
    for q in range(n):
        w = np.int64(particles.particle_index[particles.listed[f + q]])
        force[w, 0] = stamp
        for k in range(1, 4):
            force[w, k] = given[row + q, k] / dt


def _spread_block(contacts, ready, arenas, a, b):
    """Fill the arena at place ``a`` with the changes of the impulses of block ``b``, and sum work and impulse.

    ``ready`` are the weights of its first contact.
    """
    rows, felt, given, work = contacts.rows, contacts.felt, contacts.given, contacts.work
    row = contacts.place[b]
    _clear(arenas, a, contacts.pressed[b])
    total = four_zeros(work)
    for r in range(np.uint64(row), np.uint64(row + contacts.touching[b])):
        _weigh_four(rows, (r + np.uint64(1)) * np.uint64(4), ready, _place_of(r + np.uint64(1)))
        total = total + in_double(load4(given, r * np.uint64(4)))
        _add_weighted(arenas, a + _first_node(np.int64(rows[r, 0])), ready, _place_of(r), load4(felt, r * np.uint64(4)))
    store(work, 4 * b, total)


def _total_ground(work, touching, nown, total):
    """Work and impulse on all blocks that have contacts."""
    for k in range(4):
        total[k] = 0.0
    for b in range(nown):
        if touching[b] > 0:
            for k in range(4):
                total[k] += work[b, k]


def _solve_strip(particles, blocks, contacts, columns, basal, pores, grid, dt, low, end, count):
    """Work and impulse of the ``count`` contacts of the owners ``low`` to ``end``, in ``given``; in ``felt`` their changes."""
    up = blocks.up
    rows, felt, given, touching, pressed = contacts.rows, contacts.felt, contacts.given, contacts.touching, contacts.pressed
    plan = local_plan(rows)
    nodes = local_nodes(rows)
    _clear(nodes, 0, EVERY)
    row = contacts.place[low]
    ready = local_weights(rows)
    _weigh_four(rows, np.uint64(4 * row), ready, _place_of(np.uint64(row)))
    for b in range(low, end):
        if touching[b] > 0:
            later = _next_filled(touching, b, end)
            if later < end:
                _expect_nodes(grid, up, later, pressed[later])
            _load_nodes(nodes, grid, up, b, pressed[b])
            if USES_AREA:
                _load_plan(plan, columns, up, b)
            _meet_grid(contacts, ready, nodes, plan, columns, contacts.place[b], touching[b])
            if WET:
                _note_pores(contacts.drained, particles, pores, b, blocks.first[b], contacts.place[b], touching[b])
    t = local_columns(rows)
    begun = local_columns(rows)
    effective = local_effective(rows)
    for g in range(row >> 4, (row + count + 15) >> 4):
        store_4_rows(t, 0, load_felt(felt, 64 * g))
        store_4_rows(begun, 0, load_felt(given, 64 * g))
        if WET:
            _share_of_contacts(effective, contacts.drained, pores, np.uint64(g))
        _push(t, begun, contacts.measured, basal, columns, effective, g, dt)
        store_felt(felt, 64 * g, load_4_rows(t, 0))
        store_felt(given, 64 * g, load_4_rows(begun, 0))


def solve_contacts(particles, blocks, schedule, arenas, contacts, columns, basal, pores, grid, dt, stamp, total):
    """Solve for one impulse per contact, and add the changes of the impulses to the velocities of the nodes that are due.

    ``basal`` are the records of friction, ``columns`` the columns of nodes that areas come from, ``pores`` the pore pressure of the
    particles. ``particles.force`` gets the ``stamp`` of this step and the force of the ground, unless the stamp is below 0;
    ``contacts.work`` gets the work and the impulse of each block, ``total`` their sums. A node that is due is read by no later
    strip, since each block that reads it also adds to it.
    """
    rows, given, place, touching = contacts.rows, contacts.given, contacts.place, contacts.touching
    cursors = arenas.cursors
    lent = arenas.lent
    _start(cursors)
    for cut in prange(len(schedule.cuts) - 1):
        thread = np.uint64(cut)
        for s in range(_strip_of(schedule.cuts[thread]), _strip_of(schedule.cuts[thread + 1])):
            low = STRIP * s
            end = min(low + STRIP, schedule.nown)
            count = np.int64(0)
            for b in range(low, end):
                count += touching[b]
            if count > 0:
                _solve_strip(particles, blocks, contacts, columns, basal, pores, grid.nodes, dt, low, end, count)
                ready = local_weights(rows)
                _weigh_four(rows, np.uint64(4 * place[low]), ready, _place_of(np.uint64(place[low])))
                for b in range(low, end):
                    if touching[b] > 0:
                        lent[b] = _take_arena(cursors, thread, arenas.free)
                        a = ARENA * np.int64(lent[b])
                        _spread_block(contacts, ready, arenas.values, a, b)
                        if stamp >= real(0.0):
                            _keep_forces(given, place[b], touching[b], particles, blocks.first[b], stamp, dt)
            for k in range(schedule.due[s], schedule.due[s + 1]):
                n = np.int64(schedule.nodes[k])
                if grid.shared[n]:
                    _push_block(arenas.values, lent, contacts.pressed, blocks.down, n, grid, columns)
            _leave_arenas(schedule, arenas, thread, s, touching, lent)
    _total_ground(contacts.work, touching, blocks.nown, total)
