"""Phase "contact with structures", second half: impulses on the particles that touch structures, after those of the ground.

share_structure_contacts   shares    --sum, times inverse mass-->  compliance, inverse, grid.nodes
solve_structure_contacts   grid.nodes, compliance  --gather, impulse-->  push[r]    push - given  --scatter-->  shares
push_from_structures       shares    --sum, times inverse mass-->  grid.nodes
book_structures            push      --sum by patch-->  impulses (patches, 3)
find_entering              grid.nodes  --gather-->  the rows that would still enter: 1 | -  --scatter-->  shares
share_structure_contacts   as above, for their compliance
stop_entering              grid.nodes, compliance  --gather-->  push[r]  --scatter-->  shares
push_from_structures, book_structures   as above

follow_structure_contacts  grid.nodes, before the next substep of a transfer  --gather-->  rows  --scatter-->  shares
"""

import numpy as np
from numba import prange

from runout.backends.scan.structure_detection import (
    BEFORE,
    DISTANCE,
    GAP,
    NORMAL,
    _clear_share,
    _radius_of,
    _spread,
    _weights_of,
)
from runout.physics.contact import impulse, work
from runout.physics.structures import contact_gap, entry_velocity, stopping_impulse
from runout.physics.substeps import moved_gap
from runout.physics.tensors import dot, real, vec

LEAST_MASS = 1e-37  # [kg] of a node that moves, as in particles_to_grid
record = None  # makes a record of the numbers of the law of friction; the binding decides


def _has_contacts(down, count, q):
    """Whether any contact gives to a node block."""
    for d in range(8):
        m = down[q, d]
        if m >= 0 and count[m] > 0:
            return True
    return False


def _sum_at(down, count, shares, q, x, y, z):
    """Sum of the shares at node (x, y, z) of a node block: weight and impulse."""
    w = real(0.0)
    sx = real(0.0)
    sy = real(0.0)
    sz = real(0.0)
    for d in range(8):
        m = down[q, d]
        i = x + (d & 4)
        j = y + ((d & 2) << 1)
        k = z + ((d & 1) << 2)
        if m >= 0 and count[m] > 0 and i < 6 and j < 6 and k < 6:
            n = 36 * i + 6 * j + k
            w += shares[m, n, 0]
            sx += shares[m, n, 1]
            sy += shares[m, n, 2]
            sz += shares[m, n, 3]
    return w, sx, sy, sz


def _inverse_mass(grid, n, a):
    """Inverse mass [1/kg] of node ``a`` of a node block: kept where contacts with the ground took the place of the mass."""
    if grid.shared[n]:
        return grid.inverse[n, a]
    mass = grid.nodes[n, 4 * a]
    return real(1.0) / mass if mass > real(LEAST_MASS) else real(0.0)


def _add_shares(near, touching, grid, q, first):
    """Add the impulses of all shares to the velocities of a node block; the ``first`` time note compliance and inverse mass."""
    compliance, inverse, nodes = touching.compliance, touching.inverse, grid.nodes
    n = near.nodes[q]
    for a in range(64):
        w, x, y, z = _sum_at(near.down, touching.number, touching.shares, q, a >> 4, (a >> 2) & 3, a & 3)
        if first:
            inverse[q, a] = _inverse_mass(grid, n, a)
            compliance[q, a] = w * inverse[q, a]
        nodes[n, 4 * a + 1] += inverse[q, a] * x
        nodes[n, 4 * a + 2] += inverse[q, a] * y
        nodes[n, 4 * a + 3] += inverse[q, a] * z


def share_structure_contacts(near, touching, grid):
    """Compliance and inverse mass of the nodes that contacts reach; their velocities get the impulses of the step before."""
    for q in prange(len(near.nodes)):
        if _has_contacts(near.down, touching.number, q):
            _add_shares(near, touching, grid, q, True)


def push_from_structures(near, touching, grid):
    """Add the impulses of the shares to the velocities of the nodes."""
    for q in prange(len(near.nodes)):
        if _has_contacts(near.down, touching.number, q):
            _add_shares(near, touching, grid, q, False)


def _meet(near, touching, grid, m, c, w):
    """Compliance [1/kg], and the velocity [m/s] that the grid gives, of a contact in cell ``c`` of a near block."""
    wx, wy, wz = w
    shared = real(0.0)
    ux = real(0.0)
    uy = real(0.0)
    uz = real(0.0)
    for i in range(3):
        x = (np.int64(c) >> 4) + i
        for j in range(3):
            y = ((np.int64(c) >> 2) & 3) + j
            for k in range(3):
                z = (np.int64(c) & 3) + k
                q = near.up[m, (x >> 2) * 4 + (y >> 2) * 2 + (z >> 2)]
                a = ((x & 3) << 4) | ((y & 3) << 2) | (z & 3)
                o = near.nodes[q]
                s = wx[i] * wy[j] * wz[k]
                shared += s * touching.compliance[q, a]
                ux += s * grid.nodes[o, 4 * a + 1]
                uy += s * grid.nodes[o, 4 * a + 2]
                uz += s * grid.nodes[o, 4 * a + 3]
    return shared, vec(ux, uy, uz)


def _normal_and_before(measured, r):
    n = vec(measured[r, NORMAL], measured[r, NORMAL + 1], measured[r, NORMAL + 2])
    return n, vec(measured[r, BEFORE], measured[r, BEFORE + 1], measured[r, BEFORE + 2])


def _solve_block(particles, near, touching, grid, field, m, dt, force, stamp):
    """Impulses on the contacts of a near block; its share holds their changes."""
    given, push, measured, share = touching.given, touching.push, touching.measured, touching.shares[m]
    for r in range(touching.place[m], touching.place[m] + touching.number[m]):
        p = np.int64(particles.order[touching.entry[r]])
        w, c, weight = particles.particle_index[p], particles.cell[p], _weights_of(particles.rec, p)
        shared, u = _meet(near, touching, grid, m, c, weight)
        n, before = _normal_and_before(measured, r)
        begun = vec(given[r, 1], given[r, 2], given[r, 3])
        basal = record(field.friction[particles.label[w, 0], touching.patch[r]])
        j = impulse(u, n, measured[r, GAP], shared, basal, dt, begun, real(0.0))
        push[r, 0] = work(j, begun, before, u, shared)
        force[w, 0] = stamp
        for k in range(3):
            push[r, 1 + k] = j[k]
            force[w, 1 + k] = j[k] / dt
        if r == touching.place[m]:
            _clear_share(share)
        _spread(share, c, weight, real(0.0), j[0] - begun[0], j[1] - begun[1], j[2] - begun[2])


def solve_structure_contacts(particles, near, touching, grid, field, dt, force, stamp):
    """Solve for one impulse per contact; ``force`` gets the ``stamp`` of this step and the force of the structures."""
    for m in prange(len(near.owners)):
        if touching.number[m] > 0:
            _solve_block(particles, near, touching, grid, field, m, dt, force, stamp)


def _follow_block(particles, near, touching, grid, m, dt, force):
    """Move the contacts of a near block on; its share holds their weights and the impulses of the substep before."""
    given, measured, share = touching.given, touching.measured, touching.shares[m]
    _clear_share(share)
    for r in range(touching.place[m], touching.place[m] + touching.number[m]):
        p = np.int64(particles.order[touching.entry[r]])
        w, c, weight = particles.particle_index[p], particles.cell[p], _weights_of(particles.rec, p)
        _, v = _meet(near, touching, grid, m, c, weight)
        n, _ = _normal_and_before(measured, r)
        measured[r, DISTANCE] = moved_gap(measured[r, DISTANCE], n, vec(dt * v[0], dt * v[1], dt * v[2]))
        measured[r, GAP] = contact_gap(measured[r, DISTANCE], _radius_of(particles, w))
        for k in range(3):
            measured[r, BEFORE + k] = v[k]
            given[r, 1 + k] = dt * force[w, 1 + k]
        _spread(share, c, weight, real(1.0), given[r, 1], given[r, 2], given[r, 3])


def follow_structure_contacts(particles, near, touching, grid, dt, force):
    """Move the contacts on with the velocities that the nodes hold after a substep; they start from the ``force`` of it."""
    for m in prange(len(near.owners)):
        if touching.number[m] > 0:
            _follow_block(particles, near, touching, grid, m, dt, force)


def _find_entering_block(particles, near, touching, grid, m, dt, band):
    """Mark the contacts of a near block whose centres would enter a structure, with weights in its share; returns how many."""
    given, measured, share = touching.given, touching.measured, touching.shares[m]
    none = real(0.0)
    entering = 0
    _clear_share(share)
    for r in range(touching.place[m], touching.place[m] + touching.number[m]):
        p = np.int64(particles.order[touching.entry[r]])
        c, weight = particles.cell[p], _weights_of(particles.rec, p)
        _, u = _meet(near, touching, grid, m, c, weight)
        n, _ = _normal_and_before(measured, r)
        given[r, 0] = none
        if dot(u, n) < entry_velocity(measured[r, DISTANCE], dt, band):
            given[r, 0] = real(1.0)
            entering += 1
            _spread(share, c, weight, real(1.0), none, none, none)
    return entering


def find_entering(particles, near, touching, grid, dt, band, entering):
    """Mark the contacts whose centres would still enter a structure within the step; returns how many."""
    for m in prange(len(near.owners)):
        entering[m] = _find_entering_block(particles, near, touching, grid, m, dt, band) if touching.number[m] > 0 else 0
    total = 0
    for m in range(len(near.owners)):
        total += entering[m]
    return total


def _stop_block(particles, near, touching, grid, m, dt, band):
    """Impulses on the marked contacts of a near block, in its share too; none on the others."""
    given, push, measured, share = touching.given, touching.push, touching.measured, touching.shares[m]
    none = vec(real(0.0), real(0.0), real(0.0))
    _clear_share(share)
    for r in range(touching.place[m], touching.place[m] + touching.number[m]):
        for k in range(4):
            push[r, k] = real(0.0)
        if given[r, 0] == real(0.0):
            continue
        p = np.int64(particles.order[touching.entry[r]])
        c, weight = particles.cell[p], _weights_of(particles.rec, p)
        shared, u = _meet(near, touching, grid, m, c, weight)
        n, before = _normal_and_before(measured, r)
        j = stopping_impulse(dot(u, n), entry_velocity(measured[r, DISTANCE], dt, band), shared)
        stop = vec(j * n[0], j * n[1], j * n[2])
        push[r, 0] = work(stop, none, before, u, shared)
        for k in range(3):
            push[r, 1 + k] = stop[k]
        _spread(share, c, weight, real(0.0), stop[0], stop[1], stop[2])


def stop_entering(particles, near, touching, grid, dt, band):
    """Impulses on the contacts that are marked."""
    for m in prange(len(near.owners)):
        if touching.number[m] > 0:
            _stop_block(particles, near, touching, grid, m, dt, band)


def book_structures(touching, impulses):
    """Add the impulses on the structures to ``impulses`` (patches, 3) [N s], row by row; returns the work [J] that they took."""
    place, number, push, patch = touching.place, touching.number, touching.push, touching.patch
    taken = 0.0
    for m in range(len(number)):
        for r in range(place[m], place[m] + number[m]):
            taken -= np.float64(push[r, 0])
            for k in range(3):
                impulses[patch[r], k] -= np.float64(push[r, 1 + k])
    return taken
