"""Pore pressure of the particles (:mod:`runout.physics.pore_pressure`), in batches where a mass has any.

    grid.nodes                   mass of the nodes        --sum over the blocks above each other, slopes of the ground-->
    pores.layers[16 b + c]       mass by area of ground of the layer at column c of the cells of block b [kg/m2]
    pores.left, pores.excess     by the place of a particle as it was loaded: the part that remains; the excess at the start

A particle takes the layer at the middle one of the columns of nodes around it. The part that remains is advanced where the law of
the particle is followed, at the end of each substep; contacts take it in the middle of the substep.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.groups import BlockGroup, GridGroup, GroundGroup, ParticleGroup, PoreGroup, StatusGroup
from runout.backends.hash.layout import BLOCKS, HALT, WET, Vector
from runout.physics.heightfield import normal_z, surface_at
from runout.physics.pore_pressure import effective_share, layer_thickness, remaining_share
from runout.physics.tensors import real, tens

COLUMNS = 16  # of the cells of a block


def _same_column(blocks: BlockGroup, a: int, b: int):
    """Whether two blocks lie above each other."""
    return blocks.coordinates[a, 0] == blocks.coordinates[b, 0] and blocks.coordinates[a, 1] == blocks.coordinates[b, 1]


def _first_of_column(blocks: BlockGroup, b: int):
    """The lowest block of the column of block ``b``: blocks are in the order of x, y and z."""
    first = int(b)
    while first > 0 and _same_column(blocks, wp.max(first - 1, 0), b):
        first -= 1
    return first


def _mass_of_column(blocks: BlockGroup, grid: GridGroup, b: int, n: int, many: int):
    """Mass [kg] of column ``n`` of the nodes of block ``b`` and of those above and below it."""
    o = int(_first_of_column(blocks, b))
    total = real(0.0)
    while o < many and _same_column(blocks, wp.min(o, many - 1), b):
        for z in range(4):
            total += grid.nodes[64 * o + 4 * n + z][0]
        o += 1
    return total


def _slopes_above(blocks: BlockGroup, ground: GroundGroup, b: int, c: int, h: Vector, many: int):
    """Slopes [1] of the ground at the middle node above column ``c`` of the cells of block ``b``.

    Where no block of the column is near the ground, those at its middle.
    """
    east = ground.slopes[b][0]
    north = ground.slopes[b][1]
    o = int(_first_of_column(blocks, b))
    place = int(-1)
    while place < 0 and o < many and _same_column(blocks, wp.min(o, many - 1), b):
        place = ground.near[o]
        o += 1
    if place >= 0:
        a = (c >> 2) * 6 + (c & 3)
        e = surface_at(
            tens(
                ground.tiles[place, a], ground.tiles[place, a + 1], ground.tiles[place, a + 2], ground.tiles[place, a + 6],
                ground.tiles[place, a + 7], ground.tiles[place, a + 8], ground.tiles[place, a + 12], ground.tiles[place, a + 13],
                ground.tiles[place, a + 14],
            ), real(1.0), real(1.0),
        )  # fmt: skip
        east = e[1] * h[2] / h[0]
        north = e[2] * h[2] / h[1]
    return east, north


def measure_layers(
    status: StatusGroup, blocks: BlockGroup, grid: GridGroup, ground: GroundGroup, pores: PoreGroup, h: Vector, over_ground: int
):  # fmt: skip
    """Mass by area of ground of the layers at all columns of cells; ``over_ground``: whether there is any ground."""
    t = wp.tid()
    b = t // COLUMNS
    c = t % COLUMNS
    many = status.tally[BLOCKS]
    if status.flags[HALT] != 0 or b >= many:
        return
    x = (c >> 2) + 1
    y = (c & 3) + 1
    o = blocks.up[b, 4 * (x >> 2) + 2 * (y >> 2)]
    if o < 0 or blocks.up[b, 0] < 0:  # the block holds no particles
        return
    mass = _mass_of_column(blocks, grid, o, 4 * (x & 3) + (y & 3), many)
    east = real(0.0)
    north = real(0.0)
    if over_ground != 0:
        east, north = _slopes_above(blocks, ground, b, c, h, many)
    pores.layers[t] = layer_thickness(mass, h[0] * h[1], real(1.0), normal_z(east, north))


def _effective(particles: ParticleGroup, pores: PoreGroup, p: int, b: int, c: int, dt: Any):
    """Share [1] of the normal stress that the grains of a particle in a cell of block ``b`` carry in the middle of a step of ``dt``
    [s], and what is left of the excess pressure after half a step [1]."""
    release = int(particles.release[p])
    pore = pores.records[release]
    thickness = pores.layers[COLUMNS * b + (c >> 2)] / pores.density[release]
    share = remaining_share(thickness, real(0.5) * dt, pore)
    n = particles.number[p]
    return effective_share(pores.excess[n], share * pores.left[n], pore), share


def _drained(particles: ParticleGroup, pores: PoreGroup, p: int, k: int, dt: Any):
    """The first of these for a particle with the key ``k``, whose excess pressure is advanced by a step; 1 in a dry batch."""
    effective = real(1.0)
    if WET:
        effective, share = _effective(particles, pores, p, k >> 6, k & 63, dt)
        n = particles.number[p]
        pores.left[n] = share * share * pores.left[n]
    return effective
