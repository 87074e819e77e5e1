"""Distance of particles from structures: fields of blocks of a lattice, and the blocks of the grid that lie beside a structure.

    structures.fields     scene 0: | blocks east, north, up | first block | first sum | patches |    scene 1: ...
    structures.rows       row of each lattice block of a field, -1 where no particle can touch
    structures.distance   | row 0: 9 x 9 x 9 distances | row 1 | ...       structures.patch   likewise
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.groups import BlockGroup, GroundGroup, SceneGroup, StatusGroup, StructureGroup
from runout.backends.hash.layout import BESIDE, GROW, HALT, REACHED, Vector
from runout.physics.structures import lattice_block, lattice_place, nearest_place, outward_normal, separation, separation_slopes
from runout.physics.tensors import real, tens, vec

LATTICE = 729  # nodes of a block of a field
EAST, NORTH, UP, FIRST_BLOCK, FIRST_SUM, PATCHES, OF_FIELD = range(7)  # of a row of structures.fields


def _lattice(structures: StructureGroup, s: int, d: int, cell: int, f: Any):
    """Coordinate [lattice cells] along an axis, from the offset in a cell of the grid."""
    x = (wp.float64(cell) + wp.float64(f)) * structures.spacing[d]
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


def _surface(structures: StructureGroup, s: int, cell: wp.vec3i, f: Vector):
    """Outward normal, distance [m] and nearest patch of a particle at an offset in a cell; patch -1 where no structure is near."""
    qx = _lattice(structures, s, 0, cell[0], f[0])
    qy = _lattice(structures, s, 1, cell[1], f[1])
    qz = _lattice(structures, s, 2, cell[2], f[2])
    i, j, k = int(wp.floor(qx)), int(wp.floor(qy)), int(wp.floor(qz))
    row = _row_of(structures, s, lattice_block(i), lattice_block(j), lattice_block(k))
    n = vec(real(0.0), real(0.0), real(1.0))
    apart = real(0.0)
    patch = int(-1)
    if row >= 0:
        fx, fy, fz = real(qx - wp.float64(i)), real(qy - wp.float64(j)), real(qz - wp.float64(k))
        place = lattice_place(i, j, k)
        at = LATTICE * row + place
        d = structures.distance
        corners = tens(
            real(d[at]), real(d[at + 1]), real(d[at + 9]), real(d[at + 10]),
            real(d[at + 81]), real(d[at + 82]), real(d[at + 90]), real(d[at + 91]), real(0.0),
        )  # fmt: skip
        n = outward_normal(separation_slopes(corners, fx, fy, fz))
        apart = separation(corners, fx, fy, fz)
        patch = structures.patch[LATTICE * row + nearest_place(place, fx, fy, fz)]
    return n, apart, patch


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
        ground.near[b] = 1
        for q in range(8):
            ground.grounded[blocks.up[b, q]] = 1


def require_beside(status: StatusGroup, places: int, slots: int):
    """Halt if there is no room for so many blocks beside structures, or for the impulses of so many."""
    if wp.tid() == 0 and (status.counts[BESIDE] > places or status.counts[REACHED] > slots):
        status.flags[HALT] = GROW
