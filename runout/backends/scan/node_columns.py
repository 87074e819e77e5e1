"""Columns of nodes, which laws of friction with ground areas, or with drag on whole columns, sum over z.

A block column is all node blocks with the same coordinates east and north; it has 16 columns of nodes.

    particles to grid, contact solution    by node block      weights[b, 16]    moving[b, 64]    pushed[b, 64]
      --sum over the blocks of a column--> by block column    sums[c, 16], inverse[c, 16]        plans[c, 6, 16]    changes[c, 64]

Each block writes its own part where its nodes are summed anyway, and threads take block columns, so that the bits do not depend on
the number of threads.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from runout.backends.scan.groups import Blocks
from runout.backends.scan.particles_to_grid import PLAN
from runout.model.scene import Scene

REACHED = 36  # columns of nodes that the particles of a block reach


class NodeColumns(NamedTuple):
    """Columns of nodes; arrays that a law of friction does not use are empty.

    Where it uses none, ``()`` takes their place: each array that a parallel kernel takes, read or not, costs 0.06 s to compile.
    """

    of_block: np.ndarray  # (nall,): block column of each node block
    # start, parts (columns + 1,): node blocks column by column, and where those of each column begin
    start: np.ndarray
    parts: np.ndarray
    plan_area: Any  # area of a column of nodes in plan [m2]
    gravity: Any  # magnitude of gravity [m/s2]
    weights: np.ndarray  # (nall, 16): weights of the contacts in each column of nodes of a block that contacts reach
    # sums, inverse (columns, 16): their sums, and the reciprocals of these
    sums: np.ndarray
    inverse: np.ndarray
    filled: np.ndarray  # (nall,): blocks that particles reach
    moving: np.ndarray  # (nall, 64): mass [kg] and momentum [kg m/s], with gravity, in each column of nodes of these blocks
    # (nall, 64): drag [kg/m] and changes of the impulses [N s] of the contacts in each column of nodes of a block that contacts
    # reach
    pushed: np.ndarray
    beside: np.ndarray  # (columns, 9): block columns around each and itself, first axis east; the number of all where there is none
    # (columns + 1, 6, 16): mass [kg], momentum [kg m/s], drag [kg/m] and work [J] of each column of nodes; the last one stays
    # empty
    plans: np.ndarray
    # (nown, 36, releases): mass [kg] that each release in a block gives to 6 x 6 columns of nodes, where the friction of releases
    # differs
    masses: np.ndarray
    shares: np.ndarray  # (columns, 16, releases): shares of the releases in the mass of a column of nodes [1]
    slowed: np.ndarray  # (columns,): block columns whose velocities change
    changes: np.ndarray  # (columns, 64): 0, and change of velocity [m/s] of each column of nodes
    booked: np.ndarray  # (columns, 4): work [J] and impulse [N s] of the drag


class FreeDrag(NamedTuple):
    """What the drag on columns of nodes takes that no contact slows."""

    basal: np.ndarray  # (releases, kinds of ground): records of basal friction
    # kind, cell_size (nx, ny): kind of ground on the cells of the raster, and their size [m]; one cell without end where there are
    # no zones
    kind: np.ndarray
    cell_size: np.ndarray
    gravity: Any  # magnitude of gravity [m/s2]


def block_columns(blocks: Blocks) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places (columns, 2) of the block columns, the column of each node block, and ``start`` and ``parts`` of these.

    One number for both coordinates is sorted in a quarter of the time of pairs.
    """
    plan = blocks.bxyz[: blocks.nall, :2].astype(np.int64)
    low = plan.min(axis=0, initial=0)
    width = int(plan[:, 1].max(initial=0) - low[1]) + 1
    key, column = np.unique((plan[:, 0] - low[0]) * width + plan[:, 1] - low[1], return_inverse=True)
    column = column.astype(np.int32)
    parts = np.argsort(column, kind="stable").astype(np.int32)
    start = np.concatenate(([0], np.cumsum(np.bincount(column, minlength=len(key)))))
    return np.stack([key // width, key % width], axis=1) + low, column, start, parts


def node_columns_of(blocks: Blocks, scene: Scene) -> NodeColumns | tuple[()]:
    """The columns of nodes of an index, as far as the law of friction of a scene uses them."""
    law, spacing, real, releases = scene.basal.law, scene.spacing, scene.dtype, len(scene.materials)
    if not law.uses_area:
        return ()
    nodes = blocks.nall
    places, column, start, order = block_columns(blocks)
    count = len(start) - 1
    dragged, slowed, owners = (nodes, count, blocks.nown) if law.drags_column else (0, 0, 0)
    owners *= not scene.basal.alike
    shares = np.zeros((slowed, PLAN, releases), real)
    shares[:, :, :1] = 1.0
    return NodeColumns(
        column, start, order, real(spacing[0] * spacing[1]), real(math.hypot(*scene.gravity)),
        np.zeros((nodes, PLAN), real), np.zeros((count, PLAN), real), np.zeros((count, PLAN), real),
        np.zeros(dragged, np.bool_), np.zeros((dragged, 4 * PLAN), real), np.zeros((dragged, 4 * PLAN), real),
        _beside(places[:slowed]), np.zeros((slowed + 1, 6, PLAN), real), np.zeros((owners, REACHED, releases)), shares,
        np.zeros(slowed, np.bool_), np.zeros((slowed, 4 * PLAN), real), np.zeros((slowed, 4)),
    )  # fmt: skip


def _beside(places: np.ndarray) -> np.ndarray:
    """Rows (n, 9) of the ``places`` (n, 2) around each of them, n where there is none; ``places`` are sorted."""
    count = len(places)
    if not count:
        return np.zeros((0, 9), np.int32)
    x, y = (places - places.min(axis=0)).astype(np.int64).T
    width = int(y.max()) + 3  # of a row of keys, with room beyond both ends
    key = x * width + y
    wanted = key[:, None] + np.array([(q // 3 - 1) * width + q % 3 - 1 for q in range(9)])
    row = np.minimum(np.searchsorted(key, wanted), count - 1)
    return np.where(key[row] == wanted, row, count).astype(np.int32)
