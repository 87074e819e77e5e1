"""Columns of nodes, which laws of friction with ground areas, or with drag on whole columns, sum over z.

A block column is all node blocks with the same coordinates east and north; it has 16 columns of nodes.

    particles to grid, contact solution    by node block      weights[b, 16]    moving[b, 64]    pushed[b, 64]
      --sum over the blocks of a column--> by block column    sums[c, 16], inverse[c, 16]        changes[c, 64]

Each block writes its own part where its nodes are summed anyway, and threads take block columns, so that the bits do not depend on
the number of threads.
"""

from typing import Any, NamedTuple

import numpy as np

from runout.backends.scan.groups import Blocks
from runout.backends.scan.particles_to_grid import PLAN
from runout.model.friction_laws import FrictionLaw


class NodeColumns(NamedTuple):
    """Columns of nodes; arrays that a law of friction does not use are empty.

    Attributes
    ----------
    of_block : (nall,) int32
        Block column of each node block.
    start, parts : (columns + 1,) int64, (nall,) int32
        Node blocks column by column, and where those of each column begin.
    plan_area : real
        Area of a column of nodes in plan [m2].
    weights : (nall, 16) real
        Weights of the contacts in each column of nodes of a block that contacts reach.
    sums, inverse : (columns, 16) real
        Their sums, and the reciprocals of these.
    filled : (nall,) bool
        Blocks that particles reach.
    moving : (nall, 64) real
        Mass [kg] and momentum [kg m/s], with gravity, in each column of nodes of these blocks.
    pushed : (nall, 64) real
        Drag [kg/m] and changes of the impulses [N s] of the contacts in each column of nodes of a block that contacts reach.
    slowed : (columns,) bool
        Block columns whose velocities change.
    changes : (columns, 64) real
        0, and change of velocity [m/s] of each column of nodes.
    booked : (columns, 4) float64
        Work [J] and impulse [N s] of the drag.
    """

    of_block: np.ndarray
    start: np.ndarray
    parts: np.ndarray
    plan_area: Any
    weights: np.ndarray
    sums: np.ndarray
    inverse: np.ndarray
    filled: np.ndarray
    moving: np.ndarray
    pushed: np.ndarray
    slowed: np.ndarray
    changes: np.ndarray
    booked: np.ndarray


def node_columns_of(blocks: Blocks, law: FrictionLaw, spacing: tuple[float, ...], real: type) -> NodeColumns:
    """The columns of nodes of an index, as far as a law uses them."""
    nodes = blocks.nall if law.uses_area else 0
    _, column = np.unique(blocks.bxyz[:nodes, :2], axis=0, return_inverse=True)
    column = column.ravel().astype(np.int32)
    order = np.argsort(column, kind="stable").astype(np.int32)
    start = np.searchsorted(column[order], np.arange(column.max(initial=-1) + 2))
    count = len(start) - 1
    dragged, slowed = (nodes, count) if law.drags_column else (0, 0)
    return NodeColumns(
        column, start, order, real(spacing[0] * spacing[1]),
        np.zeros((nodes, PLAN), real), np.zeros((count, PLAN), real), np.zeros((count, PLAN), real),
        np.zeros(dragged, np.bool_), np.zeros((dragged, 4 * PLAN), real), np.zeros((dragged, 4 * PLAN), real),
        np.zeros(slowed, np.bool_), np.zeros((slowed, 4 * PLAN), real), np.zeros((slowed, 4)),
    )  # fmt: skip
