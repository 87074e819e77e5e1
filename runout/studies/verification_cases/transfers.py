"""U1, U2 and U3: identities of the weights; mass, momentum and affine fields between particles and nodes."""

import numpy as np

from runout.materials.elastic import Elastic
from runout.model.particles import Particles
from runout.physics import bspline
from runout.studies.verification_cases.bodies import filled, free_scene, loaded
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Result

SPACING = 0.7
CENTRE = np.array([30.0, 30.0, -3.0])
BACKENDS = ("scan", "reference")
PARTS = (1, 2, 4)  # of a millisecond, in a step


def largest_defect(real: type) -> float:
    """Largest error of the five identities at 10^4 points, nodes and cell centres among them, in cells of one."""
    rng = np.random.default_rng(0)
    whole = np.arange(-500, 500)
    q = np.concatenate([rng.uniform(-500, 500, 8000), whole, whole + 0.5])
    f: np.ndarray = (q - np.floor(q - 0.5)).astype(real)
    w, s = np.stack(bspline.weights(f), 1), np.stack(bspline.weight_slopes(f), 1)
    arm = np.arange(3, dtype=real) - f[:, None]
    second = (w * arm**2).sum(1) * real(bspline.inverse_inertia(1.0))
    defects = [w.sum(1) - 1, s.sum(1), (w * arm).sum(1), (s * arm).sum(1) - 1, second - 1]
    return float(np.abs(defects).max())


def measure_weights(full: bool) -> list[Result]:
    """Defects in both precisions."""
    return [
        Bound("largest defect, float64", largest_defect(np.float64), 1e-14),
        Bound("largest defect, float32", largest_defect(np.float32), 1e-6),
    ]


WEIGHTS = Case(
    "U1",
    "weights",
    "10^4 points, nodes, cell centres and negative ones among them: sums of weights, slopes, arms and their products, D = h^2/4",
    measure_weights,
)


def cloud(count: int = 500) -> Particles:
    """Particles of random mass, place and motion, without stress."""
    rng = np.random.default_rng(0)
    p = filled(rng.uniform(-3, 3, (count, 3)) + CENTRE, SPACING, 1.0, 1.0)
    p.mass[:] = rng.uniform(0.1, 10.0, count)
    p.velocity[:] = rng.normal(size=(count, 3))
    p.affine[:] = rng.normal(size=(count, 3, 3))
    return p


def angular_momentum(p: Particles) -> np.ndarray:
    """Angular momentum (3,) [kg m2/s] about the centre, with the affine part."""
    own = p.affine * SPACING**2 / 4
    spin = np.stack([own[:, 2, 1] - own[:, 1, 2], own[:, 0, 2] - own[:, 2, 0], own[:, 1, 0] - own[:, 0, 1]], axis=1)
    arm = p.position(np.full(3, SPACING)) - CENTRE
    return np.asarray((p.mass[:, None] * (np.cross(arm, p.velocity) + spin)).sum(axis=0))


def stepped(p: Particles, backend: str, dt: float = 1e-4, substeps: int = 1) -> Particles:
    """The particles after one transfer of short steps of ``dt`` [s] without forces from outside."""
    engine = loaded(free_scene(SPACING, Elastic(density=1e3, youngs_modulus=1e3)), p, backend)
    engine.step(dt, substeps)
    return engine.particles()


def measure_conservation(full: bool) -> list[Result]:
    """Relative losses of a transfer to and fro."""
    results: list[Result] = []
    p = cloud()
    size = (p.mass * np.linalg.norm(p.velocity, axis=1)).sum()
    for backend in BACKENDS:
        q = stepped(p, backend)
        linear = np.abs(q.mass @ q.velocity - p.mass @ p.velocity).max() / size
        turning = np.abs(angular_momentum(q) - angular_momentum(p)).max() / (5 * size)
        results += [
            Bound(f"mass, {backend}", abs(q.mass.sum() / p.mass.sum() - 1), 1e-13),
            Bound(f"momentum, {backend}", float(linear), 1e-13),
            Bound(f"angular momentum, {backend}", float(turning), 1e-13),
        ]
        ends = [stepped(p, backend, 1e-3 / n, 4) for n in PARTS]
        linear = max(np.abs(q.mass @ q.velocity - p.mass @ p.velocity).max() / size for q in ends)
        turned = tuple(float(np.abs(angular_momentum(q) - angular_momentum(p)).max() / (5 * size)) for q in ends)
        results.append(Bound(f"momentum, 4 substeps, {backend}", float(linear), 1e-13))
        results.append(Convergence(f"angular momentum, 4 substeps of 1 ms over n, {backend}", PARTS, turned, 3.0))
    return results


def measure_affine(full: bool) -> list[Result]:
    """Errors of an affine field that is handed to the nodes and back."""
    gradient = np.array([[0.3, -0.2, 0.1], [0.4, 0.0, -0.5], [0.2, 0.6, -0.1]])
    p = cloud()
    p.velocity[:] = (1.0, -2.0, 0.5) + (p.position(np.full(3, SPACING)) - CENTRE) @ gradient.T
    p.affine[:] = gradient
    results: list[Result] = []
    for backend in BACKENDS:
        q = stepped(p, backend)
        results.append(Bound(f"velocity, {backend}", float(np.abs(q.velocity - p.velocity).max() / 3), 1e-13))
        # the packed form loses up to 1/h of a velocity's rounding
        results.append(Bound(f"velocity gradient, {backend}", float(np.abs(q.affine - gradient).max()), 1e-12))
    return results


CONSERVATION = Case(
    "U2",
    "transfers conserve",
    "500 particles of random mass, velocity and affine matrix, to the grid and back without forces; with 4 substeps the stress "
    "that their motion makes pushes them",
    measure_conservation,
    "With several substeps particles that get velocities have moved on, but the affine matrix belongs to nodes that have not. "
    "The angular momentum so lost in a transfer is of third order in its length.",
)
AFFINE = Case("U3", "affine field returns", "v = a + B x on 500 random particles, one step", measure_affine)
