"""Stress of a mass under its own weight, with which a release starts: that of an infinite slope at or below yield.

On a plane parallel to a free surface of slope tan(theta), at vertical depth d below it, the weight above presses with
sigma_n = rho g d cos^2(theta) and drags with the shear t sigma_n (Taylor 1948, Fundamentals of Soil Mechanics, ch. 16);
t = tan(theta) where the mass rests. Where it slides at once, t is the friction that acts, and the rest of the weight
accelerates all depths alike. Along the plane the normal stress is K sigma_n, with K at rest of Jaky (1944, J. Soc. Hung. Eng.
Archit. 78:355), or the smallest larger one that the yield cone q <= M p + q_c admits beside the shear.

No function branches, so that all accept arrays as well.
"""

import math
from typing import Any

from runout.physics.elastic import strain_of_stress
from runout.physics.tensors import real, sym


def at_rest(phi: Any):
    """Ratio K of the horizontal to the vertical stress at rest [1]: 1 - sin(phi) (Jaky 1944)."""
    return real(1.0) - math.sin(phi)


def shear_strength(slope: Any, intercept: Any):
    """Largest shear stress over the normal stress [1] in steady simple shear without dilation, from M and q_c over that stress.

    All normal stresses are equal then, p = sigma_n and q = sqrt(3) tau: tau = (M sigma_n + q_c)/sqrt(3). With the cone of plane
    strain this is sin(phi), less than tan(phi).
    """
    return (slope + intercept) / math.sqrt(real(3.0))


def acting_friction(ground: Any, strength: Any):
    """Friction coefficient [1] at the base of a mass: that of the ground, at most the :func:`shear_strength` above it.

    A mass on stronger ground shears just above it, as in the exact solution of a thick layer. A layer of a few cells does not
    resolve that shear, and would feel the whole friction of the ground.
    """
    return min(ground, strength)


def mobilised_share(tangent: Any, limit: Any):
    """Share of the shear tan(theta) sigma_n of a resting slope that is carried [1], where shear is at most ``limit`` sigma_n."""
    return min(real(1.0), limit / max(tangent, real(1.0e-12)))


def lateral_ratio(rest: Any, shear: Any, slope: Any, intercept: Any):
    """Ratio K [1] of the normal stress along a plane to that on it: ``rest``, or the least above it inside the yield cone.

    With 1, K, K and the shear t, in units of sigma_n, x = 1 - K has p = 1 - 2x/3 and q^2 = x^2 + 3 t^2. The cone holds
    x^2 + 3 t^2 <= (c + M - 2 M x/3)^2, with c = q_c/sigma_n; the largest such x is the root of a quadratic equation. At
    K = 1 the cone holds every t up to :func:`shear_strength`.
    """
    limit = intercept + slope
    taken = real(3.0) * shear * shear
    b = real(2.0) / real(3.0) * slope * limit
    square = limit * limit - taken * (real(1.0) - real(4.0) / real(9.0) * slope * slope)
    x = max(limit * limit - taken, real(0.0)) / max(b + math.sqrt(max(square, real(0.0))), real(1.0e-12))
    return max(rest, real(1.0) - x)


def slope_stress(weight: Any, east: Any, north: Any, share: Any, ratio: Any):
    """Stress [Pa], tension positive, below a free surface with slopes ``east`` and ``north`` [1].

    ``weight`` [Pa] is that of the mass above over its plan area, rho g d; ``share`` and ``ratio`` are
    :func:`mobilised_share` and :func:`lateral_ratio`. With the upward normal n and the vector b down the slope, as long as
    its tangent, -sigma_n (K I + (1 - K) n n^T) + share sigma_n (n b^T + b n^T).
    """
    square = east * east + north * north
    cos2 = real(1.0) / (real(1.0) + square)
    normal = weight * cos2
    a = -normal * cos2 * (real(1.0) - ratio - real(2.0) * share)
    b = normal * cos2 * (real(1.0) - ratio - share * (real(1.0) - square))
    c = -normal * cos2 * (real(1.0) - ratio + real(2.0) * share * square)
    pressed = normal * ratio
    return sym(a * east * east - pressed, a * north * north - pressed, c - pressed, a * east * north, b * north, b * east)


def strain_at_rest(
    weight: Any, east: Any, north: Any, tangent: Any, friction: Any, slope: Any, intercept: Any, rest: Any, mat: Any
):
    """Hencky strain h [1] of a mass under its own weight, below a free surface.

    ``weight`` [Pa], ``east`` and ``north`` [1] as in :func:`slope_stress`; ``tangent`` [1] is the length of both slopes. The
    ``friction`` coefficient [1] acts at the base; ``slope`` and ``intercept`` [Pa] are M and q_c of the yield cone; ``rest`` is the
    ratio K [1] at rest.
    """
    normal = max(weight / (real(1.0) + tangent * tangent), real(1.0e-12))
    cohesion = intercept / normal
    limit = min(friction, shear_strength(slope, cohesion))
    share = mobilised_share(tangent, limit)
    ratio = lateral_ratio(rest, share * tangent, slope, cohesion)
    return strain_of_stress(slope_stress(weight, east, north, share, ratio), mat)
