"""State: the arrays of the particles on the device.

    memory (25, n)    turn 0: | record 0 ... 23 | radius |     turn 1: | radius | record 0 ... 23 |
    memory (50, n)    turn 0: | record 0 ... 23 | radius | 25 free |    turn 1: | 25 free | record 0 ... 23 | radius |
    a row             one number of every particle: neighbours in a warp read neighbours in memory
    number            place of a particle in the input; ``forces`` and pore pressure are in that order, all others in that of memory

A sort moves each row to the row beside it, so that the particles need no second copy. Where particles are few, launches take the
time: one moves all rows to those that are free.
"""

from __future__ import annotations

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
    FEW,
    HISTORY,
    MASS,
    MOMENTUM,
    OFFSET,
    ROWS,
    SCENE,
    SPARE,
    STAMPS,
    STRAIN,
    VOLUME,
    WARP,
    run,
    run_blocks,
)
from runout.model.particles import Particles

FEWEST_JOINING = 2**11  # columns of the table of joining particles


class Store:
    """Particle arrays on the device of the scope.

    Its arrays are those of :class:`runout.backends.hash.groups.ParticleGroup`.

    Attributes
    ----------
    loaded : int
        Number of the particles that were loaded or have joined.
    size, n : int
        Places; places that hold a particle or one that has gone since the last sort.
    memory : (ROWS + 1, size) or (ROWS + 1 + SPARE, size)
        Rows of the record and the radius. A sort moves each row to the place beside it, in ``turn`` 0 up from row 0 and in turn 1
        back, and the radius to the place at the other end; or all of them by ``spare`` places.
    forces, pore_left, pore_excess : (loaded or more,)
        As in :class:`runout.backends.hash.groups.PoreGroup`, by number; those of pores are empty in a dry batch.
    joining : (5, room) int32
        Particles that the next sort takes up: in column 0 the place of the first and their number, in the others first node,
        release and 64 times the scene of each. Without columns until some are expected or join.
    taken_up : bool
        Whether a sort has taken them up.
    put_releases : set of int
        Releases of the particles.
    """

    def __init__(self, identity: np.ndarray, number: Any, size: int | None = None, wet: bool = False):
        self._identity, self.loaded, self.wet = identity, len(identity), wet
        self.put_releases: set[int] = set()
        self.n = size = len(identity) if size is None else size
        self.forces = wp.zeros(len(identity), dtype=wp.types.vector(length=4, dtype=number))
        self.pore_left, self.pore_excess = (wp.zeros(len(identity) * wet, dtype=number) for _ in range(2))
        self.struct = groups_of(number).ParticleGroup
        self.joining, self.taken_up = wp.zeros((SCENE + 1, 0), dtype=wp.int32), False
        self._make_places(size, number)
        self.number.assign(np.arange(size, dtype=np.int32))

    def _make_places(self, size: int, number: Any) -> None:
        """Empty arrays of so many places."""
        self.size, self.spare = size, SPARE if size < FEW else 0
        self.memory = wp.zeros((ROWS + 1 + self.spare, max(size, 1)), dtype=number)  # warp takes no part of nothing
        self.release, self.number = wp.zeros(size, dtype=wp.int16), wp.zeros(size, dtype=wp.int32)
        self.key, self.order = wp.full(size, -1, dtype=wp.int32), wp.zeros(size, dtype=wp.int32)
        self._take_turn(0)

    @property
    def identity(self) -> np.ndarray:
        """Of the particles (loaded,) as they were loaded, and of those that joined behind them."""
        return self._identity[: self.loaded]

    @identity.setter
    def identity(self, values: np.ndarray) -> None:
        self._identity, self.loaded = values, len(values)

    @property
    def only(self) -> int:
        """The release of all particles, -1 if there are several or none."""
        return next(iter(self.put_releases)) if len(self.put_releases) == 1 else -1

    @property
    def pores(self) -> tuple[Any, Any]:
        """Excess pore pressure at the start, and the part that remains, (loaded,) each; empty in a dry batch."""
        return self.pore_excess, self.pore_left

    def put(self, part: slice, p: Particles, first_release: int, spacing: tuple[float, float, float], dtype: Any) -> None:
        """Bring some particles to their places ``part`` on the device, their releases numbered from ``first_release`` on.

        The records hold no stress yet (time step 0).
        """
        release = p.release + first_release
        self.put_releases |= set(np.unique(release).tolist())
        self.identity[part] = p.identity
        self.release[part].assign(release.astype(np.int16))
        wp.copy(self.memory[: ROWS + 1, part], wp.array(rows_of(p, spacing, dtype), dtype=self.memory.dtype))
        if len(self.pore_left):
            self.pore_left[part].assign(p.pore_left.astype(dtype))
            self.pore_excess[part].assign(p.pore_excess.astype(dtype))
        if p.ground_force.any():  # from which contact starts
            self.forces[part].assign(np.column_stack([np.zeros(len(p)), p.ground_force]).astype(dtype))

    def grow(self, places: int) -> None:
        """Make so many places, and room for forces and pore pressure of the numbers that may come."""
        rec, radius, by_place, n = self.rec, self.radius, (self.release, self.number, self.key), self.n
        self._make_places(places, self.memory.dtype)
        numbers = self.loaded + max(places - n, places // 8)
        self.forces = _longer(self.forces, numbers)
        self.pore_left, self.pore_excess = (_longer(a, numbers * self.wet) for a in (self.pore_left, self.pore_excess))
        self._take_turn(0)
        if not n:
            return
        wp.copy(self.rec[:, :n], rec[:, :n])
        wp.copy(self.radius[:n], radius[:n])
        for mine, former in zip((self.release, self.number, self.key), by_place, strict=True):
            wp.copy(mine, former, count=n)

    def join(self, identity: np.ndarray, releases: set[int]) -> None:
        """Count particles with an ``identity`` (m,) that lie behind the others, in free places and without cells."""
        loaded, many = self.loaded, len(identity)
        if len(self._identity) < loaded + many:
            more = np.empty(many + (loaded + many) // 8, np.int64)  # also for those that come: all are copied seldom
            self._identity = np.concatenate([self.identity, more])
        self._identity[loaded : loaded + many] = identity
        self.n, self.loaded = self.n + many, loaded + many
        self.put_releases |= releases

    def note_joining(self, numbers: np.ndarray) -> bool:
        """Bring the ``numbers`` (5, m) of particles that join behind the others; returns whether the table was made anew."""
        many, before = numbers.shape[1], self.joining.shape[1]
        if many >= before:
            self.make_joining(many)
        table = np.zeros(self.joining.shape, np.int32)
        table[:2, 0], table[:, 1 : many + 1] = (self.n, many), numbers
        self.joining.assign(table)
        self.taken_up = False
        return many >= before

    def make_joining(self, many: int) -> None:
        """A table for so many particles that join, or more; nothing is in it."""
        self.joining = wp.zeros((SCENE + 1, max(1 << many.bit_length(), FEWEST_JOINING)), dtype=wp.int32)

    def forget_joined(self) -> None:
        """Empty the table of joining particles if a sort has taken them up; that sort is done."""
        if self.taken_up:
            self.joining[1, :1].zero_()
            self.taken_up = False

    def _take_turn(self, turn: int) -> None:
        """Name the rows of a turn, and forget those that were named before, of other arrays."""
        self.turn = turn
        self.turns: dict[int, tuple[Any, Any, Any]] = {}
        first = turn * max(self.spare, 1)
        self.rec, self.radius = self.memory[first : first + ROWS], self.memory[first + ROWS if self.spare or not turn else 0]
        self.group = filled(self.struct, self)

    def sort(self, k: SimpleNamespace, index: Index, nodes: NodeArrays) -> None:
        """After the cells have been numbered: list the particles and sort them in memory; those that have gone drop out.

        Only launches: :meth:`turn_over` follows. Nothing moves where the device has halted.
        """
        status, blocks = index.status.group, index.block_group
        index.list_cells(nodes, index.count_blocks())
        self.place(k, index)
        if self.only < 0:
            self._bring_releases(k, index, nodes)
        if self.spare:
            self._sort_rows_together(k, index, nodes)
        else:
            self._sort_rows(k, index, nodes)
        numbers = nodes.scratch(self.size, wp.int32)
        run_blocks(k.renumber, index.shared, WARP, status, self.group, blocks, nodes.contact_group, numbers, index.piece)
        nodes.grid.zero_()

    def place(self, k: SimpleNamespace, index: Index) -> None:
        """List the particles of each cell, once it is known where the cells start; by their numbers where sums are ordered."""
        threads, groups = -(-self.size // (AT_ONCE * WARP)) * WARP, (index.status.group, self.group, index.block_group)
        run(k.place_particles, threads, *groups)
        if index.ordered:
            run(k.sort_cells, index.capacity * CELL_LANES, *groups)

    def _bring_releases(self, k: SimpleNamespace, index: Index, nodes: NodeArrays) -> None:
        """Releases in the order of the list, by way of the memory of the grid."""
        scratch, status, blocks = nodes.scratch(self.size, wp.int16), index.status.group, index.block_group
        run(k.gather_shorts, self.size, status, self.group, blocks, self.release, scratch)
        run(k.bring_back_shorts, self.size, status, blocks, scratch, self.release)

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
        run(k.gather_ints, self.size, status, self.group, blocks, self.number, nodes.scratch(self.size, wp.int32))

    def _sort_rows_together(self, k: SimpleNamespace, index: Index, nodes: NodeArrays) -> None:
        """Rows in the order of the list to those that are free; radius and number go with them."""
        source, target = self.memory[:SPARE], self.memory[SPARE:]
        if self.turn:
            source, target = target, source
        groups = index.status.group, self.group, index.block_group
        run(k.gather_rows, self.size, *groups, source, target, nodes.scratch(self.size, wp.int32))

    def turn_over(self) -> None:
        """The rows lie in the other places now: after a sort, or again if it moved nothing. Each turn is named once."""
        turns = self.turns | {self.turn: (self.rec, self.radius, self.group)}
        turn = 1 - self.turn
        if turn in turns:
            self.turn, (self.rec, self.radius, self.group) = turn, turns[turn]
        else:
            self._take_turn(turn)
        self.turns = turns

    def brought(self, where: Any, node: Any, affine: Any, steps: int) -> Particles:
        """Particles at the places ``where`` (n,) in memory after so many steps, without identity."""
        rec = np.stack([self.rec[row][where].numpy() for row in range(ROWS)]).astype(np.float64)
        m = rec[MASS]
        forces = self.forces[self.number[where].contiguous()].numpy().astype(np.float64)
        touched, number = forces[:, :1] == steps & STAMPS, self.number[where].numpy()
        excess, left = (a.numpy()[number].astype(np.float64) if len(a) else np.zeros(len(m)) for a in self.pores)
        return Particles(
            node.numpy(), rec[OFFSET : OFFSET + 3].T, (rec[MOMENTUM : MOMENTUM + 3] / m).T, affine.numpy().reshape(-1, 3, 3),
            rec[STRAIN : STRAIN + 6].T, rec[HISTORY], m, rec[VOLUME], self.radius[where].numpy().astype(np.float64),
            np.where(touched, forces[:, 1:], 0.0), excess, left, self.release[where].numpy().astype(np.int32),
            np.zeros(len(m), np.int64),
        )  # fmt: skip


def _longer(array: Any, size: int) -> Any:
    """An array with as many zeros behind the values of another as to have a size."""
    longer = wp.zeros(size, dtype=array.dtype)
    if len(array):
        wp.copy(longer, array, count=len(array))
    return longer


def rows_of(p: Particles, spacing: tuple[float, float, float], dtype: Any) -> np.ndarray:
    """Records and radius (25, n) of particles, without stress."""
    rows = np.zeros((ROWS + 1, len(p)), dtype)
    for place in range(ROWS + 1):
        rows[place] = _values(p, spacing, place)
    return rows


def _values(p: Particles, spacing: tuple[float, float, float], place: int) -> np.ndarray:
    """What lies at a place of the memory in turn 0."""
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
