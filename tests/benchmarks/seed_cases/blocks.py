"""Blocks of 64 nodes that a backend holds, and the box around them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

NODES = 64  # of a block


@dataclass(frozen=True)
class BlockCount:
    """Blocks at one time.

    Attributes
    ----------
    occupied : int
        Blocks that hold nodes: those with particles, and those that these reach.
    box : int
        Blocks of the box around them.
    low, high : tuple of int
        Place of the first and of the last block of the box along each axis [blocks].
    """

    occupied: int
    box: int
    low: tuple[int, ...] = ()
    high: tuple[int, ...] = ()

    @property
    def sparsity(self) -> float:
        """Blocks of the box over occupied blocks [1]."""
        return self.box / max(1, self.occupied)


def count_blocks(engine: Any) -> BlockCount:
    """Blocks of the index of a loaded backend scan or hash."""
    if hasattr(engine, "parts"):
        index = engine.parts.index
        places = index.coordinates.numpy()[: index.nall]
    else:
        blocks = engine.index.blocks
        places = blocks.bxyz[: blocks.nall]
    if not len(places):
        return BlockCount(0, 0)
    low, high = places.min(0).astype(np.int64), places.max(0).astype(np.int64)
    return BlockCount(len(places), int(np.prod(high - low + 1)), tuple(low.tolist()), tuple(high.tolist()))


def box_of_run(counts: Sequence[BlockCount]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """First and last block along each axis of the box around all blocks of a run."""
    filled = [count for count in counts if count.occupied]
    low, high = np.min([count.low for count in filled], axis=0), np.max([count.high for count in filled], axis=0)
    return tuple(low.tolist()), tuple(high.tolist())
