"""Phase "observe": sums of mass, momentum and energy, and particles as the backends exchange them.

Particles are summed in tiles of 32.

    tile t[row, column]    rows 0 .. 15 record | 16 .. 23 state, later log strain | 24, 25 moduli | 26 large strain; 32 particles
    tile x[row, column]    rows 0 .. 6 the sums of one particle in float64 | 7 .. 9 first node of its cell
    sums[b]                mass | momentum (3) | kinetic, potential, elastic energy, of block b
"""

from collections import namedtuple

import numpy as np
from numba import prange

from runout.backends.lanes import lane_sum, listed_record_vectors, load16, local_array, prefetch, row_vectors
from runout.backends.scan.grid_to_particles import OUTSIDE
from runout.backends.scan.workspace import SUMS
from runout.physics.elastic import energy_density, is_small, kirchhoff_stress, log_strain, log_strain_scaled, log_strain_series
from runout.physics.moments import gradient_column, kinetic_energy, moment_slope, momentum_at, potential_energy, stress_columns
from runout.physics.tensors import contracted, real, sym, vec

MASS, MOMENTUM, KINETIC, POTENTIAL, ELASTIC = 0, 1, 4, 5, 6  # places in a row of sums
TILE = 32
LAMBDA, SHEAR, LARGE = 24, 25, 26  # rows of a tile after record and state
NODE = SUMS  # first of three rows after the sums
Moduli = namedtuple("Moduli", ("lame_lambda", "shear_modulus"))
local_tile = local_array((27, TILE))
local_sums = local_array((SUMS + 3, TILE))
load_listed_records, load_listed_states = listed_record_vectors(16), listed_record_vectors(8)
store_16_rows, store_8_rows = (row_vectors(count, TILE)[1] for count in (16, 8))


def _moduli(moduli, release):
    """Lame parameters of the material of a release."""
    return Moduli(moduli[release, 0], moduli[release, 1])


def _strain_of(state, p):
    return sym(state[p, 0], state[p, 1], state[p, 2], state[p, 3], state[p, 4], state[p, 5])


def _add_stress(rec, p, tau, volume, slopes):
    """Add the impulse of a stress to the record of a particle, whose momentum is that at the middle node."""
    push = stress_columns(tau, volume, slopes)
    momentum = momentum_at(
        vec(rec[p, 1], rec[p, 2], rec[p, 3]),
        vec(push[0], push[1], push[2]),
        vec(push[3], push[4], push[5]),
        vec(push[6], push[7], push[8]),
        vec(real(1.0) - rec[p, 4], real(1.0) - rec[p, 8], real(1.0) - rec[p, 12]),
    )
    for i in range(3):
        rec[p, 1 + i] = momentum[i]
        for j in range(3):
            rec[p, 5 + 4 * j + i] += push[3 * j + i]


def change_step(particles, blocks, moduli, ddt, h):
    """Repack the records for a time step longer by ``ddt`` [s]."""
    rec, state, order, particle_index = particles.rec, particles.state, particles.order, particles.particle_index
    first, held, label = blocks.first, blocks.held, particles.label
    slopes = moment_slope(ddt, h[0]), moment_slope(ddt, h[1]), moment_slope(ddt, h[2])
    for b in prange(blocks.nown):
        for k in range(first[b], first[b] + held[b]):
            p = order[k]
            tau = kirchhoff_stress(log_strain(_strain_of(state, p)), _moduli(moduli, label[particle_index[p], 0]))
            _add_stress(rec, p, tau, state[p, 7], slopes)


def _take_record(t, q, rec, state, p):
    """Record and state of a particle as column ``q`` of a tile."""
    for k in range(16):
        t[k, q] = rec[p, k]
    for k in range(8):
        t[16 + k, q] = state[p, k]


def _take_place(t, x, q, mat, node):
    """Write what the record does not hold: moduli, and the first node of the cell."""
    t[LAMBDA, q] = mat.lame_lambda
    t[SHEAR, q] = mat.shear_modulus
    for j in range(3):
        x[NODE + j, q] = node[j]


def _take_tile(t, x, particles, first, n, moduli, node):
    """The ``n`` particles of a list from place ``first`` on as columns; ``node`` is the first of their block."""
    rec, state, order, cell = particles.rec, particles.state, particles.order, particles.cell
    particle_index, label = particles.particle_index, particles.label
    for g in range(0, TILE, 16):
        store_16_rows(t, g, load_listed_records(rec, order, first + g))
        store_8_rows(t, 16 * TILE + g, load_listed_states(state, order, first + g))
    mat = _moduli(moduli, 0)
    for q in range(np.uint64(n)):
        p = order[first + np.int64(q)]
        later = np.int64(order[first + np.int64(q) + TILE])
        prefetch(rec, 16 * later)
        prefetch(state, 8 * later)
        if len(moduli) > 1:
            mat = _moduli(moduli, label[particle_index[p], 0])
        c = np.int64(cell[p])
        _take_place(t, x, q, mat, (node[0] + (c >> 4), node[1] + ((c >> 2) & 3), node[2] + (c & 3)))


def _strain(t, q):
    return sym(t[16, q], t[17, q], t[18, q], t[19, q], t[20, q], t[21, q])


def _momentum(t, q):
    """Momentum [kg m/s] of column ``q`` of a tile of records, in float64: the record holds that at the middle node."""
    return momentum_at(
        (np.float64(t[1, q]), np.float64(t[2, q]), np.float64(t[3, q])),
        (np.float64(t[5, q]), np.float64(t[6, q]), np.float64(t[7, q])),
        (np.float64(t[9, q]), np.float64(t[10, q]), np.float64(t[11, q])),
        (np.float64(t[13, q]), np.float64(t[14, q]), np.float64(t[15, q])),
        (np.float64(t[4, q]) - 1.0, np.float64(t[8, q]) - 1.0, np.float64(t[12, q]) - 1.0),
    )


def _affine(t, q, tau, dt, h):
    """Columns of the affine momentum m C_j h_j [kg m/s] of a particle, in float64: what its record holds besides the stress."""
    s = stress_columns(tau, np.float64(t[23, q]), (moment_slope(dt, h[0]), moment_slope(dt, h[1]), moment_slope(dt, h[2])))
    x = t[5, q] - s[0], t[6, q] - s[1], t[7, q] - s[2]
    y = t[9, q] - s[3], t[10, q] - s[4], t[11, q] - s[5]
    z = t[13, q] - s[6], t[14, q] - s[7], t[15, q] - s[8]
    return x, y, z


def _account(t, x, q, dt, h, gravity):
    """Mass, momentum, kinetic, potential and elastic energy of a column that holds its log strain, in float64."""
    mat = Moduli(t[LAMBDA, q], t[SHEAR, q])
    log = _strain(t, q)
    m = np.float64(t[0, q])
    ax, ay, az = _affine(t, q, kirchhoff_stress(log, mat), dt, h)
    mv = _momentum(t, q)
    place = h[0] * (x[NODE, q] + t[4, q]), h[1] * (x[NODE + 1, q] + t[8, q]), h[2] * (x[NODE + 2, q] + t[12, q])
    x[MASS, q] = m
    x[MOMENTUM, q] = mv[0]
    x[MOMENTUM + 1, q] = mv[1]
    x[MOMENTUM + 2, q] = mv[2]
    x[KINETIC, q] = kinetic_energy(m, mv, ax, ay, az)
    x[POTENTIAL, q] = potential_energy(m, gravity, place)
    x[ELASTIC, q] = np.float64(energy_density(log, mat)) * t[23, q]


def _take_logs(t, n):
    """Log strain in place of the strain of ``n`` columns; small strains, nearly all, without a branch."""
    for q in range(np.uint64(TILE)):
        B = _strain(t, q)
        log = log_strain_series(B)
        small = is_small(contracted(B, B))
        t[LARGE, q] = real(0.0) if small else real(1.0)
        t[16, q] = log[0] if small else B[0]
        t[17, q] = log[1] if small else B[1]
        t[18, q] = log[2] if small else B[2]
        t[19, q] = log[3] if small else B[3]
        t[20, q] = log[4] if small else B[4]
        t[21, q] = log[5] if small else B[5]
    for q in range(n):
        if t[LARGE, q] > real(0.0):
            log = log_strain_scaled(_strain(t, q))
            for k in range(6):
                t[16 + k, q] = log[k]


def _account_tile(t, x, n, dt, h, gravity, sums, b):
    """Add the ``n`` columns of a tile to row ``b`` of sums."""
    hx, hy, hz = h[0], h[1], h[2]
    gx, gy, gz = gravity[0], gravity[1], gravity[2]
    _take_logs(t, n)
    for q in range(np.uint64(TILE)):
        _account(t, x, q, dt, (hx, hy, hz), (gx, gy, gz))
    for k in range(SUMS):
        for q in range(n, TILE):
            x[k, q] = 0.0
        sums[b, k] += lane_sum(load16(x, TILE * k) + load16(x, TILE * k + 16))


def _node_of(bxyz, b, c, corner):
    """First node of a cell on the grid of the scene."""
    x = corner[0] + 4 * bxyz[b, 0] + (c >> 4)
    y = corner[1] + 4 * bxyz[b, 1] + ((c >> 2) & 3)
    z = corner[2] + 4 * bxyz[b, 2] + (c & 3)
    return x, y, z


def _clear_sums(sums, b):
    """Set row ``b`` to zero."""
    for k in range(SUMS):
        sums[b, k] = 0.0


def _sum_block(particles, blocks, b, n, constants, moduli, dt, sums):
    """Sums over the first ``n`` particles of the list of a block."""
    t = local_tile(particles.rec)
    x = local_sums(sums)
    node = _node_of(blocks.bxyz, b, 0, constants.corner)
    for k in range(0, n, TILE):
        count = min(TILE, n - k)
        _take_tile(t, x, particles, blocks.first[b] + k, count, moduli, node)
        _account_tile(t, x, count, dt, constants.spacing, constants.gravity, sums, b)


def _sum_leaving(particles, blocks, b, n, constants, moduli, dt, sums):
    """Sums over those of the ``n`` particles that leave a block that leave the domain too."""
    t = local_tile(particles.rec)
    x = local_sums(sums)
    first = blocks.first[b]
    for m in range(n):
        entry = particles.listed[first + m]
        q = ((entry >> 6) & 63) - OUTSIDE
        if q >= 0:
            i, j, k = _node_of(blocks.bxyz, b, entry & 63, constants.corner)
            node = (i + 4 * (q // 9 - 1), j + 4 * ((q // 3) % 3 - 1), k + 4 * (q % 3 - 1))
            p = first + (entry >> 12)
            _take_record(t, 0, particles.rec, particles.state, p)
            _take_place(t, x, 0, _moduli(moduli, particles.label[particles.particle_index[p], 0]), node)
            _account_tile(t, x, np.int64(1), dt, constants.spacing, constants.gravity, sums, b)


def sum_blocks(particles, blocks, held, constants, moduli, dt, sums):
    """Sums (nown, 7) over the ``held`` (nown,) particles of each block."""
    for row in prange(blocks.nown):
        b = np.uint64(row)
        _clear_sums(sums, b)
        if held[b] > 0:
            _sum_block(particles, blocks, b, held[b], constants, moduli, dt, sums)


def sum_escaped(particles, blocks, leaving, constants, moduli, dt, sums):
    """Sums (nown, 7) over the particles of each block that leave the domain in this step."""
    for row in prange(blocks.nown):
        b = np.uint64(row)
        _clear_sums(sums, b)
        if leaving[b] > 0:
            _sum_leaving(particles, blocks, b, leaving[b], constants, moduli, dt, sums)


def unpack(particles, blocks, constants, moduli, dt, place, node, affine):
    """First node (n, 3) and velocity gradient (n, 3, 3) of the particles; ``place`` is the first row of each block."""
    rec, order, starts, first = particles.rec, particles.order, blocks.starts, blocks.first
    label, particle_index = particles.label, particles.particle_index
    h, bxyz, corner = constants.spacing, blocks.bxyz, constants.corner
    for b in prange(blocks.nown):
        column = local_tile(rec)
        for c in range(64):
            for t in range(starts[b, c], starts[b, c + 1]):
                p = order[first[b] + t]
                d = place[b] + t
                node[d, 0], node[d, 1], node[d, 2] = _node_of(bxyz, b, c, corner)
                _take_record(column, 0, rec, particles.state, p)
                tau = kirchhoff_stress(log_strain(_strain(column, 0)), _moduli(moduli, label[particle_index[p], 0]))
                columns = _affine(column, 0, tau, dt, h)
                m = np.float64(column[0, 0])
                for j in range(3):
                    for i in range(3):
                        affine[d, i, j] = gradient_column(columns[j][i], m, h[j])
