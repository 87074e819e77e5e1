"""Ground area of the contacts, for laws of friction that use it (:func:`runout.physics.contact.area_share`).

Contacts share the columns of nodes in plan. A block column is all blocks with the same coordinates east and north.

    shares[sharer[b]]               weights of the contacts of block b at 6 x 6 x 6 nodes       (contact_detection)
      --sum over z and over the blocks around, in the order of the blocks-->
    sums[c, 16], inverse[c, 16]     weights of all contacts in each column of nodes of block column c, and their reciprocals
      --gather-->
    given[r, 0]                     area [m2] of contact r; the kernel of the contact solution replaces it by work

Threads take block columns, then blocks; no sum is shared, so that the bits do not depend on the number of threads.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from runout.backends.lanes import local_array
from runout.backends.scan.contact_detection import NORMAL
from runout.backends.scan.groups import Blocks
from runout.backends.scan.particles_to_grid import PLANE_OF_SHARES, ROW_OF_SHARES, SHARES
from runout.physics.bspline import weights
from runout.physics.contact import area_share, ground_area, largest_share
from runout.physics.tensors import real

PLAN = 6  # columns of nodes along an axis that the contacts of a block reach
ABOVE = (0, 2, 4, 6)  # of Blocks.up: the block itself, and those north, east, and both
local_plan = local_array((2, PLAN * PLAN))


class Columns(NamedTuple):
    """Block columns, and the weights of all contacts in their columns of nodes.

    Attributes
    ----------
    up : (nown, 4) int32
        Column of each owner, and those north, east, and both.
    start, parts : (columns + 1,) int64, (4 nown,) int32
        4 b + q of the owners b that reach a column, which is their column q of ``up``, and where those of each column begin.
    sums, inverse : (columns, 16) real
        Sums of weights, and their reciprocals.
    """

    up: np.ndarray
    start: np.ndarray
    parts: np.ndarray
    sums: np.ndarray
    inverse: np.ndarray


def columns_of(blocks: Blocks, dtype: type) -> Columns:
    """The block columns of an index, with no sums yet."""
    places, column = np.unique(blocks.bxyz[:, :2], axis=0, return_inverse=True)
    column = column.ravel().astype(np.int32)
    up = np.ascontiguousarray(column[blocks.up[:, ABOVE]])
    order = np.argsort(up, axis=None, kind="stable")
    start = np.searchsorted(up.ravel()[order], np.arange(len(places) + 1))
    size = len(places), 16
    return Columns(up, start, order.astype(np.int32), np.zeros(size, dtype), np.zeros(size, dtype))


def _add_part(sums, c, shares, base, part):
    """Add the weights of one block at the nodes that it has in block column ``c``: its ``part`` of 4 x 4, 4 x 2, 2 x 4 or 2 x 2."""
    east = 4 * (part >> 1)
    north = 4 * (part & 1)
    for i in range(min(4, PLAN - east)):
        for j in range(min(4, PLAN - north)):
            o = base + (east + i) * PLANE_OF_SHARES + (north + j) * ROW_OF_SHARES
            low = shares[o] + shares[o + 1]  # pairs: no sum waits for the one before
            middle = shares[o + 2] + shares[o + 3]
            high = shares[o + 4] + shares[o + 5]
            sums[c, 4 * i + j] += low + middle + high


def sum_columns(contacts, columns):
    """Fill the sums of the weights of all contacts in each column of nodes."""
    shares, sharer, touching = contacts.shares.ravel(), contacts.sharer, contacts.touching
    start, parts = columns.start, columns.parts
    sums = columns.sums
    inverse = columns.inverse
    for c in prange(len(sums)):
        for n in range(16):
            sums[c, n] = real(0.0)
        for e in range(start[c], start[c + 1]):
            b = parts[e] >> 2
            if touching[b] > 0:
                _add_part(sums, c, shares, SHARES * np.int64(sharer[b]), parts[e] & 3)
        for n in range(16):
            inverse[c, n] = real(1.0) / sums[c, n]


def _load_plan(plan, columns, b):
    """Sums, and their reciprocals, of the 6 x 6 columns of nodes that the contacts of a block reach."""
    for i in range(PLAN):
        for j in range(PLAN):
            c = columns.up[b, 2 * (i >> 2) + (j >> 2)]
            n = 4 * (i & 3) + (j & 3)
            plan[0, PLAN * i + j] = columns.sums[c, n]
            plan[1, PLAN * i + j] = columns.inverse[c, n]


def _shares_of_contact(plan, o, wx, wy):
    """Columns of ground that a contact takes in all, [1]; ``o`` is its first column of nodes."""
    around = real(0.0)
    for i in range(3):
        for j in range(3):
            around += wx[i] * wy[j] * plan[0, o + PLAN * i + j]
    largest = largest_share(around)
    shares = real(0.0)
    for i in range(3):
        for j in range(3):
            shares += area_share(wx[i] * wy[j], plan[1, o + PLAN * i + j], largest)
    return shares


def take_areas(blocks, contacts, columns, plan_area):
    """Write the ground area of every contact; a column of nodes has ``plan_area`` [m2]."""
    rows, measured, place, touching = contacts.rows, contacts.measured, contacts.place, contacts.touching
    given = contacts.given
    for b in prange(blocks.nown):
        if touching[b] > 0:
            plan = local_plan(rows)
            _load_plan(plan, columns, b)
            for r in range(place[b], place[b] + touching[b]):
                c = np.int64(rows[r, 0])
                o = PLAN * (c >> 4) + ((c >> 2) & 3)
                shares = _shares_of_contact(plan, o, weights(rows[r, 1]), weights(rows[r, 2]))
                given[r, 0] = ground_area(plan_area, shares, measured[r >> 4, NORMAL + 2, r & 15])
