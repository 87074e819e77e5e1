"""Phase "contact with structures", first half: the particles that touch structures.

Only blocks near structures take part. Each fills a share of its own, and each node sums the up to eight shares that reach it in a
fixed order, so that the bits do not depend on the number of threads. The loops are plain: few particles touch structures.

    find_structure_contacts    rows[r]   weight | impulse of the step before  --scatter-->  shares[near block]

:mod:`runout.backends.scan.structure_solution` goes on.
"""

import math

import numpy as np
from numba import prange

from runout.physics.bspline import weights
from runout.physics.contact import in_contact
from runout.physics.moments import momentum_at
from runout.physics.structures import (
    contact_gap,
    faces_more,
    is_closer,
    lattice_block,
    lattice_place,
    nearest_place,
    outward_normal,
    separation,
    separation_slopes,
)
from runout.physics.tensors import dot, real, vec

DIAGONAL = 1.75  # of a lattice cell, a little more than its length in cells; distances differ at most by it
NORMAL, GAP, BEFORE, DISTANCE = 0, 3, 4, 7  # columns of what is measured


def _lattice_position(constants, bxyz, b, c, rec, p, field, axis):
    """Place of a particle in cells of the lattice along one axis."""
    node = constants.corner[axis] + 4 * np.int64(bxyz[b, axis]) + ((np.int64(c) >> (4 - 2 * axis)) & 3)
    x = (node + np.float64(rec[p, 4 + 4 * axis])) * constants.spacing[axis]
    return (x - field.origin[axis]) / field.spacing[0]


def _row_of_block(blocks, i, j, k):
    """Row of the block of the lattice that a cell lies in; -1 where there is none."""
    a = lattice_block(i)
    b = lattice_block(j)
    c = lattice_block(k)
    if a < 0 or b < 0 or c < 0 or a >= blocks.shape[0] or b >= blocks.shape[1] or c >= blocks.shape[2]:
        return np.int64(-1)
    return np.int64(blocks[a, b, c])


def _corners(d, a):
    """Distances at the nodes of the cell whose first one is at place ``a``."""
    return (
        real(d[a]), real(d[a + 1]), real(d[a + 9]), real(d[a + 10]),
        real(d[a + 81]), real(d[a + 82]), real(d[a + 90]), real(d[a + 91]),
    )  # fmt: skip


def _velocity(rec, p):
    """Velocity [m/s] of a particle from its record."""
    r = rec[p]
    to_particle = vec(r[4] - real(1.0), r[8] - real(1.0), r[12] - real(1.0))
    here, ax, ay, az = vec(r[1], r[2], r[3]), vec(r[5], r[6], r[7]), vec(r[9], r[10], r[11]), vec(r[13], r[14], r[15])
    x, y, z = momentum_at(here, ax, ay, az, to_particle)
    m = real(1.0) / r[0]
    return vec(m * x, m * y, m * z)


def _weights_of(rec, p):
    """Weights of a particle along each axis."""
    return weights(rec[p, 4]), weights(rec[p, 8]), weights(rec[p, 12])


def _radius_of(particles, w):
    """Touching radius [m] of the particle with index ``w``."""
    return particles.radius[w] if len(particles.radius) > 1 else particles.radius[0]


def _plane(field, k, x, y, z):
    """Distance [m] of a point from the plane of a patch, and its normal."""
    centre = field.centre
    away = vec(real(x - centre[k, 0]), real(y - centre[k, 1]), real(z - centre[k, 2]))
    normal = vec(field.normal[k, 0], field.normal[k, 1], field.normal[k, 2])
    return dot(away, normal) * real(field.spacing[0]), normal


def _take_patch(field, row, place, x, y, z, distance, n, patch):
    """Distance [m], normal and patch that faces the contact most; where ``distance`` is cut short, those of the closest plane.

    ``x``, ``y``, ``z`` are in cells of the lattice.
    """
    spacing = real(field.spacing[0])
    closest = patch
    least, normal = _plane(field, patch, x, y, z)
    most = dot(normal, n)
    for q in range(8):
        k = np.int64(field.patch[row, place + 81 * (q >> 2) + 9 * ((q >> 1) & 1) + (q & 1)])
        if k in (closest, patch):
            continue
        plane, facing = _plane(field, k, x, y, z)
        if is_closer(plane, least, spacing):
            least = plane
            normal = facing
            closest = k
        if faces_more(dot(facing, n), most):
            most = dot(facing, n)
            patch = k
    if is_closer(distance, least, spacing):
        return least, normal, closest
    return distance, n, patch


def _measure(particles, b, p, blocks, field, touching, r, constants, search):
    """Fill row ``r`` for a particle; returns whether it touches; ``search`` is as for :func:`find_structure_contacts`."""
    lasting, band, reach, _ = search
    rec, c, w = particles.rec, particles.cell[p], particles.particle_index[p]
    x = _lattice_position(constants, blocks.bxyz, b, c, rec, p, field, 0)
    y = _lattice_position(constants, blocks.bxyz, b, c, rec, p, field, 1)
    z = _lattice_position(constants, blocks.bxyz, b, c, rec, p, field, 2)
    i = np.int64(math.floor(x))
    j = np.int64(math.floor(y))
    k = np.int64(math.floor(z))
    row = _row_of_block(field.blocks, i, j, k)
    if row < 0:
        return False
    place = lattice_place(i, j, k)
    if field.distance[row, place] > reach + real(DIAGONAL * field.spacing[0]):
        return False
    fx = real(x - i)
    fy = real(y - j)
    fz = real(z - k)
    eight = _corners(field.distance[row], place)
    distance = separation(eight, fx, fy, fz)
    if distance > reach:
        return False
    n = outward_normal(separation_slopes(eight, fx, fy, fz))
    radius = _radius_of(particles, w)
    v = _velocity(rec, p)
    if not in_contact(contact_gap(distance, radius), dot(v, n), lasting, band):
        return False
    patch = np.int64(field.patch[row, nearest_place(place, fx, fy, fz)])
    distance, n, patch = _take_patch(field, row, place, x, y, z, distance, n, patch)
    gap = contact_gap(distance, radius)
    touching.patch[r] = patch
    measured = touching.measured
    for a in range(3):
        measured[r, NORMAL + a] = n[a]
        measured[r, BEFORE + a] = v[a]
    measured[r, GAP] = gap
    measured[r, DISTANCE] = distance
    return in_contact(gap, dot(v, n), lasting, band)


def _clear_share(share):
    for n in range(216):
        for k in range(4):
            share[n, k] = real(0.0)


def _spread(share, c, w, weight, x, y, z):
    """Add a contact in cell ``c`` to the share of its block: ``weight`` and impulse, by its weights ``w``."""
    wx, wy, wz = w
    o = (np.int64(c) >> 4) * 36 + ((np.int64(c) >> 2) & 3) * 6 + (np.int64(c) & 3)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                s = wx[i] * wy[j] * wz[k]
                n = o + 36 * i + 6 * j + k
                share[n, 0] += s * weight
                share[n, 1] += s * x
                share[n, 2] += s * y
                share[n, 3] += s * z


def _find_in_block(particles, blocks, b, field, touching, m, constants, search, force, last):
    """List the particles of a block that touch structures, and start its share with the forces of the step before."""
    order, first, share, given = particles.order, blocks.first[b], touching.shares[m], touching.given
    r = touching.place[m]
    for t in range(first, first + blocks.held[b]):
        p = np.int64(order[t])
        if not _measure(particles, b, p, blocks, field, touching, r, constants, search):
            continue
        if r == touching.place[m]:
            _clear_share(share)
        touching.entry[r] = t
        w = particles.particle_index[p]
        lasting = search[3] if force[w, 0] == last else real(0.0)
        for k in range(1, 4):
            given[r, k] = lasting * force[w, k]
        _spread(share, particles.cell[p], _weights_of(particles.rec, p), real(1.0), given[r, 1], given[r, 2], given[r, 3])
        r += 1
    return r - touching.place[m]


def find_structure_contacts(particles, blocks, near, field, touching, constants, search, force, last):
    """List the particles of near blocks that touch structures; returns how many.

    ``search`` are the time [s] within which they touch, the width of the band of contact and the distance [m] beyond which no
    particle can touch, and the length of a substep [s]. ``last`` is the stamp of the step before, whose forces still hold.
    """
    number = touching.number
    for m in prange(len(near.owners)):
        number[m] = _find_in_block(particles, blocks, near.owners[m], field, touching, m, constants, search, force, last)
    total = 0
    for m in range(len(near.owners)):
        total += number[m]
    return total
