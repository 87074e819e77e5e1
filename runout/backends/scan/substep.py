"""Phase "substep": gather, law and internal force on nodes that keep their particles, in one pass over the blocks.

A transfer of several substeps (:mod:`runout.physics.substeps`) begins with the phases of a step up to the solution of contacts.
Then follows, for each further substep,

    grid.nodes  --gather, by cell-->  buffers[thread]   m | v | fx | moments | ...                         in the cache
    buffers     --tile-->             law               state and sums of the particle, stress in buffers[thread]
    buffers     --scatter-->          arenas            --sum, when due-->  v += dt g + impulse / m         in place

and the contacts again, with the same nodes, normals and areas. ``grid_to_particles`` ends the transfer.

In the first of these passes the particles of a block are put into the order of its cells, where they stay. In place of momentum
and A, which nothing reads before the end of the transfer, their records hold the sums of the gathered velocities and moments: way
and deformation follow from these. A node is summed when all blocks that reach it have gathered from it, so that it is written in
place. It has no other mass than in the transfer before, and its first number stays: mass, or compliance where contacts reach.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import lane_sum, load4, load8, load16, store
from runout.backends.scan.contact_detection import BEFORE, GAP, NORMAL
from runout.backends.scan.grid_to_particles import (
    _expect_list,
    _expect_next,
    _follow_all_large,
    _follow_tile,
    _gather_again,
    _gather_block,
)
from runout.backends.scan.particles_to_grid import (
    _find_arenas,
    _inverse,
    _leave_arenas,
    _node_velocities,
    _start,
    _strip_of,
    _sum_all,
    _sum_of_nodes,
    _take_arena,
    heads,
    local_places,
)
from runout.backends.scan.pore_pressure import _drain_tile
from runout.backends.scan.schedule import STRIP
from runout.backends.scan.stencil import (
    ARENA,
    _add_rows,
    _add_weighted,
    _clear,
    _first_node,
    _load_nodes,
    _nothing,
    _place_of,
    _scatter,
    _weigh,
    _weigh_four,
    heads_and_tails,
    in_all_four,
    local_nodes,
    local_weights,
    zeros,
)
from runout.backends.scan.tile import LOST, TILE, _load_sums, _load_tile, _store_tile, local_tile
from runout.physics.substeps import moved_gap
from runout.physics.tensors import real, vec

DRAGS_COLUMN = False  # whether columns of nodes are summed (node_columns.py); the binding decides
WET = False  # whether particles have pore pressure, likewise


def _follow_order(listed, order, f, held):
    """Replace the slots of the listed contacts of a block, in the order of its particles, by those that the gather gives them."""
    q = np.int64(f)
    for t in range(np.int64(f), np.int64(f) + held):
        here = np.int64(listed[q] == order[t])
        listed[q] = t if here else listed[q]
        q += here


def _move_contacts(contacts, listed, b, f, q, end, records, dt):
    """Move the gaps of the contacts of a block from number ``q`` on, and note the velocities that their particles have got.

    Those of the particles before place ``end`` of the block are moved; returns the number of the next contact.
    """
    measured, given = contacts.measured, contacts.given
    while q < contacts.touching[b] and listed[f + q] < f + end:
        r = np.int64(contacts.place[b]) + q
        g = r >> 4
        m = r & 15
        p = np.int64(listed[f + q]) - f
        q += 1
        v = vec(records[p, 1], records[p, 2], records[p, 3])
        n = vec(measured[g, NORMAL, m], measured[g, NORMAL + 1, m], measured[g, NORMAL + 2, m])
        measured[g, GAP, m] = moved_gap(measured[g, GAP, m], n, vec(dt * v[0], dt * v[1], dt * v[2]))
        given[r, 0] = real(0.0)
        for k in range(3):
            measured[g, BEFORE + k, m] = v[k]
    return q


def _put_in_order(rec, state, held, f, records, states):
    """Write the gathered records and the states of a block from a buffer back to its slots: the first sums."""
    for t in range(np.uint64(held)):
        store(rec, (f + t) * np.uint64(16), load16(records, t * np.uint64(16)))
        store(state, (f + t) * np.uint64(8), load8(states, t * np.uint64(8)))


def _fill_from_buffer(records, starts, b, parts, arenas, a):
    """Add the records of a block, which lie in a buffer in the order of its cells, to the arena at place ``a``."""
    _clear(arenas, a, parts)
    ready = local_weights(records)
    _weigh(records, np.uint64(0), ready, _place_of(np.uint64(0)))
    for c in range(64):
        s = np.uint64(starts[b, c])
        e = np.uint64(starts[b, c + 1])
        if s == e:
            continue
        rows = _nothing(records)
        for t in range(s, e):
            _weigh(records, (t + np.uint64(1)) * np.uint64(16), ready, _place_of(t + np.uint64(1)))
            rows = _scatter(records, t * np.uint64(16), ready, _place_of(t), rows)
        _add_rows(arenas, a + _first_node(c), rows)


def _begin_contacts(contacts, b, arenas, a):
    """Add the impulses from which the contacts of a block start to its arena."""
    rows, given, row = contacts.rows, contacts.given, np.uint64(contacts.place[b])
    ready = local_weights(rows)
    _weigh_four(rows, row * np.uint64(4), ready, _place_of(row))
    for r in range(row, row + np.uint64(contacts.touching[b])):
        _weigh_four(rows, (r + np.uint64(1)) * np.uint64(4), ready, _place_of(r + np.uint64(1)))
        _add_weighted(arenas, a + _first_node(np.int64(rows[r, 0])), ready, _place_of(r), load4(given, r * np.uint64(4)))


def _go_on(arenas, down, b, nodes, columns, dv):
    """Add gravity and the impulses in the arenas to the velocities of the nodes of a block."""
    place = local_places(down)
    there = _find_arenas(place, arenas.values, arenas.number, arenas.reached, down, b)
    if there:
        for i in range(4):
            for j in range(4):
                s = _sum_all(arenas.values, place, there, i, j)
                o = b * 256 + (i * 4 + j) * 16
                before = load16(nodes, o)
                v = _node_velocities(s, _inverse(s), before + load16(dv, 0))
                store(nodes, o, heads_and_tails(before, v))
                if DRAGS_COLUMN:
                    moving = _sum_of_nodes(heads_and_tails(s, in_all_four(heads(s)) * v))
                    store(columns.moving, b * 64 + (i * 4 + j) * 4, moving)


def substep(particles, blocks, schedule, arenas, contacts, nodes, columns, dv, step, buffers, motion, first):
    """One substep of all particles on the grid of their transfer, the ``first`` one or a later one.

    ``nodes`` (nall, 256) hold velocities after the substep before, and get those before contacts. Returns the energy lost [J].
    """
    rec, state, starts, firsts = particles.rec, particles.state, blocks.starts, blocks.first
    values, cursors, reached = arenas.values, arenas.cursors, arenas.reached
    number = arenas.number
    index, label, order, listed = particles.particle_index, particles.label, particles.order, particles.listed
    mats, dt, s4, cells = step.mats, step.dt, step.slopes, step.cells
    _start(cursors)
    for cut in prange(len(schedule.cuts) - 1):
        thread = np.uint64(cut)
        records, states = buffers.rec[thread], buffers.state[thread]
        labels, of_cell = buffers.particle_index[thread], buffers.cell[thread]
        around = local_nodes(rec)
        t = local_tile(rec)
        for s in range(_strip_of(schedule.cuts[thread]), _strip_of(schedule.cuts[thread + 1])):
            for b in range(STRIP * s, min(STRIP * s + STRIP, schedule.nown)):
                held = blocks.held[b]
                motion[b, 2] = 0.0
                if held == 0:
                    continue
                f = firsts[b]
                _load_nodes(around, nodes, blocks.up, b, reached[b])
                if first:
                    if contacts.touching[b] > 0:
                        _follow_order(listed, order, f, held)
                    _expect_list(order, index, blocks, b)
                    _gather_block(particles, held, np.uint64(f), around, records, states, labels, of_cell, buffers.pores[thread])
                    _put_in_order(rec, state, held, np.uint64(f), records, states)
                _expect_next(rec, state, order, blocks, b, nodes)
                lost = zeros(rec)
                q = np.int64(0)
                for k in range(0, held, TILE):
                    count = min(TILE, held - k)
                    groups = (count + 15) >> 4
                    if not first:
                        _gather_again(particles, np.uint64(f + k), np.uint64(count), around, records, np.uint64(k))
                    q = _move_contacts(contacts, listed, b, f, q, k + count, records, dt)
                    _load_tile(t, records, k, state, f + k, groups)
                    _load_sums(t, rec, f + k, groups)
                    if WET:
                        _drain_tile(t, particles, step.pores, np.int64(b), f + k, count)
                    _follow_tile(t, index, label, np.uint64(f + k), np.uint64(count), mats, s4, cells)
                    _follow_all_large(t, records, k, state, f + k, particles, f + k, groups, mats, s4, cells)
                    _store_tile(t, records, k, state, f + k, groups)
                    for g in range(groups):
                        lost = lost + load16(t, LOST * TILE + 16 * g)
                motion[b, 2] = lane_sum(lost)
                number[b] = _take_arena(cursors, thread, arenas.free)
                a = ARENA * np.int64(number[b])
                _fill_from_buffer(records, starts, b, reached[b], values, a)
                if contacts.touching[b] > 0:
                    _begin_contacts(contacts, b, values, a)
            for k in range(schedule.due[s], schedule.due[s + 1]):
                _go_on(arenas, blocks.down, np.int64(schedule.nodes[k]), nodes, columns, dv)
            _leave_arenas(schedule, arenas, thread, s, blocks.held, number)
    lost_in_all = 0.0
    for b in range(blocks.nown):
        lost_in_all += motion[b, 2]
    return lost_in_all
