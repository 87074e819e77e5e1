"""Structures as a surface: distance, normal and patch at a particle, sums of impulses and energy, and the blocks beside structures.

    structures.fields     scene 0: | blocks east, north, up | first block | first patch | first sum | patches |   scene 1: ...
    structures.rows       row of each lattice block of a field, -1 where no particle can touch
    structures.distance   | row 0: 9 x 9 x 9 distances | row 1 | ...       structures.patch   likewise
    upper, lower          impulses on patch 0 x, y, z | patch 1 | ... | energy taken of scene 0 | scene 1 | ...

Impulses and energy are added as whole numbers, of which each sum has two: exact, and the same in any order.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.groups import BlockGroup, GroundGroup, SceneGroup, StructureGroup
from runout.backends.hash.layout import Vector
from runout.physics.structures import (
    faces_more,
    is_closer,
    lattice_block,
    lattice_place,
    nearest_place,
    outward_normal,
    separation,
    separation_slopes,
)
from runout.physics.tensors import dot, i64, real, tens, vec

LATTICE = 729  # nodes of a block of a field
EAST, NORTH, UP, FIRST_BLOCK, FIRST_PATCH, FIRST_SUM, PATCHES, OF_FIELD = range(8)  # of a row of structures.fields
CARRIED, PARTED = 40, 2.0**40  # so many bits, and units, of a lower sum make one unit of the upper
sum_lanes: Any = None  # sum over the lanes of a warp; the binding puts it in its place


def _lattice(structures: StructureGroup, s: int, d: int, cell: int, f: Any):
    """Coordinate [lattice cells] along an axis, from the offset in a cell of the grid."""
    x = (wp.float64(cell) + wp.float64(f)) * structures.lattices[s, 4 + d]
    return (x - structures.lattices[s, d]) / structures.lattices[s, 3]


def _row_of(structures: StructureGroup, s: int, i: int, j: int, k: int):
    """Row of a block of the lattice of a scene, -1 for none."""
    n = structures.fields
    row = int(-1)
    if i >= 0 and j >= 0 and k >= 0 and i < n[s, EAST] and j < n[s, NORTH] and k < n[s, UP]:
        row = structures.rows[n[s, FIRST_BLOCK] + (i * n[s, NORTH] + j) * n[s, UP] + k]
    return row


def _cell(blocks: BlockGroup, scenes: SceneGroup, s: int, b: int, c: int):
    """First node of a cell of a block, in its scene."""
    x = 4 * blocks.coordinates[b, 0] + (c >> 4)
    y = 4 * blocks.coordinates[b, 1] - scenes.shift[s] + ((c >> 2) & 3)
    return wp.vec3i(x, y, 4 * blocks.coordinates[b, 2] + (c & 3))


def _normal_of(structures: StructureGroup, s: int, k: int):
    """Outward normal of patch ``k`` of a scene."""
    at = structures.fields[s, FIRST_PATCH] + k
    return vec(real(structures.planes[at, 3]), real(structures.planes[at, 4]), real(structures.planes[at, 5]))


def _plane(structures: StructureGroup, s: int, k: int, q: wp.vec3d, normal: Vector):
    """Distance [m] of a point at ``q`` [lattice cells] from the plane of patch ``k`` of a scene with this ``normal``."""
    at = structures.fields[s, FIRST_PATCH] + k
    planes = structures.planes
    away = vec(real(q[0] - planes[at, 0]), real(q[1] - planes[at, 1]), real(q[2] - planes[at, 2]))
    return dot(away, normal) * real(structures.lattices[s, 3])


def _take_patch(structures: StructureGroup, s: int, at: int, q: wp.vec3d, n: Vector, apart: Any, nearest: int):
    """Normal, distance [m] and patch that faces the contact most; where ``apart`` is cut short, those of the closest plane.

    The patches are the ``nearest`` one and those of the eight nodes of the lattice cell at ``at``.
    """
    spacing = real(structures.lattices[s, 3])
    closest, patch = int(nearest), int(nearest)
    facing = _normal_of(structures, s, nearest)
    least = _plane(structures, s, nearest, q, facing)
    most = dot(facing, n)
    for corner in range(8):
        k = structures.patch[at + 81 * (corner >> 2) + 9 * ((corner >> 1) & 1) + (corner & 1)]
        if k != closest:
            facing = _normal_of(structures, s, k)
            plane = _plane(structures, s, k, q, facing)
            if is_closer(plane, least, spacing):
                least = plane
                closest = k
            if faces_more(dot(facing, n), most):
                most = dot(facing, n)
                patch = k
    if is_closer(apart, least, spacing):
        n = _normal_of(structures, s, closest)
        apart = least
        patch = closest
    return n, apart, patch


def _surface(structures: StructureGroup, s: int, cell: wp.vec3i, f: Vector, far: Any):
    """Outward normal, distance [m] and nearest patch of a particle at an offset in a cell.

    The patch is -1 beyond ``far`` [m], where the normal is not that of contact, and where no structure is near, at distance inf.
    """
    q = wp.vec3d()
    for axis in range(3):
        q[axis] = _lattice(structures, s, axis, cell[axis], f[axis])
    i, j, k = int(wp.floor(q[0])), int(wp.floor(q[1])), int(wp.floor(q[2]))
    row = _row_of(structures, s, lattice_block(i), lattice_block(j), lattice_block(k))
    n = vec(real(0.0), real(0.0), real(1.0))
    apart = real(wp.inf)
    patch = int(-1)
    if row >= 0:
        fx, fy, fz = real(q[0] - wp.float64(i)), real(q[1] - wp.float64(j)), real(q[2] - wp.float64(k))
        place = lattice_place(i, j, k)
        at = LATTICE * row + place
        d = structures.distance
        corners = tens(
            real(d[at]), real(d[at + 1]), real(d[at + 9]), real(d[at + 10]),
            real(d[at + 81]), real(d[at + 82]), real(d[at + 90]), real(d[at + 91]), real(0.0),
        )  # fmt: skip
        apart = separation(corners, fx, fy, fz)
        if apart <= far:  # a plane that takes its place is farther away
            n = outward_normal(separation_slopes(corners, fx, fy, fz))
            patch = structures.patch[LATTICE * row + nearest_place(place, fx, fy, fz)]
            n, apart, patch = _take_patch(structures, s, at, q, n, apart, patch)
    return n, apart, patch


def carry_sums(structures: StructureGroup):
    """Carry what the lower sums hold beyond a unit of the upper ones, which leaves room for the steps to the next sort."""
    t = wp.tid()
    units = structures.lower[t] >> i64(CARRIED)
    structures.upper[t] = structures.upper[t] + units
    structures.lower[t] = structures.lower[t] - (units << i64(CARRIED))


def _book(structures: StructureGroup, s: int, at: int, value: wp.float64):
    """Add to a sum: as whole numbers, whose sum is the same in any order."""
    units = value * structures.units[s]
    whole = wp.floor(units)
    wp.atomic_add(structures.upper, at, wp.int64(whole))
    wp.atomic_add(structures.lower, at, wp.int64(wp.round((units - whole) * wp.float64(PARTED))))


def _book_impulse(structures: StructureGroup, s: int, patch: int, push: Vector):
    """Add the impulse of the mass on a patch, against the ``push`` [N s] of the structure, to its sums."""
    for d in range(3):
        _book(structures, s, 3 * (structures.fields[s, FIRST_SUM] + patch) + d, -wp.float64(push[d]))


def _book_work(structures: StructureGroup, s: int, done: Any, lane: int):
    """Add the energy that structures take from a block to that of its scene; ``done`` [J] is the work on particles of each lane."""
    taken = -sum_lanes(wp.float64(done))
    if lane == 0:
        many = structures.fields.shape[0]
        _book(structures, s, structures.upper.shape[0] - many + s, taken)


def note_beside(blocks: BlockGroup, ground: GroundGroup, scenes: SceneGroup, structures: StructureGroup):
    """Blocks whose particles may touch a structure before the next sort, and the blocks of the nodes that these reach."""
    b = wp.tid()
    if blocks.up[b, 0] < 0:
        return
    s = blocks.member[b]
    low = _cell(blocks, scenes, s, b, 0)
    near = bool(False)
    if structures.fields[s, PATCHES] > 0:
        first, last = wp.vec3i(), wp.vec3i()
        for d in range(3):  # offsets in a cell go from 0.5 to 1.5
            first[d] = lattice_block(int(wp.floor(_lattice(structures, s, d, low[d], wp.float64(0.5)))))
            last[d] = lattice_block(int(wp.floor(_lattice(structures, s, d, low[d] + 3, wp.float64(1.5)))))
        for i in range(wp.max(first[0], 0), wp.min(last[0] + 1, structures.fields[s, EAST])):
            for j in range(wp.max(first[1], 0), wp.min(last[1] + 1, structures.fields[s, NORTH])):
                for k in range(wp.max(first[2], 0), wp.min(last[2] + 1, structures.fields[s, UP])):
                    near = near or _row_of(structures, s, i, j, k) >= 0
    if near:
        ground.near[b] = 0
        for q in range(8):
            ground.grounded[blocks.up[b, q]] = 0
