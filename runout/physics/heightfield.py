"""Height field as a biquadratic B-spline: elevation, normal and distance at a point.

The spline is C1, so that normals are continuous; it is exact for planes and, with coefficients from
:func:`quasi_interpolant`, for parabolas (de Boor 2001, A Practical Guide to Splines, ch. XII).
"""

import math
from typing import Any

from runout.physics.bspline import weight_slopes, weights
from runout.physics.tensors import real, vec


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


def height_at(separation: Any, n_z: Any):
    """Height above the surface [m] of a point at a first-order distance [m] from it: what :func:`distance` undoes."""
    return separation / n_z


def surface_at(c: Any, fx: Any, fy: Any):
    """Elevation and its slopes by the two coordinates [m / cell], from nine coefficients [m] by rows of x around the point."""
    wx = weights(fx)
    wy = weights(fy)
    dx = weight_slopes(fx)
    dy = weight_slopes(fy)
    r0 = interpolate(wy, c[0], c[1], c[2])
    r1 = interpolate(wy, c[3], c[4], c[5])
    r2 = interpolate(wy, c[6], c[7], c[8])
    s0 = interpolate(dy, c[0], c[1], c[2])
    s1 = interpolate(dy, c[3], c[4], c[5])
    s2 = interpolate(dy, c[6], c[7], c[8])
    return vec(interpolate(wx, r0, r1, r2), interpolate(dx, r0, r1, r2), interpolate(wx, s0, s1, s2))


def upward_normal(slope_x: Any, slope_y: Any):
    """Upward unit normal [1] of a surface with the given slopes [1]."""
    n_z = normal_z(slope_x, slope_y)
    return vec(-slope_x * n_z, -slope_y * n_z, n_z)
