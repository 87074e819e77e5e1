"""Unloading: the particles as backends exchange them, a few at a time beside the arrays of the run."""

from types import SimpleNamespace

import numpy as np

from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks
from runout.backends.scan.state import Store
from runout.model.particles import CHUNK, Particles
from runout.physics import moments


def unloaded(k: SimpleNamespace, store: Store, blocks: Blocks, tables: Tables, steps: int) -> Particles:
    """The particles after so many steps, in the order of their identity."""
    slots, n = store.particles, store.n
    node, affine = np.empty((n, 3), np.int32), np.empty((n, 3, 3))
    place = np.cumsum(blocks.held) - blocks.held
    dt = slots.rec.dtype.type(tables.packed_dt)
    k.unpack(slots, blocks, tables.constants, tables.moduli, dt, place, node, affine)
    slot = slots.order[np.repeat(blocks.first - place, blocks.held) + np.arange(n)]
    found, rank = Particles.zeros(n), np.empty(n, np.int32)
    rank[np.argsort(slots.label[slots.particle_index[slot], 1])] = np.arange(n, dtype=np.int32)
    for first in range(0, n, CHUNK):
        part = slice(first, first + CHUNK)
        where = rank[part]
        found.node[where], found.affine[where] = node[part], affine[part]
        _unload(found, where, store, slot[part], steps)
    return found


def _unload(found: Particles, where: np.ndarray, store: Store, slot: np.ndarray, steps: int) -> None:
    """Write what some slots (m,) hold into the rows ``where`` (m,) of the particles."""
    slots = store.particles
    rec, state = slots.rec[slot].astype(np.float64), slots.state[slot].astype(np.float64)
    particle_index = slots.particle_index[slot]
    mass = rec[:, 0]
    middle, *slopes = np.moveaxis(rec.reshape(-1, 4, 4)[:, :, 1:], 0, 2)
    momentum = moments.momentum_at(middle, slopes[0], slopes[1], slopes[2], rec[:, 4::4].T - 1.0)
    found.offset[where], found.velocity[where], found.mass[where] = rec[:, 4::4], np.column_stack(momentum) / mass[:, None], mass
    found.strain[where], found.history[where], found.volume[where] = state[:, :6], state[:, 6], state[:, 7]
    found.radius[where] = store.radius[particle_index]
    found.ground_force[where] = store.ground_force(particle_index, steps)
    if store.pore_left is not None:
        found.pore_left[where], found.pore_excess[where] = store.pores_at(slot)
    found.release[where], found.identity[where] = slots.label[particle_index].T
