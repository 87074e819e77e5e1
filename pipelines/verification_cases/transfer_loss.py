"""The kinetic energy that goes lost between particles and grid, counted by single steps of the reference backend."""

import numpy as np

from runout.backends.reference.backend import ReferenceBackend, Stencils
from runout.model.particles import Particles
from runout.model.scene import Scene


class TransferLoss(ReferenceBackend):
    """A reference backend that counts what its transfers lose: from particles to nodes without forces, and back again."""

    lost = 0.0  # [J]

    def rate(self, scene: Scene, particles: Particles, dt: float) -> float:
        """Loss [W] in one step of ``dt`` [s] from ``particles``."""
        self.load(scene, particles)
        self.lost = 0.0
        self.step(dt)
        return self.lost / dt

    def _particles_to_grid(self, stencils: Stencils, dt: float) -> tuple[np.ndarray, np.ndarray]:
        p = self._p
        momentum = p.mass[:, None, None] * (p.velocity[:, None, :] + np.einsum("pij,pnj->pni", p.affine, stencils.arm))
        self._mass = stencils.scatter(p.mass[:, None])
        occupied = self._mass[:, 0] > 0.0
        squares = (stencils.scatter(momentum)[occupied] ** 2).sum(axis=1)
        self.lost += self._kinetic() - float(0.5 * (squares / self._mass[occupied, 0]).sum())
        return super()._particles_to_grid(stencils, dt)

    def _grid_to_particles(self, stencils: Stencils, velocity: np.ndarray, dt: float) -> None:
        of_nodes = float(0.5 * (self._mass * velocity**2).sum())
        super()._grid_to_particles(stencils, velocity, dt)
        self.lost += of_nodes - self._kinetic()

    def _kinetic(self) -> float:
        return float(self._energies()[0].sum())
