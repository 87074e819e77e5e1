"""Bodies of regular particles, and runs of a backend in equal steps with the transfers of a run."""

from dataclasses import replace

import numpy as np

from runout.backends.protocol import Backend, get_backend
from runout.model.limits import CFL
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.physics.substeps import MOST_SUBSTEPS


def lattice(size: tuple[float, ...], spacing: float, per_cell: int = 2) -> np.ndarray:
    """Positions (n, 3) [m] of regular particles in a box with one corner at the origin."""
    axes = [np.arange(round(s * per_cell / spacing)) * spacing / per_cell + spacing / per_cell / 2 for s in size]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def particles_at(position: np.ndarray, spacing: float, density: float, radius: float, per_cell: int = 2) -> Particles:
    """Particles of equal volume at positions (n, 3) [m] of a cubic grid."""
    return filled(position, spacing, density, (spacing / per_cell) ** 3, radius)


def filled(
    position: np.ndarray, spacing: float | tuple[float, float, float], density: float, volume: float, radius: float = 0.0
) -> Particles:
    """Particles of one stress-free ``volume`` [m3] each at positions (n, 3) [m] of a grid, cubic if ``spacing`` is one number."""
    p = Particles.at(position, np.broadcast_to(np.asarray(spacing, float), 3))
    p.volume[:] = volume
    p.mass[:] = density * volume
    p.radius[:] = radius
    return p


def free_scene(spacing: float, material: object, surface: Surface | None = None, gravity: float = 0.0, cfl: float = CFL) -> Scene:
    """Scene in float64 on a cubic grid in a domain of 1 km, without friction."""
    raster = Raster(100, 100, (10.0, 10.0))
    return Scene((spacing,) * 3, surface, raster, (material,), (0.0,), (0.0, 0.0, -gravity), cfl=cfl, precision="float64")  # type: ignore[arg-type]


def loaded(scene: Scene, particles: Particles, backend: str = "scan") -> Backend:
    """A backend on one thread that has taken over a scene."""
    engine = get_backend(backend, threads=1)
    engine.load(scene, particles)
    return engine


def equal_steps(time: float, limit: float) -> tuple[int, float]:
    """How many equal steps within 0.95 of ``limit`` [s] make up ``time`` [s], and their length [s]."""
    steps = int(np.ceil(time / (0.95 * limit)))
    return steps, time / steps


def transfer(engine: Backend, scene: Scene, dt: float, most: int = MOST_SUBSTEPS) -> int:
    """One transfer of steps of ``dt`` [s], as many as a run would take and at most ``most``; returns their number."""
    count = min(most, scene.substep_count(dt, engine.max_speed))
    engine.step(dt, count)
    return count


def advance(engine: Backend, scene: Scene, steps: int, dt: float) -> None:
    """``steps`` steps of ``dt`` [s] in the transfers that a run would make."""
    while steps:
        steps -= transfer(engine, scene, dt, steps)


def relaxed(
    scene: Scene,
    particles: Particles,
    time: float,
    damping: float,
    along: np.ndarray | None = None,
    ramp: float = 0.0,
    every: int = 10,
    engine: Backend | None = None,
) -> Particles:
    """Particles at rest with the stresses that remain after ``time`` [s] with ``damping`` [1/s].

    Velocities are damped towards rest, or towards the mean velocity ``along`` a unit vector (3,), once in ``every`` steps.
    Gravity grows from zero during ``ramp`` [s]. ``engine`` takes the steps, scan on one thread where none is given.
    """
    engine = engine or get_backend("scan", threads=1)
    engine.load(scene, particles)
    steps, dt = equal_steps(time, engine.stable_step())
    remaining = float(np.exp(-damping * every * dt))
    for step in range(0, steps, every):
        share = min(1.0, (step + every) * dt / ramp) if ramp > 0 else 1.0
        x, y, z = scene.gravity
        engine.load(replace(scene, gravity=(share * x, share * y, share * z)), particles)
        advance(engine, scene, every, dt)
        particles = engine.particles()
        rigid = np.zeros(3) if along is None else (particles.velocity @ along).mean() * along
        particles.velocity[:] = rigid + remaining * (particles.velocity - rigid)
        particles.affine *= remaining
    particles.velocity[:] = 0.0
    particles.affine[:] = 0.0
    return particles
