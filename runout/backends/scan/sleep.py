"""Blocks at rest may sleep: their particles keep place and stress, and cost nothing until something moves beside them.

A block falls asleep when it and its neighbours have been slower than the ``sleep_speed`` of the scene for some steps. Static
friction of the ground takes the rest of its momentum, which is booked as impulse of the ground. A sleeping block beside a block
awake still gives mass and stress to their common nodes; one among sleeping blocks does nothing. A block wakes when a particle
enters it, or when a neighbour holds one twice as fast. Blocks near structures stay awake: resting mass presses on them. A scene
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


def after_step(
    k: SimpleNamespace, slow: float, dt: float, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables, totals: Totals,
    structures: Structures | None = None,
) -> None:
    """Let blocks fall asleep and wake after a step of ``dt`` [s]; blocks are slow below ``slow`` [m/s].

    The ground holds sleeping blocks against gravity.
    """
    sleep, moves, mass = workspace.sleep, workspace.moves, totals.sleeping_mass
    totals.basal_impulse -= dt * mass * tables.constants.gravity
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
