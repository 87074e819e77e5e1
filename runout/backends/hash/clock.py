"""Time steps of the scenes of a batch on the device, and what depends on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from runout.backends.hash.gradient_transfer import choices
from runout.backends.hash.layout import CLOCK, KEPT, run

if TYPE_CHECKING:
    from runout.backends.hash.batch import Batch


def set_steps(batch: Batch, dt: np.ndarray, left: np.ndarray) -> None:
    """Time steps [s] of the scenes that have steps ``left``; packed records are packed anew where theirs changes."""
    before = np.array([a.packed_dt for a in batch.accounts])
    now = np.where(left > 0, dt, before)
    if np.array_equal(before, now):
        return
    i, s = batch.index, batch.store
    if batch.scene.packed:
        longer = wp.array(now - before, dtype=batch.real)
        run(batch.k.change_step, s.n, s.rec, s.key, s.release, i.member, batch.mats, longer, batch.h)
    for account, step in zip(batch.accounts, now, strict=True):
        account.packed_dt = float(step)
    write(batch, now)


def write(batch: Batch, now: np.ndarray) -> None:
    """Time steps [s] of the scenes to the device."""
    kinds = batch.scene.dtype
    batch.steps_of.assign(now.astype(kinds))
    batch.packed.assign((now * batch.scene.packed).astype(kinds))
    clock = np.zeros((len(now), CLOCK))
    clock[:, 1:4] = now[:, None] * np.array(batch.scene.gravity)
    clock[:, KEPT:CLOCK] = choices(batch.scenes)
    batch.clock.assign(clock.astype(kinds))
    if batch.scene.law.depends_on_rate:
        for step, first, last in zip(now, batch.first_release[:-1], batch.first_release[1:], strict=True):
            batch.scene.law.set_step(batch.table[first:last], step)
        wp.copy(batch.mats, wp.array(batch.table, dtype=batch.k.record))
