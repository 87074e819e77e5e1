"""What every backend asks of the particles that it loads."""

import numpy as np

from runout.errors import StabilityError
from runout.model.particle_source import ParticleSource, slices
from runout.model.particles import Particles


def require_movable(p: Particles) -> None:
    """Raise StabilityError for particles that no step can move."""
    if not (p.is_still or np.isfinite(p.velocity).all()) or not np.isfinite(p.offset).all():
        raise StabilityError("positions or velocities of the particles are not finite; check the input")
    if not (p.mass > 0).all():
        raise StabilityError("a particle has no mass; every particle needs a positive mass")


def fastest(p: Particles) -> float:
    """Largest speed [m/s]."""
    return 0.0 if p.is_still else float(np.sqrt((p.velocity**2).sum(1).max(initial=0.0)))


def surveyed(source: ParticleSource) -> tuple[np.ndarray, float]:
    """First nodes (n, 3) int32 of all particles and their largest speed [m/s]; StabilityError for those that no step can move."""
    nodes, speed = np.empty((len(source), 3), np.int32), 0.0
    for part, chunk in slices(source, stressed=False):
        require_movable(chunk)
        nodes[part], speed = chunk.node, max(speed, fastest(chunk))
    return nodes, speed
