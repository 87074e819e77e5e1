"""Blocks at rest may sleep: their particles keep place and stress, and cost nothing until something moves beside them.

A block falls asleep when it and its neighbours have been slower than the ``sleep_speed`` of the scene for some steps. Static
friction of the ground takes the rest of its momentum, which is booked as impulse of the ground. A sleeping block beside a block
awake still gives mass and stress to their common nodes; one among sleeping blocks does nothing. The ground takes the momentum that
the common nodes would give to sleeping particles, and holds the others against gravity. A block wakes when a particle enters it, or
when a neighbour holds one twice as fast. Blocks near structures stay awake: resting mass presses on them. A scene
without ``sleep_speed`` calls nothing of this.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends.scan import observe
from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks, Sleep
from runout.backends.scan.state import Store
from runout.backends.scan.structures import Structures
from runout.backends.scan.totals import Totals, add_up
from runout.backends.scan.workspace import Workspace

WAKING = 2.0  # of sleep_speed, in a neighbour


def carry_over(before: Sleep, held: np.ndarray, numbers: np.ndarray, after: Sleep) -> None:
    """Copy which blocks sleep, from the blocks of the last index to their new ``numbers``."""
    used = np.flatnonzero(held)
    after.asleep[numbers[used]] = before.asleep[used]
    after.calm[numbers[used]] = before.calm[used]


def hold_sleepers(
    k: SimpleNamespace, dt: float, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables, totals: Totals
) -> None:
    """Book the impulse of the ground on sleeping blocks in a step of ``dt`` [s], before nodes give to particles.

    Gravity and contact of those that give to nodes are in the momentum of the nodes; the ground holds the others against gravity.
    """
    if not totals.sleepers:
        return
    held = np.empty((blocks.nown, 4))
    k.sum_held(store.particles, blocks, workspace.sleep, workspace.grid.nodes, held)
    mass, *momentum = held.sum(axis=0)
    totals.basal_impulse -= dt * (totals.sleeping_mass - mass) * tables.constants.gravity + momentum


def after_step(
    k: SimpleNamespace,
    slow: float,
    store: Store,
    blocks: Blocks,
    workspace: Workspace,
    tables: Tables,
    totals: Totals,
    structures: Structures | None = None,
) -> None:
    """Let blocks fall asleep and wake after a step; blocks are slow below ``slow`` [m/s]."""
    sleep, moves = workspace.sleep, workspace.moves
    if not totals.moved:
        moves.arrivals.fill(0)
    woken = bool((sleep.asleep[: blocks.nown] & (moves.arrivals > 0)).any())
    k.count_calm(blocks, moves, sleep, slow**2)
    if structures:
        sleep.calm[structures.near.owners] = 0
    k.choose_sleepers(blocks, moves, sleep, (WAKING * slow) ** 2)

    def sums(kernel: Any, chosen: np.ndarray) -> np.ndarray:
        return add_up(k, kernel, chosen, store, blocks, workspace, tables)

    if (sleep.falling > 0).any():
        total, c = sums(k.sum_blocks, np.maximum(sleep.falling, 0)), tables.constants
        totals.basal_impulse -= total[observe.MOMENTUM : observe.KINETIC]
        totals.basal_dissipation += float(total[observe.KINETIC])
        k.put_to_rest(store.particles, blocks, sleep.falling, tables.moduli, c.h.dtype.type(tables.packed_dt), c.h)
    if woken or sleep.falling.any():
        totals.sleepers = k.change_sleepers(blocks.nown, sleep)
        totals.sleeping_mass = float(sums(k.sum_blocks, np.where(sleep.asleep, blocks.held, 0))[observe.MASS])
    k.share_work(blocks, sleep)
