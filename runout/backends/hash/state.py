"""Particle arrays on the device."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.grid import NodeArrays
from runout.backends.hash.index import Index
from runout.backends.hash.layout import (
    AFFINE,
    AT_ONCE,
    CELL_LANES,
    CLEARING,
    HISTORY,
    MASS,
    MOMENTUM,
    OFFSET,
    ROWS,
    STAMPS,
    STRAIN,
    VOLUME,
    WARP,
    run,
    run_blocks,
)
from runout.model.particles import Particles

STAGED = 4  # rows that are prepared at once for the device


class Store:
    """Particle arrays on the device of the scope.

    Attributes
    ----------
    size, n : int
        Places; places that hold a particle or one that has gone since the last sort.
    rec : (ROWS, size)
        See :mod:`runout.backends.hash.layout`.
    radius : (size,)
    memory : (ROWS + 1, size)
        What holds both: a sort moves each row to the place beside it, in ``turn`` 0 up from row 0 and in turn 1 back, and the
        radius to the place at the other end.
    release : (size,) int16
        ``only`` is its number where there is but one, else -1.
    stress : (6, size)
        Kirchhoff stress [Pa] while nodes take it, if the store is ``stressed``: with transfers whose records hold none.
    number : (size,) int32
        Place in the particles as they were loaded.
    forces : (loaded,) four numbers
        By that place: stamp of the step in which the particle last touched the ground, and the force then [N].
    key : (size,) int32
        64 times the block plus the cell; -2 - key for a particle that has gone, -1 for no particle.
    order : (size,) int32
        Places of the particles, cell by cell; near the ground, from the middle of a step on, of those in contact alone.
    """

    def __init__(self, size: int, number: Any, stressed: bool = False, loaded: int | None = None):
        self.size = self.n = size
        self.forces = wp.zeros(size if loaded is None else loaded, dtype=wp.types.vector(length=4, dtype=number))
        self.only = -1
        self.memory = wp.zeros((ROWS + 1, max(size, 1)), dtype=number)  # warp takes no part of nothing
        self._take_turn(0)
        self.release, self.number = wp.zeros(size, dtype=wp.int16), wp.array(np.arange(size, dtype=np.int32), dtype=wp.int32)
        self.stress = wp.zeros((6, size * stressed), dtype=number)
        self.key, self.order = wp.full(size, -1, dtype=wp.int32), wp.zeros(size, dtype=wp.int32)

    def fill(self, parts: Sequence[Particles], release: np.ndarray, spacing: tuple[float, float, float], dtype: Any) -> None:
        """Bring particles with numbers of releases (size,) to the device; the records hold no stress yet (time step 0).

        A few rows at a time: together, the particles of many scenes are the largest thing on the host, and never lie there twice.
        """
        self.release.assign(release.astype(np.int16))
        self._fill_forces(parts, dtype)
        self.only = -1 if (release != release[:1]).any() else int(release[0])
        with ThreadPoolExecutor(STAGED) as pool:
            for first in range(0, ROWS + 1, STAGED):
                places = range(first, min(first + STAGED, ROWS + 1))
                for place, row in zip(places, pool.map(partial(_row_of, parts, spacing, dtype), places), strict=True):
                    self.memory[place].assign(row)

    def _fill_forces(self, parts: Sequence[Particles], dtype: Any) -> None:
        """Forces from which contact starts, if there are any."""
        if any(p.ground_force.any() for p in parts):
            forces = np.concatenate([p.ground_force for p in parts])
            self.forces.assign(np.column_stack([np.zeros(len(forces)), forces]).astype(dtype))

    def _take_turn(self, turn: int) -> None:
        self.turn = turn
        self.rec, self.radius = self.memory[turn : turn + ROWS], self.memory[0 if turn else ROWS]

    def sort(self, k: SimpleNamespace, index: Index, nodes: NodeArrays, ordered: bool) -> None:
        """After the cells have been numbered: list the particles and sort them in memory; those that have gone drop out.

        Only launches: :meth:`turn_over` follows. Nothing moves where the device has halted.
        """
        flags, totals = index.device_status.flags, index.count_blocks()
        index.list_cells(flags, nodes, totals)
        self.place(k, index)
        if ordered:
            run(k.sort_cells, index.capacity * CELL_LANES, flags, index.tally, index.active, self.number, index.cstart, self.order)
        self._sort_rows(k, flags, nodes.scratch(self.size, self.memory.dtype), totals)
        self._bring(k.gather_ints, k.bring_back_ints, flags, self.number, nodes, totals)
        if self.only < 0:
            self._bring(k.gather_shorts, k.bring_back_shorts, flags, self.release, nodes, totals)
        nodes.grid.zero_(), nodes.approach_speeds.zero_()
        run_blocks(
            k.renumber, index.shared, WARP, flags, index.tally, index.active, index.cstart, totals, index.device_status.counts,
            index.homes, index.home, self.order, self.key, nodes.approach_speeds,
        )  # fmt: skip
        run(k.clear_beyond, CLEARING, flags, totals, self.key)

    def place(self, k: SimpleNamespace, index: Index) -> None:
        """List the particles of each cell, once it is known where the cells start."""
        threads = -(-self.size // (AT_ONCE * WARP)) * WARP
        run(k.place_particles, threads, index.device_status.flags, self.key, index.ends, self.order)

    def _bring(self, gather: Any, bring_back: Any, flags: Any, array: Any, nodes: NodeArrays, totals: Any) -> None:
        """An array in the order of the list, by way of the memory of the grid."""
        scratch = nodes.scratch(self.size, array.dtype)
        run(gather, self.size, flags, array, self.order, totals, scratch)
        run(bring_back, self.size, flags, scratch, totals, array)

    def _sort_rows(self, k: SimpleNamespace, flags: Any, scratch: Any, totals: Any) -> None:
        """Rows in the order of the list, each to the place beside it, which has become free; only the radius is copied."""
        threads, radius = -(-self.size // AT_ONCE), self.memory[ROWS if self.turn else 0]
        run(k.gather_reals, threads, flags, self.radius, self.order, totals, scratch)
        places = range(ROWS - 1, -1, -1) if self.turn == 0 else range(1, ROWS + 1)
        step = 1 - 2 * self.turn
        for place in places:
            run(k.gather_reals, threads, flags, self.memory[place], self.order, totals, self.memory[place + step])
        run(k.bring_back_reals, self.size, flags, scratch, totals, radius)

    def turn_over(self) -> None:
        """The rows lie in the other places now: after a sort, or again if it moved nothing."""
        self._take_turn(1 - self.turn)

    def brought(self, where: Any, node: Any, affine: Any, steps: int) -> tuple[Particles, np.ndarray]:
        """Particles at the places ``where`` (n,) in memory after so many steps, without identity, and their numbers."""
        rec = np.stack([self.rec[row][where].numpy() for row in range(ROWS)]).astype(np.float64)
        m, number = rec[MASS], self.number[where].numpy()
        forces = self.forces[wp.array(number, dtype=wp.int32)].numpy().astype(np.float64)
        touched = forces[:, :1] == steps & STAMPS
        p = Particles(
            node.numpy(), rec[OFFSET : OFFSET + 3].T, (rec[MOMENTUM : MOMENTUM + 3] / m).T, affine.numpy().reshape(-1, 3, 3),
            rec[STRAIN : STRAIN + 6].T, rec[HISTORY], m, rec[VOLUME], self.radius[where].numpy().astype(np.float64),
            np.where(touched, forces[:, 1:], 0.0), self.release[where].numpy().astype(np.int32), np.zeros(len(m), np.int64),
        )  # fmt: skip
        return p, number


def _row_of(parts: Sequence[Particles], spacing: tuple[float, float, float], dtype: Any, place: int) -> np.ndarray:
    """What lies at a place of the memory in turn 0, for the particles of all parts."""
    row = np.empty(sum(len(p) for p in parts), dtype)
    ends = np.cumsum([len(p) for p in parts])
    for p, end in zip(parts, ends, strict=True):
        row[end - len(p) : end] = _values(p, spacing, place)
    return row


def _values(p: Particles, spacing: tuple[float, float, float], place: int) -> np.ndarray:
    if MOMENTUM <= place < MOMENTUM + 3:
        return p.mass * p.velocity[:, place - MOMENTUM]
    if OFFSET <= place < OFFSET + 3:
        return p.offset[:, place - OFFSET]
    if AFFINE <= place < AFFINE + 9:
        j, d = divmod(place - AFFINE, 3)
        return p.mass * p.affine[:, d, j] * spacing[j]
    if STRAIN <= place < STRAIN + 6:
        return p.strain[:, place - STRAIN]
    return {MASS: p.mass, HISTORY: p.history, VOLUME: p.volume, ROWS: p.radius}[place]
