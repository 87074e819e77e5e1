"""Loops over particles that apply one formula of :mod:`runout.physics` to each; the binding compiles them.

They hold no formula and no addressing. ``law_step`` and ``impulse`` stand for the laws of the scene: the binding puts them there.
"""

from typing import Any

from runout.physics.contact import effective_impulse as impulse
from runout.physics.contact import in_contact, work
from runout.physics.elastic import energy_density, kirchhoff_stress, log_strain
from runout.physics.heightfield import distance, upward_normal
from runout.physics.plastic import effective_step as law_step
from runout.physics.pore_pressure import effective_share, remaining_share
from runout.physics.structures import (
    contact_gap,
    entry_velocity,
    nearest_place,
    outward_normal,
    separation,
    separation_slopes,
    stopping_impulse,
)
from runout.physics.substeps import inverse_deformation, moved_gap, present_gradient, stress_at_start
from runout.physics.tensors import dot, sym, tens, vec


def follow_law(strain: Any, gradient: Any, history: Any, release: Any, table: Any, effective: Any, dissipated: Any):
    """Advance ``strain`` (n, 6) and ``history`` (n,) by the law and the velocity gradient times dt (n, 9) [1].

    ``effective`` (n,) [1] is the share of the mean stress that grains carry. Writes the ``dissipated`` energy (n,) [J/m3].
    """
    for p in range(len(strain)):
        B = strain[p]
        L = gradient[p]
        rate = tens(L[0], L[1], L[2], L[3], L[4], L[5], L[6], L[7], L[8])
        trial = sym(B[0], B[1], B[2], B[3], B[4], B[5])
        new, _, left, lost = law_step(trial, rate, history[p], table[release[p]], effective[p])
        history[p] = left
        dissipated[p] = lost
        for k in range(6):
            strain[p, k] = new[k]


def take_stress(strain: Any, release: Any, table: Any, stress: Any, energy: Any):
    """Kirchhoff ``stress`` (n, 6) [Pa] and stored ``energy`` (n,) [J/m3] of the elastic strain B (n, 6) [1]."""
    for p in range(len(strain)):
        B = strain[p]
        h = log_strain(sym(B[0], B[1], B[2], B[3], B[4], B[5]))
        tau = kirchhoff_stress(h, table[release[p]])
        energy[p] = energy_density(h, table[release[p]])
        for k in range(6):
            stress[p, k] = tau[k]


def follow_deformation(gradient: Any, deformation: Any):
    """Refer the velocity gradients times a substep (n, 9) [1] to present places, and add what they were to the ``deformation``.

    ``deformation`` (n, 9) [1] is the gradient of the way since the start of the transfer.
    """
    for p in range(len(gradient)):
        L, G = gradient[p], deformation[p]
        rate = tens(L[0], L[1], L[2], L[3], L[4], L[5], L[6], L[7], L[8])
        way = tens(G[0], G[1], G[2], G[3], G[4], G[5], G[6], G[7], G[8])
        present = present_gradient(rate, inverse_deformation(way))
        for k in range(9):
            deformation[p, k] += rate[k]
            gradient[p, k] = present[k]


def refer_stress(stress: Any, deformation: Any, at_start: Any):
    """Write the stress ``at_start`` (n, 9) [Pa] of the transfer from the Kirchhoff ``stress`` (n, 6) [Pa] and the deformation."""
    for p in range(len(stress)):
        tau, G = stress[p], deformation[p]
        way = tens(G[0], G[1], G[2], G[3], G[4], G[5], G[6], G[7], G[8])
        P = stress_at_start(sym(tau[0], tau[1], tau[2], tau[3], tau[4], tau[5]), inverse_deformation(way))
        for k in range(9):
            at_start[p, k] = P[k]


def move_gaps(gap: Any, normal: Any, way: Any, moved: Any):
    """Write the gaps or distances (n,) [m] of particles that have gone a ``way`` (n, 3) [m] since they were found."""
    for p in range(len(gap)):
        n, gone = vec(normal[p, 0], normal[p, 1], normal[p, 2]), vec(way[p, 0], way[p, 1], way[p, 2])
        moved[p] = moved_gap(gap[p], n, gone)


def gaps_of(distance: Any, radius: Any, gap: Any):
    """Write the ``gap`` (n,) [m] of particles at a ``distance`` (n,) [m] from structures."""
    for p in range(len(gap)):
        gap[p] = contact_gap(distance[p], radius[p])


def find_contacts(velocity: Any, radius: Any, dt: Any, band: Any, gap: Any, normal: Any, touches: Any):
    """Turn height above the ground [m] into the ``gap`` (n,) [m], slopes (east, north, 1) into the unit ``normal`` (n, 3).

    Says whether each particle ``touches`` (n,) the ground within the step.
    """
    for p in range(len(gap)):
        n = upward_normal(normal[p, 0], normal[p, 1])
        gap[p] = distance(gap[p], n[2]) - radius[p]
        touches[p] = in_contact(gap[p], dot(vec(velocity[p, 0], velocity[p, 1], velocity[p, 2]), n), dt, band)
        for k in range(3):
            normal[p, k] = n[k]


def drain(excess: Any, left: Any, thickness: Any, release: Any, pores: Any, dt: Any, effective: Any):
    """Advance the part that is ``left`` (n,) of the excess pore pressure in layers of a ``thickness`` (n,) [m] by ``dt`` [s].

    Writes the ``effective`` shares (n,) [1] in the middle of this time. ``pores`` are records.
    """
    for p in range(len(left)):
        pore = pores[release[p]]
        share = remaining_share(thickness[p], 0.5 * dt, pore)
        effective[p] = effective_share(excess[p], share * left[p], pore)
        left[p] = share * share * left[p]


def take_impulses(
    gap: Any, basal: Any, area: Any, effective: Any, dt: Any, v: Any, u: Any, normal: Any, compliance: Any, impulses: Any,
    done: Any,
):  # fmt: skip
    """``impulses`` (n, 3) [N s] of a surface on contact particles, and the work ``done`` (n,) [J] by them.

    ``impulses`` come in as those that ``u`` contains. ``v`` (n, 3) [m/s]: before the step; ``u`` (n, 3): what the grid gives.
    ``basal`` (n,): records of friction; ``area`` (n,) [m2]: of the ground below; ``effective`` (n,) [1]: share of the normal
    impulse that grains carry.
    """
    for p in range(len(u)):
        n, felt = vec(normal[p, 0], normal[p, 1], normal[p, 2]), vec(u[p, 0], u[p, 1], u[p, 2])
        given = vec(impulses[p, 0], impulses[p, 1], impulses[p, 2])
        push = impulse(felt, n, gap[p], compliance[p], basal[p], dt, given, area[p], effective[p])
        done[p] = work(push, given, vec(v[p, 0], v[p, 1], v[p, 2]), felt, compliance[p])
        for k in range(3):
            impulses[p, k] = push[k]


def stop_entering(distance: Any, dt: Any, band: Any, v: Any, u: Any, normal: Any, compliance: Any, impulses: Any, done: Any):
    """The same for particles that would enter a structure; they start from no impulse."""
    for p in range(len(u)):
        n, felt = vec(normal[p, 0], normal[p, 1], normal[p, 2]), vec(u[p, 0], u[p, 1], u[p, 2])
        j = stopping_impulse(dot(felt, n), entry_velocity(distance[p], dt, band), compliance[p])
        push = vec(j * n[0], j * n[1], j * n[2])
        done[p] = work(push, vec(0.0, 0.0, 0.0), vec(v[p, 0], v[p, 1], v[p, 2]), felt, compliance[p])
        for k in range(3):
            impulses[p, k] = push[k]


def measure_structures(corners: Any, inside: Any, place: Any, distance: Any, normal: Any):
    """Write the ``distance`` (n,) [m] from structures and the ``normal`` (n, 3) of particles in a cell of their lattice.

    ``corners`` (n, 9) hold the distances [m] at its nodes, ``inside`` (n, 3) the part of it below the particle; ``place`` (n,)
    comes in as the place of its first node and becomes that of the nearest one.
    """
    for p in range(len(distance)):
        c = corners[p]
        eight = tens(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8])
        fx, fy, fz = inside[p, 0], inside[p, 1], inside[p, 2]
        n = outward_normal(separation_slopes(eight, fx, fy, fz))
        distance[p] = separation(eight, fx, fy, fz)
        place[p] = nearest_place(place[p], fx, fy, fz)
        for k in range(3):
            normal[p, k] = n[k]


def touch_structures(velocity: Any, radius: Any, dt: Any, band: Any, distance: Any, normal: Any, touches: Any):
    """Say whether each particle ``touches`` (n,) a structure within ``dt`` [s]."""
    for p in range(len(touches)):
        v, n = vec(velocity[p, 0], velocity[p, 1], velocity[p, 2]), vec(normal[p, 0], normal[p, 1], normal[p, 2])
        touches[p] = in_contact(contact_gap(distance[p], radius[p]), dot(v, n), dt, band)


def find_entering(u: Any, normal: Any, distance: Any, dt: Any, band: Any, enters: Any):
    """Say whether each centre ``enters`` (n,) a structure within the step with the velocity ``u`` (n, 3) [m/s]."""
    for p in range(len(u)):
        un = dot(vec(u[p, 0], u[p, 1], u[p, 2]), vec(normal[p, 0], normal[p, 1], normal[p, 2]))
        enters[p] = un < entry_velocity(distance[p], dt, band)
