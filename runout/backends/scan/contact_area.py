"""Ground area of the contacts, for laws of friction that use it (:func:`runout.physics.contact.area_share`).

Contacts share the columns of nodes in plan (:mod:`runout.backends.scan.node_columns`).

    weights[b, 16]                  weights of the contacts in the columns of nodes of block b      (particles to grid)
      --sum over the blocks of a column-->
    sums[c, 16], inverse[c, 16]     weights of all contacts in each column of nodes, and their reciprocals
      --gather, in the contact solution-->
    given[r, 0]                     area [m2] of contact r
"""

import numpy as np
from numba import prange

from runout.backends.lanes import lane_sum, load4, load16, local_array, store
from runout.backends.scan.contact_detection import three_ones
from runout.backends.scan.particles_to_grid import PLAN
from runout.backends.scan.stencil import ones, zeros
from runout.physics.contact import area_share, ground_area, largest_share

SIDE = 6  # columns of nodes along an axis that the contacts of a block reach
AREA = SIDE * SIDE + 4  # numbers of a plan: the columns of nodes, and room for the vector that starts at the last ones
local_plan = local_array((2 * AREA,))


def sum_columns(shared, columns):
    """Fill the sums of the weights of all contacts in each column of nodes; ``shared`` are the blocks that they reach."""
    weights, start, parts = columns.weights, columns.start, columns.parts
    sums = columns.sums
    inverse = columns.inverse
    for c in prange(len(sums)):
        s = zeros(weights)
        for e in range(start[c], start[c + 1]):
            if shared[parts[e]]:
                s = s + load16(weights, PLAN * np.int64(parts[e]))
        store(sums, PLAN * np.int64(c), s)
        store(inverse, PLAN * np.int64(c), ones(s) / s)


def _load_plan(plan, columns, up, b):
    """Load the sums, and then their reciprocals, of the 6 x 6 columns of nodes that the contacts of a block reach."""
    for i in range(SIDE):
        for north in range(2):
            c = np.int64(columns.of_block[up[b, 4 * (i >> 2) + 2 * north]])
            o = PLAN * c + 4 * (i & 3)
            p = SIDE * i + 4 * north
            store(plan, p, load4(columns.sums, o))
            store(plan, AREA + p, load4(columns.inverse, o))


def _area(plan, cell, ready, w, plan_area, upward):
    """Ground area [m2] of a contact in a cell of its block; its weights are at place ``w`` of ``ready``."""
    o = SIDE * (cell >> 4) + ((cell >> 2) & 3)
    y = load4(ready, w + np.uint64(8)) * three_ones(ready)
    x0 = ready[w + np.uint64(4)]
    x1 = ready[w + np.uint64(5)]
    x2 = ready[w + np.uint64(6)]
    around = (x0 * load4(plan, o) + x1 * load4(plan, o + SIDE)) + x2 * load4(plan, o + 2 * SIDE)
    largest = largest_share(lane_sum(around * y))
    o += AREA
    low = area_share(x0 * y, load4(plan, o), largest) + area_share(x1 * y, load4(plan, o + SIDE), largest)
    return ground_area(plan_area, lane_sum(low + area_share(x2 * y, load4(plan, o + 2 * SIDE), largest)), upward)
