"""Collapse of a column of sand on a flat floor."""

import numpy as np

from runout import DruckerPrager
from runout.backends.protocol import get_backend
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.studies.verification_cases.bodies import lattice, particles_at
from runout.studies.verification_cases.closed_forms import GRAVITY


def collapsed_column(aspect, friction_angle, *, basal_friction_angle=22.0, radius=8.0, spacing=1.0):
    """Run-out (R_99 - R_0)/R_0 and final height H_f/R_0 of a sand column of H_0/R_0 = ``aspect`` on a flat floor.

    R_99 holds 99 % of the mass. The column starts at rest under its own weight in uniaxial strain.
    """
    height = aspect * radius
    sand = DruckerPrager(density=2000.0, youngs_modulus=8e6 * aspect, poisson_ratio=0.3, friction_angle=friction_angle)
    floor, centre = 5.0 + 0.35 * spacing, np.array([50.0 + 0.13 * spacing, 50.0 + 0.27 * spacing])
    local = lattice((2 * radius, 2 * radius, height), spacing) - (radius, radius, 0.0)
    local = local[np.hypot(local[:, 0], local[:, 1]) < radius]
    p = particles_at(local + np.array([*centre, floor]), spacing, sand.density, spacing / 4)
    stiffness = sand.lame_lambda + 2 * sand.shear_modulus
    vertical = sand.density * GRAVITY * (local[:, 2] - height) / stiffness
    p.strain[:, 2] = np.expm1(2 * vertical)
    surface = Surface.through(np.full((12, 12), floor), (10.0, 10.0))
    friction = float(np.tan(np.radians(basal_friction_angle)))
    scene = Scene((spacing,) * 3, surface, Raster(100, 100, (1.0, 1.0)), (sand,), (friction,), precision="float64")
    end = _settled(scene, p, 3.5 * np.sqrt(height / GRAVITY)).position(np.full(3, spacing))
    distance = np.hypot(*(end[:, :2] - centre).T)
    top = end[distance < spacing, 2].max() + spacing / 4 - floor
    return float(np.quantile(distance, 0.99) / radius - 1), float(top / radius)


def _settled(scene, particles, time):
    """Particles after as many stable steps as ``time`` [s] takes."""
    backend, now = get_backend("scan", threads=1), 0.0
    backend.load(scene, particles)
    while now < time:
        dt = backend.stable_step()
        backend.step(dt)
        now += dt
    return backend.particles()
