"""Particles to grid: mass and momentum of the particles are added to the nodes.

    block b      64 cells, one per thread
    cell c       particles order[cstart[b, c]] ... order[cstart[b, c + 1] - 1]
    registers    27 nodes x (mass, momentum x, y, z) of the cell
    tile         6 x 6 x 6 nodes in shared memory, [x][y][z], z next to each other: nodes of the block and of seven neighbours
    grid.nodes   64 nodes of block 0, 64 nodes of block 1, ...; in a block 16 x + 4 y + z

A thread sums the particles of its cell in registers, adds them to the tile, and the block adds the tile to the grid.
"""

from __future__ import annotations

import warp as wp

from runout.backends.hash.groups import BlockGroup, GridGroup, ParticleGroup, SceneGroup, StatusGroup
from runout.backends.hash.layout import (
    ACTIVE,
    AFFINE,
    CELL_LANES,
    HALT,
    MASS,
    MOMENTUM,
    NOT_NEGATIVE,
    OFFSET,
    TILE,
    lane_count,
    node4,
    sums4,
)
from runout.backends.hash.stencil import _add_cell, _first_node, _give_tile, _set_bases
from runout.physics.bspline import weights
from runout.physics.tensors import real, vec


def _sum_cell(particles: ParticleGroup, begin: int, last: int):
    """Mass and momentum that the particles at some places of the list hand to the 27 nodes of their cell.

    From node to node the momentum that a particle hands over grows by a column of its affine part.
    """
    rec = particles.rec
    acc = sums4()
    ahead = int(0)
    if begin < last:
        ahead = particles.order[begin]
    for t in range(begin, last):
        p = ahead & NOT_NEGATIVE
        if t + 1 < last:
            ahead = particles.order[t + 1]
        m = rec[MASS, p]
        fx = rec[OFFSET, p]
        fy = rec[OFFSET + 1, p]
        fz = rec[OFFSET + 2, p]
        wx = weights(fx)
        wy = weights(fy)
        wz = weights(fz)
        ax = vec(rec[AFFINE, p], rec[AFFINE + 1, p], rec[AFFINE + 2, p])
        ay = vec(rec[AFFINE + 3, p], rec[AFFINE + 4, p], rec[AFFINE + 5, p])
        az = vec(rec[AFFINE + 6, p], rec[AFFINE + 7, p], rec[AFFINE + 8, p])
        q = vec(rec[MOMENTUM, p], rec[MOMENTUM + 1, p], rec[MOMENTUM + 2, p])
        x = q - fx * ax - fy * ay - fz * az
        for i in range(3):
            y = x
            for j in range(3):
                wij = wx[i] * wy[j]
                z = y
                for k in range(3):
                    w = wij * wz[k]
                    acc[(i * 3 + j) * 3 + k, 0] += w * m
                    acc[(i * 3 + j) * 3 + k, 1] += w * z[0]
                    acc[(i * 3 + j) * 3 + k, 2] += w * z[1]
                    acc[(i * 3 + j) * 3 + k, 3] += w * z[2]
                    z = z + az
                y = y + ay
            x = x + ax
    return acc


def particles_to_grid(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, scenes: SceneGroup, launched: int,
):  # fmt: skip
    """Mass and momentum of the particles to the nodes. In fixed order, each block only fills its own arena."""
    begin, lane = wp.tid()
    b = int(blocks.active[begin])  # loaded before it is known whether there is anything to do
    if status.flags[HALT] != 0:
        return
    for a in range(begin, status.tally[ACTIVE], launched):
        if scenes.clock[blocks.member[b], 0] > real(0.0):
            tile = wp.tile_zeros(shape=TILE, dtype=node4, storage="shared")
            bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
            _set_bases(bases, blocks.up, b, lane)
            for c in range(lane, CELL_LANES, lane_count()):
                acc = _sum_cell(particles, blocks.cstart[b, c], blocks.cstart[b, c + 1])
                first = _first_node(c)
                _add_cell(tile, first, acc)
            _give_tile(tile, grid.arenas, grid.nodes, bases, b, lane)
        b = blocks.active[wp.min(a + launched, blocks.active.shape[0] - 1)]
