"""Distance from structures: trilinear in the cells of a lattice, with its gradient as the normal.

The lattice is that of :class:`runout.model.structures.StructureField`: blocks of 8 x 8 x 8 cells, and 9 x 9 x 9 nodes each. A plane
surface is exact at any angle to the lattice. At a convex edge the distance is rounded over one of its cells. In a concave edge,
where it would be too small, the planes of the patches nearest to the nodes count (:func:`is_closer`). A contact with a structure is
one with the ground (:mod:`runout.physics.contact`) besides, with Coulomb friction.
"""

import math
from typing import Any

from runout.physics.tensors import real, vec

SAME = 0.01  # by which two distances, in lattice cells, or two cosines may differ
BETWEEN = 0.5  # part of a lattice cell from which the next node is the nearest


def lattice_block(cell: Any):
    """Block coordinate of a lattice cell; floors for negative ones."""
    return cell >> 3


def lattice_place(i: Any, j: Any, k: Any):
    """Place of the first node of a lattice cell among the 729 nodes of its block, from its three coordinates."""
    return ((i & 7) * 9 + (j & 7)) * 9 + (k & 7)


def nearest_place(place: Any, fx: Any, fy: Any, fz: Any):
    """Place of the node nearest to a point: ``fx`` to ``fz`` from 0 to 1 in the lattice cell whose first node is at ``place``."""
    near = place
    if fx >= real(BETWEEN):
        near = near + 81
    if fy >= real(BETWEEN):
        near = near + 9
    if fz >= real(BETWEEN):
        near = near + 1
    return near


def between(a: Any, b: Any, f: Any):
    """Linear interpolation from ``a`` at 0 to ``b`` at 1."""
    return a + f * (b - a)


def separation(c: Any, fx: Any, fy: Any, fz: Any):
    """Distance [m] of a point from the structures, from those of the eight nodes of its lattice cell, z first, then y, then x."""
    south_west = between(c[0], c[1], fz)
    north_west = between(c[2], c[3], fz)
    south_east = between(c[4], c[5], fz)
    north_east = between(c[6], c[7], fz)
    return between(between(south_west, north_west, fy), between(south_east, north_east, fy), fx)


def separation_slopes(c: Any, fx: Any, fy: Any, fz: Any):
    """Gradient [m per lattice cell] of :func:`separation`."""
    south = between(c[4] - c[0], c[5] - c[1], fz)
    north = between(c[6] - c[2], c[7] - c[3], fz)
    west = between(c[2] - c[0], c[3] - c[1], fz)
    east = between(c[6] - c[4], c[7] - c[5], fz)
    low = between(c[1] - c[0], c[3] - c[2], fy)
    high = between(c[5] - c[4], c[7] - c[6], fy)
    return vec(between(south, north, fy), between(west, east, fx), between(low, high, fx))


def outward_normal(slopes: Any):
    """Unit normal [1] away from a structure; upward where the gradient vanishes, as in the middle of a wall."""
    length = math.sqrt(slopes[0] * slopes[0] + slopes[1] * slopes[1] + slopes[2] * slopes[2])
    if length <= real(0.0):
        return vec(real(0.0), real(0.0), real(1.0))
    return vec(slopes[0] / length, slopes[1] / length, slopes[2] / length)


def is_closer(a: Any, b: Any, spacing: Any):
    """Whether a distance ``a`` [m] is less than ``b`` [m] by more than rounding, on a lattice of ``spacing`` [m].

    It chooses the closest of the planes of the patches near a point, the nearest patch first, so that patches of one plane keep
    their contacts. Where the trilinear distance is closer than all of these planes, it is cut short: so it is in a concave edge,
    because the smaller of two distances lies above its interpolation. The closest plane then takes its place. At a convex edge a
    plane is always closer.
    """
    return a < b - real(SAME) * spacing


def faces_more(a: Any, b: Any):
    """Whether a patch faces a contact more than another: ``a`` and ``b`` are the cosines between their normals and its normal.

    At a convex edge two or three facades are equally near. The flow presses on the one that faces the contact most. Among patches
    of one plane the nearest one stays.
    """
    return a > b + real(SAME)


def contact_gap(distance: Any, radius: Any):
    """Gap [m] of a particle with a touching ``radius`` [m]; 0 for one that is closer, which a structure does not push outward.

    The ground raises such particles (:func:`runout.physics.contact.normal_target`). Mass between two walls cannot rise from both.
    """
    return max(real(0.0), distance - radius)


def entry_velocity(distance: Any, dt: Any, band: Any):
    """Normal velocity [m/s], at most 0, below which a particle's centre comes closer than ``band`` [m] within the step.

    The lumped compliance of :func:`runout.physics.contact.impulse` leaves an approach to particles that are pushed harder than
    their neighbours. Above the ground they sink a little; a thin wall would let them through. A centre that lies inside already is
    not moved outward.
    """
    return min(real(0.0), (band - distance) / dt)


def stopping_impulse(un: Any, entry: Any, compliance: Any):
    """Normal impulse [N s] that brings a normal velocity ``un`` [m/s] to :func:`entry_velocity`.

    The lumped ``compliance`` [1/kg] is that of the few particles that would enter, not of all contacts.
    """
    return (entry - un) / compliance
