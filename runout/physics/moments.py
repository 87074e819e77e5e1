"""What particles hand to nodes and get back (Hu et al. 2018, ACM TOG 37:150, eq. 18), and the kinetic energy that they then hold.

With quadratic weights a particle's velocity gradient is C = B / (h^2/4), B the first moments of the nodal velocities about it.
Kept in cells, b_j = B_j / h_j, so that m C (x_n - x_p) + the impulse of the internal force is one product with the offset in cells.
Nine numbers are the three columns one after the other: column j belongs to axis j of the grid.
"""

from typing import Any

from runout.physics.tensors import dot, real, tens, vec


def moment_slope(dt: Any, h: Any):
    """Factor 4 dt / h [s/m] between a first moment [m/s] and a velocity gradient times the step [1]; h^2/4 is the second moment."""
    return real(4.0) * dt / h


def moment_about(b: Any, f: Any, v: Any):
    """Column of first moments [m/s] about a point at ``f`` [cells], from that about zero and the velocity; numbers or lanes."""
    return vec(b[0] - f * v[0], b[1] - f * v[1], b[2] - f * v[2])


def velocity_gradient(bx: Any, by: Any, bz: Any, s: Any):
    """Velocity gradient times the step [1] from the columns b_j of first moments [m/s]; ``s`` of :func:`moment_slope` by axis."""
    return tens(
        s[0] * bx[0], s[1] * by[0], s[2] * bz[0],
        s[0] * bx[1], s[1] * by[1], s[2] * bz[1],
        s[0] * bx[2], s[1] * by[2], s[2] * bz[2],
    )  # fmt: skip


def stress_columns(tau: Any, volume: Any, s: Any):
    """Columns of the impulse of the internal force over a step [kg m/s], -4 dt/h_j V0 tau_j; Kirchhoff stress ``tau`` [Pa]."""
    x = -s[0] * volume
    y = -s[1] * volume
    z = -s[2] * volume
    return tens(x * tau[0], x * tau[3], x * tau[5], y * tau[3], y * tau[1], y * tau[4], z * tau[5], z * tau[4], z * tau[2])


def affine_columns(m: Any, bx: Any, by: Any, bz: Any):
    """Columns of the affine momentum m C_j h_j [kg m/s] from those of the first moments [m/s]."""
    a = real(4.0) * m
    return tens(a * bx[0], a * bx[1], a * bx[2], a * by[0], a * by[1], a * by[2], a * bz[0], a * bz[1], a * bz[2])


def affine_at(p: Any, ax: Any, ay: Any, az: Any, d: Any):
    """Component of an affine field at ``d`` [cells] from where it is ``p``, from its slopes; of numbers or lanes."""
    return p + (d[0] * ax + d[1] * ay + d[2] * az)


def momentum_at(p: Any, ax: Any, ay: Any, az: Any, d: Any):
    """Momentum [kg m/s] of an affine field at ``d`` [cells] from where it is ``p``, from the columns of its slopes [kg m/s]."""
    return vec(
        affine_at(p[0], ax[0], ay[0], az[0], d),
        affine_at(p[1], ax[1], ay[1], az[1], d),
        affine_at(p[2], ax[2], ay[2], az[2], d),
    )


def gradient_column(column: Any, m: Any, h: Any):
    """Column j of the velocity gradient C [1/s] from that of the affine momentum, m C_j h_j."""
    return column / (m * h)


def node_velocity(momentum: Any, mass: Any, dv: Any):
    """Velocity of a node [m/s] after a step, from what its particles brought; ``dv`` = dt g. By component, and by lanes."""
    return momentum / mass + dv


def velocity_after(v: Any, momentum: Any, inverse_mass: Any):
    """Velocity [m/s] of a mass, whose inverse [1/kg] is given, after it took up momentum [kg m/s]. By component, and by lanes."""
    return v + momentum * inverse_mass


def kinetic_energy(m: Any, p: Any, ax: Any, ay: Any, az: Any):
    """Kinetic energy of a particle [J] with its affine part, from its momentum and the columns m C_j h_j [kg m/s].

    h^2/4 is the second moment of the weights along an axis: m (v^2 + sum of h_j^2/4 C_j^2) / 2 without a division by axis.
    """
    spin = dot(ax, ax) + dot(ay, ay) + dot(az, az)
    return real(0.5) * (dot(p, p) + real(0.25) * spin) / m


def potential_energy(m: Any, gravity: Any, x: Any):
    """Potential energy of a particle [J] at ``x`` [m], against the local origin."""
    return -(m * dot(gravity, x))
