"""What the host knows of a scene."""

from __future__ import annotations

from dataclasses import dataclass

from runout.backends import footprints
from runout.backends.hash.validation import fastest, require_finite
from runout.model.particles import Particles
from runout.model.scene import Scene


@dataclass
class Account:
    """What the host knows of a scene."""

    particles: int
    mass: float  # [kg]
    max_speed: float
    particle_volume: float = 0.0  # mean [m3]
    packed_dt: float = 0.0  # time step for which the records hold the stress [s]
    contact_particles: int = 0
    failure: str = ""


def account_of(scene: tuple[Scene, Particles]) -> Account:
    """That of a scene whose particles a step can move."""
    s, p = scene
    require_finite(p, s)
    return Account(len(p), float(p.mass.sum()), fastest(p), footprints.mean_volume(s, p))
