"""Contacts with a surface, the ground or structures: one impulse per particle."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from runout.backends.reference.stencils import Stencils, quotient
from runout.model.particles import Particles


class Contacts(NamedTuple):
    """Particles (m,) by number that touch a surface within a transfer.

    ``distance`` (m,) [m] is the gap to the ground, or the distance of the centre from structures, when they were found;
    ``normal`` (m, 3) that of the surface, ``basal`` (m,) records of friction, ``area`` (m,) [m2] of the ground, 0 at structures.
    """

    chosen: np.ndarray
    distance: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    basal: np.ndarray

    def moved(self, loops: SimpleNamespace, way: np.ndarray) -> np.ndarray:
        """Distances (m,) [m] after the particles have gone a ``way`` (n, 3) [m]."""
        present = np.zeros(len(self.chosen))
        loops.move_gaps(self.distance, self.normal, way[self.chosen], present)
        return present

    def push(
        self, p: Particles, given: np.ndarray, stencils: Stencils, mass: np.ndarray, velocity: np.ndarray, solve: Callable[..., Any]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Change nodal velocities (nodes, 3) [m/s] by impulses that start from the ``given`` ones (m, 3) [N s].

        ``solve`` is a loop of :mod:`runout.backends.reference.particles`. Returns the velocities (m, 3) [m/s] that the grid gives
        with the ``given`` impulses, the impulses (m, 3) [N s], their work (m,) [J] and the compliances (m,) [1/kg].
        """
        weights = stencils.scatter(np.ones((len(given), 1)), self.chosen)
        compliance = stencils.gather(quotient(weights, mass), self.chosen)[:, 0]
        velocity += quotient(stencils.scatter(given, self.chosen), mass)
        u, impulses, work = stencils.gather(velocity, self.chosen), given.copy(), np.zeros(len(given))
        solve(p.velocity[self.chosen], u, self.normal, compliance, impulses, work)
        velocity += quotient(stencils.scatter(impulses - given, self.chosen), mass)
        return u, impulses, work, compliance
