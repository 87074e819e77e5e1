"""Height field as a biquadratic B-spline: elevation, normal and distance at a point.

The spline is C1, so that normals are continuous. With coefficients from :func:`spline_coefficient` it is exact for planes and
parabolas (de Boor 2001, A Practical Guide to Splines, ch. XII), and it has no lip at the edge of a cliff and no moat at its toe.
"""

import math
from typing import Any

from runout.physics.bspline import weight_slopes, weights
from runout.physics.tensors import real, vec


def weight_of_means(count: Any):
    """Weight [1] in :func:`spline_coefficient` of elevations that are means of ``count`` point values.

    A coefficient of a parabola lies 1/8 of the second difference below the middle of its cell; the mean of ``count`` values lies
    (1 - 1/count^2)/24 of it above the middle.
    """
    return real(1.0) / real(3.0) - real(1.0) / (real(12.0) * count * count)


def second_difference(before: Any, here: Any, after: Any):
    """Second difference of three values at equal distances."""
    return before - real(2.0) * here + after


def smoothness(farther_before: Any, before: Any, here: Any, after: Any, farther_after: Any):
    """1 where five second differences are those of smooth ground, 0 at an edge, from the edge to the smooth ground continuous.

    Smooth: the three in the middle have one sign and differ by a factor of 1.6 at most, and the outer two do not outweigh those
    beside them with the other sign. All parabolas are smooth, and waves of at least nine spacings.
    """
    low, high = min(here, min(before, after)), max(here, max(before, after))
    largest = max(high, -low)
    outer_before, outer_after = farther_before + before, after + farther_after
    least = max(real(0.0), max(min(low, min(outer_before, outer_after)), -max(high, max(outer_before, outer_after))))
    return min(real(1.0), max(real(0.0), real(8.0) * least / (largest + real(1.0e-30)) - real(4.0)))


def smooth_coefficient(here: Any, before: Any, after: Any, weight: Any):
    """:func:`spline_coefficient` [m] on smooth ground."""
    return here - weight * (before + after)


def spline_coefficient(here: Any, before: Any, after: Any, smooth: Any, weight: Any):
    """Spline coefficient [m] at an elevation ``here`` [m]; the surface gets no extremum that the elevations do not have.

    On smooth ground c = z - weight (``before`` + ``after``), exact for parabolas. Elsewhere the coefficient is bounded: it rises by
    at most 0.8 of the higher difference and falls by at most 0.8 of the lower one. So none rises above a level edge, and the
    surface half-way to the neighbour stays between both. At a crest or a bottom the surface passes through the elevation if the
    bounds admit it, which takes a weight of 1/3.

    Parameters
    ----------
    here : float
        Elevation [m] at the place of the coefficient.
    before, after : float
        Half of what the elevation one spacing before and after exceeds it by [m]; with the weight 1/2 all of what that half a
        spacing before and after does.
    smooth : float
        :func:`smoothness` [1].
    weight : float
        1/4 for point values at the spacing, see :func:`weight_of_means`; 1/2 for point values at half of it.
    """
    change = -weight * (before + after)
    low, high = min(before, after), max(before, after)
    both = max(real(0.0), low) + min(real(0.0), high)  # the smaller one, 0 for two signs
    bounded = change - real(2.0) * max(real(0.0), real(1.0) / real(3.0) - weight) * both
    bounded = max(min(bounded, real(0.8) * abs(high)), real(-0.8) * abs(low))
    return here + smooth * change + (real(1.0) - smooth) * bounded


def bend_smoothness(slope_2: Any, slope_1: Any, slope: Any, slope_3: Any, slope_4: Any):
    """:func:`smoothness` of a surface with these five slopes one spacing before, half of one before, here, and likewise after."""
    here = real(0.5) * (slope_3 - slope_1)
    return smoothness(slope - slope_1, slope_1 - slope_2, here, slope_4 - slope_3, slope_3 - slope)


def resampled_coefficient(before: Any, here: Any, after: Any, smooth: Any):
    """Coefficient [m] of a spline that follows a surface, from its elevations [m] half a spacing before, here and after.

    Exact for a smooth surface that is such a spline itself; bounded as :func:`spline_coefficient` is.
    """
    return spline_coefficient(here, before - here, after - here, smooth, real(0.5))


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
