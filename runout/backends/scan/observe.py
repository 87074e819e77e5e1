"""What observers see: energies, columns of the raster, and particles as the backends exchange them."""

import math

import numpy as np
from numba import prange

from runout.backends.scan.motion import OUTSIDE
from runout.physics.elastic import energy_density, kirchhoff_stress, log_strain
from runout.physics.tensors import real, sym

MASS, MOMENTUM, KINETIC, POTENTIAL, ELASTIC = 0, 1, 4, 5, 6  # places in a row of sums


def _strain_of(state, p):
    return sym(state[p, 0], state[p, 1], state[p, 2], state[p, 3], state[p, 4], state[p, 5])


def change_step(rec, state, who, label, order, first, held, nown, mats, ddt, h):
    """Repack the records for a time step longer by ``ddt`` [s]."""
    for b in prange(nown):
        for k in range(first[b], first[b] + held[b]):
            p = order[k]
            tau = kirchhoff_stress(log_strain(_strain_of(state, p)), mats[label[who[p], 0]])
            x = -ddt * real(4.0) / h[0] * state[p, 7]
            y = -ddt * real(4.0) / h[1] * state[p, 7]
            z = -ddt * real(4.0) / h[2] * state[p, 7]
            rec[p, 5] += x * tau[0]
            rec[p, 6] += x * tau[3]
            rec[p, 7] += x * tau[5]
            rec[p, 9] += y * tau[3]
            rec[p, 10] += y * tau[1]
            rec[p, 11] += y * tau[4]
            rec[p, 13] += z * tau[5]
            rec[p, 14] += z * tau[4]
            rec[p, 15] += z * tau[2]


def _gradient_row(rec, state, p, j, stress, dt, h):
    """Column j of the velocity gradient C of a particle, in float64."""
    push = dt * 4.0 / h[j] * state[p, 7]
    scale = 1.0 / (np.float64(rec[p, 0]) * h[j])
    x = (rec[p, 5 + 4 * j] + push * stress[0]) * scale
    y = (rec[p, 6 + 4 * j] + push * stress[1]) * scale
    z = (rec[p, 7 + 4 * j] + push * stress[2]) * scale
    return x, y, z


def _gradient_of(rec, state, p, mat, dt, h):
    """Columns of the velocity gradient C of a particle, in float64."""
    tau = kirchhoff_stress(log_strain(_strain_of(state, p)), mat)
    x = _gradient_row(rec, state, p, 0, (tau[0], tau[3], tau[5]), dt, h)
    y = _gradient_row(rec, state, p, 1, (tau[3], tau[1], tau[4]), dt, h)
    z = _gradient_row(rec, state, p, 2, (tau[5], tau[4], tau[2]), dt, h)
    return x, y, z


def _add_sums(rec, state, p, node, mat, dt, h, gravity, sums, b):
    """Add mass, momentum, kinetic, potential and elastic energy of a particle to row ``b`` of sums."""
    m = np.float64(rec[p, 0])
    u = np.float64(rec[p, 1]) / m
    v = np.float64(rec[p, 2]) / m
    w = np.float64(rec[p, 3]) / m
    spin = 0.0
    columns = _gradient_of(rec, state, p, mat, dt, h)
    for j in range(3):
        c = columns[j]
        spin += 0.25 * h[j] * h[j] * (c[0] * c[0] + c[1] * c[1] + c[2] * c[2])
    sums[b, MASS] += m
    sums[b, MOMENTUM] += rec[p, 1]
    sums[b, MOMENTUM + 1] += rec[p, 2]
    sums[b, MOMENTUM + 2] += rec[p, 3]
    sums[b, KINETIC] += 0.5 * m * (u * u + v * v + w * w + spin)
    for j in range(3):
        sums[b, POTENTIAL] -= m * gravity[j] * h[j] * (node[j] + rec[p, 4 + 4 * j])
    sums[b, ELASTIC] += energy_density(log_strain(_strain_of(state, p)), mat) * state[p, 7]


def _node_of(bxyz, b, c, corner):
    """First node of a cell on the grid of the scene."""
    x = corner[0] + 4 * bxyz[b, 0] + (c >> 4)
    y = corner[1] + 4 * bxyz[b, 1] + ((c >> 2) & 3)
    z = corner[2] + 4 * bxyz[b, 2] + (c & 3)
    return x, y, z


def sum_blocks(rec, state, who, label, order, starts, first, nown, bxyz, corner, mats, dt, h, gravity, sums):
    """Sums (nown, 7) over the particles of each block."""
    for b in prange(nown):
        for k in range(7):
            sums[b, k] = 0.0
        for c in range(64):
            node = _node_of(bxyz, b, c, corner)
            for t in range(first[b] + starts[b, c], first[b] + starts[b, c + 1]):
                p = order[t]
                _add_sums(rec, state, p, node, mats[label[who[p], 0]], dt, h, gravity, sums, b)


def sum_escaped(rec, state, who, label, movers, leaving, first, nown, bxyz, corner, mats, dt, h, gravity, sums):
    """The same over the particles that leave the domain in this step."""
    for b in prange(nown):
        for k in range(7):
            sums[b, k] = 0.0
        for t in range(leaving[b]):
            entry = movers[first[b] + t]
            q = ((entry >> 6) & 63) - OUTSIDE
            if q >= 0:
                x, y, z = _node_of(bxyz, b, entry & 63, corner)
                node = (x + 4 * (q // 9 - 1), y + 4 * ((q // 3) % 3 - 1), z + 4 * (q % 3 - 1))
                p = first[b] + (entry >> 12)
                _add_sums(rec, state, p, node, mats[label[who[p], 0]], dt, h, gravity, sums, b)


def unpack(rec, state, who, label, order, starts, first, nown, bxyz, corner, mats, dt, h, place, node, affine):
    """First node (n, 3), velocity gradient (n, 3, 3) and slot (n,) of the particles; ``place`` is each block's first row."""
    for b in prange(nown):
        for c in range(64):
            for t in range(starts[b, c], starts[b, c + 1]):
                p = order[first[b] + t]
                d = place[b] + t
                node[d, 0], node[d, 1], node[d, 2] = _node_of(bxyz, b, c, corner)
                columns = _gradient_of(rec, state, p, mats[label[who[p], 0]], dt, h)
                for j in range(3):
                    for i in range(3):
                        affine[d, i, j] = columns[j][i]


def add_columns(rec, who, label, order, starts, first, nown, bxyz, corner, density, h, cell, raster):
    """Add each particle, spread over a plan box of one grid cell, to the raster (rows, columns, 5): volume, mass, momentum."""
    rows, columns, _ = raster.shape
    for b in range(nown):
        for c in range(64):
            node = _node_of(bxyz, b, c, corner)
            for t in range(first[b] + starts[b, c], first[b] + starts[b, c + 1]):
                p = order[t]
                x = (node[0] + rec[p, 4] - 0.5) * h[0] / cell[0]
                y = (node[1] + rec[p, 8] - 0.5) * h[1] / cell[1]
                wx = h[0] / cell[0]
                wy = h[1] / cell[1]
                m = rec[p, 0]
                for i in range(math.floor(x), math.floor(x + wx) + 1):
                    sx = (min(x + wx, i + 1.0) - max(x, i)) / wx
                    for j in range(math.floor(y), math.floor(y + wy) + 1):
                        share = sx * (min(y + wy, j + 1.0) - max(y, j)) / wy
                        if share > 0.0:
                            row = rows - 1 - min(max(j, 0), rows - 1)
                            column = min(max(i, 0), columns - 1)
                            raster[row, column, 0] += share * m / density[label[who[p], 0]]
                            raster[row, column, 1] += share * m
                            for d in range(3):
                                raster[row, column, 2 + d] += share * rec[p, 1 + d]
