"""Phase "contact with structures", second half: impulses on the particles that touch structures, after those of the ground.

One kernel solves the contacts. Its rounds differ in what a contact adds to the share of its block, and all sum the shares alike:

    SOLVE     shares          --sum, times inverse mass-->  compliance, inverse, grid.nodes
              grid.nodes, compliance  --gather, impulse-->  push[r]    push - given  --scatter-->  shares
    ENTER     shares          --sum, times inverse mass-->  grid.nodes
              grid.nodes  --gather-->  the rows that would still enter: 1 | -  --scatter-->  shares
    STOP      as SOLVE, with the impulse that stops those that would enter
    FOLLOW    shares          --sum, times inverse mass-->  grid.nodes
              grid.nodes, before the next substep of a transfer  --gather-->  rows  --scatter-->  shares

    push      --sum by patch-->  impulses (patches, 3), after SOLVE and STOP
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
SOLVE, ENTER, STOP, FOLLOW = range(4)  # rounds
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


def _keep_push(push, r, j, begun, before, u, compliance):
    """Note work and impulse of a contact; returns the change of the impulse."""
    push[r, 0] = work(j, begun, before, u, compliance)
    for k in range(3):
        push[r, 1 + k] = j[k]
    return vec(j[0] - begun[0], j[1] - begun[1], j[2] - begun[2])


def _solve(touching, r, basal, u, compliance, dt, force, w, stamp):
    """Impulse on a contact; returns its change. ``force`` gets the ``stamp`` of this step and the force of the structures."""
    given, measured = touching.given, touching.measured
    n, before = _normal_and_before(measured, r)
    begun = vec(given[r, 1], given[r, 2], given[r, 3])
    j = impulse(u, n, measured[r, GAP], compliance, basal, dt, begun, real(0.0))
    force[w, 0] = stamp
    for k in range(3):
        force[w, 1 + k] = j[k] / dt
    return _keep_push(touching.push, r, j, begun, before, u, compliance)


def _stop(touching, r, u, compliance, dt, band):
    """Impulse on a contact whose centre would enter."""
    n, before = _normal_and_before(touching.measured, r)
    none = vec(real(0.0), real(0.0), real(0.0))
    j = stopping_impulse(dot(u, n), entry_velocity(touching.measured[r, DISTANCE], dt, band), compliance)
    return _keep_push(touching.push, r, vec(j * n[0], j * n[1], j * n[2]), none, before, u, compliance)


def _enters(touching, r, u, dt, band):
    """Mark a contact whose centre would still enter a structure within the step; returns whether it is one."""
    n, _ = _normal_and_before(touching.measured, r)
    enters = dot(u, n) < entry_velocity(touching.measured[r, DISTANCE], dt, band)
    touching.given[r, 0] = real(1.0) if enters else real(0.0)
    return enters


def _follow(touching, r, u, dt, force, w, radius):
    """Move a contact on with the velocity ``u`` after a substep; returns the impulse from which it starts in the next one."""
    given, measured = touching.given, touching.measured
    n, _ = _normal_and_before(measured, r)
    measured[r, DISTANCE] = moved_gap(measured[r, DISTANCE], n, vec(dt * u[0], dt * u[1], dt * u[2]))
    measured[r, GAP] = contact_gap(measured[r, DISTANCE], radius)
    for k in range(3):
        measured[r, BEFORE + k] = u[k]
        given[r, 1 + k] = dt * force[w, 1 + k]
    return vec(given[r, 1], given[r, 2], given[r, 3])


def _pass_block(particles, near, touching, grid, field, m, step, force, doing):
    """One round over the contacts of a near block, which fills its share; returns how many would enter.

    ``step`` are the time step [s], the width [m] of the band of contact and the stamp of this step.
    """
    dt, band, stamp = step
    share = touching.shares[m]
    entering = 0
    _clear_share(share)
    for r in range(touching.place[m], touching.place[m] + touching.number[m]):
        if doing == STOP and touching.given[r, 0] == real(0.0):
            for k in range(4):
                touching.push[r, k] = real(0.0)
            continue
        p = np.int64(particles.order[touching.entry[r]])
        w, c, weight = particles.particle_index[p], particles.cell[p], _weights_of(particles.rec, p)
        compliance, u = _meet(near, touching, grid, m, c, weight)
        none = real(0.0)
        if doing == SOLVE:
            basal = record(field.friction[particles.label[w, 0], touching.patch[r]])
            x = _solve(touching, r, basal, u, compliance, dt, force, w, stamp)
            _spread(share, c, weight, none, x[0], x[1], x[2])
        elif doing == ENTER:
            if _enters(touching, r, u, dt, band):
                entering += 1
                _spread(share, c, weight, real(1.0), none, none, none)
        elif doing == STOP:
            x = _stop(touching, r, u, compliance, dt, band)
            _spread(share, c, weight, none, x[0], x[1], x[2])
        else:
            x = _follow(touching, r, u, dt, force, w, _radius_of(particles, w))
            _spread(share, c, weight, real(1.0), x[0], x[1], x[2])
    return entering


def _book(touching, impulses):
    """Add the impulses on the structures to ``impulses`` (patches, 3) [N s], row by row; returns the work [J] that they took."""
    place, number, push, patch = touching.place, touching.number, touching.push, touching.patch
    taken = 0.0
    for m in range(len(number)):
        for r in range(place[m], place[m] + number[m]):
            taken -= np.float64(push[r, 0])
            for k in range(3):
                impulses[patch[r], k] -= np.float64(push[r, 1 + k])
    return taken


def push_from_structures(particles, near, touching, grid, field, step, force, impulses, taken, follows):
    """Solve for one impulse per contact, stop the particles that would still enter, and add all impulses to the nodes.

    ``step`` is as for :func:`_pass_block`; ``force`` gets the stamp of this step and the force of the structures, ``impulses``
    (patches, 3) what acts on these. If another substep ``follows``, the contacts are moved on. Returns the work [J] that the
    structures have ``taken`` since the start, and the number of particles that were stopped.
    """
    number = touching.number
    entering = touching.entering
    stopped = 0
    for doing in range(4):
        if doing == STOP and stopped == 0:
            continue
        if doing < FOLLOW or stopped > 0:
            for q in prange(len(near.nodes)):
                if _has_contacts(near.down, number, q):
                    _add_shares(near, touching, grid, q, doing in (SOLVE, STOP))
        if doing == FOLLOW and not follows:
            break
        for m in prange(len(near.owners)):
            if number[m] > 0:
                entering[m] = _pass_block(particles, near, touching, grid, field, m, step, force, doing)
        if doing == ENTER:
            for m in range(len(number)):
                stopped += entering[m] if number[m] > 0 else 0
        elif doing < FOLLOW:
            taken += _book(touching, impulses)
    return taken, stopped
