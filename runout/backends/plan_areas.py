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


def layer_thicknesses(scene: Scene, p: Particles, stencils: Any, mass: np.ndarray) -> np.ndarray:
    """Thickness (n,) [m], normal to the ground, of the layers of particles, from nodal ``mass`` (nodes, 1) [kg].

    That of the middle one of the columns of nodes around each, with the slopes of the ground there and the density of the particle.
    """
    formulas, (nx, ny) = array_binding(), stencils.shape[:2]
    middle = stencils.node[:, 13] // stencils.height
    total = _over_z(stencils, mass)[middle, 0]
    x, y = ((stencils.first[axis] + k) * scene.spacing[axis] for axis, k in enumerate(np.divmod(np.arange(nx * ny), ny)))
    slopes = (np.zeros(nx * ny),) * 2 if scene.ground is None else scene.ground.evaluate(x, y)[1:]
    upward = formulas.heightfield.normal_z(*slopes)[middle]
    area = scene.spacing[0] * scene.spacing[1]
    return formulas.pore_pressure.layer_thickness(total, area, scene.densities[p.release], upward)  # type: ignore[no-any-return]


def begun_impulses(scene: Scene, p: Particles, dt: float) -> np.ndarray:
    """Impulses (n, 3) [N s] by the forces of the step before, from which contacts of particles (n,) start."""
    if not scene.basal.law.uses_area:
        return dt * p.ground_force  # type: ignore[no-any-return]
    fastest = contact.fastest_start(min(scene.spacing), math.hypot(*scene.gravity), dt)
    lasting = np.array([contact.started_time(v, fastest, dt) for v in p.velocity])
    lasting = np.where(scene.basal.limits_start[p.release], lasting, dt)
    return lasting.reshape(-1, 1) * p.ground_force  # type: ignore[no-any-return]


def column_drags(scene: Scene, u: np.ndarray, contacts: Any, impulses: np.ndarray, compliance: np.ndarray, dt: float) -> np.ndarray:
    """Drags (n, 1) [kg/m] by which contacts slow the columns of nodes around (:func:`runout.physics.contact.column_drag`).

    ``u`` and ``impulses`` are (n, 3), ``compliance`` [1/kg] (n,), ``contacts`` those of the reference.
    """
    drag, gravity = scene.basal.law.column_drag, math.hypot(*scene.gravity)
    each = (impulses, u, contacts.normal, contacts.area, compliance)
    rows = zip(*(values.tolist() for values in each), contacts.basal.view(np.recarray), strict=True)
    return np.array([drag(*numbers, gravity, dt, record) for *numbers, record in rows]).reshape(-1, 1)


def slow_columns(
    scene: Scene, p: Particles, stencils: Any, mass: np.ndarray, velocity: np.ndarray, drags: np.ndarray, dt: float
) -> tuple[float, np.ndarray]:
    """Change nodal velocities (nodes, 3) [m/s] by the drag on columns of nodes as a whole.

    ``p`` are all particles, ``mass`` (nodes, 1) [kg], ``drags`` (nodes, 1) [kg/m] those of the contacts. Returns the work [J] and
    the impulse (3,) [N s].
    """
    total, drag, momentum = (_over_z(stencils, values) for values in (mass, drags, mass * velocity))
    total, drag = total[:, 0], _with_free_drag(scene, p, stencils, (total[:, 0], momentum), drag[:, 0], dt)
    change, work = np.zeros((len(total), 3)), 0.0
    for c in np.flatnonzero((drag > 0.0) & (total > 0.0)):
        change[c] = contact.column_slowing(total[c], momentum[c], drag[c], dt)
        work += contact.column_work(total[c], momentum[c], change[c])
    velocity += np.repeat(change, stencils.height, axis=0)
    return float(work), total @ change


def _over_z(stencils: Any, values: np.ndarray) -> np.ndarray:
    """Sums (columns, k) of nodal values (nodes, k) over the columns of nodes."""
    return values.reshape(-1, stencils.height, values.shape[1]).sum(axis=1)  # type: ignore[no-any-return]


def _with_free_drag(
    scene: Scene, p: Particles, stencils: Any, moving: tuple[np.ndarray, np.ndarray], drag: np.ndarray, dt: float
) -> np.ndarray:
    """The ``drag`` (columns,) [kg/m], and where it is 0 that of mass in flight (:func:`runout.physics.contact.free_column_drag`).

    ``moving`` are mass (columns,) [kg] and momentum (columns, 3) [kg m/s].
    """
    total, momentum = moving
    free = np.flatnonzero((drag == 0.0) & (total > 0.0))
    area = scene.spacing[0] * scene.spacing[1] * covered_shares(total.reshape(stencils.shape[:2])).ravel()
    i, j = np.unravel_index(free, stencils.shape[:2])
    x, y = (stencils.first[0] + i) * scene.spacing[0], (stencils.first[1] + j) * scene.spacing[1]
    table, law, gravity = scene.basal.table().view(np.recarray), scene.basal.law.free_column_drag, math.hypot(*scene.gravity)
    drag = drag.astype(np.float64)  # sums over no contacts are whole numbers
    for release, share in enumerate(_release_shares(scene, p, stencils)):
        records = table[scene.basal.rows(np.full(len(free), release), x, y)]
        for c, record in zip(free, records, strict=True):
            drag[c] += share[c] * law(total[c], momentum[c], area[c], gravity, dt, record)
    return drag


def covered_shares(total: np.ndarray) -> np.ndarray:
    """Shares (nx, ny) [1] of their ground that columns of nodes with a mass (nx, ny) [kg] cover; 0 without mass."""
    around, squares = _sums_around(total), _sums_around(total**2)
    covered = array_binding().contact.covered_share(total, around, np.where(total > 0.0, squares, 1.0))
    return np.where(total > 0.0, covered, 0.0)


def _sums_around(values: np.ndarray) -> np.ndarray:
    """Sums (nx, ny) of the 3 x 3 values around each of (nx, ny)."""
    padded = np.pad(values, 1)
    rows = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    return rows[:-2] + rows[1:-1] + rows[2:]  # type: ignore[no-any-return]


def _release_shares(scene: Scene, p: Particles, stencils: Any) -> np.ndarray:
    """Shares (releases, columns) [1] of the releases in the mass of columns of nodes; one row of ones if all have one friction."""
    if scene.basal.alike:
        return np.ones((1, stencils.size // stencils.height))
    own = np.where(p.release[:, None] == np.arange(len(scene.materials)), p.mass[:, None], 0.0)
    masses = _over_z(stencils, stencils.scatter(own)).T
    return np.divide(masses, masses.sum(axis=0), out=np.zeros(masses.shape), where=masses.sum(axis=0) > 0.0)


def weighed(
    node: tuple[np.ndarray, np.ndarray], mass: np.ndarray, release: np.ndarray, ratio: np.ndarray, releases: int,
    first: tuple[int, int], shape: tuple[int, int],
) -> np.ndarray:  # fmt: skip
    """Mass [kg], and mass times pore pressure ratio, (releases, 2, nx, ny) of particles by release and nearest node of the plan.

    Parameters
    ----------
    node : tuple of ndarray (n,)
        Nearest nodes of the particles, east and north.
    mass, release, ratio : ndarray (n,)
        Mass [kg], release, and pore pressure ratio [1].
    releases : int
        Number of all releases.
    first, shape : tuple of int
        First node and number of nodes of the window; particles beyond it do not count.
    """
    i, j = (along - begin for along, begin in zip(node, first, strict=True))
    inside = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
    places = (release[inside] * shape[0] + i[inside]) * shape[1] + j[inside]
    weights = (mass[inside], (mass * ratio)[inside])
    sums = [np.bincount(places, values, releases * shape[0] * shape[1]).reshape(releases, *shape) for values in weights]
    return np.stack(sums, axis=1)


def nearest_nodes(p: Particles) -> tuple[np.ndarray, np.ndarray]:
    """Nearest nodes of the plan (n,) of particles, east and north."""
    east, north = (p.node[:, :2] + np.rint(p.offset[:, :2]).astype(np.int64)).T
    return east, north


def weighed_particles(scene: Scene, p: Particles, first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    """The same (releases, 2, nx, ny) of particles of a scene."""
    ratio = np.zeros(len(p))
    if scene.is_wet:
        table = scene.pore_table().view(np.recarray)[p.release]
        ratio = array_binding().pore_pressure.pore_ratio(p.pore_excess, p.pore_left, table)
    return weighed(nearest_nodes(p), p.mass, p.release, ratio, len(scene.materials), first, shape)
