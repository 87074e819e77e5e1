"""Internal forces by the gradients of the weights, added to the nodes that hold mass and momentum (transfers apic and aflip)."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import _give_moving, _set_all_bases
from runout.backends.hash.deform import _strain_of
from runout.backends.hash.gradients import _cells
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
    BASES,
    BLOCKS,
    CELL_LANES,
    DRAGS_AT_ONCE,
    HALT,
    HALVES,
    NOT_NEGATIVE,
    OFFSET,
    VOLUME,
    Materials,
    lane_count,
    node4,
    sums4,
)
from runout.backends.hash.stencil import _add_cell, _give_tile, _sum_arenas
from runout.physics.bspline import weight_slopes, weights
from runout.physics.elastic import kirchhoff_stress, log_strain
from runout.physics.moments import node_velocity, stress_columns
from runout.physics.tensors import real, sym, vec


def note_given(status: StatusGroup, blocks: BlockGroup, grid: GridGroup):
    """Velocity [m/s] that the particles gave to each node, before any force, behind the nodes of all blocks."""
    t = wp.tid()
    if status.flags[HALT] != 0 or (t >> 6) >= status.tally[BLOCKS]:
        return
    g = grid.nodes[t]
    given = node4()
    if g[0] > real(0.0):
        v = node_velocity(vec(g[1], g[2], g[3]), g[0], vec(real(0.0), real(0.0), real(0.0)))
        given = node4(g[0], v[0], v[1], v[2])
    grid.nodes[t + 64 * blocks.up.shape[0]] = given


def take_stresses(status: StatusGroup, particles: ParticleGroup, mats: Materials):
    """Kirchhoff stress [Pa] of every particle, from its strain."""
    p = wp.tid()
    if status.flags[HALT] != 0 or particles.key[p] < 0:
        return
    tau = kirchhoff_stress(log_strain(_strain_of(particles.rec, p)), mats[int(particles.release[p])])
    for k in range(6):
        particles.stress[k, p] = tau[k]


def _sum_forces(particles: ParticleGroup, first: int, last: int, cells: Any):
    """Impulses [N s] of the internal forces of the particles at some places of the list on the 27 nodes of their cell."""
    rec = particles.rec
    stress = particles.stress
    acc = sums4()
    for t in range(first, last):
        p = particles.order[t] & NOT_NEGATIVE
        wx = weights(rec[OFFSET, p])
        wy = weights(rec[OFFSET + 1, p])
        wz = weights(rec[OFFSET + 2, p])
        dx = weight_slopes(rec[OFFSET, p])
        dy = weight_slopes(rec[OFFSET + 1, p])
        dz = weight_slopes(rec[OFFSET + 2, p])
        tau = sym(stress[0, p], stress[1, p], stress[2, p], stress[3, p], stress[4, p], stress[5, p])
        a = stress_columns(tau, rec[VOLUME, p], cells)
        ax = vec(a[0], a[1], a[2])
        ay = vec(a[3], a[4], a[5])
        az = vec(a[6], a[7], a[8])
        for i in range(3):
            for j in range(3):
                plan = (dx[i] * wy[j]) * ax + (wx[i] * dy[j]) * ay
                wij = wx[i] * wy[j]
                for k in range(3):
                    s = wz[k] * plan + (wij * dz[k]) * az
                    for d in range(3):
                        acc[(i * 3 + j) * 3 + k, d + 1] += s[d]
    return acc


def add_forces(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, scenes: SceneGroup,
    constants: Constants, contacts: ContactGroup, columns: ColumnGroup, launched: int,
):  # fmt: skip
    """Impulses of the internal forces to the nodes. In fixed order, each block only fills its own arena."""
    begin, lane = wp.tid()
    if status.flags[HALT] != 0:
        return
    for a in range(begin, status.tally[ACTIVE], launched):
        b = blocks.active[a]
        dt = scenes.clock[blocks.member[b], 0]
        if dt > real(0.0):
            cells = _cells(dt, constants.h)
            bases = wp.tile_empty(shape=BASES, dtype=int, storage="shared")
            _set_all_bases(bases, blocks, contacts, b, lane)
            tile = wp.tile_zeros(shape=HALVES, dtype=node4, storage="shared")
            for c in range(lane, CELL_LANES, lane_count()):
                acc = _sum_forces(particles, blocks.cstart[b, c], blocks.cstart[b, c + 1], cells)
                _add_cell(tile, c, acc)
            _give_tile(tile, grid.arenas, grid.nodes, bases, b, lane, 0)
            if DRAGS_AT_ONCE:
                _give_moving(columns, tile, bases, lane)


def add_nodes(status: StatusGroup, blocks: BlockGroup, grid: GridGroup):
    """Add the sums of the arenas to every node, in fixed order."""
    t = wp.tid()
    if status.flags[HALT] == 0:
        grid.nodes[t] = grid.nodes[t] + _sum_arenas(blocks, grid, grid.held, t)
