"""U4 and U5: free fall and rotation of whole bodies."""

import numpy as np

from runout.materials.elastic import Elastic
from runout.studies.verification_cases.bodies import advance, free_scene, lattice, loaded, particles_at
from runout.studies.verification_cases.closed_forms import GRAVITY, rotated, symplectic_free_fall
from runout.studies.verification_cases.finding import Bound, Case, Result

ROCK = Elastic(density=1550.0, youngs_modulus=1e6, poisson_ratio=0.3)
SPACING = 0.1
WIDTHS = np.full(3, SPACING)


def fall(backend: str = "scan") -> tuple[float, float, float]:
    """Largest error of position [m] and velocity [m/s], and largest strain [1], of a cube after 200 steps of free fall."""
    p = particles_at(lattice((0.5, 0.5, 0.5), SPACING) + np.array([5.013, 5.027, 3.041]), SPACING, ROCK.density, 0.0)
    scene, steps, dt = free_scene(SPACING, ROCK, gravity=GRAVITY), 200, 1e-3
    engine = loaded(scene, p, backend)
    advance(engine, scene, steps, dt)
    q, (height, velocity) = engine.particles(), symplectic_free_fall(steps, dt)
    place = np.abs(q.position(WIDTHS) - p.position(WIDTHS) - (0, 0, height)).max()
    return float(place), float(np.abs(q.velocity - (0, 0, velocity)).max()), float(np.abs(q.strain).max())


def spin(time: float, spacing: float = SPACING) -> tuple[float, float, float]:
    """A cube of 1 m that turns at 1 rad/s about its centre for ``time`` [s].

    Returns the share of its energy that is lost [1], the smallest such share at any second [1] and the largest error of
    a particle's place [m].
    """
    centre, local = np.array([10.0, 10.0, 0.0]), lattice((1.0, 1.0, 1.0), spacing) - 0.5
    p = particles_at(centre + local, spacing, ROCK.density, 0.0)
    whirl = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    p.velocity[:] = local @ whirl.T
    p.affine[:] = whirl
    scene = free_scene(spacing, ROCK)
    engine = loaded(scene, p)
    start, steps, losses = engine.ledger().kinetic_energy, int(np.ceil(85.0 / spacing)), []
    for _ in range(round(time)):
        advance(engine, scene, steps, 1.0 / steps)
        row = engine.ledger()
        losses.append(1 - (row.kinetic_energy + row.elastic_energy) / start)
    place = engine.particles().position(np.full(3, spacing)) - centre
    return losses[-1], min(losses), float(np.abs(place - rotated(local, time)).max())


def measure_fall(full: bool) -> list[Result]:
    """Errors of a falling cube."""
    place, velocity, strain = fall()
    return [Bound("position [m]", place, 1e-12), Bound("velocity [m/s]", velocity, 1e-12), Bound("strain", strain, 1e-12)]


def measure_spin(full: bool) -> list[Result]:
    """Loss of energy and place of a spinning cube."""
    time = 20.0 if full else 1.0
    loss, least, place = spin(time)
    return [
        Bound(f"energy lost after {time:g} s", loss, 1e-3 if full else 1.2e-4),
        Bound("smallest loss at any second (a gain is negative)", least, low=0.0),
        Bound(f"error of place after {time:g} s [m]", place, 4e-3 if full else 2e-4),
    ]


FALL = Case("U4", "free fall", "cube of 0.5 m off the grid, 200 steps, against symplectic Euler's own parabola", measure_fall)
SPIN = Case("U5", "rotation", "cube of 1 m, E = 1 MPa, 1550 kg/m3, 1 rad/s, h = 0.1 m, 8 particles a cell", measure_spin)
