"""Blocks at rest may sleep: their particles keep place and stress, and cost nothing until something moves beside them.

A block falls asleep when it and its neighbours have been slower than the scene's ``sleep_speed`` for some steps; the static
friction of what carries it takes the rest of its momentum, which is booked as if the ground did. A sleeper beside a block awake
still gives mass and stress to their common nodes; one among sleepers does nothing. It wakes when a particle enters, or when
a neighbour holds one twice as fast. A scene without ``sleep_speed`` takes no part of this.
"""

from typing import TYPE_CHECKING

import numpy as np

from runout.backends.scan import observe
from runout.backends.scan.arenas import Arenas

if TYPE_CHECKING:
    from runout.backends.scan.backend import ScanBackend

WAKING = 2.0  # of sleep_speed, in a neighbour


def carry_over(engine: "ScanBackend", before: Arenas, held: np.ndarray, numbers: np.ndarray) -> None:
    """Who sleeps, from the blocks of the last index to their new ``numbers``."""
    used = np.flatnonzero(held)
    engine.arenas.asleep[numbers[used]] = before.asleep[used]
    engine.arenas.calm[numbers[used]] = before.calm[used]
    share_work(engine)


def share_work(engine: "ScanBackend") -> None:
    """Who moves, and who gives to the grid, from who sleeps."""
    i, a = engine.index, engine.arenas
    engine.k.share_work(i.nown, i.around, i.held, a.asleep, a.moving, a.giving)


def after_step(engine: "ScanBackend", dt: float) -> None:
    """Let blocks fall asleep and wake after a step of ``dt`` [s]; what sleeps is held against gravity."""
    i, a, k, slow = engine.index, engine.arenas, engine.k, engine.scene.sleep_speed
    engine.basal_impulse -= dt * engine.sleeping_mass * engine.gravity
    if not engine.moved:
        a.arrivals.fill(0)
    woken = bool((a.asleep[: i.nown] & (a.arrivals > 0)).any())
    k.count_calm(i.nown, i.held, a.motion, a.arrivals, slow**2, a.asleep, a.calm)
    k.choose_sleepers(i.nown, i.around, i.held, a.motion, a.changed, (WAKING * slow) ** 2, a.asleep, a.calm, a.falling)
    if (a.falling > 0).any():
        _put_to_rest(engine)
    if woken or a.falling.any():
        engine.sleepers = k.change_sleepers(i.nown, a.falling, a.asleep, a.calm)
        engine._sum(k.sum_blocks, engine.store.cell, engine.store.order, i.first, np.where(a.asleep, i.held, 0))
        engine.sleeping_mass = float(a.total[observe.MASS])
    share_work(engine)


def _put_to_rest(engine: "ScanBackend") -> None:
    """Take velocity from those who fall asleep, and book momentum and energy with the ground."""
    i, s, a, k = engine.index, engine.store, engine.arenas, engine.k
    engine._sum(k.sum_blocks, s.cell, s.order, i.first, np.maximum(a.falling, 0))
    engine.basal_impulse -= a.total[observe.MOMENTUM : observe.KINETIC]
    engine.basal_dissipation += float(a.total[observe.KINETIC])
    dt = engine.scene.dtype(engine.packed_dt)
    k.put_to_rest(s.rec, s.state, s.particle_index, s.label, s.order, i.first, a.falling, i.nown, engine.mats, dt, engine.h)
