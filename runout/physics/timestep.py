"""Limits of an explicit time step."""

from typing import Any

from runout.physics.tensors import real


def acoustic_limit(cfl: Any, h: Any, wave_speed: Any, speed: Any):
    """Largest step [s] at which a pressure wave on moving material crosses ``cfl`` cells of size ``h`` [m]."""
    return cfl * h / (wave_speed + speed)


def particle_limit(h: Any, speed: Any):
    """Largest step [s] in which a particle moves half a cell of size ``h`` [m]."""
    return real(0.5) * h / speed
