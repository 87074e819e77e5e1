"""Sums over the columns of the raster's cells: in parallel by stripes of blocks, the same bits for any number of threads.

A particle counts where a plan box of one grid cell around it lies; on rasters finer than the grid, the cells are those of the
lattice of :mod:`runout.backends.footprints`. A stripe is so wide that it shares cells with its two
neighbours alone: the even stripes are added at once, then the odd ones.
"""

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
from numba import prange

from runout.backends import footprints
from runout.backends.lanes import constant, in_double, load4, permutation_of_two, prefetch, store
from runout.backends.protocol import RasterSums
from runout.backends.scan.observe import _node_of
from runout.backends.scan.stencil import AHEAD
from runout.physics.moments import affine_at

if TYPE_CHECKING:
    from runout.backends.scan.backend import ScanBackend

WIDTH = 8  # numbers of a cell of the raster, a line of the cache: mass and momentum, and the same over the density
WINDOW = 3  # cells of the raster that are added to at once
first_of_one = permutation_of_two((0, 5, 6, 7))
nothing = constant([0.0] * 4)


def whole(engine: "ScanBackend") -> RasterSums:
    """Sums over all cells of the raster."""
    raster = engine.scene.raster
    if footprints.apply_to(engine.scene):
        return footprints.on_whole(around_flow(engine), raster)
    return _on_raster(engine, (0, 0, raster.rows, raster.columns))


def around_flow(engine: "ScanBackend") -> RasterSums:
    """Sums over the smallest window of cells that the blocks with particles cover: none beside it holds any mass."""
    raster, i = engine.scene.raster, engine.index
    occupied = i.bxyz[: i.nown][i.held[: i.nown] > 0, :2]
    if not len(occupied):
        return footprints.nothing()
    low, high = 4 * occupied.min(0) + engine.corner[:2], 4 * occupied.max(0) + engine.corner[:2] + 5
    if footprints.apply_to(engine.scene):
        return _on_lattice(engine, footprints.Lattice.around(engine.scene, low, high))
    h, cell, count = engine.spacing[:2], np.array(raster.cell_size), np.array((raster.columns, raster.rows))
    first = np.clip(np.floor(low * h / cell - 1e-6), 0, count - 1).astype(int)
    last = np.clip(np.floor(high * h / cell + 1e-6), 0, count - 1).astype(int)
    (west, south), (columns, rows) = first.tolist(), (last - first + 1).tolist()
    return _on_raster(engine, (raster.rows - south - rows, west, rows, columns))


def _on_lattice(engine: "ScanBackend", lattice: footprints.Lattice) -> RasterSums:
    """Sums over the cells of the raster under a window of the lattice that holds all mass, of particles with their footprints."""
    (east, north), (columns, rows) = lattice.first, lattice.shape
    sums = _over(engine, lattice.cell, (0, east, north + rows), (rows, columns))
    volume = _volume(engine, sums)[..., None]
    together = np.concatenate([volume, sums[..., :4]], axis=-1)
    return footprints.on_raster(together, lattice, engine.scene.raster, engine.particle_volume)


def _on_raster(engine: "ScanBackend", window: tuple[int, int, int, int]) -> RasterSums:
    """Sums over a window (first row, first column, rows, columns) of the raster that holds all mass."""
    raster = engine.scene.raster
    row, column, rows, columns = window
    sums = _over(engine, raster.cell_size, (row, column, raster.rows), (rows, columns))
    return RasterSums(_volume(engine, sums), sums[..., 0], sums[..., 1:4], row, column)


def _volume(engine: "ScanBackend", sums: np.ndarray) -> np.ndarray:
    """Volume [m3] of sums (rows, columns, 8)."""
    return sums[..., 4] if len(engine.density) > 1 else sums[..., 0] / engine.density[0]  # type: ignore[no-any-return]


def _over(engine: "ScanBackend", cell: tuple[float, float], place: tuple[int, int, int], shape: tuple[int, int]) -> np.ndarray:
    """Sums (rows, columns, 8) over a window of plan cells of size ``cell`` [m] that holds all mass.

    ``place``: its first row from the north and first column, and the rows of the whole, whose last ends at the local origin.
    """
    i, s = engine.index, engine.store
    sums = np.zeros((*shape, WIDTH))
    if sums.size and engine.n:
        order, starts = _stripes(engine, cell)
        wide = engine.spacing[:2] / np.array(cell)
        for parity, over_density in itertools.product((0, 1), (False, True) if len(engine.density) > 1 else (False,)):
            engine.k.add_stripes(
                s.rec, s.particle_index, s.label, s.order, i.starts, i.first, i.bxyz, engine.corner, engine.density, over_density,
                wide, np.array(place), order, starts, parity, sums,
            )  # fmt: skip
    return sums


def _stripes(engine: "ScanBackend", cell: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Blocks with particles by stripe (n,), and the first of each stripe (stripes + 1,); stripes lie across the longer way."""
    i, h = engine.index, engine.spacing
    occupied = np.flatnonzero(i.held[: i.nown])
    blocks = i.bxyz[occupied, :2].astype(np.int64)
    widths = [math.ceil((h[d] + 2 * cell[d]) / (4 * h[d])) for d in (0, 1)]  # blocks: wider than what two stripes share
    extents = (blocks.max(0) - blocks.min(0)) // widths
    axis = int(np.argmax(extents))
    stripe = (blocks[:, axis] - blocks[:, axis].min()) // widths[axis]
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


def _add_cell(rec, particle_index, label, order, s, e, over, corner, step, row, column, size, sums):
    """Add the particles s to e of a grid cell to three times three cells of the raster, the first at ``row`` and ``column``.

    Of the box of a particle with offset f, f + ``corner`` (2,) lies beyond the first cells; ``step`` (2,) are cells over boxes.
    ``over`` are the densities by which mass and momentum are divided; or none.
    """
    a00 = a01 = a02 = a10 = a11 = a12 = a20 = a21 = a22 = nothing(sums)
    for t in range(s, e):
        p = order[t]
        r = 16 * p
        prefetch(rec, 16 * np.int64(order[t + AHEAD]))
        x = _shares(corner[0] + rec[r + 4], step[0])
        y = _shares(corner[1] + rec[r + 8], step[1])
        amounts = _mass_and_momentum(rec, r)
        if len(over) > 0:
            amounts = amounts * (1.0 / over[label[particle_index[p], 0]])
        u0 = y[0] * amounts
        u1 = y[1] * amounts
        u2 = y[2] * amounts
        a00 += x[0] * u0
        a01 += x[0] * u1
        a02 += x[0] * u2
        a10 += x[1] * u0
        a11 += x[1] * u1
        a12 += x[1] * u2
        a20 += x[2] * u0
        a21 += x[2] * u1
        a22 += x[2] * u2
    lane = 4 if len(over) > 0 else 0
    for k, three in enumerate(((a00, a01, a02), (a10, a11, a12), (a20, a21, a22))):
        _add_to_cell(three[0], row, column + k, size, sums, lane)
        _add_to_cell(three[1], row - 1, column + k, size, sums, lane)
        _add_to_cell(three[2], row - 2, column + k, size, sums, lane)


def _add_block(rec, particle_index, label, order, starts, first, b, node, over, wide, place, size, sums):
    """Add the particles of a block; ``node`` is its first, ``wide`` (2,) the size of a grid cell in cells of the raster."""
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
                _add_cell(rec, particle_index, label, order, s, e, over, corner, step, row, i - place[1], size, sums)


def add_stripes(
    rec, particle_index, label, order, starts, first, bxyz, corner, density, over_density, wide, place, blocks, stripes, parity,
    sums,
):  # fmt: skip
    """Add mass and momentum, or these over the density, of every second stripe of blocks to a window (rows, columns, 8).

    ``place`` holds the first row and column of the window, and the rows of the raster.
    """
    flat = rec.reshape(-1)
    total = sums.reshape(-1)
    size = sums.shape[0], sums.shape[1]
    over = density if over_density else density[:0]
    for k in prange((len(stripes) - parity) // 2):
        s = 2 * k + parity
        for e in range(stripes[s], stripes[s + 1]):
            b = blocks[e]
            node = _node_of(bxyz, b, 0, corner)
            _add_block(flat, particle_index, label, order, starts, first, b, node, over, wide, place, size, total)
