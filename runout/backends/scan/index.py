"""Phase "index": finds the blocks near particles, numbers them and links them to their neighbours.

An *owner* block may hold particles; a *node* block holds nodes that particles of owners reach. Owners are node blocks too.

    table[i, j, k]    box of superblocks around the flow; -1, or the number s of a superblock in use    4 bytes a superblock
    mask[s, p]        the 8 x 8 x 8 blocks of superblock s, z fastest: 0, OWNER or NODES                 1 byte a block
    number[s, p]      number b of the block, -1 where it is not in use                                   4 bytes a block

    blocks    | 0 ... owners ... nown - 1 | nown ... other node blocks ... nall - 1 |    in each part by superblock, then by place
    arrays of blocks: bxyz[b], up[b, 8], down[b, 8], around[b, 27], starts[b, 65], held[b], first[b], capacity[b]

Marks and a prefix scan over the superblocks in use give the numbers. Only ``table`` grows with the extent of the scene.
"""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numba import prange

from runout.backends.scan.groups import Blocks
from runout.errors import CapacityError, ConfigError
from runout.model.particles import node_range
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
    """The blocks in use, and how far particles have moved since they were found."""

    blocks: Blocks  # see :class:`runout.backends.scan.groups.Blocks`
    travelled: float = 0.0  # largest distance [cells] that a particle may have moved since the index was made

    @classmethod
    def of_size(cls, nown: int, nall: int) -> "Index":
        """An index without content."""
        bxyz, up, down, around = (np.empty((n, w), np.int32) for n, w in ((nall, 3), (nown, 8), (nall, 8), (nown, 27)))
        held, first, capacity = (np.zeros(nown, np.int64) for _ in range(3))
        return cls(Blocks(nown, nall, bxyz, up, down, around, np.zeros((nown, 65), np.int32), held, first, capacity))

    @classmethod
    def of_nodes(cls, node: np.ndarray) -> "tuple[np.ndarray, Index]":
        """Rank (n,) int32 of particles with first nodes (n, 3) by block and cell, and the occupied blocks, not linked yet.

        Raises CapacityError if the box around them is too large.
        """
        rank = np.zeros(len(node), np.int32)
        if not len(node):
            return rank, cls.of_size(0, 0)
        low, high = (end >> 2 for end in node_range(node))
        require_box(low, high)
        shape = high - low + 1
        keys = _keys(node, low, shape)
        order = np.argsort(keys, kind="stable")
        rank[order] = np.arange(len(node), dtype=np.int32)
        keys = keys[order]
        del order
        begins = np.flatnonzero(np.diff(keys, prepend=-1))  # of each occupied cell
        cells, count = keys[begins], np.diff(begins, append=len(node))
        used, which = np.unique(cells >> 6, return_inverse=True)
        index = cls.of_size(len(used), len(used))
        b = index.blocks
        b.bxyz[:] = np.stack(np.unravel_index(used, shape), axis=1) + low
        b.starts[which, (cells & 63) + 1] = count
        np.cumsum(b.starts, axis=1, out=b.starts)
        b.held[:] = b.starts[:, 64]
        b.first[:] = np.cumsum(b.held) - b.held
        return rank, index

    def rebuilt(self, k: SimpleNamespace, margin: int, dense: bool = False) -> "tuple[Index, np.ndarray]":
        """Index of the blocks that hold particles now or will after ``margin`` cells of motion, and new numbers of the old.

        ``dense`` takes every block in the box around them. The particles have no slots yet.
        """
        old = self.blocks
        occupied = np.flatnonzero(old.held)
        if not len(occupied):
            return Index.of_size(0, 0), np.zeros(old.nown, np.int32)
        low, high = old.bxyz[occupied].min(0).astype(np.int64) - 1, old.bxyz[occupied].max(0).astype(np.int64) + 1
        corner = low >> 3
        table = _table(((high + 1) >> 3) - corner + 1)
        k.mark_superblocks(old, corner, table, dense)
        used = np.flatnonzero(table)
        table[...] = -1
        table.ravel()[used] = np.arange(len(used), dtype=np.int32)
        places = np.stack(np.unravel_index(used, table.shape), axis=1) + corner
        mask, number = np.zeros((len(used), PAGE), np.uint8), np.empty((len(used), PAGE), np.int32)
        if dense:
            k.mark_box(low, high, places, mask)
        else:
            k.mark_owners(old, corner, table, margin, mask)
        k.mark_nodes(places, corner, table, mask)
        counts = np.stack([np.count_nonzero(mask == kind, axis=1) for kind in (OWNER, NODES)], axis=1)
        before = np.cumsum(counts, axis=0) - counts
        new = Index.of_size(int(counts[:, 0].sum()), int(counts.sum()))
        k.number_blocks(places, mask, before, number, new.blocks)
        numbers = np.zeros(old.nown, np.int32)
        k.find_numbers(old, corner, table, number, numbers)
        k.link_blocks(corner, table, number, new.blocks)
        return new, numbers

    def join_ends(self, period: tuple[int, int, int]) -> None:
        """Link the blocks at either end of a period to each other, for verification; their images beyond it stay empty.

        ``period`` [cells], 0 along an axis that does not repeat. The index holds every block of the box around the particles.

        Raises ConfigError if a period is no multiple of a block, or shorter than the mass.
        """
        b, blocks = self.blocks, np.array(period) // 4
        if (4 * blocks != period).any():
            raise ConfigError(f"period is {period}; it must be a multiple of 4 cells along each axis")
        xyz, nown, repeats = b.bxyz.astype(np.int64), b.nown, blocks > 0
        if not len(xyz):
            return
        inside = np.asarray(((xyz >= 0) & (xyz < blocks) | ~repeats).all(axis=1))
        if (b.held[~inside[:nown]] > 0).any():
            raise ConfigError(f"the particles reach beyond the period of {period} cells")
        low = xyz.min(axis=0) - 1
        table = np.full(xyz.max(axis=0) + 2 - low, -1, np.int32)
        table[tuple((xyz - low).T)] = np.arange(b.nall)
        for links, steps in ((b.up, UP), (b.down, -UP), (b.around, AROUND)):
            here = np.flatnonzero(inside[: len(links)])
            target = xyz[here, None, :] + steps
            target[..., repeats] %= blocks[repeats]
            links[here] = table[tuple(np.moveaxis(target - low, -1, 0))]
        for links in (b.down, b.around):
            links[links >= nown] = -1
            links[~inside[: len(links)]] = -1  # an image gives and takes nothing


def _keys(node: np.ndarray, low: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Keys (n,) of cells in the order of blocks, counted from ``low`` (3,) in a box of so many, and of the cells of a block."""
    block, cell = np.zeros(len(node), np.int64), np.zeros(len(node), np.int64)
    for axis in range(3):
        block *= shape[axis]
        block += (node[:, axis] >> 2) - low[axis]
        cell <<= 2
        cell += node[:, axis] & 3
    block <<= 6
    block += cell
    return block


def require_held(held: np.ndarray, most: int) -> None:
    """Raise CapacityError if a block holds more particles than ``most``."""
    if held.max(initial=0) > most:
        raise CapacityError(f"a block of 64 cells holds {held.max()} particles, at most {most} fit; use smaller cells")


def require_box(low: np.ndarray, high: np.ndarray) -> None:
    """Raise CapacityError if the box from the block ``low`` (3,) to ``high`` is too large."""
    _require_table(((high + 1) >> 3) - ((low - 1) >> 3) + 1)


def _require_table(shape: np.ndarray) -> None:
    """Raise CapacityError for a box of too many superblocks."""
    if np.prod(shape.astype(float)) > LARGEST_TABLE:
        size = " x ".join(str(32 * n) for n in shape)
        raise CapacityError(
            f"the flow spans {size} cells; at most {32**3 * LARGEST_TABLE:.2g} cells fit into the box around it, use larger cells"
        )


def _table(shape: np.ndarray) -> np.ndarray:
    _require_table(shape)
    return np.zeros(shape, np.int32)


def mark_superblocks(blocks, corner, table, dense):
    """Mark the superblocks of all blocks with particles and of their neighbours up to two blocks on."""
    bxyz, held = blocks.bxyz, blocks.held
    for b in range(blocks.nown):
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


def mark_owners(blocks, corner, table, margin, mask):
    """Mark every block that a particle may enter while it moves up to ``margin`` cells, at most 4."""
    bxyz, starts = blocks.bxyz, blocks.starts
    for b in prange(blocks.nown):
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


def _block_of_place(places, s, p):
    """Coordinates of place ``p`` of superblock ``s``."""
    return places[s, 0] * 8 + (p >> 6), places[s, 1] * 8 + ((p >> 3) & 7), places[s, 2] * 8 + (p & 7)


def mark_box(low, high, places, mask):
    """Mark every block of a box."""
    for s in prange(len(places)):
        for p in range(PAGE):
            i, j, k = _block_of_place(places, s, p)
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
            i, j, k = _block_of_place(places, s, p)
            if mask[s, p] == 0 and _beside_owner(corner, table, mask, i, j, k):
                mask[s, p] = NODES


def number_blocks(places, mask, before, number, blocks):
    """Number the marked blocks from the sums ``before`` each superblock and note their coordinates; -1 elsewhere."""
    bxyz = blocks.bxyz
    for s in prange(len(places)):
        owner = before[s, 0]
        other = blocks.nown + before[s, 1]
        for p in range(PAGE):
            b = -1
            if mask[s, p] == OWNER:
                b = owner
                owner += 1
            elif mask[s, p] == NODES:
                b = other
                other += 1
            number[s, p] = b
            if b >= 0:
                bxyz[b, 0], bxyz[b, 1], bxyz[b, 2] = _block_of_place(places, s, p)


def _number(corner, table, number, i, j, k):
    return _at(number, corner, table, i, j, k, np.int32(-1))


def link_blocks(corner, table, number, blocks):
    """Set the neighbours of all blocks by number: ``up``, ``down`` and ``around``."""
    nown, bxyz = blocks.nown, blocks.bxyz
    up = blocks.up
    down = blocks.down
    around = blocks.around
    for b in prange(blocks.nall):
        i = bxyz[b, 0]
        j = bxyz[b, 1]
        k = bxyz[b, 2]
        for q in range(8):
            s = _number(corner, table, number, i - (q >> 2), j - ((q >> 1) & 1), k - (q & 1))
            down[b, q] = s if s < nown else -1
            if b < nown:
                up[b, q] = _number(corner, table, number, i + (q >> 2), j + ((q >> 1) & 1), k + (q & 1))
        if b < nown:
            for q in range(27):
                s = _number(corner, table, number, i + q // 9 - 1, j + (q // 3) % 3 - 1, k + q % 3 - 1)
                around[b, q] = s if s < nown else -1


def find_numbers(old, corner, table, number, numbers):
    """New numbers of the old blocks that hold particles."""
    bxyz, held = old.bxyz, old.held
    for b in prange(old.nown):
        if held[b] > 0:
            numbers[b] = _number(corner, table, number, bxyz[b, 0], bxyz[b, 1], bxyz[b, 2])
