"""Sums over the lattice of half grid cells, in parallel by stripes of blocks; the bits do not depend on the number of threads.

    | stripe 0 | stripe 1 | stripe 2 | stripe 3 |    blocks in plan: the even stripes are added at once, then the odd ones

A box of one grid cell that lies anywhere covers three cells of the lattice: as much as two boxes of a cell of the lattice each,
one half a grid cell beyond the other. So a particle adds to the four nodes of the lattice around it, by distance, and a cell of the
lattice is the mean of its four nodes: exact, with a third of the sums.

    nodes[row, column]    mass | momentum (3) | mass / density | momentum / density (3)    rows from the south, in float64

The particles of a grid cell, with offsets f from 0.5 to 1.5, add to the nodes 1, 2 and 3 of the lattice from its first node on.
"""

import itertools
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numba import prange

from runout.backends import footprints
from runout.backends.compile import array_binding
from runout.backends.lanes import constant, in_double, load4, permutation_of_two, prefetch, store
from runout.backends.plan_areas import weighed
from runout.backends.protocol import NodeSums, RasterSums
from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks
from runout.backends.scan.observe import _node_of
from runout.backends.scan.state import Store
from runout.backends.scan.stencil import AHEAD, _add_products
from runout.model.scene import Scene
from runout.physics.moments import affine_at

first_of_one = permutation_of_two((0, 5, 6, 7))
nobody = constant([0.0] * 4)


@dataclass(frozen=True)
class Summed:
    """What is summed: particles in blocks, with the tables of the run and the kernels."""

    scene: Scene
    k: SimpleNamespace
    store: Store
    blocks: Blocks
    tables: Tables

    def whole(self) -> RasterSums:
        """Sums over all cells of the raster."""
        return footprints.on_whole(self.around_flow(), self.scene.raster)

    def around_flow(self) -> RasterSums:
        """Sums over a window of cells that holds all mass."""
        return footprints.on_raster(self.on_lattice(), self.scene.raster, footprints.lattice_cell(self.scene))

    def on_lattice(self) -> RasterSums:
        """Sums over a window of the lattice that holds all mass, of particles with footprints."""
        found = self._on_cells()
        if found is None:
            return footprints.nothing()
        sums, lattice, density = found
        return footprints.spread(sums, lattice, self.scene.raster, self.tables.particle_volume, density)

    def around_nodes(self) -> NodeSums | None:
        """Sums around nodes of the plan; None without particles."""
        found = self._on_cells()
        return footprints.around_nodes(*found[:2], self.scene.raster, found[2]) if found else None

    def plan_masses(self, first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
        """Mass, and mass times pore pressure ratio, (releases, 2, nx, ny) by release around nodes of the plan."""
        b, p, corner = self.blocks, self.store.particles, self.tables.constants.corner
        held = b.held[: b.nown]
        slot = self.store.occupied(b)
        cell, rec, index = p.cell[slot].astype(np.int64), p.rec[slot], p.particle_index[slot]
        block = corner[:2] + 4 * b.bxyz[: b.nown, :2].astype(np.int64)
        east, north = (
            np.repeat(block[:, d], held) + ((cell >> (4 - 2 * d)) & 3) + np.rint(rec[:, 4 + 4 * d]).astype(np.int64) for d in (0, 1)
        )
        release, ratio = p.label[index, 0], np.zeros(len(slot))
        if self.store.pore_left is not None:
            left, excess = (values.astype(float) for values in self.store.pores_at(slot))
            ratio = array_binding().pore_pressure.pore_ratio(excess, left, self.scene.pore_table().view(np.recarray)[release])
        return weighed((east, north), rec[:, 0].astype(float), release, ratio, len(self.scene.materials), first, shape)

    def _on_cells(self) -> tuple[np.ndarray, footprints.Lattice, float] | None:
        """Sums (lanes, rows, columns) on the cells of a window of the lattice, the window, and the density if all have one."""
        extent, density = self._extent(), self.tables.constants.density
        if extent is None:
            return None
        lattice = footprints.Lattice.around(self.scene, *extent)
        (columns, rows), several = lattice.shape, len(density) > 1
        nodes, sums = np.zeros((rows + 1, columns + 1, 4 + 4 * several)), np.empty((4 + several, rows, columns))
        self._add(np.array(lattice.first), nodes)
        self.k.add_nodes_to_cells(nodes, density, sums)
        return sums, lattice, float(density[0])

    def _extent(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Lowest and highest node (2,) in plan that the particles cover; None without particles."""
        b, corner = self.blocks, self.tables.constants.corner[:2]
        occupied = b.bxyz[: b.nown][b.held[: b.nown] > 0, :2]
        return (4 * occupied.min(0) + corner, 4 * occupied.max(0) + corner + 5) if len(occupied) else None

    def _add(self, first: np.ndarray, nodes: np.ndarray) -> None:
        """Add all particles to ``nodes``, by stripes that share nodes only with their neighbours."""
        constants = self.tables.constants
        listed, stripes = _stripes(self.blocks)
        for parity, over_density in itertools.product((0, 1), (False, True) if len(constants.density) > 1 else (False,)):
            held = self.store.particles, self.blocks, constants.corner, constants.density
            self.k.add_to_nodes(*held, over_density, first, listed, stripes, parity, nodes)


def _stripes(blocks: Blocks) -> tuple[np.ndarray, np.ndarray]:
    """Blocks with particles by stripe (n,), and the first of each stripe (stripes + 1,); stripes lie across the longer way."""
    occupied = np.flatnonzero(blocks.held[: blocks.nown])
    plan = blocks.bxyz[occupied, :2].astype(np.int64)
    axis = int(np.argmax(np.ptp(plan, axis=0)))
    stripe = plan[:, axis] - plan[:, axis].min()
    order = np.argsort(stripe, kind="stable")
    starts = np.searchsorted(stripe[order], np.arange(stripe.max() + 2))
    return occupied[order], starts


def _mass_and_momentum(rec, r):
    """Mass [kg] and momentum [kg m/s] of the record at place ``r`` in float64; the record holds that at the middle node."""
    middle = in_double(load4(rec, r))
    slopes = in_double(load4(rec, r + 4)), in_double(load4(rec, r + 8)), in_double(load4(rec, r + 12))
    d = np.float64(rec[r + 4]) - 1.0, np.float64(rec[r + 8]) - 1.0, np.float64(rec[r + 12]) - 1.0
    return first_of_one(middle, affine_at(middle, slopes[0], slopes[1], slopes[2], d))


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
