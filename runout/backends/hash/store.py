"""Particle arrays on the device."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.index import Index
from runout.backends.hash.layout import (
    AFFINE,
    CELL_LANES,
    HISTORY,
    MASS,
    MOMENTUM,
    OFFSET,
    RADIUS,
    ROWS,
    STRAIN,
    VOLUME,
    run,
)
from runout.backends.hash.nodes import NodeArrays
from runout.model.particles import Particles


class Store:
    """Particle arrays on the device of the scope.

    Attributes
    ----------
    size, n : int
        Places; places that hold a particle or one that has gone since the last sort.
    rec : (ROWS, size)
        See :mod:`runout.backends.hash.layout`.
    release : (size,) int16
    number : (size,) int32
        Place in the particles as they were loaded.
    key : (size,) int32
        64 times the block plus the cell; -2 - key for a particle that has gone, -1 for no particle.
    order : (size,) int32
        Places of the particles, cell by cell; those in contact come first in their cell, as -1 - place.
    """

    def __init__(self, size: int, number: Any):
        self.size = self.n = size
        self.rec = wp.zeros((ROWS, size), dtype=number)
        self.release, self.number = wp.zeros(size, dtype=wp.int16), wp.array(np.arange(size, dtype=np.int32), dtype=wp.int32)
        self.key, self.order = wp.full(size, -1, dtype=wp.int32), wp.zeros(size, dtype=wp.int32)

    def fill(self, p: Particles, spacing: tuple[float, float, float], dtype: Any) -> None:
        """Bring particles to the device; the records hold no stress yet (time step 0)."""
        self.release.assign(p.release.astype(np.int16))
        for row, values in self._rows(p, spacing):
            self.rec[row].assign(values.astype(dtype))

    def sort(self, k: SimpleNamespace, index: Index, nodes: NodeArrays, ordered: bool, flags: Any) -> None:
        """After the cells have been numbered: list the particles and sort them in memory; those that have gone drop out."""
        totals, left = index.totals()
        index.list_cells(flags, nodes, totals)
        run(k.place_particles, self.n, flags, self.key, index.ends, self.order)
        if ordered:
            run(k.sort_cells, index.room * CELL_LANES, flags, index.tally, index.active, self.number, index.cstart, self.order)
        scratch = nodes.scratch(self.size, self.rec.dtype)
        for row in range(ROWS):
            self._gather(k.gather_reals, self.rec[row], scratch, left)
        for array in (self.key, self.number):
            self._gather(k.gather_ints, array, nodes.scratch(self.size, wp.int32), left)
        self._gather(k.gather_shorts, self.release, nodes.scratch(self.size, wp.int16), left)
        nodes.grid.zero_()
        self.n = left
        run(k.note_homes, index.room, index.tally, index.active, index.cstart, index.homes, index.home)
        run(k.count_up, self.size, self.order, left, self.key)

    def _gather(self, kernel: Any, array: Any, scratch: Any, count: int) -> None:
        if count:
            run(kernel, count, array, self.order, scratch)
            wp.copy(array, scratch, count=count)

    def brought(self, where: Any, node: Any, affine: Any) -> tuple[Particles, np.ndarray]:
        """Particles at the places ``where`` (n,) in memory, without identity, and their numbers."""
        rec = np.stack([self.rec[row][where].numpy() for row in range(ROWS)]).astype(np.float64)
        m = rec[MASS]
        p = Particles(
            node.numpy(), rec[OFFSET : OFFSET + 3].T, (rec[MOMENTUM : MOMENTUM + 3] / m).T, affine.numpy().reshape(-1, 3, 3),
            rec[STRAIN : STRAIN + 6].T, rec[HISTORY], m, rec[VOLUME], rec[RADIUS],
            self.release[where].numpy().astype(np.int32), np.zeros(len(m), np.int64),
        )  # fmt: skip
        return p, self.number[where].numpy()

    @staticmethod
    def _rows(p: Particles, spacing: tuple[float, float, float]) -> Iterator[tuple[int, np.ndarray]]:
        """Rows of the particle matrix and their values."""
        yield MASS, p.mass
        for d in range(3):
            yield MOMENTUM + d, p.mass * p.velocity[:, d]
            yield OFFSET + d, p.offset[:, d]
            for j in range(3):
                yield AFFINE + 3 * j + d, p.mass * p.affine[:, d, j] * spacing[j]
        for k in range(6):
            yield STRAIN + k, p.strain[:, k]
        yield HISTORY, p.history
        yield VOLUME, p.volume
        yield RADIUS, p.radius
