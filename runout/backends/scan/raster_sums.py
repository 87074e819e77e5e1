"""Sums over the columns of the raster, in parallel by stripes of blocks; the bits do not depend on the number of threads.

    sums[row, column]    mass | momentum (3) | mass / density | momentum / density (3)    in float64, one line of the cache

    | stripe 0 | stripe 1 | stripe 2 | stripe 3 |    blocks in plan: the even stripes are added at once, then the odd ones

A particle counts where a plan box of one grid cell around it lies; on rasters finer than the grid, ``lattice_sums`` add to the
lattice of :mod:`runout.backends.footprints`. A stripe is so wide that it shares cells only with its two neighbours.
"""

import itertools
import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from runout.backends import footprints
from runout.backends.lanes import constant, in_double, load4, permutation_of_two, prefetch, store
from runout.backends.protocol import RasterSums
from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks
from runout.backends.scan.observe import _node_of
from runout.backends.scan.state import Store
from runout.backends.scan.stencil import AHEAD, _add_products
from runout.model.scene import Scene
from runout.physics.moments import affine_at

WIDTH = 8  # numbers of a cell of the raster, a line of the cache: mass and momentum, and the same over the density
WINDOW = 3  # cells of the raster that are added to at once
first_of_one = permutation_of_two((0, 5, 6, 7))
nothing = constant([0.0] * 4)


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
        raster = self.scene.raster
        if footprints.apply_to(self.scene):
            return footprints.on_whole(self.around_flow(), raster)
        return self._on_raster((0, 0, raster.rows, raster.columns))

    def around_flow(self) -> RasterSums:
        """Sums over the smallest window of cells that the blocks with particles cover: none beside it holds any mass."""
        raster, constants = self.scene.raster, self.tables.constants
        if footprints.apply_to(self.scene):
            return footprints.on_raster(self.on_lattice(), raster, footprints.lattice_cell(self.scene))
        extent = self._extent()
        if extent is None:
            return footprints.nothing()
        h, cell, count = constants.spacing[:2], np.array(raster.cell_size), np.array((raster.columns, raster.rows))
        first = np.clip(np.floor(extent[0] * h / cell - 1e-6), 0, count - 1).astype(int)
        last = np.clip(np.floor(extent[1] * h / cell + 1e-6), 0, count - 1).astype(int)
        (west, south), (columns, rows) = first.tolist(), (last - first + 1).tolist()
        return self._on_raster((raster.rows - south - rows, west, rows, columns))

    def on_lattice(self) -> RasterSums:
        """Sums over a window of the lattice that holds all mass, of particles with footprints."""
        extent, density = self._extent(), self.tables.constants.density
        if extent is None:
            return footprints.nothing()
        lattice = footprints.Lattice.around(self.scene, *extent)
        (columns, rows), several = lattice.shape, len(density) > 1
        nodes, sums = np.zeros((rows + 1, columns + 1, 4 + 4 * several)), np.empty((4 + several, rows, columns))
        self._add(self.k.add_to_nodes, lattice.cell, (np.array(lattice.first),), nodes)
        self.k.add_nodes_to_cells(nodes, density, sums)
        return footprints.spread(sums, lattice, self.scene.raster, self.tables.particle_volume, float(density[0]))

    def _extent(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Lowest and highest node (2,) in plan that the particles cover; None without particles."""
        b, corner = self.blocks, self.tables.constants.corner[:2]
        occupied = b.bxyz[: b.nown][b.held[: b.nown] > 0, :2]
        return (4 * occupied.min(0) + corner, 4 * occupied.max(0) + corner + 5) if len(occupied) else None

    def _on_raster(self, window: tuple[int, int, int, int]) -> RasterSums:
        """Sums over a window (first row, first column, rows, columns) of the raster that holds all mass."""
        raster = self.scene.raster
        row, column, rows, columns = window
        sums = self._over(raster.cell_size, (row, column, raster.rows), (rows, columns))
        return RasterSums(self._volume(sums), sums[..., 0], sums[..., 1:4], row, column)

    def _volume(self, sums: np.ndarray) -> np.ndarray:
        """Volume [m3] of sums (rows, columns, 8)."""
        density = self.tables.constants.density
        return sums[..., 4] if len(density) > 1 else sums[..., 0] / density[0]  # type: ignore[no-any-return]

    def _over(self, cell: tuple[float, float], place: tuple[int, int, int], shape: tuple[int, int]) -> np.ndarray:
        """Sums (rows, columns, 8) over a window of plan cells of size ``cell`` [m] that holds all mass.

        ``place``: its first row from the north and first column, and the rows of the whole, whose last ends at the local origin.
        """
        sums, wide = np.zeros((*shape, WIDTH)), self.tables.constants.spacing[:2] / np.array(cell)
        if sums.size and self.store.n:
            self._add(self.k.add_stripes, cell, (wide, np.array(place)), sums)
        return sums

    def _add(self, kernel: Any, cell: tuple[float, float], where: tuple[np.ndarray, ...], sums: np.ndarray) -> None:
        """Add all particles to ``sums``, by stripes that share cells of size ``cell`` [m] only with their neighbours."""
        constants = self.tables.constants
        listed, stripes = _stripes(self.blocks, constants.spacing, cell)
        for parity, over_density in itertools.product((0, 1), (False, True) if len(constants.density) > 1 else (False,)):
            held = self.store.particles, self.blocks, constants.corner, constants.density
            kernel(*held, over_density, *where, listed, stripes, parity, sums)


def _stripes(blocks: Blocks, h: np.ndarray, cell: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Blocks with particles by stripe (n,), and the first of each stripe (stripes + 1,); stripes lie across the longer way."""
    occupied = np.flatnonzero(blocks.held[: blocks.nown])
    plan = blocks.bxyz[occupied, :2].astype(np.int64)
    widths = [math.ceil((h[d] + 2 * cell[d]) / (4 * h[d])) for d in (0, 1)]  # blocks: wider than what two stripes share
    extents = (plan.max(0) - plan.min(0)) // widths
    axis = int(np.argmax(extents))
    stripe = (plan[:, axis] - plan[:, axis].min()) // widths[axis]
    order = np.argsort(stripe, kind="stable")
    starts = np.searchsorted(stripe[order], np.arange(stripe.max() + 2))
    return occupied[order], starts


def _mass_and_momentum(rec, r):
    """Mass [kg] and momentum [kg m/s] of the record at place ``r`` in float64; the record holds that at the middle node."""
    middle = in_double(load4(rec, r))
    slopes = in_double(load4(rec, r + 4)), in_double(load4(rec, r + 8)), in_double(load4(rec, r + 12))
    d = np.float64(rec[r + 4]) - 1.0, np.float64(rec[r + 8]) - 1.0, np.float64(rec[r + 12]) - 1.0
    return first_of_one(middle, affine_at(middle, slopes[0], slopes[1], slopes[2], d))


def _shares(q, step):
    """Parts of a box that lie in three cells in a row; ``q`` of it lies beyond the first, ``step`` less beyond the next."""
    c0 = min(max(q + step, 0.0), 1.0)
    c1 = min(max(q, 0.0), 1.0)
    c2 = min(max(q - step, 0.0), 1.0)
    c3 = min(max(q - 2.0 * step, 0.0), 1.0)
    return c0 - c1, c1 - c2, c2 - c3


def _add_to_cell(amounts, row, column, size, sums, lane):
    """Add to a cell of the raster; what hangs over the edge of the window counts in the edge cell."""
    o = (min(max(row, 0), size[0] - 1) * size[1] + min(max(column, 0), size[1] - 1)) * WIDTH + lane
    store(sums, o, load4(sums, o) + amounts)


def _add_cell(rec, particles, s, e, over, corner, step, row, column, size, sums):
    """Add the particles s to e of a grid cell to three times three cells of the raster, the first at ``row`` and ``column``.

    Of the box of a particle with offset f, f + ``corner`` (2,) lies beyond the first cells; ``step`` (2,) are cells over boxes.
    ``over`` are the densities by which mass and momentum are divided; or none.
    """
    particle_index, label, order = particles.particle_index, particles.label, particles.order
    z = nothing(sums)
    rows = z, z, z, z, z, z, z, z, z
    for t in range(s, e):
        p = order[t]
        r = 16 * p
        prefetch(rec, 16 * np.int64(order[t + AHEAD]))
        x = _shares(corner[0] + rec[r + 4], step[0])
        y = _shares(corner[1] + rec[r + 8], step[1])
        amounts = _mass_and_momentum(rec, r)
        if len(over) > 0:
            amounts = amounts * (1.0 / over[label[particle_index[p], 0]])
        rows = _add_products(x, y, amounts, rows)
    lane = 4 if len(over) > 0 else 0
    for k, three in enumerate((rows[:3], rows[3:6], rows[6:])):
        _add_to_cell(three[0], row, column + k, size, sums, lane)
        _add_to_cell(three[1], row - 1, column + k, size, sums, lane)
        _add_to_cell(three[2], row - 2, column + k, size, sums, lane)


def _add_block(rec, particles, blocks, b, node, over, wide, place, size, sums):
    """Add the particles of a block; ``node`` is its first, ``wide`` (2,) the size of a grid cell in cells of the raster."""
    starts, first = blocks.starts, blocks.first
    step = 1.0 / wide[0], 1.0 / wide[1]
    for c in range(64):
        s = first[b] + starts[b, c]
        e = first[b] + starts[b, c + 1]
        if s == e:
            continue
        west = (node[0] + (c >> 4)) * wide[0]
        south = (node[1] + ((c >> 2) & 3)) * wide[1]
        for i in range(math.floor(west), math.floor(west + 2.0 * wide[0]) + 1, WINDOW):
            for j in range(math.floor(south), math.floor(south + 2.0 * wide[1]) + 1, WINDOW):
                corner = (west - i - 1.0) * step[0] + 0.5, (south - j - 1.0) * step[1] + 0.5
                row = place[2] - 1 - j - place[0]
                _add_cell(rec, particles, s, e, over, corner, step, row, i - place[1], size, sums)


def add_stripes(particles, blocks, corner, density, over_density, wide, place, listed, stripes, parity, sums):
    """Add mass and momentum, or these over the density, of every second stripe of blocks to a window (rows, columns, 8).

    ``listed`` are the blocks by stripe, ``place`` holds the first row and column of the window, and the rows of the raster.
    """
    flat = particles.rec.reshape(-1)
    total = sums.reshape(-1)
    size = sums.shape[0], sums.shape[1]
    over = density if over_density else density[:0]
    for k in prange((len(stripes) - parity) // 2):
        s = 2 * k + parity
        for e in range(stripes[s], stripes[s + 1]):
            b = listed[e]
            node = _node_of(blocks.bxyz, b, 0, corner)
            _add_block(flat, particles, blocks, b, node, over, wide, place, size, total)
