"""What the grid cannot resolve: the viscosity of the transfers, and how long a shear through the depth of a flow survives it."""

from typing import Any

from runout.physics.tensors import real


def numerical_viscosity(h: Any, wave_length: Any, dt: Any):
    """Kinematic viscosity [m2/s] of a transfer with quadratic weights for motion of ``wave_length`` [m], cells ``h`` [m]."""
    ratio = h / wave_length
    return real(0.95) * ratio * ratio * h * h / dt


def decay_time(viscosity: Any, wave_length: Any):
    """Time [s] in which a viscosity [m2/s] lets motion of ``wave_length`` [m] fall to 1/e."""
    k = real(6.283185307179586) / wave_length
    return real(1.0) / (viscosity * k * k)


def shear_wave_length(depth: Any):
    """Wave length [m] of the slowest shear of a layer of ``depth`` [m]: at rest below, free above, a quarter wave."""
    return real(4.0) * depth
