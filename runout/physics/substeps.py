"""Substeps of a transfer: a grid that moves with the mass while positions, weights and nodal masses stay.

A transfer of several substeps passes velocities between particles and nodes once, and takes forces and contacts anew in each of
them. With u_n, the way [m] of a node since the start of the transfer, the deformation of a particle is

    F = I + sum_n w_np u_n (x_n - x_p)^T D^-1,

as the velocity gradient follows from nodal velocities (Hu et al. 2018, ACM TOG 37:150, eq. 18). A gradient with respect to places
at the start of the transfer becomes one with respect to present places by F^-1 from the right, and a Kirchhoff stress becomes the
stress whose divergence is taken at the start, tau F^-T (total Lagrangian form; de Vaucorbeil, Nguyen & Hutchinson 2020,
Comput. Methods Appl. Mech. Eng. 360:112783).
"""

import math
from typing import Any

from runout.physics.tensors import dot, real, tens

MOST_SUBSTEPS = 64
LONGEST_WAY = 0.45  # cells that the fastest particle may go in a transfer of several substeps
SLOWEST = 0.01  # cells in a substep; mass that moves more slowly creeps less where each step damps
LEAST_VOLUME, LARGEST_VOLUME = 0.5, 2.0  # of the volume at the start of the transfer, between which its deformation counts


def longest_transfer(speed: Any, gravity: Any, h: Any):
    """Time [s] in which the fastest particle goes :data:`LONGEST_WAY` cells of size ``h`` [m].

    It moves at ``speed`` [m/s], and ``gravity`` [m/s2] speeds it up: the root T > 0 of speed T + gravity T^2 = way, twice the fall.
    """
    way = real(LONGEST_WAY) * h
    return real(2.0) * way / (speed + math.sqrt(speed * speed + real(4.0) * gravity * way))


def is_slow(speed: Any, dt: Any, h: Any):
    """Whether mass at ``speed`` [m/s] is so slow that a transfer has one substep: the loss of each transfer stops its creep."""
    return speed * dt < real(SLOWEST) * h


def inverse_deformation(G: Any):
    """Inverse F^-1 [1] of F = I + G, from the gradient ``G`` [1] of the way since the start of the transfer.

    The identity where the volume has left :data:`LEAST_VOLUME` to :data:`LARGEST_VOLUME`: a particle that deforms so much within
    one transfer is treated as if its grid stood still.
    """
    xx = real(1.0) + G[0]
    yy = real(1.0) + G[4]
    zz = real(1.0) + G[8]
    a = yy * zz - G[5] * G[7]
    b = G[5] * G[6] - G[3] * zz
    c = G[3] * G[7] - yy * G[6]
    volume = xx * a + G[1] * b + G[2] * c
    d = real(0.0)
    rest = real(1.0)
    if volume > real(LEAST_VOLUME) and volume < real(LARGEST_VOLUME):
        d = real(1.0) / volume
        rest = real(0.0)
    return tens(
        a * d + rest, (G[2] * G[7] - G[1] * zz) * d, (G[1] * G[5] - G[2] * yy) * d,
        b * d, (xx * zz - G[2] * G[6]) * d + rest, (G[2] * G[3] - xx * G[5]) * d,
        c * d, (G[1] * G[6] - xx * G[7]) * d, (xx * yy - G[1] * G[3]) * d + rest,
    )  # fmt: skip


def present_gradient(L: Any, inverse: Any):
    """Velocity gradient times the substep [1] with respect to present places, L F^-1, from that to places at the start."""
    return tens(
        L[0] * inverse[0] + L[1] * inverse[3] + L[2] * inverse[6],
        L[0] * inverse[1] + L[1] * inverse[4] + L[2] * inverse[7],
        L[0] * inverse[2] + L[1] * inverse[5] + L[2] * inverse[8],
        L[3] * inverse[0] + L[4] * inverse[3] + L[5] * inverse[6],
        L[3] * inverse[1] + L[4] * inverse[4] + L[5] * inverse[7],
        L[3] * inverse[2] + L[4] * inverse[5] + L[5] * inverse[8],
        L[6] * inverse[0] + L[7] * inverse[3] + L[8] * inverse[6],
        L[6] * inverse[1] + L[7] * inverse[4] + L[8] * inverse[7],
        L[6] * inverse[2] + L[7] * inverse[5] + L[8] * inverse[8],
    )


def stress_at_start(tau: Any, inverse: Any):
    """Stress tau F^-T [Pa] (not symmetric), whose divergence is taken at the places at the start; Kirchhoff stress ``tau`` [Pa]."""
    return tens(
        tau[0] * inverse[0] + tau[3] * inverse[1] + tau[5] * inverse[2],
        tau[0] * inverse[3] + tau[3] * inverse[4] + tau[5] * inverse[5],
        tau[0] * inverse[6] + tau[3] * inverse[7] + tau[5] * inverse[8],
        tau[3] * inverse[0] + tau[1] * inverse[1] + tau[4] * inverse[2],
        tau[3] * inverse[3] + tau[1] * inverse[4] + tau[4] * inverse[5],
        tau[3] * inverse[6] + tau[1] * inverse[7] + tau[4] * inverse[8],
        tau[5] * inverse[0] + tau[4] * inverse[1] + tau[2] * inverse[2],
        tau[5] * inverse[3] + tau[4] * inverse[4] + tau[2] * inverse[5],
        tau[5] * inverse[6] + tau[4] * inverse[7] + tau[2] * inverse[8],
    )


def force_columns(P: Any, volume: Any, s: Any):
    """Columns of the impulse of the internal force over a substep [kg m/s], -4 dt/h_j V0 P_j, from :func:`stress_at_start`.

    As :func:`runout.physics.moments.stress_columns`, of a stress that is not symmetric.
    """
    x = -s[0] * volume
    y = -s[1] * volume
    z = -s[2] * volume
    return tens(x * P[0], x * P[3], x * P[6], y * P[1], y * P[4], y * P[7], z * P[2], z * P[5], z * P[8])


def time_ahead(lasting: Any, dt: Any):
    """Time [s] after the start of a transfer of ``lasting`` [s] at which contacts take the ground and its friction.

    The middle of the transfer but for half a substep ``dt`` [s]. A ground that bends turns by w / R on a way w. With the normal of
    the start the mass would move along the tangent there, and the ground would lift it back by w^2 / 2R at the end without taking
    that from its velocity: it would gain (w - w / k) / 2R of its weight for each metre in a hollow of radius R. With the normal of
    the middle it moves along the chord. A change of friction acts where the mass crosses it, not half a transfer later.
    """
    return real(0.5) * (lasting - dt)


def moved_gap(gap: Any, n: Any, way: Any):
    """Gap or distance [m] of a particle that has gone a ``way`` [m] since it was measured, with the normal ``n`` of then."""
    return gap + dot(n, way)
