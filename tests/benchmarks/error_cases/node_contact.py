"""The usual ground contact, a condition on the velocities of nodes below the surface, for comparison with that of runout."""

from functools import partial
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.model.surface import Surface
from runout.physics.heightfield import distance, upward_normal


def node_contact() -> Any:
    """The reference backend with contact at nodes; one friction coefficient, that of the first release.

    A node below the surface that moves into it loses that part of its velocity, and of its tangential velocity what Coulomb
    friction with this impulse takes. A body is held where its outermost node is, between 0 and 0.9 cells above the ground.
    """
    engine: Any = get_backend("reference")
    engine._touch_ground = partial(_touch_nodes, engine)
    return engine


def _touch_nodes(
    engine: Any, contacts: Any, way: np.ndarray, stencils: Any, mass: np.ndarray, velocity: np.ndarray, dt: float, *, first: bool
) -> None:
    """Change the velocities of nodes below the surface, in place of those of particles in contact."""
    x = np.zeros((stencils.size, 3))
    x[stencils.node.ravel()] = (engine._p.position(engine.spacing)[:, None, :] + stencils.arm).reshape(-1, 3)
    mass = mass.reshape(-1)
    carries = np.flatnonzero(mass > 0.0)
    gap, normal = _gap(engine.scene.surface, x[carries])
    into = np.einsum("ni,ni->n", velocity[carries], normal)
    touches = (gap < 0.0) & (into < 0.0)
    chosen, n, into = carries[touches], normal[touches], into[touches]
    engine._contacts = len(chosen)
    before = velocity[chosen]
    along = before - into[:, None] * n
    speed = np.linalg.norm(along, axis=1)
    kept = np.maximum(0.0, 1.0 + engine.scene.friction[0] * into / np.maximum(speed, np.finfo(float).tiny))
    velocity[chosen] = kept[:, None] * along
    impulse = mass[chosen, None] * (velocity[chosen] - before)
    engine._basal -= float(0.5 * (impulse * (velocity[chosen] + before)).sum())
    engine._basal_impulse += impulse.sum(axis=0)


def _gap(surface: Surface, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (n,) [m] of places (n, 3) [m] from the ground, and its unit normals there (n, 3)."""
    elevation, east, north = surface.evaluate(x[:, 0], x[:, 1])
    normal = np.array([upward_normal(*slopes) for slopes in zip(east, north, strict=True)]).reshape(-1, 3)
    return distance(x[:, 2] - elevation, normal[:, 2]), normal
