"""Limits of an explicit time step."""

import math
from typing import Any

from runout.physics.tensors import real


def acoustic_limit(cfl: Any, h: Any, wave_speed: Any, speed: Any):
    """Largest step [s] at which a pressure wave on moving material crosses ``cfl`` cells of size ``h`` [m]."""
    return cfl * h / (wave_speed + speed)


def isolated_limit(lam: Any, mu: Any):
    """Courant number [1] above which an isolated particle gains energy, from Lame's constants [Pa].

    Its own nodes give it back a dilatation whose stiffness is 3 K where waves feel M = K + 4 G/3. With strain and stress through
    the affine matrix the oscillation is that of a leapfrog with CFL^2 < M/(3 K) = (1 - nu)/(1 + nu).
    """
    return math.sqrt((lam + real(2.0) * mu) / (real(3.0) * lam + real(2.0) * mu))


def particle_limit(h: Any, speed: Any):
    """Largest step [s] in which a particle moves half a cell of size ``h`` [m]."""
    return real(0.5) * h / speed
