"""Arrays that belong to the blocks of one index, made when the index is; a step writes into them and makes none.

The groups of arrays are those of :mod:`runout.backends.scan.groups`.

    arenas, contacts, ground, moves    by owner block
    grid                               by node block
    columns                            by node block and block column, as far as the law of friction uses columns of nodes
    layers                             by node block and block column, where a mass has pore pressure
    sums[b], total                     sums over the particles of block b, and over all blocks
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from runout.backends.scan.domain import blocks_at_edge
from runout.backends.scan.groups import Arenas, Blocks, Contacts, Domain, Grid, Ground, Moves
from runout.backends.scan.node_columns import NodeColumns, node_columns_of
from runout.backends.scan.particles_to_grid import SHARES
from runout.backends.scan.pore_pressure import NOTED, Layers, diffuses, layers_of
from runout.backends.scan.schedule import Schedule
from runout.backends.scan.state import PADDING, _zeros, bytes_of
from runout.backends.scan.stencil import ARENA
from runout.model.scene import Scene

SUMS = 7  # mass, momentum, kinetic, potential and elastic energy


@dataclass
class Workspace:
    """Arrays by block, and the order in which threads go through the blocks."""

    schedule: Schedule
    # arenas, grid, contacts, ground, moves: see :mod:`runout.backends.scan.groups`
    arenas: Arenas
    grid: Grid
    contacts: Contacts
    ground: Ground
    moves: Moves
    # sums, total (nown, 7), (7,): what :mod:`runout.backends.scan.observe` adds up, by block and in all
    sums: np.ndarray
    total: np.ndarray
    columns: NodeColumns | tuple[()]
    layers: Layers | tuple[()]

    @classmethod
    def of(cls, blocks: Blocks, schedule: Schedule, scene: Scene, domain: Domain, former: Contacts | None = None) -> "Workspace":
        """Arrays for the blocks of an index.

        Parameters
        ----------
        blocks, schedule, scene, domain
        former : Contacts, optional
            Those of the index before, whose sizes are kept: with less memory the next step would run twice.
        """
        n, real = blocks.nown, scene.dtype
        threads, capacity = len(schedule.cuts) - 1, _roomy(schedule.most_arenas(blocks.held))
        count, byte, number = (partial(np.zeros, n, kind) for kind in (np.int64, np.uint8, np.int32))
        return cls(
            schedule=schedule,
            arenas=Arenas(
                _zeros(threads * capacity + 1, ARENA, real), np.zeros((threads, capacity), np.int32),
                np.zeros((threads, 8), np.int64), number(), number(), byte(),
            ),
            grid=Grid(
                _zeros(blocks.nall, 256, real), np.zeros(blocks.nall, np.bool_), _zeros(blocks.nall, 64, real),
                _zeros(blocks.nall if scene.is_wet and diffuses(scene.pore_table()) else 0, 64, real),
            ),
            contacts=Contacts(
                *(former[:5] if former else _rows_of_contacts(0, real, scene.is_wet)),
                np.zeros((len(former.shares) if former else 0, SHARES), real), count(), count(), count(), number(), byte(),
                np.zeros((n, 4)),
            ),
            ground=Ground(np.empty((n, 36), real), np.empty((n, 48), real), np.empty((n, 2), real)),
            moves=Moves(count(), count(), count(), count(), count(), blocks_at_edge(domain, blocks.bxyz[:n]), np.zeros((n, 4))),
            sums=np.zeros((n, SUMS)), total=np.zeros(SUMS), columns=node_columns_of(blocks, scene),
            layers=layers_of(blocks, scene),
        )  # fmt: skip

    def make_arenas(self, wanted: int) -> None:
        """More arenas for each thread."""
        threads, capacity = len(self.arenas.free), _roomy(wanted)
        values = _zeros(threads * capacity + 1, ARENA, self.arenas.values.dtype)
        self.arenas = self.arenas._replace(values=values, free=np.zeros((threads, capacity), np.int32))

    def make_rows(self, wanted: int) -> None:
        """So many rows of contacts; the old ones are forgotten."""
        made = _rows_of_contacts(wanted, self.contacts.rows.dtype, bool(self.layers))
        self.contacts = self.contacts._replace(**dict(zip(Contacts._fields, made, strict=False)))

    def make_shares(self, wanted: int) -> None:
        """Shares of so many blocks, and empty ones."""
        self.contacts = self.contacts._replace(shares=np.zeros((wanted + 1, SHARES), self.contacts.shares.dtype))

    def memory(self, blocks: Blocks) -> dict[str, int]:
        """Bytes by array, with those of the index."""
        parts: list[Any] = [self.arenas, self.grid, self.contacts, self.ground, self.moves]
        parts += [part for part in (self.columns, self.layers) if part]
        rest = {"sums": self.sums, "total": self.total, **vars(self.schedule)}
        return bytes_of(blocks, *parts, **rest)


def _rows_of_contacts(rows: int, dtype: Any, wet: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    n = (rows + PADDING) & ~15
    measured, drained = _zeros(n // 16, 128, dtype).reshape(-1, 8, 16), _zeros(wet * n // 16, 16 * NOTED, dtype)
    drained = drained.reshape(-1, NOTED, 16)
    return _zeros(n, 4, dtype), measured, _zeros(n, 4, dtype), _zeros(n, 4, dtype), drained


def _roomy(count: int) -> int:
    return count + count // 8 + 8


def _total_held(held, nown):
    """Number of particles, and of those in the fullest block."""
    n = 0
    most = 0
    for b in range(nown):
        n += held[b]
        most = max(most, held[b])
    return n, most


def total_held(blocks):
    """The same, of an index."""
    return _total_held(blocks.held, blocks.nown)


def total_rows(rows, chosen, nown, total):
    """Sums of the rows of the blocks whose number ``chosen`` is not 0."""
    for k in range(rows.shape[1]):
        total[k] = 0.0
    for b in range(nown):
        if chosen[b] > 0:
            for k in range(rows.shape[1]):
                total[k] += rows[b, k]


def total_escaped(listed, leaving, blocks, outside):
    """Number of particles that leave the domain in this step."""
    n = 0
    for b in range(blocks.nown):
        for t in range(leaving[b]):
            n += (listed[blocks.first[b] + t] >> 6) & outside > 0
    return n
