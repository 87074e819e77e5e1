"""Sums over the lattice of half grid cells, in parallel by the stripes of :mod:`runout.backends.scan.raster_sums`.

A box of one grid cell that lies anywhere covers three cells of the lattice: as much as two boxes of a cell of the lattice each,
one half a grid cell beyond the other. So a particle adds to the four nodes of the lattice around it, by distance, and a cell of the
lattice is the mean of its four nodes: exact, with a third of the sums.

    nodes[row, column]    mass | momentum (3) | mass / density | momentum / density (3)    rows from the south, in float64

The particles of a grid cell, with offsets f from 0.5 to 1.5, add to the nodes 1, 2 and 3 of the lattice from its first node on.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import constant, load4, prefetch, store
from runout.backends.scan.observe import _node_of
from runout.backends.scan.raster_sums import _mass_and_momentum
from runout.backends.scan.stencil import AHEAD, _add_products

nobody = constant([0.0] * 4)


def _node_shares(f):
    """Shares of the nodes 1, 2 and 3 of the lattice in a particle with offset ``f`` [grid cells]."""
    return max(2.0 - 2.0 * f, 0.0), 1.0 - abs(2.0 * f - 2.0), max(2.0 * f - 2.0, 0.0)


def _add_cell_to_nodes(rec, particles, s, e, over, row, column, width, nodes, lanes):
    """Add the particles s to e of a grid cell to three times three nodes, the first at ``row`` and ``column``."""
    particle_index, label, order = particles.particle_index, particles.label, particles.order
    z = nobody(nodes)
    rows = z, z, z, z, z, z, z, z, z
    for t in range(s, e):
        p = order[t]
        r = 16 * p
        prefetch(rec, 16 * np.int64(order[t + AHEAD]))
        amounts = _mass_and_momentum(rec, r)
        if len(over) > 0:
            amounts = amounts * (1.0 / over[label[particle_index[p], 0]])
        rows = _add_products(_node_shares(np.float64(rec[r + 4])), _node_shares(np.float64(rec[r + 8])), amounts, rows)
    lane = 4 if len(over) > 0 else 0
    for k, three in enumerate((rows[:3], rows[3:6], rows[6:])):
        for i in range(3):
            o = ((row + i) * width + column + k) * lanes + lane
            store(nodes, o, load4(nodes, o) + three[i])


def add_to_nodes(particles, blocks, corner, density, over_density, first, listed, stripes, parity, nodes):
    """Add mass and momentum, or these over the density, of every second stripe of blocks to nodes (rows, columns, 4 or 8).

    ``first`` is the lattice's cell, east and north, after node (0, 0).
    """
    flat = particles.rec.reshape(-1)
    total = nodes.reshape(-1)
    width, lanes = nodes.shape[1], nodes.shape[2]
    over = density if over_density else density[:0]
    starts, begin = blocks.starts, blocks.first
    for k in prange((len(stripes) - parity) // 2):
        s = 2 * k + parity
        for e in range(stripes[s], stripes[s + 1]):
            b = listed[e]
            node = _node_of(blocks.bxyz, b, 0, corner)
            for c in range(64):
                t, u = begin[b] + starts[b, c], begin[b] + starts[b, c + 1]
                if t < u:
                    column = 2 * (node[0] + (c >> 4)) + 1 - first[0]
                    row = 2 * (node[1] + ((c >> 2) & 3)) + 1 - first[1]
                    _add_cell_to_nodes(flat, particles, t, u, over, row, column, width, total, lanes)


def add_nodes_to_cells(nodes, density, sums):
    """Volume, momentum (3), and with several densities mass, of the cells (lanes, rows, columns) between nodes."""
    several = nodes.shape[2] > 4
    share = 0.25 if several else 0.25 / density[0]
    volume = 4 if several else 0
    for i in prange(sums.shape[1]):
        for j in range(sums.shape[2]):
            sums[0, i, j] = share * (
                (nodes[i, j, volume] + nodes[i, j + 1, volume]) + (nodes[i + 1, j, volume] + nodes[i + 1, j + 1, volume])
            )
            for k in range(1, 4):
                sums[k, i, j] = 0.25 * ((nodes[i, j, k] + nodes[i, j + 1, k]) + (nodes[i + 1, j, k] + nodes[i + 1, j + 1, k]))
            if several:
                sums[4, i, j] = 0.25 * ((nodes[i, j, 0] + nodes[i, j + 1, 0]) + (nodes[i + 1, j, 0] + nodes[i + 1, j + 1, 0]))
