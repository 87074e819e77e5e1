"""Particles to grid and back, through the tile of nodes that a block shares; see :mod:`runout.backends.hash.layout`."""

from __future__ import annotations

import warp as wp

from runout.backends.hash.contact import _find_contacts, _listed
from runout.backends.hash.layout import (
    ACTIVE,
    AFFINE,
    CELL_LANES,
    HALT,
    MASS,
    MOMENTUM,
    OFFSET,
    ORDERED,
    TILE,
    TOUCHED,
    Ints,
    Nodes,
    Real,
    Rows,
    Table2,
    Vector,
    add_node,
    node4,
    sums4,
)
from runout.backends.hash.stencil import _arms, _first_node, _node
from runout.physics.bspline import weights
from runout.physics.tensors import real, vec


def _sum_cell(rec: Rows, order: Ints, first: int, last: int):
    """Mass and momentum that the particles at some places of the list hand to the 27 nodes of their cell."""
    acc = sums4()
    ahead = int(0)
    if first < last:
        ahead = _listed(order, first)
    for t in range(first, last):
        p = int(ahead)
        if t + 1 < last:
            ahead = _listed(order, t + 1)
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
        dx = _arms(fx)
        dy = _arms(fy)
        dz = _arms(fz)
        for i in range(3):
            for j in range(3):
                wij = wx[i] * wy[j]
                r = q + dx[i] * ax + dy[j] * ay
                for k in range(3):
                    w = wij * wz[k]
                    s = r + dz[k] * az
                    acc[(i * 3 + j) * 3 + k, 0] += w * m
                    acc[(i * 3 + j) * 3 + k, 1] += w * s[0]
                    acc[(i * 3 + j) * 3 + k, 2] += w * s[1]
                    acc[(i * 3 + j) * 3 + k, 3] += w * s[2]
    return acc


def particles_to_grid(
    rec: Rows, order: Ints, cstart: Table2, up: Table2, flags: Ints, tally: Ints, active: Ints, member: Ints, clock: Rows,
    tiles: Rows, near: Ints, h: Vector, band: Real, touching: Ints, touched: Ints, contacts: Ints, grid: Nodes, arenas: Nodes,
    launched: int,
):  # fmt: skip
    """Mass and momentum of the particles to the nodes, and which particles touch the ground.

    In fixed order, each block only fills its own arena. Particles in contact come to the front of their cell's list, marked.
    """
    begin, lane = wp.tid()
    if flags[HALT] != 0:
        return
    for a in range(begin, tally[ACTIVE], launched):
        b = active[a]
        dt = clock[member[b], 0]
        if dt > real(0.0):
            if near[b] >= 0:
                found = int(0)
                for c in range(lane, CELL_LANES, wp.block_dim()):
                    found += _find_contacts(
                        rec, order, cstart[b, c], cstart[b, c + 1], tiles, near[b], c, h, dt, band, clock[member[b], 4]
                    )  # fmt: skip
                all_found = wp.tile_sum(wp.tile(found))
                if lane == 0 and all_found[0] > 0:
                    touching[b] = all_found[0]
                    touched[wp.atomic_add(tally, TOUCHED, 1)] = b
                    wp.atomic_add(contacts, member[b], all_found[0])
            tile = wp.tile_zeros(shape=TILE, dtype=node4, storage="shared")
            for c in range(lane, CELL_LANES, wp.block_dim()):
                acc = _sum_cell(rec, order, cstart[b, c], cstart[b, c + 1])
                first = _first_node(c)
                for i in range(3):
                    for j in range(3):
                        for k in range(3):
                            n = (i * 3 + j) * 3 + k
                            g = node4(acc[n, 0], acc[n, 1], acc[n, 2], acc[n, 3])
                            wp.tile_scatter_add(tile, first + (i * 6 + j) * 6 + k, g, True, False)
            for t in range(lane, TILE, wp.block_dim()):
                g = tile[t]
                if ORDERED:
                    arenas[b * TILE + t] = g
                elif g[0] != real(0.0):
                    add_node(grid, _node(up, b, t), g)
