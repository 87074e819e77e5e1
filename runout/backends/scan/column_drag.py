"""Drag that slows whole columns of nodes, for laws of friction that want it (:func:`runout.physics.contact.column_slowing`).

A block column is all node blocks with the same coordinates east and north. Its 16 columns of nodes have in all

    mass, momentum    of all nodes that particles reach        drag    of the contacts, spread to the nodes with their impulses

and all nodes of a column get the same change of velocity. A thread takes block columns; no sum is shared, so that the bits do not
depend on the number of threads.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from runout.backends.lanes import local_array
from runout.backends.scan.groups import Blocks
from runout.physics.contact import column_slowing, column_work
from runout.physics.tensors import real, vec

PLAN = 16  # columns of nodes of a block
local_plan = local_array((5, PLAN))


class NodeColumns(NamedTuple):
    """Columns of node blocks.

    Attributes
    ----------
    start, parts : (columns + 1,) int64, (nall,) int32
        Node blocks column by column, and where those of each column begin.
    booked : (columns, 4)
        Work [J] and impulse [N s] of the drag.
    """

    start: np.ndarray
    parts: np.ndarray
    booked: np.ndarray


def node_columns_of(blocks: Blocks) -> NodeColumns:
    """The columns of the node blocks of an index."""
    _, column = np.unique(blocks.bxyz[: blocks.nall, :2], axis=0, return_inverse=True)
    column = column.ravel()
    order = np.argsort(column, kind="stable")
    start = np.searchsorted(column[order], np.arange(column.max(initial=-1) + 2))
    return NodeColumns(start, order.astype(np.int32), np.zeros((len(start) - 1, 4)))


def _is_reached(down, reached, b):
    """Whether any particle reaches node block ``b``; nodes of the others hold old numbers."""
    found = 0
    for q in range(8):
        owner = np.int64(down[b, q])
        if owner >= 0:
            found |= (np.int64(reached[owner]) >> q) & 1
    return found > 0


def _add_block(plan, grid, b):
    """Add mass, momentum and drag of the nodes of a block to the sums of its columns."""
    nodes, inverse, shared = grid.nodes, grid.inverse, grid.shared[b]
    for n in range(PLAN):
        for k in range(4):
            a = 4 * n + k
            m = nodes[b, 4 * a]
            if shared:
                plan[4, n] += m
                m = real(0.0)
                if inverse[b, a] > real(0.0):
                    m = real(1.0) / inverse[b, a]
            plan[0, n] += m
            for i in range(1, 4):
                plan[i, n] += m * nodes[b, 4 * a + i]


def _slow(plan, booked, c, dt):
    """Replace the momentum of each column by the change of its velocity; books work and impulse."""
    for n in range(PLAN):
        m = plan[0, n]
        p = vec(plan[1, n], plan[2, n], plan[3, n])
        change = vec(real(0.0), real(0.0), real(0.0))
        if plan[4, n] > real(0.0) and m > real(0.0):
            change = column_slowing(m, p, plan[4, n], dt)
            booked[c, 0] += column_work(m, p, change)
        for i in range(3):
            plan[1 + i, n] = change[i]
            booked[c, 1 + i] += m * change[i]


def slow_columns(blocks, reached, grid, columns, dt, total):
    """Change the velocities of the nodes by the drag on their columns; adds work [J] and impulse [N s] to ``total`` (4,).

    ``grid.nodes`` of blocks with contacts hold the drag [kg/m] in place of the mass.
    """
    nodes = grid.nodes
    booked = columns.booked
    down, shared, start, parts = blocks.down, grid.shared, columns.start, columns.parts
    for c in prange(len(booked)):
        for i in range(4):
            booked[c, i] = 0.0
        touched = 0
        for e in range(start[c], start[c + 1]):
            touched |= np.int64(shared[parts[e]])
        if touched > 0:
            plan = local_plan(nodes)
            for n in range(PLAN):
                for i in range(5):
                    plan[i, n] = real(0.0)
            for e in range(start[c], start[c + 1]):
                if _is_reached(down, reached, np.int64(parts[e])):
                    _add_block(plan, grid, np.int64(parts[e]))
            _slow(plan, booked, c, dt)
            for e in range(start[c], start[c + 1]):
                b = np.int64(parts[e])
                for n in range(PLAN):
                    for k in range(4):
                        for i in range(3):
                            nodes[b, 16 * n + 4 * k + 1 + i] += plan[1 + i, n]
    for c in range(len(booked)):
        for i in range(4):
            total[i] += booked[c, i]
