"""Loss of kinetic energy between particles and grid, from single steps of the reference backend."""

from typing import Any, cast

import numpy as np

from runout.backends.protocol import get_backend
from runout.model.particles import Particles
from runout.model.scene import Scene


class TransferLoss:
    """Loss of the transfers from particles to nodes without forces, and back. ``period`` (3,) [cells] of the grid."""

    def __init__(self, period: tuple[int, int, int] = (0, 0, 0)):
        engine: Any = cast(Any, get_backend("reference"))
        engine.watch = self._look
        for axis, cells in enumerate(period):
            if cells:
                engine.period[axis] = cells
        self._engine = engine

    def rates(self, scene: Scene, particles: Particles, dt: float) -> tuple[float, float]:
        """Loss [W] in a step of ``dt`` [s] from ``particles``: in the transfers, and at the ground beyond what is booked there.

        The ground's work on the nodes takes the mean of their velocities before and after the step. What is booked follows from
        the particles, with lumped compliances.
        """
        self._engine.load(scene, particles)
        self._particles = self._engine.particles()
        before = self._engine.ledger().kinetic_energy
        self._engine.step(dt)
        after = self._engine.ledger()
        mass, given, pushed, end = self._mass, self._given, self._pushed, self._velocity
        taken = 0.5 * float(mass @ (end**2).sum(axis=1))
        lost = before - 0.5 * float(mass @ (given**2).sum(axis=1)) + taken - after.kinetic_energy - after.escaped_energy
        ground = -0.5 * float((mass[:, None] * (end - pushed) * (given + end)).sum())
        return lost / dt, (ground - after.basal_dissipation) / dt

    def _look(self, stencils: Any, mass: np.ndarray, velocity: np.ndarray) -> None:
        """Note velocities [m/s] of nodes: as given by particles, with forces, and, once the step is done, with contact."""
        p = self._particles
        momentum = p.mass[:, None, None] * (p.velocity[:, None, :] + np.einsum("pij,pnj->pni", p.affine, stencils.arm))
        occupied = mass > 0.0
        self._given = np.zeros_like(velocity)
        self._given[occupied] = stencils.scatter(momentum)[occupied] / mass[occupied, None]
        self._mass, self._pushed, self._velocity = mass, velocity.copy(), velocity
