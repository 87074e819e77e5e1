"""The usual ground contact, a condition on the velocities of nodes below the surface, for comparison with that of runout."""

import numpy as np

from runout.backends.reference.backend import ReferenceBackend
from runout.backends.reference.stencils import Stencils
from runout.physics.heightfield import distance


class NodeContact(ReferenceBackend):
    """The reference backend with contact at nodes; one friction coefficient, that of the first release.

    A node below the surface that moves into it loses that part of its velocity, and of its tangential velocity what Coulomb
    friction with this impulse takes. A body is held where its outermost node is, between 0 and 0.9 cells above the ground.
    """

    def _touch_ground(self, stencils: Stencils, mass: np.ndarray, velocity: np.ndarray, dt: float) -> None:
        x = np.zeros((stencils.size, 3))
        x[stencils.node.ravel()] = (self._p.position(self.spacing)[:, None, :] + stencils.arm).reshape(-1, 3)
        carries = np.flatnonzero(mass[:, 0] > 0.0)
        gap, normal = self._gap_of_nodes(x[carries])
        into = np.einsum("ni,ni->n", velocity[carries], normal)
        touches = (gap < 0.0) & (into < 0.0)
        chosen, n, into = carries[touches], normal[touches], into[touches]
        self._contacts = len(chosen)
        before = velocity[chosen]
        along = before - into[:, None] * n
        speed = np.linalg.norm(along, axis=1)
        kept = np.maximum(0.0, 1.0 + self.scene.friction[0] * into / np.maximum(speed, np.finfo(float).tiny))
        velocity[chosen] = kept[:, None] * along
        impulse = mass[chosen] * (velocity[chosen] - before)
        self._basal -= float(0.5 * (impulse * (velocity[chosen] + before)).sum())
        self._basal_impulse += impulse.sum(axis=0)

    def _gap_of_nodes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (n,) [m] of places (n, 3) [m] from the ground, and its unit normals there (n, 3)."""
        elevation, east, north = self.scene.surface.evaluate(x[:, 0], x[:, 1])  # type: ignore[union-attr]
        upward = np.column_stack([-east, -north, np.ones(len(x))])
        normal = upward / np.linalg.norm(upward, axis=1, keepdims=True)
        return distance(x[:, 2] - elevation, normal[:, 2]), normal
