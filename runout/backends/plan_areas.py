"""Ground areas of contacts, impulses from which they start, and drag over columns, in NumPy: for the reference backend."""

import math
from typing import Any

import numpy as np

from runout.backends.compile import array_binding
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics import contact


def contact_areas(scene: Scene, stencils: Any, chosen: np.ndarray, upward: np.ndarray) -> np.ndarray:
    """Ground area (n,) [m2] of contacts; 0 if the law of friction does not use it.

    Parameters
    ----------
    scene : Scene
    stencils : runout.backends.reference.stencils.Stencils
    chosen : ndarray (n,)
        Numbers of the particles in contact.
    upward : ndarray (n,)
        Upward part of the normal of the ground [1].
    """
    if not scene.basal.law.uses_area:
        return np.zeros(len(chosen))
    shares = plan_shares(stencils.node[chosen][:, ::3] // stencils.height, stencils.weight[chosen].reshape(-1, 9, 3).sum(axis=2))
    return contact.ground_area(scene.spacing[0] * scene.spacing[1], shares, upward)  # type: ignore[no-any-return]


def plan_shares(place: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Columns of ground (n,) [1] that contacts take (:func:`runout.physics.contact.area_share`).

    ``place`` (n, 9) are the columns of nodes around each, ``weight`` (n, 9) [1] its weights there.
    """
    formulas = array_binding().contact
    sums = np.bincount(place.ravel(), weight.ravel())[place]
    largest = formulas.largest_share((weight * sums).sum(axis=1, keepdims=True))
    inverse = np.divide(1.0, sums, out=np.full(sums.shape, np.inf), where=sums > 0.0)
    return formulas.area_share(weight, inverse, largest).sum(axis=1)  # type: ignore[no-any-return]


def begun_impulses(scene: Scene, p: Particles, dt: float) -> np.ndarray:
    """Impulses (n, 3) [N s] by the forces of the step before, from which contacts of particles (n,) start."""
    if not scene.basal.law.uses_area:
        return dt * p.ground_force  # type: ignore[no-any-return]
    fastest = contact.fastest_start(min(scene.spacing), math.hypot(*scene.gravity), dt)
    lasting = np.array([contact.started_time(v, fastest, dt) for v in p.velocity])
    return lasting.reshape(-1, 1) * p.ground_force  # type: ignore[no-any-return]


def column_drags(
    scene: Scene, u: np.ndarray, normal: np.ndarray, impulses: np.ndarray, basal: np.ndarray, area: np.ndarray, dt: float
) -> np.ndarray:
    """Drags (n, 1) [kg/m] by which contacts slow the columns of nodes around (:func:`runout.physics.contact.column_drag`).

    ``u``, ``normal`` and ``impulses`` are (n, 3), ``basal`` the records of friction and ``area`` [m2] (n,).
    """
    contacts = zip(impulses.tolist(), u.tolist(), normal.tolist(), area.tolist(), basal.view(np.recarray), strict=True)
    drag = scene.basal.law.column_drag
    return np.array([drag(push, felt, n, a, dt, record) for push, felt, n, a, record in contacts]).reshape(-1, 1)


def slow_columns(mass: np.ndarray, velocity: np.ndarray, drag: np.ndarray, dt: float, height: int) -> tuple[float, np.ndarray]:
    """Change nodal velocities (nodes, 3) [m/s] by the ``drag`` (nodes, 1) [kg/m] on columns of ``height`` nodes as a whole.

    Returns the work [J] and the impulse (3,) [N s].
    """
    total, drags = (a.reshape(-1, height).sum(axis=1) for a in (mass, drag))
    momentum, change, work = (mass * velocity).reshape(-1, height, 3).sum(axis=1), np.zeros((len(total), 3)), 0.0
    for c in np.flatnonzero((drags > 0.0) & (total > 0.0)):
        change[c] = contact.column_slowing(total[c], momentum[c], drags[c], dt)
        work += contact.column_work(total[c], momentum[c], change[c])
    velocity += np.repeat(change, height, axis=0)
    return float(work), total @ change
