"""What a step does more where the transfer is not the packed one, or where F-bar averages: its launches and its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from runout.backends.hash.layout import CELL_LANES, run, run_blocks
from runout.model.scene import Scene

if TYPE_CHECKING:
    from runout.backends.hash.batch import Batch


def uses_gradient_transfer(scene: Scene) -> bool:
    """Whether a scene needs more than the packed transfer, which has kernels of its own."""
    return not scene.packed or scene.f_bar


def choices(scenes: Sequence[Scene]) -> np.ndarray:
    """Columns (scenes, 3) of the clock: slips kept, dilatation averaged, gradients by the slopes of the weights."""
    return np.array([(s.keeps, s.f_bar, not s.packed) for s in scenes], float)


def push(batch: Batch) -> None:
    """Launches that add internal forces to nodes with mass and momentum, once what particles alone gave is noted."""
    i, s, n, k = batch.index, batch.store, batch.nodes, batch.k
    if batch.scene.packed:
        return
    if n.kept:
        run(k.note_given, i.capacity * 64, batch.flags, i.tally, i.capacity, n.grid)
    run(k.take_stresses, s.size, batch.flags, s.rec, s.key, s.release, batch.mats, s.stress)
    run_blocks(
        k.add_forces, i.launched, CELL_LANES, s.rec, s.stress, s.order, i.cstart, i.up, batch.flags, i.tally, i.active, i.member,
        batch.clock, batch.h, n.grid, n.arenas,
    )  # fmt: skip
    if batch.deterministic:
        run(k.add_nodes, i.capacity * 64, batch.flags, n.arenas, n.held, i.down, n.grid)


def average(batch: Batch) -> None:
    """Launches that average the dilatation of this step over the nodes, whose velocities are known."""
    i, s, n, k = batch.index, batch.store, batch.nodes, batch.k
    if not uses_gradient_transfer(batch.scene):
        return
    if batch.scene.f_bar:
        run_blocks(
            k.spread_dilatation, i.launched, CELL_LANES, s.rec, s.order, i.cstart, i.up, batch.flags, i.tally, i.active, i.member,
            batch.clock, batch.h, n.grid, n.dilated, n.arenas,
        )  # fmt: skip
        run(k.average_dilatation, i.capacity * 64, batch.flags, i.tally, n.arenas, n.held, i.down, n.dilated, n.grid)
    run(k.count_anew, i.capacity * 64, batch.flags, i.tally, i.ends)
