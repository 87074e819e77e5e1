"""Impulses of the ground on the particles that touch it, and by their weights on the nodes: see :mod:`runout.physics.contact`.

The rows of contacts are those of :mod:`runout.backends.scan.contact_detection`. The nodes hold the impulses ``given`` from the
start; they get the differences from these.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import in_double, load4, load16, local_array, record_vectors, row_vectors, store
from runout.backends.scan.contact_detection import BEFORE, FRICTION, GAP, NORMAL
from runout.backends.scan.particles_to_grid import _leave_arenas, _push_block, _start, _strip_of, _take_arena, four_zeros
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
from runout.physics.contact import impulse, work
from runout.physics.tensors import real, vec

local_columns = local_array((4, 16))
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


def _meet_grid(contacts, ready, felt, nodes, row, n):
    """Compliance and velocity that the grid would give to each contact of a block; ``ready`` are the weights of the first."""
    for r in range(np.uint64(row), np.uint64(row + n)):
        _weigh_four(contacts, (r + np.uint64(1)) * np.uint64(4), ready, _place_of(r + np.uint64(1)))
        rows = _load_rows(nodes, _first_node(np.int64(contacts[r, 0])))
        store(felt, r * np.uint64(4), _weighted_mean(ready, _place_of(r), rows))


def _push(t, begun, measured, g, dt):
    """Of 16 contacts the change of their impulses in place of what they feel, and work and impulse in place of those ``begun``."""
    for q in range(np.uint64(16)):
        compliance = t[0, q]
        u = vec(t[1, q], t[2, q], t[3, q])
        normal = vec(measured[g, NORMAL, q], measured[g, NORMAL + 1, q], measured[g, NORMAL + 2, q])
        before = vec(measured[g, BEFORE, q], measured[g, BEFORE + 1, q], measured[g, BEFORE + 2, q])
        given = vec(begun[1, q], begun[2, q], begun[3, q])
        push = impulse(u, normal, measured[g, GAP, q], compliance, measured[g, FRICTION, q], dt, given)
        t[0, q] = real(0.0)
        t[1, q] = push[0] - given[0]
        t[2, q] = push[1] - given[1]
        t[3, q] = push[2] - given[2]
        begun[0, q] = work(push, given, before, u, compliance)
        begun[1, q] = push[0]
        begun[2, q] = push[1]
        begun[3, q] = push[2]


def _keep_forces(given, row, n, listed, f, particle_index, force, stamp, dt):
    """Note the forces of the ground on the ``n`` contacts of a block, which are listed from place ``f`` on."""
    for q in range(n):
        w = np.int64(particle_index[listed[f + q]])
        force[w, 0] = stamp
        for k in range(1, 4):
            force[w, k] = given[row + q, k] / dt


def _spread_block(contacts, ready, felt, given, row, n, arenas, a, parts, ground, b):
    """Fill the arena at place ``a`` with the changes of its contacts' impulses, and sum up work and impulse.

    ``ready`` are the weights of the first.
    """
    _clear(arenas, a, parts)
    total = four_zeros(ground)
    for r in range(np.uint64(row), np.uint64(row + n)):
        _weigh_four(contacts, (r + np.uint64(1)) * np.uint64(4), ready, _place_of(r + np.uint64(1)))
        total = total + in_double(load4(given, r * np.uint64(4)))
        _add_weighted(arenas, a + _first_node(np.int64(contacts[r, 0])), ready, _place_of(r), load4(felt, r * np.uint64(4)))
    store(ground, 4 * b, total)


def _total_ground(ground, touching, asleep, nown, total):
    """Sums of the rows of the blocks with contacts, those that sleep left out."""
    for k in range(4):
        total[k] = 0.0
    for b in range(nown):
        if touching[b] > 0 and not asleep[b]:
            for k in range(4):
                total[k] += ground[b, k]


def _solve_strip(contacts, measured, felt, given, place, touching, pressed, grid, up, dt, low, end, total):
    """Work and impulse of the ``total`` contacts of the owners ``low`` to ``end``, in ``given``; in ``felt`` its change."""
    nodes = local_nodes(contacts)
    _clear(nodes, 0, EVERY)
    row = place[low]
    ready = local_weights(contacts)
    _weigh_four(contacts, np.uint64(4 * row), ready, _place_of(np.uint64(row)))
    for b in range(low, end):
        if touching[b] > 0:
            later = _next_filled(touching, b, end)
            if later < end:
                _expect_nodes(grid, up, later, pressed[later])
            _load_nodes(nodes, grid, up, b, pressed[b])
            _meet_grid(contacts, ready, felt, nodes, place[b], touching[b])
    t = local_columns(contacts)
    begun = local_columns(contacts)
    for g in range(row >> 4, (row + total + 15) >> 4):
        store_4_rows(t, 0, load_felt(felt, 64 * g))
        store_4_rows(begun, 0, load_felt(given, 64 * g))
        _push(t, begun, measured, g, dt)
        store_felt(felt, 64 * g, load_4_rows(t, 0))
        store_felt(given, 64 * g, load_4_rows(begun, 0))


def solve_contacts(
    contacts, measured, felt, given, place, touching, pressed, listed, first, particle_index, force, stamp, nown, cuts, due,
    nodes, over, owners, grid, up, down, dt, lent, arenas, capacity, free, cursors, shared, inverse, asleep, ground, sums,
):  # fmt: skip
    """One impulse per contact; its change is spread to an arena of the block, and by it to the nodes that are due.

    The contacts of block b are ``listed`` from place ``first[b]`` on; ``force`` (n, 4) gets the ``stamp`` of this step and the
    force of the ground on each. ``lent`` are the numbers of the arenas, ``ground`` (nown, 4) the contacts' work [J] and sum [N s];
    ``sums`` are over all blocks but those that are ``asleep``. Who reads the velocity of a node reaches it too, so that nobody does
    once it is due. With no owners, ``nown`` = 0, nodes are pushed alone.
    """
    _start(cursors)
    for thread in prange(len(cuts) - 1):
        for s in range(_strip_of(cuts[thread]), _strip_of(cuts[thread + 1])):
            low = STRIP * s
            end = min(low + STRIP, nown)
            total = 0
            for b in range(low, end):
                total += touching[b]
            if total > 0:
                _solve_strip(contacts, measured, felt, given, place, touching, pressed, grid, up, dt, low, end, total)
                ready = local_weights(contacts)
                _weigh_four(contacts, np.uint64(4 * place[low]), ready, _place_of(np.uint64(place[low])))
                for b in range(low, end):
                    if touching[b] > 0:
                        lent[b] = _take_arena(cursors, thread, capacity, free)
                        a = ARENA * np.int64(lent[b])
                        _spread_block(contacts, ready, felt, given, place[b], touching[b], arenas, a, pressed[b], ground, b)
                        _keep_forces(given, place[b], touching[b], listed, first[b], particle_index, force, stamp, dt)
            for k in range(due[s], due[s + 1]):
                n = np.int64(nodes[k])
                if shared[n]:
                    _push_block(arenas, lent, pressed, down, n, grid, inverse)
            _leave_arenas(cursors, thread, free, s, over, owners, touching, lent)
    _total_ground(ground, touching, asleep, nown, sums)
