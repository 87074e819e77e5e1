"""The kinetic energy that goes lost between particles and grid, counted by single steps of the reference backend."""

from typing import Any, cast

import numpy as np

from runout.backends.protocol import get_backend
from runout.model.particles import Particles
from runout.model.scene import Scene


class TransferLoss:
    """What the transfers lose: from particles to nodes without forces, and back again. ``period`` (3,) [cells] of the grid."""

    def __init__(self, period: tuple[int, int, int] = (0, 0, 0)):
        engine: Any = cast(Any, get_backend("reference"))
        engine.watch = self._look
        for axis, cells in enumerate(period):
            if cells:
                engine.period[axis] = cells
        self._engine = engine

    def rate(self, scene: Scene, particles: Particles, dt: float) -> float:
        """Loss [W] in one step of ``dt`` [s] from ``particles``."""
        self._engine.load(scene, particles)
        self._particles = self._engine.particles()
        before = self._engine.ledger().kinetic_energy
        self._engine.step(dt)
        after = self._engine.ledger()
        return float(before - self._given + self._taken - after.kinetic_energy - after.escaped_energy) / dt

    def _look(self, stencils: Any, mass: np.ndarray, velocity: np.ndarray) -> None:
        """Note the kinetic energy [J] that the nodes get, and that which they have after forces and contact."""
        p = self._particles
        momentum = p.mass[:, None, None] * (p.velocity[:, None, :] + np.einsum("pij,pnj->pni", p.affine, stencils.arm))
        occupied = mass > 0.0
        squares = (stencils.scatter(momentum)[occupied] ** 2).sum(axis=1)
        self._given = 0.5 * (squares / mass[occupied]).sum()
        self._taken = 0.5 * (mass @ (velocity**2).sum(axis=1))
