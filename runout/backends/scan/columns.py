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
        cell, place = np.array(raster.cell_size), np.array((row, column, raster.rows, raster.columns))
        for parity in (0, 1):
            engine.k.add_stripes(
                s.rec, s.who, s.label, s.order, i.starts, i.first, i.bxyz, engine.corner, engine.density, engine.spacing, cell,
                place, order, starts, parity, sums,
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


def _covered(low, width, k):
    """Share of an interval from ``low`` that lies in cell k; all in cells."""
    return (min(low + width, k + 1.0) - max(low, float(k))) / width


def _add_particle(rec, p, density, node, h, cell, place, sums):
    """Add a particle, spread over a plan box of one grid cell, to the cells of the window."""
    wx = h[0] / cell[0]
    wy = h[1] / cell[1]
    x = (node[0] + rec[p, 4] - 0.5) * wx
    y = (node[1] + rec[p, 8] - 0.5) * wy
    m = rec[p, 0]
    mv = _momentum(rec.T, p)
    for i in range(math.floor(x), math.floor(x + wx) + 1):
        sx = _covered(x, wx, i)
        column = min(max(i, 0), place[3] - 1) - place[1]
        for j in range(math.floor(y), math.floor(y + wy) + 1):
            share = sx * _covered(y, wy, j)
            if share > 0.0:
                row = place[2] - 1 - min(max(j, 0), place[2] - 1) - place[0]
                sums[row, column, 0] += share * m / density
                sums[row, column, 1] += share * m
                for d in range(3):
                    sums[row, column, 2 + d] += share * mv[d]


def add_stripes(rec, who, label, order, starts, first, bxyz, corner, density, h, cell, place, blocks, stripes, parity, sums):
    """Add the particles of every second stripe of blocks to a window (rows, columns, 5): volume, mass, momentum.

    ``place`` holds the first row and column of the window, and the rows and columns of the raster.
    """
    for k in prange((len(stripes) - parity) // 2):
        s = 2 * k + parity
        for e in range(stripes[s], stripes[s + 1]):
            b = blocks[e]
            for c in range(64):
                node = _node_of(bxyz, b, c, corner)
                for t in range(first[b] + starts[b, c], first[b] + starts[b, c + 1]):
                    p = order[t]
                    _add_particle(rec, p, density[label[who[p], 0]], node, h, cell, place, sums)
