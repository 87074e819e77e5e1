"""What the transfers can do besides the packed form of :mod:`runout.physics.moments`.

``apic`` takes stress and strain through the gradients of the weights (Jiang et al. 2016, SIGGRAPH course, sec. 10), ``aflip`` keeps
a part of what the grid does not see of a particle's velocity (Fei et al. 2021, ACM TOG 40:109) and affine matrix, F-bar averages
the volumetric strain over the grid (Zhao, Jiang & Choo 2023, Int. J. Numer. Meth. Eng. 124:5334, here in rate form).
"""

from typing import Any

from runout.physics.tensors import real, tens, vec


def gradient_slope(dt: Any, h: Any):
    """Factor dt / h [s/m] between a sum of nodal velocities over the slopes of the weights [m/s per cell] and dt grad v [1]."""
    return dt / h


def slip_velocity(v: Any, seen: Any):
    """Velocity [m/s] of a particle that the grid has not seen: its own less the mean of the nodal velocities that it gave."""
    return vec(v[0] - seen[0], v[1] - seen[1], v[2] - seen[2])


def slip_moment(a: Any, m: Any, seen: Any):
    """Column of first moments [m/s] that the grid has not seen, from columns m C_j h_j of the particle and C_j h_j of the grid."""
    return vec(
        real(0.25) * (a[0] / m - seen[0]),
        real(0.25) * (a[1] / m - seen[1]),
        real(0.25) * (a[2] / m - seen[2]),
    )


def kept_velocity(u: Any, slip: Any, ratio: Any):
    """Velocity [m/s], or column of moments, after a step: that of the grid and the part ``ratio`` of what it had not seen.

    Both must be kept: forces then do the work on particles that they do on nodes. With the velocities alone the work on the
    affine part is missed, and a flow that shears gains energy.
    """
    return vec(u[0] + ratio * slip[0], u[1] + ratio * slip[1], u[2] + ratio * slip[2])


def dilatation(L: Any):
    """Volumetric strain of a step [1] from the velocity gradient times the step."""
    return L[0] + L[4] + L[8]


def with_dilatation(L: Any, mean: Any, share: Any):
    """Velocity gradient times the step with the ``share`` (0 or 1) of its dilatation replaced by the ``mean`` over the grid."""
    more = share * (mean - (L[0] + L[4] + L[8])) * (real(1.0) / real(3.0))
    return tens(L[0] + more, L[1], L[2], L[3], L[4] + more, L[5], L[6], L[7], L[8] + more)
