"""What the host knows of a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runout.model.particles import Particles, joined_mean


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

    def join(self, p: Particles, densities: np.ndarray, speed: float) -> None:
        """Count particles that join the scene, the fastest of them with a ``speed`` [m/s]."""
        more = p.sums(densities)
        self.particle_volume = joined_mean(self.particle_volume, self.particles, more.mean_volume, len(p))
        self.particles += len(p)
        self.mass += more.mass
        self.max_speed = max(self.max_speed, speed)
