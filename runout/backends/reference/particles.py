"""Loops over particles that apply one formula of :mod:`runout.physics` to each; the binding compiles them.

They hold no formula and no addressing. ``update`` stands for the law of the scene: the binding puts it there.
"""

from typing import Any

from runout.physics.contact import impulse, in_contact, work
from runout.physics.elastic import energy_density, kirchhoff_stress, log_strain, update
from runout.physics.heightfield import distance, normal_z
from runout.physics.tensors import sym, tens, vec
from runout.physics.transfers import kept_velocity, with_dilatation


def take_log(strain: Any, log: Any):
    """Hencky strain ``log`` (n, 6) [1] of the elastic strain B (n, 6) [1]."""
    for p in range(len(strain)):
        B = strain[p]
        h = log_strain(sym(B[0], B[1], B[2], B[3], B[4], B[5]))
        for k in range(6):
            log[p, k] = h[k]


def follow_law(strain: Any, gradient: Any, history: Any, release: Any, table: Any, log: Any, dissipated: Any):
    """Advance the law of every particle by the velocity gradient times dt (n, 3, 3) [1].

    Changes ``strain`` (n, 6) and ``history`` (n,), writes the Hencky strain ``log`` (n, 6) [1] that gives the stress and
    the ``dissipated`` energy (n,) [J/m3].
    """
    for p in range(len(strain)):
        B = strain[p]
        L = gradient[p]
        rate = tens(L[0, 0], L[0, 1], L[0, 2], L[1, 0], L[1, 1], L[1, 2], L[2, 0], L[2, 1], L[2, 2])
        new, h, left, lost = update(sym(B[0], B[1], B[2], B[3], B[4], B[5]), rate, history[p], table[release[p]])
        history[p] = left
        dissipated[p] = lost
        for k in range(6):
            strain[p, k] = new[k]
            log[p, k] = h[k]


def take_stress(log: Any, release: Any, table: Any, stress: Any, energy: Any):
    """Kirchhoff ``stress`` (n, 6) [Pa] and stored ``energy`` (n,) [J/m3] of the Hencky strain (n, 6) [1]."""
    for p in range(len(log)):
        h = sym(log[p, 0], log[p, 1], log[p, 2], log[p, 3], log[p, 4], log[p, 5])
        tau = kirchhoff_stress(h, table[release[p]])
        energy[p] = energy_density(h, table[release[p]])
        for k in range(6):
            stress[p, k] = tau[k]


def take_gap(radius: Any, gap: Any, normal: Any):
    """Turn height above the ground [m] into the ``gap`` (n,) [m], slopes (east, north, 1) into the unit ``normal`` (n, 3)."""
    for p in range(len(gap)):
        n_z = normal_z(normal[p, 0], normal[p, 1])
        normal[p, 0] *= -n_z
        normal[p, 1] *= -n_z
        normal[p, 2] = n_z
        gap[p] = distance(gap[p], n_z) - radius[p]


def find_contacts(gap: Any, normal_velocity: Any, dt: Any, band: Any, touches: Any):
    """Whether each particle ``touches`` (n,) the ground within the step."""
    for p in range(len(gap)):
        touches[p] = in_contact(gap[p], normal_velocity[p], dt, band)


def take_impulses(before: Any, u: Any, normal: Any, gap: Any, compliance: Any, friction: Any, dt: Any, impulses: Any, done: Any):
    """Ground's ``impulses`` (n, 3) [N s] on contact particles and the work ``done`` (n,) [J] by them.

    ``before`` (n, 3) [m/s] are velocities before the step, ``u`` (n, 3) those that the grid would give back.
    """
    for p in range(len(u)):
        n = vec(normal[p, 0], normal[p, 1], normal[p, 2])
        given = vec(u[p, 0], u[p, 1], u[p, 2])
        push = impulse(given, n, gap[p], compliance[p], friction[p], dt)
        done[p] = work(push, vec(before[p, 0], before[p, 1], before[p, 2]), given, compliance[p])
        for k in range(3):
            impulses[p, k] = push[k]


def average_dilatation(gradient: Any, mean: Any):
    """Put the ``mean`` (n,) [1] in the place of the dilatation of each velocity gradient times dt (n, 3, 3) [1]."""
    for p in range(len(mean)):
        L = gradient[p]
        rate = tens(L[0, 0], L[0, 1], L[0, 2], L[1, 0], L[1, 1], L[1, 2], L[2, 0], L[2, 1], L[2, 2])
        new = with_dilatation(rate, mean[p], 1.0)
        for i in range(3):
            L[i, i] = new[4 * i]


def keep_velocity(velocity: Any, slip: Any, ratio: Any):
    """Add the part ``ratio`` of the ``slip`` (n, 3), unseen by the grid, to velocities or rows of matrices (n, 3) of the grid."""
    for p in range(len(velocity)):
        u = vec(velocity[p, 0], velocity[p, 1], velocity[p, 2])
        kept = kept_velocity(u, vec(slip[p, 0], slip[p, 1], slip[p, 2]), ratio)
        for k in range(3):
            velocity[p, k] = kept[k]
