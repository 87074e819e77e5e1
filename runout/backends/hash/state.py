"""State: the arrays of the particles on the device.

    memory (25, n)    turn 0: | record 0 ... 23 | radius |     turn 1: | radius | record 0 ... 23 |
    a row             one number of every particle: neighbours in a warp read neighbours in memory
    number            place of a particle in the input; ``forces`` is in that order, all other arrays in the order of memory

A sort moves each row to the row beside it, so that the particles need no second copy.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.grid import NodeArrays
from runout.backends.hash.groups import filled, groups_of
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

    Its arrays are those of :class:`runout.backends.hash.groups.ParticleGroup`; ``stress`` only if it is ``stressed``: with
    transfers whose records hold none.

    Attributes
    ----------
    identity : (loaded,) int
        Of the particles as they were loaded.
    size, n : int
        Places; places that hold a particle or one that has gone since the last sort.
    memory : (ROWS + 1, size)
        Rows of the record and the radius. A sort moves each row to the place beside it, in ``turn`` 0 up from row 0 and in turn 1
        back, and the radius to the place at the other end.
    only : int
        The release of all particles, -1 if there are several.
    """

    def __init__(self, identity: np.ndarray, number: Any, stressed: bool = False, size: int | None = None):
        self.identity, self.size = identity, len(identity) if size is None else size
        self.n = size = self.size
        self.forces = wp.zeros(len(identity), dtype=wp.types.vector(length=4, dtype=number))
        self.only = -1
        self.memory = wp.zeros((ROWS + 1, max(size, 1)), dtype=number)  # warp takes no part of nothing
        self.release, self.number = wp.zeros(size, dtype=wp.int16), wp.array(np.arange(size, dtype=np.int32), dtype=wp.int32)
        self.stress = wp.zeros((6, size * stressed), dtype=number)
        self.key, self.order = wp.full(size, -1, dtype=wp.int32), wp.zeros(size, dtype=wp.int32)
        self.struct = groups_of(number).ParticleGroup
        self._take_turn(0)

    def fill(self, parts: Sequence[Particles], release: np.ndarray, spacing: tuple[float, float, float], dtype: Any) -> int:
        """Bring particles with numbers of releases (size,) to the device; returns the only release, -1 if there are several.

        The records hold no stress yet (time step 0).

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
        return self.only

    def _fill_forces(self, parts: Sequence[Particles], dtype: Any) -> None:
        """Forces from which contact starts, if there are any."""
        if any(p.ground_force.any() for p in parts):
            forces = np.concatenate([p.ground_force for p in parts])
            self.forces.assign(np.column_stack([np.zeros(len(forces)), forces]).astype(dtype))

    def _take_turn(self, turn: int) -> None:
        self.turn = turn
        self.rec, self.radius = self.memory[turn : turn + ROWS], self.memory[0 if turn else ROWS]
        self.group = filled(self.struct, self)

    def sort(self, k: SimpleNamespace, index: Index, nodes: NodeArrays) -> None:
        """After the cells have been numbered: list the particles and sort them in memory; those that have gone drop out.

        Only launches: :meth:`turn_over` follows. Nothing moves where the device has halted.
        """
        status, blocks = index.status.group, index.block_group
        index.count_blocks()
        index.list_cells(nodes, by_sums=True)
        self.place(k, index)
        self._sort_rows(k, index, nodes)
        self._bring(k.gather_ints, k.bring_back_ints, index, nodes, self.number)
        if self.only < 0:
            self._bring(k.gather_shorts, k.bring_back_shorts, index, nodes, self.release)
        nodes.grid.zero_(), nodes.approach_speeds.zero_()
        run_blocks(k.renumber, index.shared, WARP, status, self.group, blocks, nodes.contact_group)
        run(k.clear_beyond, CLEARING, status, self.group, blocks)

    def place(self, k: SimpleNamespace, index: Index) -> None:
        """List the particles of each cell, once it is known where the cells start; by their numbers where sums are ordered."""
        threads, groups = -(-self.size // (AT_ONCE * WARP)) * WARP, (index.status.group, self.group, index.block_group)
        run(k.place_particles, threads, *groups)
        if index.ordered:
            run(k.sort_cells, index.capacity * CELL_LANES, *groups)

    def _bring(self, gather: Any, bring_back: Any, index: Index, nodes: NodeArrays, array: Any) -> None:
        """An array in the order of the list, by way of the memory of the grid."""
        scratch, status, blocks = nodes.scratch(self.size, array.dtype), index.status.group, index.block_group
        run(gather, self.size, status, self.group, blocks, array, scratch)
        run(bring_back, self.size, status, blocks, scratch, array)

    def _sort_rows(self, k: SimpleNamespace, index: Index, nodes: NodeArrays) -> None:
        """Rows in the order of the list, each to the place beside it, which has become free; only the radius is copied."""
        threads, status, blocks = -(-self.size // AT_ONCE), index.status.group, index.block_group
        scratch, radius = nodes.scratch(self.size, self.memory.dtype), self.memory[ROWS if self.turn else 0]
        run(k.gather_reals, threads, status, self.group, blocks, self.radius, scratch)
        places = range(ROWS - 1, -1, -1) if self.turn == 0 else range(1, ROWS + 1)
        step = 1 - 2 * self.turn
        for place in places:
            run(k.gather_reals, threads, status, self.group, blocks, self.memory[place], self.memory[place + step])
        run(k.bring_back_reals, self.size, status, blocks, scratch, radius)

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
