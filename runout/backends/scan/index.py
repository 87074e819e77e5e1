"""Sparse index: marks over the box of blocks, exclusive prefix scan, compact blocks and their neighbours.

An *owner* block may hold particles; a *node* block holds nodes that particles of owners reach. Owners come first, both in
lexicographic order of their coordinates, so that the order of the particles survives a rebuild.
"""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numba import prange

from runout.errors import CapacityError
from runout.physics.blocks import block_of

OWNER = 1
NODES = 2
LARGEST_BOX = 2**28  # blocks of the mask


@dataclass
class Index:
    """Blocks and their neighbours.

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
    cstart : (64 nown + 1,) int64
        First particle of each cell.
    travelled : float
        Largest distance [cells] that a particle may have moved since the index was made.
    """

    nown: int
    nall: int
    bxyz: np.ndarray
    up: np.ndarray
    down: np.ndarray
    around: np.ndarray
    cstart: np.ndarray
    travelled: float = 0.0

    @classmethod
    def room(cls, nown: int, nall: int) -> "Index":
        """An index without content."""
        bxyz, up, down, around = (np.empty((n, w), np.int32) for n, w in ((nall, 3), (nown, 8), (nall, 8), (nown, 27)))
        return cls(nown, nall, bxyz, up, down, around, np.zeros(nown * 64 + 1, np.int64))

    @classmethod
    def of_nodes(cls, node: np.ndarray) -> "tuple[np.ndarray, Index]":
        """Order of particles with first nodes (n, 3) by block and cell, and the occupied blocks, not linked yet."""
        block = node >> 2
        cell = ((node & 3) << np.array([4, 2, 0])).sum(1)
        order = np.lexsort((cell, block[:, 2], block[:, 1], block[:, 0]))
        if not len(node):
            return order, cls.room(0, 0)
        bxyz, which = np.unique(block[order], axis=0, return_inverse=True)
        index = cls.room(len(bxyz), len(bxyz))
        index.bxyz[:] = bxyz
        count = np.bincount(which.ravel() * 64 + cell[order], minlength=64 * len(bxyz))
        np.cumsum(count, out=index.cstart[1:])
        return order, index

    def rebuilt(self, k: SimpleNamespace, margin: int) -> "Index":
        """The index of the blocks that hold particles now, or will after ``margin`` cells of motion."""
        held = np.flatnonzero(np.diff(self.cstart[::64]))
        if not len(held):
            return Index.room(0, 0)
        low = self.bxyz[held].min(0).astype(np.int64) - 2
        shape = self.bxyz[held].max(0) + 4 - low
        if np.prod(shape.astype(float)) > LARGEST_BOX:
            size = " x ".join(map(str, shape))
            raise CapacityError(f"the flow spans {size} blocks of 4 x 4 x 4 cells; at most {LARGEST_BOX} fit, use larger cells")
        mask, slot = np.zeros(shape, np.uint8), np.empty(shape, np.int32)
        k.mark_owners(self.bxyz, self.cstart, self.nown, low, margin, mask)
        k.mark_nodes(mask)
        counts = np.zeros((shape[0], 2), np.int64)
        k.count_slabs(mask, counts)
        starts = np.cumsum(counts, axis=0) - counts
        new = Index.room(int(counts[:, 0].sum()), int(counts.sum()))
        k.number_blocks(mask, starts, new.nown, low, slot, new.bxyz)
        k.link_blocks(slot, low, new.bxyz, new.nown, new.nall, new.up, new.down, new.around)
        count = np.empty(new.nown * 64, np.int64)
        k.move_starts(self.bxyz, self.cstart, self.nown, slot, low, count)
        k.sum_starts(count, new.nown * 64, new.cstart)
        return new


def mark_owners(bxyz, cstart, nown, low, margin, mask):
    """Mark every block that a particle may enter while it moves up to ``margin`` cells."""
    for b in prange(nown):
        for c in range(64):
            if cstart[b * 64 + c] == cstart[b * 64 + c + 1]:
                continue
            x = bxyz[b, 0] * 4 + (c >> 4)
            y = bxyz[b, 1] * 4 + ((c >> 2) & 3)
            z = bxyz[b, 2] * 4 + (c & 3)
            for i in range(block_of(x - margin), block_of(x + margin) + 1):
                for j in range(block_of(y - margin), block_of(y + margin) + 1):
                    for k in range(block_of(z - margin), block_of(z + margin) + 1):
                        mask[i - low[0], j - low[1], k - low[2]] = OWNER


def mark_nodes(mask):
    """Mark the blocks that hold further nodes of an owner: one step up in each axis."""
    nx, ny, nz = mask.shape
    for i in prange(nx):
        for j in range(ny):
            for k in range(nz):
                if mask[i, j, k] != 0:
                    continue
                for q in range(1, 8):
                    a = i - (q >> 2)
                    b = j - ((q >> 1) & 1)
                    c = k - (q & 1)
                    if a >= 0 and b >= 0 and c >= 0 and mask[a, b, c] == OWNER:
                        mask[i, j, k] = NODES
                        break


def count_slabs(mask, counts):
    """Owners and other node blocks in each slab of the box."""
    nx, ny, nz = mask.shape
    for i in prange(nx):
        owners = 0
        others = 0
        for j in range(ny):
            for k in range(nz):
                owners += mask[i, j, k] == OWNER
                others += mask[i, j, k] == NODES
        counts[i, 0] = owners
        counts[i, 1] = others


def number_blocks(mask, starts, nown, low, slot, bxyz):
    """Exclusive scan: number the marked blocks and note their coordinates; -1 elsewhere."""
    nx, ny, nz = mask.shape
    for i in prange(nx):
        owner = starts[i, 0]
        other = nown + starts[i, 1]
        for j in range(ny):
            for k in range(nz):
                s = -1
                if mask[i, j, k] == OWNER:
                    s = owner
                    owner += 1
                elif mask[i, j, k] == NODES:
                    s = other
                    other += 1
                slot[i, j, k] = s
                if s >= 0:
                    bxyz[s, 0] = i + low[0]
                    bxyz[s, 1] = j + low[1]
                    bxyz[s, 2] = k + low[2]


def _slot_at(slot, i, j, k):
    if i < 0 or j < 0 or k < 0 or i >= slot.shape[0] or j >= slot.shape[1] or k >= slot.shape[2]:
        return -1
    return slot[i, j, k]


def link_blocks(slot, low, bxyz, nown, nall, up, down, around):
    """Neighbours by number: ``up`` (nown, 8) node blocks, ``down`` (nall, 8) and ``around`` (nown, 27) owners or -1."""
    for b in prange(nall):
        i = bxyz[b, 0] - low[0]
        j = bxyz[b, 1] - low[1]
        k = bxyz[b, 2] - low[2]
        for q in range(8):
            dx = q >> 2
            dy = (q >> 1) & 1
            dz = q & 1
            s = _slot_at(slot, i - dx, j - dy, k - dz)
            down[b, q] = s if s < nown else -1
            if b < nown:
                up[b, q] = _slot_at(slot, i + dx, j + dy, k + dz)
        if b < nown:
            for q in range(27):
                s = _slot_at(slot, i + q // 9 - 1, j + (q // 3) % 3 - 1, k + q % 3 - 1)
                around[b, q] = s if s < nown else -1


def move_starts(old_bxyz, old_cstart, old_nown, slot, low, first):
    """First particle of each owner's cells under the new numbers: counts, to be summed by :func:`sum_starts`."""
    for b in prange(first.size):
        first[b] = 0
    for b in prange(old_nown):
        if old_cstart[b * 64] == old_cstart[b * 64 + 64]:
            continue
        s = slot[old_bxyz[b, 0] - low[0], old_bxyz[b, 1] - low[1], old_bxyz[b, 2] - low[2]]
        for c in range(64):
            first[s * 64 + c] = old_cstart[b * 64 + c + 1] - old_cstart[b * 64 + c]


def sum_starts(count, size, cstart):
    """Exclusive sum of the counts of ``size`` cells."""
    total = 0
    for k in range(size):
        cstart[k] = total
        total += count[k]
    cstart[size] = total
