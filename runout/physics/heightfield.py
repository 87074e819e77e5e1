"""Height field as a biquadratic B-spline: elevation, normal and distance at a point.

The spline is C1, so that normals are continuous; it is exact for planes and, with coefficients from
:func:`quasi_interpolant`, for parabolas (de Boor 2001, A Practical Guide to Splines, ch. XII).
"""

import math
from typing import Any

from runout.physics.tensors import real


def quasi_interpolant(before: Any, here: Any, after: Any):
    """Spline coefficient [m] at the middle of three equally spaced elevations [m]."""
    return here - real(0.125) * (before - real(2.0) * here + after)


def interpolate(w: Any, a: Any, b: Any, c: Any):
    """Weighted sum of three values along one axis."""
    return w[0] * a + w[1] * b + w[2] * c


def normal_z(slope_x: Any, slope_y: Any):
    """Vertical component of the upward unit normal [1] of a surface with the given slopes [1]."""
    return real(1.0) / math.sqrt(real(1.0) + slope_x * slope_x + slope_y * slope_y)


def distance(height_above: Any, n_z: Any):
    """First-order distance [m] from the surface for a height above it [m], positive outside."""
    return height_above * n_z
