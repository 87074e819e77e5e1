"""Drag that slows whole columns of nodes, for laws of friction that want it (:func:`runout.physics.contact.column_slowing`).

    moving[b, 64], pushed[b, 64]   mass and momentum of the columns of nodes of block b, and drag and impulses of its contacts
      --sum over the blocks of a column, transpose-->
    plan[:, n]                     mass | momentum | drag | work, of 16 columns of nodes
      --change of velocity, transpose-->
    changes[c, 64]                 0 | change of the velocity of all nodes of a column

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
from runout.backends.scan.particles_to_grid import PLAN, lower_half
from runout.backends.scan.stencil import PLANE, ROW, UPPER, repeated, zeros
from runout.physics.contact import column_slowing, column_work
from runout.physics.tensors import real, vec

DRAG, WORK = 4, 5  # rows of a plan, after mass and momentum
local_numbers = local_array((4 * PLAN,))
local_plan = local_array((6, PLAN))
load_columns, store_columns = record_vectors(4)
load_4_rows, store_4_rows = row_vectors(4, PLAN)


def _transposed(numbers, a, b, c, d):
    """Vectors of the four numbers of 16 columns, from the numbers of one column after the other; ``numbers`` is scratch."""
    store(numbers, 0, a)
    store(numbers, 16, b)
    store(numbers, 32, c)
    store(numbers, 48, d)
    return load_columns(numbers, 0)


def _sum_blocks(plan, shared, columns, c):
    """Fill the rows of mass, momentum and drag of a plan; returns whether any contact reaches block column ``c``."""
    moving, pushed, filled, start, parts = columns.moving, columns.pushed, columns.filled, columns.start, columns.parts
    s0 = s1 = s2 = s3 = p0 = p1 = p2 = p3 = zeros(moving)
    touched = False
    for e in range(start[c], start[c + 1]):
        b = np.int64(parts[e])
        if filled[b]:
            o = 4 * PLAN * b
            s0 = s0 + load16(moving, o)
            s1 = s1 + load16(moving, o + 16)
            s2 = s2 + load16(moving, o + 32)
            s3 = s3 + load16(moving, o + 48)
            if shared[b]:
                touched = True
                p0 = p0 + load16(pushed, o)
                p1 = p1 + load16(pushed, o + 16)
                p2 = p2 + load16(pushed, o + 32)
                p3 = p3 + load16(pushed, o + 48)
    if touched:
        numbers = local_numbers(moving)
        mass, x, y, z = _transposed(numbers, s0, s1, s2, s3)
        drag, more_x, more_y, more_z = _transposed(numbers, p0, p1, p2, p3)
        store_4_rows(plan, 0, (mass, x + more_x, y + more_y, z + more_z))
        store(plan, DRAG * PLAN, drag)
    return touched


def _slow(plan, dt):
    """Replace the momentum of each column by the change of its velocity, and fill the row of work."""
    for n in range(np.uint64(PLAN)):
        m = plan[0, n]
        p = vec(plan[1, n], plan[2, n], plan[3, n])
        change = column_slowing(m if m > real(0.0) else real(1.0), p, plan[DRAG, n], dt)
        plan[WORK, n] = column_work(m, p, change)
        plan[1, n] = change[0]
        plan[2, n] = change[1]
        plan[3, n] = change[2]


def _keep(plan, columns, c):
    """Keep the changes of block column ``c``, and book work and impulse."""
    mass, x, y, z = load_4_rows(plan, 0)
    store_columns(columns.changes, 4 * PLAN * c, (zeros(mass), x, y, z))
    columns.booked[c, 0] = lane_sum(in_double(load16(plan, WORK * PLAN)))
    columns.booked[c, 1] = lane_sum(in_double(mass * x))
    columns.booked[c, 2] = lane_sum(in_double(mass * y))
    columns.booked[c, 3] = lane_sum(in_double(mass * z))


def slow_columns(shared, columns, dt, total):
    """Changes of velocity by the drag on the columns of nodes; adds work [J] and impulse [N s] to ``total`` (4,).

    ``shared`` are the blocks that contacts reach.
    """
    slowed = columns.slowed
    booked = columns.booked
    for c in prange(len(slowed)):
        plan = local_plan(columns.moving)
        slowed[c] = _sum_blocks(plan, shared, columns, np.int64(c))
        if slowed[c]:
            _slow(plan, dt)
            _keep(plan, columns, np.int64(c))
    for c in range(len(slowed)):
        if slowed[c]:
            for i in range(4):
                total[i] += booked[c, i]


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
