"""Sparse index in two levels: superblocks of 8 x 8 x 8 blocks in a box, marks and a prefix scan over the blocks in those in use.

An *owner* block may hold particles; a *node* block holds nodes that particles of owners reach. Owners come first. Only the
table of superblocks grows with the extent of the scene: 4 bytes for 32 x 32 x 32 cells.
"""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numba import prange

from runout.errors import CapacityError, ConfigError
from runout.physics.blocks import block_of

OWNER = 1
NODES = 2
PAGE = 512  # blocks of a superblock
LARGEST_TABLE = 2**24  # superblocks: 64 MB
UP = np.array([(q >> 2, (q >> 1) & 1, q & 1) for q in range(8)])  # steps to the blocks of Index.up
IN_PLANE, IN_ROWS, IN_COLUMNS = 0o777, 0o007007007, 0o111111111  # bits of the neighbours below the middle along x, y and z
AROUND = np.array([(q // 9 - 1, (q // 3) % 3 - 1, q % 3 - 1) for q in range(27)])


@dataclass
class Index:
    """Blocks, their neighbours and the slots of their particles.

    Attributes
    ----------
    nown, nall : int
        Owner blocks; all node blocks, owners first.
    bxyz : (nall, 3) int32
        Coordinates of the blocks.
    up : (nown, 8) int32
        Node blocks at the block itself and one step up in each axis.
    down : (nall, 8) int32
        Owners at the block itself and one step down, -1 where there is none.
    around : (nown, 27) int32
        Owners among the neighbours, -1 where there is none.
    starts : (nown, 65) int32
        First particle of each cell in the order of the block.
    held, first, capacity : (nown,) int64
        Particles; first slot; slots.
    travelled : float
        Largest distance [cells] that a particle may have moved since the index was made.
    """

    nown: int
    nall: int
    bxyz: np.ndarray
    up: np.ndarray
    down: np.ndarray
    around: np.ndarray
    starts: np.ndarray
    held: np.ndarray
    first: np.ndarray
    capacity: np.ndarray
    travelled: float = 0.0

    @classmethod
    def room_for(cls, nown: int, nall: int) -> "Index":
        """An index without content."""
        bxyz, up, down, around = (np.empty((n, w), np.int32) for n, w in ((nall, 3), (nown, 8), (nall, 8), (nown, 27)))
        held, first, capacity = (np.zeros(nown, np.int64) for _ in range(3))
        return cls(nown, nall, bxyz, up, down, around, np.zeros((nown, 65), np.int32), held, first, capacity)

    @classmethod
    def of_nodes(cls, node: np.ndarray) -> "tuple[np.ndarray, Index]":
        """Order of particles with first nodes (n, 3) by block and cell, and the occupied blocks, not linked yet."""
        block = node >> 2
        cell = ((node & 3) << np.array([4, 2, 0])).sum(1)
        order = np.lexsort((cell, block[:, 2], block[:, 1], block[:, 0]))
        if not len(node):
            return order, cls.room_for(0, 0)
        bxyz, which = np.unique(block[order], axis=0, return_inverse=True)
        index = cls.room_for(len(bxyz), len(bxyz))
        index.bxyz[:] = bxyz
        count = np.bincount(which.ravel() * 64 + cell[order], minlength=64 * len(bxyz)).reshape(-1, 64)
        np.cumsum(count, axis=1, out=index.starts[:, 1:])
        index.held[:] = index.starts[:, 64]
        index.first[:] = np.cumsum(index.held) - index.held
        return order, index

    def rebuilt(self, k: SimpleNamespace, margin: int, dense: bool = False) -> "tuple[Index, np.ndarray]":
        """Index of the blocks that hold particles now or will after ``margin`` cells of motion, and new numbers of the old.

        ``dense`` takes every block in the box around them. The particles have no slots yet.
        """
        occupied = np.flatnonzero(self.held)
        if not len(occupied):
            return Index.room_for(0, 0), np.zeros(self.nown, np.int32)
        low, high = self.bxyz[occupied].min(0).astype(np.int64) - 1, self.bxyz[occupied].max(0).astype(np.int64) + 1
        corner = low >> 3
        table = _table(((high + 1) >> 3) - corner + 1)
        k.mark_superblocks(self.bxyz, self.held, self.nown, corner, table, dense)
        used = np.flatnonzero(table)
        table[...] = -1
        table.ravel()[used] = np.arange(len(used), dtype=np.int32)
        places = np.stack(np.unravel_index(used, table.shape), axis=1) + corner
        mask, slot = np.zeros((len(used), PAGE), np.uint8), np.empty((len(used), PAGE), np.int32)
        if dense:
            k.mark_box(low, high, places, mask)
        else:
            k.mark_owners(self.bxyz, self.starts, self.nown, corner, table, margin, mask)
        k.mark_nodes(places, corner, table, mask)
        counts = np.stack([np.count_nonzero(mask == kind, axis=1) for kind in (OWNER, NODES)], axis=1)
        before = np.cumsum(counts, axis=0) - counts
        new = Index.room_for(int(counts[:, 0].sum()), int(counts.sum()))
        k.number_blocks(places, mask, before, new.nown, slot, new.bxyz)
        numbers = np.zeros(self.nown, np.int32)
        k.find_numbers(self.bxyz, self.held, self.nown, corner, table, slot, numbers)
        k.link_blocks(corner, table, slot, new.bxyz, new.nown, new.nall, new.up, new.down, new.around)
        return new, numbers

    def join_ends(self, period: tuple[int, int, int]) -> None:
        """Link the blocks at either end of a period to each other, for verification; their images beyond it stay empty.

        ``period`` [cells], 0 along an axis that does not repeat. The index holds every block of the box around the particles.

        Raises
        ------
        ConfigError
            If a period is no multiple of a block, or shorter than the mass.
        """
        blocks = np.array(period) // 4
        if (4 * blocks != period).any():
            raise ConfigError(f"period is {period}; it must be a multiple of 4 cells along each axis")
        xyz, nown, repeats = self.bxyz.astype(np.int64), self.nown, blocks > 0
        inside = np.asarray(((xyz >= 0) & (xyz < blocks) | ~repeats).all(axis=1))
        if (self.held[~inside[:nown]] > 0).any():
            raise ConfigError(f"the particles reach beyond the period of {period} cells")
        low = xyz.min(axis=0) - 1
        table = np.full(xyz.max(axis=0) + 2 - low, -1, np.int32)
        table[tuple((xyz - low).T)] = np.arange(self.nall)
        for links, steps in ((self.up, UP), (self.down, -UP), (self.around, AROUND)):
            here = np.flatnonzero(inside[: len(links)])
            target = xyz[here, None, :] + steps
            target[..., repeats] %= blocks[repeats]
            links[here] = table[tuple(np.moveaxis(target - low, -1, 0))]
        for links in (self.down, self.around):
            links[links >= nown] = -1
            links[~inside[: len(links)]] = -1  # an image gives and takes nothing


def _table(shape: np.ndarray) -> np.ndarray:
    if np.prod(shape.astype(float)) > LARGEST_TABLE:
        size = " x ".join(str(32 * n) for n in shape)
        raise CapacityError(
            f"the flow spans {size} cells; at most {32**3 * LARGEST_TABLE:.2g} cells fit into the box around it, use larger cells"
        )
    return np.zeros(shape, np.int32)


def mark_superblocks(bxyz, held, nown, corner, table, dense):
    """Mark the superblocks of all blocks with particles and of their neighbours up to two blocks on."""
    for b in range(nown):
        if held[b] == 0:
            continue
        for i in range(((bxyz[b, 0] - 1) >> 3) - corner[0], ((bxyz[b, 0] + 2) >> 3) - corner[0] + 1):
            for j in range(((bxyz[b, 1] - 1) >> 3) - corner[1], ((bxyz[b, 1] + 2) >> 3) - corner[1] + 1):
                for k in range(((bxyz[b, 2] - 1) >> 3) - corner[2], ((bxyz[b, 2] + 2) >> 3) - corner[2] + 1):
                    table[i, j, k] = 1
    if dense:
        for i in range(table.shape[0]):
            for j in range(table.shape[1]):
                for k in range(table.shape[2]):
                    table[i, j, k] = 1


def _place(i, j, k):
    """Place of a block in its superblock."""
    return ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)


def _page_of(corner, table, i, j, k):
    """Number of the superblock of a block, -1 if it is not in use."""
    x = (i >> 3) - corner[0]
    y = (j >> 3) - corner[1]
    z = (k >> 3) - corner[2]
    if x < 0 or y < 0 or z < 0 or x >= table.shape[0] or y >= table.shape[1] or z >= table.shape[2]:
        return np.int32(-1)
    return table[x, y, z]


def _at(values, corner, table, i, j, k, nothing):
    """Value at a block, ``nothing`` outside the superblocks in use."""
    page = _page_of(corner, table, i, j, k)
    return values[page, _place(i, j, k)] if page >= 0 else nothing


def _entered(cell, margin, neighbours, distance):
    """Bits of the neighbours that a particle may enter along an axis from one of four cells; a step is a ``distance`` of bits."""
    entered = 0
    for step in range(block_of(cell - margin), block_of(cell + margin) + 1):
        entered |= neighbours << (distance * (step + 1))
    return entered


def mark_owners(bxyz, starts, nown, corner, table, margin, mask):
    """Mark every block that a particle may enter while it moves up to ``margin`` cells, at most 4."""
    for b in prange(nown):
        entered = 0
        for i in range(4):
            x = _entered(i, margin, IN_PLANE, 9)
            for j in range(4):
                xy = x & _entered(j, margin, IN_ROWS, 3)
                for k in range(4):
                    c = (i << 4) | (j << 2) | k
                    if starts[b, c] != starts[b, c + 1]:
                        entered |= xy & _entered(k, margin, IN_COLUMNS, 1)
        for q in range(27):
            if (entered >> q) & 1:
                i = bxyz[b, 0] + q // 9 - 1
                j = bxyz[b, 1] + (q // 3) % 3 - 1
                k = bxyz[b, 2] + q % 3 - 1
                mask[_page_of(corner, table, i, j, k), _place(i, j, k)] = OWNER


def mark_box(low, high, places, mask):
    """Mark every block of a box."""
    for s in prange(len(places)):
        for p in range(PAGE):
            i = places[s, 0] * 8 + (p >> 6)
            j = places[s, 1] * 8 + ((p >> 3) & 7)
            k = places[s, 2] * 8 + (p & 7)
            inside = i >= low[0] and j >= low[1] and k >= low[2] and i <= high[0] and j <= high[1] and k <= high[2]
            mask[s, p] = OWNER if inside else 0


def _beside_owner(corner, table, mask, i, j, k):
    """Whether an owner lies one step down in some axes."""
    for q in range(1, 8):
        if _at(mask, corner, table, i - (q >> 2), j - ((q >> 1) & 1), k - (q & 1), np.uint8(0)) == OWNER:
            return True
    return False


def mark_nodes(places, corner, table, mask):
    """Mark the blocks that hold further nodes of an owner: one step up in each axis."""
    for s in prange(len(places)):
        for p in range(PAGE):
            i = places[s, 0] * 8 + (p >> 6)
            j = places[s, 1] * 8 + ((p >> 3) & 7)
            k = places[s, 2] * 8 + (p & 7)
            if mask[s, p] == 0 and _beside_owner(corner, table, mask, i, j, k):
                mask[s, p] = NODES


def number_blocks(places, mask, before, nown, slot, bxyz):
    """Number the marked blocks from the sums ``before`` each superblock and note their coordinates; -1 elsewhere."""
    for s in prange(len(places)):
        owner = before[s, 0]
        other = nown + before[s, 1]
        for p in range(PAGE):
            number = -1
            if mask[s, p] == OWNER:
                number = owner
                owner += 1
            elif mask[s, p] == NODES:
                number = other
                other += 1
            slot[s, p] = number
            if number >= 0:
                bxyz[number, 0] = places[s, 0] * 8 + (p >> 6)
                bxyz[number, 1] = places[s, 1] * 8 + ((p >> 3) & 7)
                bxyz[number, 2] = places[s, 2] * 8 + (p & 7)


def _number(corner, table, slot, i, j, k):
    return _at(slot, corner, table, i, j, k, np.int32(-1))


def link_blocks(corner, table, slot, bxyz, nown, nall, up, down, around):
    """Neighbours by number: ``up`` (nown, 8) node blocks, ``down`` (nall, 8) and ``around`` (nown, 27) owners or -1."""
    for b in prange(nall):
        i = bxyz[b, 0]
        j = bxyz[b, 1]
        k = bxyz[b, 2]
        for q in range(8):
            s = _number(corner, table, slot, i - (q >> 2), j - ((q >> 1) & 1), k - (q & 1))
            down[b, q] = s if s < nown else -1
            if b < nown:
                up[b, q] = _number(corner, table, slot, i + (q >> 2), j + ((q >> 1) & 1), k + (q & 1))
        if b < nown:
            for q in range(27):
                s = _number(corner, table, slot, i + q // 9 - 1, j + (q // 3) % 3 - 1, k + q % 3 - 1)
                around[b, q] = s if s < nown else -1


def find_numbers(bxyz, held, nown, corner, table, slot, numbers):
    """New numbers of the old blocks that hold particles."""
    for b in prange(nown):
        if held[b] > 0:
            numbers[b] = _number(corner, table, slot, bxyz[b, 0], bxyz[b, 1], bxyz[b, 2])
