"""Velocity gradients of all particles, computed before the law: for gradients of the weights, F-bar and aflip.

A particle has a row of 16 numbers in ``rates`` and in ``slips``, in the order of the cells from the first slot of its block on:

    rates[t]    [ mean dilatation, - | fx, sums for d/dx | fy, for d/dy | fz, for d/dz ]
    slips[t]    [ -, velocity        | -, moments in x   | -, in y      | -, in z      ]

The sums [m/s per cell] are nodal velocities times slopes of the weights, or times their counterparts in the packed transfer. Slips
are what the grid has not seen of a particle.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import constant, load16, permutation, select, splat, store
from runout.backends.scan.forces import _z_slopes
from runout.backends.scan.particles_to_grid import _find_arenas, _sum_row, local_places, masses
from runout.backends.scan.stencil import (
    ARENA,
    EVERY,
    _add_rows,
    _clear,
    _first_node,
    _load_nodes,
    _load_rows,
    _mean,
    _nothing,
    _spread,
    _sum_groups,
    _z_weights,
    heads_and_tails,
    in_groups,
    local_nodes,
    local_weights,
    zeros,
)
from runout.physics.bspline import moment_slopes, weight_slopes, weights
from runout.physics.moments import momentum_at, velocity_gradient
from runout.physics.tensors import real, vec
from runout.physics.transfers import dilatation, slip_moment, slip_velocity

ones = constant([1.0] * 16)
seconds = permutation(in_groups((1, 5, 9, 13)))
z_nodes = constant(in_groups((0.0, 4.0, 8.0, 0.0)))


def _gradient_row(rec, r, spline, rows):
    """Row of the record at place ``r``, its first four numbers mass and velocity."""
    g00, g01, g02, g10, g11, g12, g20, g21, g22 = rows
    fx = rec[r + np.uint64(4)]
    fy = rec[r + np.uint64(8)]
    fz = rec[r + np.uint64(12)]
    x = weights(fx)
    y = weights(fy)
    z = _z_weights(fz)
    if spline:
        dx = weight_slopes(fx)
        dy = weight_slopes(fy)
        dz = _z_slopes(fz)
    else:
        dx = moment_slopes(fx)
        dy = moment_slopes(fy)
        dz = (z_nodes(z) - splat(real(4.0) * fz)) * z
    c0 = x[0] * g00 + x[1] * g10 + x[2] * g20
    c1 = x[0] * g01 + x[1] * g11 + x[2] * g21
    c2 = x[0] * g02 + x[1] * g12 + x[2] * g22
    e0 = dx[0] * g00 + dx[1] * g10 + dx[2] * g20
    e1 = dx[0] * g01 + dx[1] * g11 + dx[2] * g21
    e2 = dx[0] * g02 + dx[1] * g12 + dx[2] * g22
    s = y[0] * c0 + y[1] * c1 + y[2] * c2
    east = y[0] * e0 + y[1] * e1 + y[2] * e2
    north = dy[0] * c0 + dy[1] * c1 + dy[2] * c2
    return heads_and_tails(load16(rec, r), _sum_groups(s * z, east * z, north * z, s * dz))


def _rate(rates, p, cells):
    """Velocity gradient times the step [1] of a row; ``cells`` = dt / h [s/m]."""
    x = vec(rates[p, 5], rates[p, 6], rates[p, 7])
    y = vec(rates[p, 9], rates[p, 10], rates[p, 11])
    return velocity_gradient(x, y, vec(rates[p, 13], rates[p, 14], rates[p, 15]), cells)


def _velocity(rec, p):
    """Velocity [m/s] of a particle from its record: that at the middle node, and its slopes."""
    momentum = momentum_at(
        vec(rec[p, 1], rec[p, 2], rec[p, 3]),
        vec(rec[p, 5], rec[p, 6], rec[p, 7]),
        vec(rec[p, 9], rec[p, 10], rec[p, 11]),
        vec(rec[p, 13], rec[p, 14], rec[p, 15]),
        vec(rec[p, 4] - real(1.0), rec[p, 8] - real(1.0), rec[p, 12] - real(1.0)),
    )
    m = real(1.0) / rec[p, 0]
    return vec(momentum[0] * m, momentum[1] * m, momentum[2] * m)


def take_gradients(particles, blocks, grid, spline, rates):
    """Rows of all particles from the nodal velocities; ``spline``: by slopes of the weights, else as in the packed transfer."""
    rec, order, starts = particles.rec, particles.order, blocks.starts
    for b in prange(blocks.nown):
        if starts[b, 64] == 0:
            continue
        flat = rec.reshape(-1)
        out = rates.reshape(-1)
        nodes = local_nodes(rec)
        _load_nodes(nodes, grid, blocks.up, b, EVERY)
        f = np.uint64(blocks.first[b])
        for c in range(64):
            if starts[b, c] == starts[b, c + 1]:
                continue
            rows = _load_rows(nodes, _first_node(c))
            for t in range(np.uint64(starts[b, c]), np.uint64(starts[b, c + 1])):
                p = np.uint64(order[f + t])
                store(out, (f + t) * np.uint64(16), _gradient_row(flat, p * np.uint64(16), spline, rows))


def spread_dilatation(rates, particles, blocks, cells, arenas):
    """Fill the arenas with volume and volume times dilatation, in place of what the nodes have taken already."""
    state, order, starts, values = particles.state, particles.order, blocks.starts, arenas.values
    for b in prange(blocks.nown):
        if starts[b, 64] == 0:
            continue
        a = ARENA * np.int64(arenas.number[b])
        flat = rates.reshape(-1)
        _clear(values, a, EVERY)
        f = np.uint64(blocks.first[b])
        for c in range(64):
            if starts[b, c] == starts[b, c + 1]:
                continue
            rows = _nothing(rates)
            for t in range(f + np.uint64(starts[b, c]), f + np.uint64(starts[b, c + 1])):
                volume = state[order[t], 7]
                rates[t, 0] = volume
                rates[t, 1] = volume * dilatation(_rate(rates, t, cells))
                rates[t, 2] = real(0.0)
                rates[t, 3] = real(0.0)
                rows = _spread(flat, t * np.uint64(16), rows)
            _add_rows(values, a + _first_node(c), rows)


def average_dilatation(arenas, down, nall, grid):
    """Put the mean dilatation of each node in the place of its mass, which nothing reads any more in this step."""
    values = arenas.values
    for b in prange(nall):
        place = local_places(down)
        if not _find_arenas(place, values, arenas.number, arenas.reached, down, b):
            continue
        for i in range(4):
            for j in range(4):
                o = b * 256 + (i * 4 + j) * 16
                s = _sum_row(values, place, i, j, 0, 1)
                volume = masses(s)
                filled = volume > zeros(s)
                mean = select(filled, seconds(s) / select(filled, volume, ones(s)), zeros(s))
                store(grid, o, heads_and_tails(mean, load16(grid, o)))


def take_dilatation(rates, blocks, grid):
    """Mean over the nodes of what :func:`average_dilatation` has put there, as the first number of each row."""
    starts = blocks.starts
    for b in prange(blocks.nown):
        if starts[b, 64] == 0:
            continue
        flat = rates.reshape(-1)
        nodes = local_nodes(rates)
        _load_nodes(nodes, grid, blocks.up, b, EVERY)
        f = np.uint64(blocks.first[b])
        for c in range(64):
            if starts[b, c] == starts[b, c + 1]:
                continue
            rows = _load_rows(nodes, _first_node(c))
            for t in range(f + np.uint64(starts[b, c]), f + np.uint64(starts[b, c + 1])):
                r = t * np.uint64(16)
                store(flat, r, _mean(flat, r, rows))


def take_slips(particles, blocks, given, slips):
    """What the grid has not seen of each particle: its velocity and moments less those of the ``given`` nodal velocities."""
    rec, order, starts, first = particles.rec, particles.order, blocks.starts, blocks.first
    for b in prange(blocks.nown):
        if starts[b, 64] == 0:
            continue
        flat = rec.reshape(-1)
        nodes = local_nodes(rec)
        seen = local_weights(rec)
        _load_nodes(nodes, given, blocks.up, b, EVERY)
        f = first[b]
        for c in range(64):
            if starts[b, c] == starts[b, c + 1]:
                continue
            rows = _load_rows(nodes, _first_node(c))
            for t in range(f + starts[b, c], f + starts[b, c + 1]):
                p = order[t]
                store(seen, 0, _gradient_row(flat, np.uint64(16 * p), False, rows))
                slip = slip_velocity(_velocity(rec, p), vec(seen[1], seen[2], seen[3]))
                slips[t, 1], slips[t, 2], slips[t, 3] = slip
                for k in (5, 9, 13):
                    column = vec(rec[p, k], rec[p, k + 1], rec[p, k + 2])
                    slip = slip_moment(column, rec[p, 0], vec(seen[k], seen[k + 1], seen[k + 2]))
                    slips[t, k], slips[t, k + 1], slips[t, k + 2] = slip
