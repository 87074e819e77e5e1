"""What the host knows of a scene."""

from __future__ import annotations

from dataclasses import dataclass


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
