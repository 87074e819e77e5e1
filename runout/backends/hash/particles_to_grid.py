"""Particles to grid: mass and momentum of the particles are added to the nodes.

    block b      64 cells, one per thread
    cell c       particles order[cstart[b, c]] ... order[cstart[b, c + 1] - 1]
    registers    27 nodes x (mass, momentum x, y, z) of the cell
    tiles        two of 4 x 6 x 6 nodes in shared memory, [x][y][z], z next to each other: what either half of the cells reaches
    grid.nodes   64 nodes of block 0, 64 nodes of block 1, ...; in a block 16 x + 4 y + z

A thread sums the particles of its cell in registers and adds them to the tile of its half. The block adds both tiles to the grid,
and where drag slows columns of nodes the sums over these to ``columns.moving``.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import _give_moving, _set_all_bases
from runout.backends.hash.groups import (
    BlockGroup,
    ColumnGroup,
    Constants,
    ContactGroup,
    GridGroup,
    ParticleGroup,
    SceneGroup,
    StatusGroup,
)
from runout.backends.hash.layout import (
    ACTIVE,
    AFFINE,
    BASES,
    CELL_LANES,
    DRAGS_AT_ONCE,
    GIVES_MASS,
    HALT,
    HALVES,
    LASTING,
    MASS,
    MOMENTUM,
    NEXT,
    NOT_NEGATIVE,
    OFFSET,
    PENDING,
    PITCH,
    PLACES,
    STEPS,
    TOUCHED,
    Ints,
    Rows,
    Tile,
    lane_count,
    node4,
    sums4,
)
from runout.backends.hash.stencil import _add_cell, _cell_of_lane, _give_tile
from runout.physics.bspline import weights
from runout.physics.contact import reach
from runout.physics.tensors import real, vec


def _given_by_record(rec: Rows, p: int):
    """Mass [kg] of a particle, its offset, momentum [kg m/s], and the columns of its affine part."""
    f = vec(rec[OFFSET, p], rec[OFFSET + 1, p], rec[OFFSET + 2, p])
    q = vec(rec[MOMENTUM, p], rec[MOMENTUM + 1, p], rec[MOMENTUM + 2, p])
    x = vec(rec[AFFINE, p], rec[AFFINE + 1, p], rec[AFFINE + 2, p])
    y = vec(rec[AFFINE + 3, p], rec[AFFINE + 4, p], rec[AFFINE + 5, p])
    return rec[MASS, p], f, q, x, y, vec(rec[AFFINE + 6, p], rec[AFFINE + 7, p], rec[AFFINE + 8, p])


def _held_place(t: int):
    """Where the numbers of particle ``t`` of those that a further substep holds begin; one place of 33 stays free."""
    return (t + (t >> 5)) & PLACES


def _given_by_stress(held: Tile, t: int):
    """The same of the impulse of the stress of particle ``t``, from what a further substep holds of it; it has no mass."""
    n = _held_place(t)
    f = vec(held[n + PITCH], held[n + 2 * PITCH], held[n + 3 * PITCH])
    x = vec(held[n], held[n + 4 * PITCH], held[n + 5 * PITCH])
    y = vec(held[n + 6 * PITCH], held[n + 7 * PITCH], held[n + 8 * PITCH])
    z = vec(held[n + 9 * PITCH], held[n + 10 * PITCH], held[n + 11 * PITCH])
    return real(0.0), f, vec(real(0.0), real(0.0), real(0.0)), x, y, z


def _sum_cell(given: Any, order: Ints, begin: int, last: int, step: int):
    """Mass and momentum that some particles hand to the 27 nodes of their cell; in a further substep, impulses of their stress.

    ``given`` are the records of the particles at some places of the list, or what is held of every ``step`` th of them. From node
    to node the momentum that a particle hands over grows by a column of its affine part.
    """
    acc = sums4()
    ahead = int(0)
    if GIVES_MASS:  # noqa: SIM102 - a constant alone: warp compiles no branch
        if begin < last:
            ahead = order[begin]
    for t in range(begin, last, step):
        if GIVES_MASS:
            p = ahead & NOT_NEGATIVE
            if t + 1 < last:
                ahead = order[t + 1]
            m, f, q, ax, ay, az = _given_by_record(given, p)
        else:
            m, f, q, ax, ay, az = _given_by_stress(given, t)
        wx = weights(f[0])
        wy = weights(f[1])
        wz = weights(f[2])
        x = q - f[0] * ax - f[1] * ay - f[2] * az
        for i in range(3):
            y = x
            for j in range(3):
                wij = wx[i] * wy[j]
                z = y
                for k in range(3):
                    w = wij * wz[k]
                    if GIVES_MASS:
                        acc[(i * 3 + j) * 3 + k, 0] += w * m
                    acc[(i * 3 + j) * 3 + k, 1] += w * z[0]
                    acc[(i * 3 + j) * 3 + k, 2] += w * z[1]
                    acc[(i * 3 + j) * 3 + k, 3] += w * z[2]
                    z = z + az
                y = y + ay
            x = x + ax
    return acc


def _open_step(status: StatusGroup, scenes: SceneGroup, constants: Constants, s: int):
    """Open the step of a scene; one without steps left has time step 0.

    Row of the clock: time step [s], change of velocity by gravity [m/s], distance beyond which no particle is in contact [m]; and
    what the transfer does, see :func:`runout.backends.hash.scenes.choices`.

    Other threads of the launch still read ``left`` and the count of blocks: ``update_nodes`` changes them.
    """
    if s == 0:
        status.flags[STEPS] = status.flags[STEPS] + 1
        status.tally[ACTIVE] = status.tally[NEXT]
        status.tally[TOUCHED] = 0
    scenes.clock[s, 0] = real(0.0)
    if scenes.left[s] > 0:
        scenes.step_counts[s] = scenes.step_counts[s] + 1
        scenes.clock[s, 0] = scenes.steps[s]
        scenes.clock[s, 4] = reach(constants.largest, wp.sqrt(status.peaks[s]), scenes.clock[s, LASTING], constants.band)
        status.peaks[s] = real(0.0)
        status.contacts[s] = 0


def particles_to_grid(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, scenes: SceneGroup,
    constants: Constants, contacts: ContactGroup, columns: ColumnGroup, launched: int,
):  # fmt: skip
    """Mass and momentum of the particles to the nodes; in fixed order, each block only fills its own arena.

    One more block of threads than ``launched`` opens the step meanwhile.
    """
    begin, lane = wp.tid()
    b = int(blocks.active[wp.min(begin, blocks.active.shape[0] - 1)])  # loaded before it is known whether there is anything to do
    if status.flags[HALT] != 0:
        return
    if status.flags[PENDING] != 0:
        if begin == launched and lane == 0:
            status.flags[HALT] = status.flags[PENDING]
        return
    if begin == launched:
        for s in range(lane, scenes.left.shape[0], lane_count()):
            _open_step(status, scenes, constants, s)
        return
    for a in range(begin, status.tally[NEXT], launched):
        if scenes.left[blocks.member[b]] > 0:
            tile = wp.tile_zeros(shape=HALVES, dtype=node4, storage="shared")
            bases = wp.tile_empty(shape=BASES, dtype=int, storage="shared")
            _set_all_bases(bases, blocks, contacts, b, lane)
            for q in range(lane, CELL_LANES, lane_count()):
                c = _cell_of_lane(q)
                acc = _sum_cell(particles.rec, particles.order, blocks.cstart[b, c], blocks.cstart[b, c + 1], 1)
                _add_cell(tile, c, 0, acc)
            _give_tile(tile, 1, grid.arenas, grid.nodes, bases, b, lane)
            if DRAGS_AT_ONCE:
                _give_moving(columns, tile, bases, lane)
        b = blocks.active[wp.min(a + launched, blocks.active.shape[0] - 1)]
