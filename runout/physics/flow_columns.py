"""A column of the flow over a cell of a map: sums over its particles, its quantities, and what passes between two times."""

import math
from typing import Any


def column_speed(mass: Any, px: Any, py: Any, pz: Any):
    """Speed [m/s] of a column as a whole: its momentum [kg m/s] over its mass [kg]."""
    return math.sqrt(px * px + py * py + pz * pz) / mass


def flow_thickness(depth: Any, speed: Any, density: Any):
    """Vertical thickness h [m]."""
    return depth


def flow_speed(depth: Any, speed: Any, density: Any):
    """Speed v [m/s]."""
    return speed


def dynamic_pressure(depth: Any, speed: Any, density: Any):
    """Pressure rho v^2 [Pa] of a column of ``density`` [kg/m3]: its mass over its volume."""
    return density * speed * speed


def momentum_flux(depth: Any, speed: Any, density: Any):
    """Flux of momentum h v^2 [m3/s2] through a width of 1 m, over the density: the intensity index of Jakob et al. (2012)."""
    return depth * speed * speed


def time_of_passing(level: Any, before: Any, now: Any, start: Any, end: Any):
    """Time [s] at which a number, ``before`` at ``start`` and ``now`` at ``end``, passed ``level`` at a steady rate."""
    return start + (level - before) / (now - before) * (end - start)
