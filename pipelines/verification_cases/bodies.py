"""Bodies of regular particles, and runs of a backend in equal steps."""

import numpy as np

from runout.backends.protocol import Backend, get_backend
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface


def lattice(size: tuple[float, ...], spacing: float, per_cell: int = 2) -> np.ndarray:
    """Positions (n, 3) [m] of regular particles in a box with one corner at the origin."""
    axes = [np.arange(round(s * per_cell / spacing)) * spacing / per_cell + spacing / per_cell / 2 for s in size]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def particles_at(position: np.ndarray, spacing: float, density: float, radius: float, per_cell: int = 2) -> Particles:
    """Particles of equal volume at positions (n, 3) [m] of a cubic grid."""
    return filled(position, spacing, density, (spacing / per_cell) ** 3, radius)


def filled(position: np.ndarray, spacing: float, density: float, volume: float, radius: float = 0.0) -> Particles:
    """Particles of one stress-free ``volume`` [m3] each at positions (n, 3) [m] of a cubic grid."""
    p = Particles.at(position, np.full(3, spacing))
    p.volume[:] = volume
    p.mass[:] = density * volume
    p.radius[:] = radius
    return p


def free_scene(spacing: float, material: object, surface: Surface | None = None, gravity: float = 0.0, cfl: float = 0.4) -> Scene:
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
