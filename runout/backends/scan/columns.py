"""Sums over the columns of the raster's cells: in parallel by stripes of blocks, the same bits for any number of threads.

A particle counts where a plan box of one grid cell around it lies. A stripe is so wide that it shares cells with its two
neighbours alone: the even stripes are added at once, then the odd ones.
"""

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import prange

from runout.backends.protocol import Columns
from runout.backends.scan.observe import _momentum, _node_of

if TYPE_CHECKING:
    from runout.backends.scan.backend import ScanBackend


def whole(engine: "ScanBackend") -> Columns:
    """Sums over all cells of the raster."""
    raster = engine.scene.raster
    return _over(engine, (0, 0, raster.rows, raster.columns))


def around_flow(engine: "ScanBackend") -> Columns:
    """Sums over the smallest window of cells that the blocks with particles cover: none beside it holds any mass."""
    raster, i = engine.scene.raster, engine.index
    occupied = i.bxyz[: i.nown][i.held[: i.nown] > 0, :2]
    if not len(occupied):
        return _over(engine, (0, 0, 0, 0))
    h, cell, count = engine.spacing[:2], np.array(raster.cell_size), np.array((raster.columns, raster.rows))
    low, high = 4 * occupied.min(0) + engine.corner[:2], 4 * occupied.max(0) + engine.corner[:2] + 5
    first = np.clip(np.floor(low * h / cell - 1e-6), 0, count - 1).astype(int)
    last = np.clip(np.floor(high * h / cell + 1e-6), 0, count - 1).astype(int)
    (west, south), (columns, rows) = first.tolist(), (last - first + 1).tolist()
    return _over(engine, (raster.rows - south - rows, west, rows, columns))


def _over(engine: "ScanBackend", window: tuple[int, int, int, int]) -> Columns:
    """Sums over a window (first row, first column, rows, columns) that holds all mass."""
    i, s, raster = engine.index, engine.store, engine.scene.raster
    row, column, rows, columns = window
    sums = np.zeros((rows, columns, 5))
    if sums.size and engine.n:
        order, starts = _stripes(engine)
        wide, place = engine.spacing[:2] / np.array(raster.cell_size), np.array((row, column, raster.rows))
        for parity in (0, 1):
            engine.k.add_stripes(
                s.rec, s.who, s.label, s.order, i.starts, i.first, i.bxyz, engine.corner, engine.density, wide, place, order,
                starts, parity, sums,
            )  # fmt: skip
    return Columns(sums[..., 0], sums[..., 1], sums[..., 2:], row, column)


def _stripes(engine: "ScanBackend") -> tuple[np.ndarray, np.ndarray]:
    """Blocks with particles by stripe (n,), and the first of each stripe (stripes + 1,); stripes lie across the longer way."""
    i, h, cell = engine.index, engine.spacing, engine.scene.raster.cell_size
    occupied = np.flatnonzero(i.held[: i.nown])
    blocks = i.bxyz[occupied, :2].astype(np.int64)
    widths = [math.ceil((h[d] + 2 * cell[d]) / (4 * h[d])) for d in (0, 1)]  # blocks: wider than what two stripes share
    extents = (blocks.max(0) - blocks.min(0)) // widths
    axis = int(np.argmax(extents))
    stripe = (blocks[:, axis] - blocks[:, axis].min()) // widths[axis]
    order = np.argsort(stripe, kind="stable")
    starts = np.searchsorted(stripe[order], np.arange(stripe.max() + 2))
    return occupied[order], starts


def _clamped(k, count):
    """Row or column of the window: what hangs over the edge of the raster counts in the edge cell."""
    return min(max(k, 0), count - 1)


def _add_piece(amounts, x, y, width, place, sums):
    """Add a box no larger than a cell of the raster, ``width`` (2,) of one wide from (x, y) on, to the up to four it covers."""
    i = math.floor(x)
    j = math.floor(y)
    east = max(x + width[0] - (i + 1.0), 0.0) / width[0]
    north = max(y + width[1] - (j + 1.0), 0.0) / width[1]
    for a in range(2):
        column = _clamped(i + a - place[1], sums.shape[1])
        across = east if a == 1 else 1.0 - east
        for b in range(2):
            row = _clamped(place[2] - 1 - j - b - place[0], sums.shape[0])
            share = across * north if b == 1 else across * (1.0 - north)
            for d in range(5):
                sums[row, column, d] += share * amounts[d]


def _add_particle(rec, p, density, x, y, pieces, width, place, sums):
    """Add a particle whose plan box begins at (x, y) [cells of the raster], in pieces no larger than such a cell."""
    part = 1.0 / (pieces[0] * pieces[1])
    m = part * rec[p, 0]
    mv = _momentum(rec.T, p)
    amounts = (m / density, m, part * mv[0], part * mv[1], part * mv[2])
    for i in range(pieces[0]):
        for j in range(pieces[1]):
            _add_piece(amounts, x + i * width[0], y + j * width[1], width, place, sums)


def _add_block(rec, who, label, order, starts, first, density, b, node, wide, pieces, width, place, sums):
    """Add the particles of a block; ``node`` is its first, ``wide`` (2,) the size of a grid cell in cells of the raster."""
    for c in range(64):
        west = (node[0] + (c >> 4) - 0.5) * wide[0]
        south = (node[1] + ((c >> 2) & 3) - 0.5) * wide[1]
        for t in range(first[b] + starts[b, c], first[b] + starts[b, c + 1]):
            p = order[t]
            rho = density[0] if len(density) == 1 else density[label[who[p], 0]]
            _add_particle(rec, p, rho, west + rec[p, 4] * wide[0], south + rec[p, 8] * wide[1], pieces, width, place, sums)


def add_stripes(rec, who, label, order, starts, first, bxyz, corner, density, wide, place, blocks, stripes, parity, sums):
    """Add the particles of every second stripe of blocks to a window (rows, columns, 5): volume, mass, momentum.

    ``place`` holds the first row and column of the window, and the rows of the raster.
    """
    pieces = math.ceil(wide[0]), math.ceil(wide[1])
    width = wide[0] / pieces[0], wide[1] / pieces[1]
    for k in prange((len(stripes) - parity) // 2):
        s = 2 * k + parity
        for e in range(stripes[s], stripes[s + 1]):
            b = blocks[e]
            node = _node_of(bxyz, b, 0, corner)
            _add_block(rec, who, label, order, starts, first, density, b, node, wide, pieces, width, place, sums)
