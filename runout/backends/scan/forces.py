"""Internal forces by the gradients of the weights, added to the arenas that hold mass and momentum (transfers apic and aflip).

The records of these transfers hold no stress. Each block computes the stresses of its particles in a buffer of its thread, with one
row for each particle in the order of the cells, and adds them to its arena:

    buffers.rec[thread, t]    [ - | fx, column 0 | fy, column 1 | fz, column 2 ]   with columns -dt/h_j V0 tau_j of the impulse
"""

import numpy as np
from numba import get_thread_id, prange

from runout.backends.lanes import (
    constant,
    listed_record_vectors,
    load4,
    local_array,
    record_vectors,
    row_vectors,
    splat,
)
from runout.backends.scan.observe import LAMBDA, SHEAR, TILE, Moduli, _strain, _take_logs
from runout.backends.scan.stencil import ARENA, _add_rows, _first_node, _nothing, _z_weights, in_groups, repeated, tails, z_centre
from runout.physics.bspline import weight_slopes, weights
from runout.physics.elastic import kirchhoff_stress
from runout.physics.moments import stress_columns

z_slope_scale = constant(in_groups((1.0, -2.0, 1.0, 0.0)))
local_tile = local_array((27, TILE))
load_listed_records = listed_record_vectors(16)
load_listed_states = listed_record_vectors(8)
_, store_records = record_vectors(16)
load_16_rows, store_16_rows = row_vectors(16, TILE)
_, store_8_rows = row_vectors(8, TILE)


def _z_slopes(f):
    """Slope of the weight of node k in group k; none in the last."""
    d = splat(f)
    return z_slope_scale(d) * (d - z_centre(d))


def _take_tile(t, particles, start, groups, moduli):
    """Records, states and moduli of listed particles as columns of a tile; the columns after the last hold any others."""
    order = particles.order
    for g in range(groups):
        store_16_rows(t, 16 * g, load_listed_records(particles.rec, order, start + 16 * g))
        store_8_rows(t, 16 * TILE + 16 * g, load_listed_states(particles.state, order, start + 16 * g))
    for q in range(16 * groups):
        release = particles.label[particles.particle_index[order[start + q]], 0]
        t[LAMBDA, q], t[SHEAR, q] = moduli[release, 0], moduli[release, 1]


def _replace_by_forces(t, s, n):
    """Impulse of the internal force in place of the affine columns."""
    _take_logs(t, n)
    for q in range(np.uint64(TILE)):
        tau = kirchhoff_stress(_strain(t, q), Moduli(t[LAMBDA, q], t[SHEAR, q]))
        push = stress_columns(tau, t[23, q], s)
        t[5, q] = push[0]
        t[6, q] = push[1]
        t[7, q] = push[2]
        t[9, q] = push[3]
        t[10, q] = push[4]
        t[11, q] = push[5]
        t[13, q] = push[6]
        t[14, q] = push[7]
        t[15, q] = push[8]


def _scatter_slopes(rec, r, rows):
    """Rows with the columns of the row at place ``r`` added, each times the slope of the weights along its axis."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = rows
    x = weights(rec[r + np.uint64(4)])
    y = weights(rec[r + np.uint64(8)])
    dx = weight_slopes(rec[r + np.uint64(4)])
    dy = weight_slopes(rec[r + np.uint64(8)])
    z = tails(_z_weights(rec[r + np.uint64(12)]))
    east = repeated(load4(rec, r + np.uint64(4))) * z
    north = repeated(load4(rec, r + np.uint64(8))) * z
    up = repeated(load4(rec, r + np.uint64(12))) * tails(_z_slopes(rec[r + np.uint64(12)]))
    d0 = y[0] * east
    d1 = y[1] * east
    d2 = y[2] * east
    u0 = dy[0] * north + y[0] * up
    u1 = dy[1] * north + y[1] * up
    u2 = dy[2] * north + y[2] * up
    a00 += x[0] * u0 + dx[0] * d0
    a01 += x[0] * u1 + dx[0] * d1
    a02 += x[0] * u2 + dx[0] * d2
    a10 += x[1] * u0 + dx[1] * d0
    a11 += x[1] * u1 + dx[1] * d1
    a12 += x[1] * u2 + dx[1] * d2
    a20 += x[2] * u0 + dx[2] * d0
    a21 += x[2] * u1 + dx[2] * d1
    a22 += x[2] * u2 + dx[2] * d2
    return a00, a01, a02, a10, a11, a12, a20, a21, a22


def add_forces(particles, blocks, moduli, s, arenas, buffer):
    """Add the impulses of the internal forces to the arenas; ``s`` = dt / h [s/m] by axis.

    ``buffer`` (threads, rows, 16) has a row for each particle of the fullest block.
    """
    rec, starts, first, values, number = particles.rec, blocks.starts, blocks.first, arenas.values, arenas.number
    for b in prange(blocks.nown):
        held = starts[b, 64]
        if held == 0:
            continue
        forces = buffer[get_thread_id()]
        t = local_tile(rec)
        for k in range(0, held, TILE):
            count = min(TILE, held - k)
            groups = (count + 15) >> 4
            _take_tile(t, particles, first[b] + k, groups, moduli)
            _replace_by_forces(t, s, count)
            for g in range(groups):
                store_records(forces, 16 * (k + 16 * g), load_16_rows(t, 16 * g))
        flat = forces.reshape(-1)
        for c in range(64):
            if starts[b, c] == starts[b, c + 1]:
                continue
            rows = _nothing(rec)
            for q in range(np.uint64(starts[b, c]), np.uint64(starts[b, c + 1])):
                rows = _scatter_slopes(flat, q * np.uint64(16), rows)
            _add_rows(values, ARENA * np.int64(number[b]) + _first_node(c), rows)
