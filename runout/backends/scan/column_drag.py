"""Drag that slows whole columns of nodes, for laws of friction that want it (:func:`runout.physics.contact.column_slowing`).

    moving[b, 64], pushed[b, 64]   mass and momentum of the columns of nodes of block b, and drag and impulses of its contacts
      --sum over the blocks of a column, transpose-->
    plans[c, :, n]                 mass | momentum | drag | work, of 16 columns of nodes
      --drag where no contact gives one, by the masses of the 3 x 3 columns around-->
      --change of velocity, transpose-->
    changes[c, 64]                 0 | change of the velocity of all nodes of a column

A column without drag from contacts is in flight (:func:`runout.physics.contact.free_column_drag`). It takes the friction of each
release by its share in the mass of the column.

The changes are added where particles gather velocities (``grid_to_particles``); or to the nodes before, where other kernels read
these, :func:`change_nodes`.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import (
    in_double,
    lane_sum,
    load4,
    load8,
    load16,
    local_array,
    record_vectors,
    row_vectors,
    store,
)
from runout.backends.scan.ground import _kind_at
from runout.backends.scan.particles_to_grid import PLAN, lower_half
from runout.backends.scan.stencil import PLANE, ROW, UPPER, repeated, zeros
from runout.physics.bspline import weights
from runout.physics.contact import column_slowing, column_work, covered_share, free_column_drag
from runout.physics.tensors import real, vec

DRAG, WORK = 4, 5  # rows of a plan, after mass and momentum
ROWS = 6 * PLAN  # numbers of a plan
HALO = 6  # columns of nodes along an axis, with one around those of a block
local_numbers = local_array((4 * PLAN,))
local_masses = local_array((HALO * HALO,))
load_columns, store_columns = record_vectors(4)
load_4_rows, store_4_rows = row_vectors(4, PLAN)


def _transposed(numbers, a, b, c, d):
    """Vectors of the four numbers of 16 columns, from the numbers of one column after the other; ``numbers`` is scratch."""
    store(numbers, 0, a)
    store(numbers, 16, b)
    store(numbers, 32, c)
    store(numbers, 48, d)
    return load_columns(numbers, 0)


def _sum_blocks(shared, columns, c):
    """Fill mass, momentum and drag in the plan of block column ``c``; returns whether it holds any mass."""
    moving, pushed, filled, start, parts = columns.moving, columns.pushed, columns.filled, columns.start, columns.parts
    s0 = s1 = s2 = s3 = p0 = p1 = p2 = p3 = zeros(moving)
    found = False
    for e in range(start[c], start[c + 1]):
        b = np.int64(parts[e])
        if filled[b]:
            found = True
            o = 4 * PLAN * b
            s0 = s0 + load16(moving, o)
            s1 = s1 + load16(moving, o + 16)
            s2 = s2 + load16(moving, o + 32)
            s3 = s3 + load16(moving, o + 48)
            if shared[b]:
                p0 = p0 + load16(pushed, o)
                p1 = p1 + load16(pushed, o + 16)
                p2 = p2 + load16(pushed, o + 32)
                p3 = p3 + load16(pushed, o + 48)
    numbers = local_numbers(moving)
    mass, x, y, z = _transposed(numbers, s0, s1, s2, s3)
    drag, more_x, more_y, more_z = _transposed(numbers, p0, p1, p2, p3)
    store_4_rows(columns.plans, ROWS * c, (mass, x + more_x, y + more_y, z + more_z))
    store(columns.plans, ROWS * c + DRAG * PLAN, drag)
    return found


def _any_free(plans, c):
    """Whether a column of nodes of block column ``c`` has mass and no drag."""
    for n in range(PLAN):
        if plans[c, 0, n] > real(0.0) and plans[c, DRAG, n] <= real(0.0):
            return True
    return False


def _load_masses(masses, columns, c):
    """Masses of the columns of nodes of a block column, and of one around them."""
    for x in range(HALO):
        for y in range(HALO):
            other = np.int64(columns.beside[c, 3 * ((x + 3) >> 2) + ((y + 3) >> 2)])
            masses[HALO * x + y] = columns.plans[other, 0, 4 * ((x + 3) & 3) + ((y + 3) & 3)]


def _covered_area(masses, plan_area, n):
    """Area [m2] in plan of column ``n``, from the masses around."""
    first = HALO * (n >> 2) + (n & 3)
    around = real(0.0)
    squares = real(0.0)
    for i in range(3):
        for j in range(3):
            m = masses[first + HALO * i + j]
            around += m
            squares += m * m
    return plan_area * covered_share(masses[first + HALO + 1], around, squares)


def _kind_of_ground(bxyz, b, n, free, constants):
    """Kind of ground at column ``n`` of the nodes of block ``b``."""
    x = np.float64(constants.corner[0] + 4 * np.int64(bxyz[b, 0]) + (n >> 2)) * constants.spacing[0]
    y = np.float64(constants.corner[1] + 4 * np.int64(bxyz[b, 1]) + (n & 3)) * constants.spacing[1]
    return _kind_at(x, y, free.cell_size, free.kind)


def _add_free_drag(masses, bxyz, columns, free, constants, c, dt):
    """Fill the drag of the columns of nodes in flight."""
    plans, shares, b = columns.plans, columns.shares, np.int64(columns.parts[columns.start[c]])
    _load_masses(masses, columns, c)
    for n in range(PLAN):
        mass = plans[c, 0, n]
        if mass > real(0.0) and plans[c, DRAG, n] <= real(0.0):
            area = _covered_area(masses, columns.plan_area, n)
            kind = _kind_of_ground(bxyz, b, n, free, constants)
            momentum = vec(plans[c, 1, n], plans[c, 2, n], plans[c, 3, n])
            drag = real(0.0)
            for r in range(shares.shape[2]):
                if shares[c, n, r] > real(0.0):
                    drag += shares[c, n, r] * free_column_drag(mass, momentum, area, free.gravity, dt, free.basal[r, kind])
            plans[c, DRAG, n] = drag


def _slow(plans, c, dt):
    """Replace the momentum of each column by the change of its velocity, and fill the row of work."""
    for n in range(np.uint64(PLAN)):
        m = plans[c, 0, n]
        p = vec(plans[c, 1, n], plans[c, 2, n], plans[c, 3, n])
        change = column_slowing(m if m > real(0.0) else real(1.0), p, plans[c, DRAG, n], dt)
        plans[c, WORK, n] = column_work(m, p, change)
        plans[c, 1, n] = change[0]
        plans[c, 2, n] = change[1]
        plans[c, 3, n] = change[2]


def _keep(columns, c):
    """Keep the changes of block column ``c``, and book work and impulse."""
    mass, x, y, z = load_4_rows(columns.plans, ROWS * c)
    store_columns(columns.changes, 4 * PLAN * c, (zeros(mass), x, y, z))
    columns.booked[c, 0] = lane_sum(in_double(load16(columns.plans, ROWS * c + WORK * PLAN)))
    columns.booked[c, 1] = lane_sum(in_double(mass * x))
    columns.booked[c, 2] = lane_sum(in_double(mass * y))
    columns.booked[c, 3] = lane_sum(in_double(mass * z))


def slow_columns(blocks, shared, columns, free, constants, dt, total):
    """Changes of velocity by the drag on the columns of nodes; adds work [J] and impulse [N s] to ``total`` (4,).

    ``shared`` are the blocks that contacts reach, ``free`` is what mass in flight takes.
    """
    slowed = columns.slowed
    booked = columns.booked
    for c in prange(len(slowed)):
        slowed[c] = _sum_blocks(shared, columns, np.int64(c))
    for c in prange(len(slowed)):
        if slowed[c]:
            if _any_free(columns.plans, np.int64(c)):
                masses = local_masses(columns.moving)
                _add_free_drag(masses, blocks.bxyz, columns, free, constants, np.int64(c), dt)
            _slow(columns.plans, np.int64(c), dt)
            _keep(columns, np.int64(c))
    for c in range(len(slowed)):
        if slowed[c]:
            for i in range(4):
                total[i] += booked[c, i]


def _mass_of(columns, nown, c, n, r):
    """Mass [kg] of a release in column ``n`` of the nodes of block column ``c``."""
    masses, start, parts = columns.masses, columns.start, columns.parts
    total = 0.0
    for q in range(4):
        x = (n >> 2) + 4 * (1 - (q >> 1))
        y = (n & 3) + 4 * (1 - (q & 1))
        other = np.int64(columns.beside[c, 3 * (q >> 1) + (q & 1)])
        if x < HALO and y < HALO and other < len(columns.shares):
            for e in range(start[other], start[other + 1]):
                if parts[e] < nown:
                    total += masses[parts[e], HALO * x + y, r]
    return total


def _share_column(columns, nown, c):
    """Shares of the releases in the columns of nodes of block column ``c``."""
    shares = columns.shares
    for n in range(PLAN):
        total = real(0.0)
        for r in range(shares.shape[2]):
            shares[c, n, r] = real(_mass_of(columns, nown, c, n, r))
            total += shares[c, n, r]
        for r in range(shares.shape[2]):
            shares[c, n, r] = shares[c, n, r] / total if total > real(0.0) else real(0.0)


def _weigh_releases(particles, starts, first, masses, b):
    """Mass that the releases in block ``b`` give to columns of nodes."""
    rec, order = particles.rec, particles.order
    for n in range(HALO * HALO):
        for r in range(masses.shape[2]):
            masses[b, n, r] = 0.0
    for cell in range(64):
        o = HALO * (cell >> 4) + ((cell >> 2) & 3)
        for t in range(starts[b, cell], starts[b, cell + 1]):
            p = order[first[b] + t]
            r = particles.label[particles.particle_index[p], 0]
            x = weights(rec[p, 4])
            y = weights(rec[p, 8])
            for i in range(3):
                for j in range(3):
                    masses[b, o + HALO * i + j, r] += np.float64(rec[p, 0] * x[i] * y[j])


def share_releases(particles, blocks, columns):
    """Fill the shares of the releases, whose friction differs."""
    starts, first = blocks.starts, blocks.first
    for b in prange(len(columns.masses)):
        _weigh_releases(particles, starts, first, columns.masses, np.int64(b))
    for c in prange(len(columns.shares) if len(columns.masses) else 0):
        _share_column(columns, blocks.nown, np.int64(c))


def change_nodes(columns, nodes):
    """Add the changes of velocity to the nodes of all blocks that particles reach."""
    filled, slowed, of_block = columns.filled, columns.slowed, columns.of_block
    for b in prange(len(filled)):
        c = np.int64(of_block[b])
        if filled[b] and slowed[c]:
            for n in range(PLAN):
                o = 256 * np.int64(b) + 16 * n
                store(nodes, o, load16(nodes, o) + repeated(load4(columns.changes, 4 * (PLAN * c + n))))


def _add_changes(nodes, columns, up, b, parts):
    """Add the changes of velocity to the nodes that block ``b`` has loaded, as :func:`stencil._load_nodes` does."""
    above = parts & UPPER != 0
    for q in range(0, 8, 2):
        east, north = q & 4, (q & 2) << 1
        c = np.int64(columns.of_block[up[b, q]])
        if columns.slowed[c]:
            for i in range(min(4, 6 - east)):
                for j in range(min(4, 6 - north)):
                    change = repeated(load4(columns.changes, 4 * (PLAN * c + 4 * i + j)))
                    a = (east + i) * PLANE + (north + j) * ROW
                    store(nodes, a, load16(nodes, a) + change)
                    if above:
                        store(nodes, a + 16, load8(nodes, a + 16) + lower_half(change))
