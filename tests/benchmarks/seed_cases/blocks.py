"""Blocks of 64 nodes that a backend holds, and the box around them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

NODES = 64  # of a block


@dataclass(frozen=True)
class BlockCount:
    """Blocks at one time.

    Attributes
    ----------
    held : int
        Blocks that hold nodes: those with particles, and those that these reach.
    box : int
        Blocks of the box around them.
    """

    held: int
    box: int

    @property
    def sparsity(self) -> float:
        """Blocks of the box over blocks held [1]."""
        return self.box / max(1, self.held)


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
    extent = np.ptp(places.astype(np.int64), axis=0) + 1
    return BlockCount(len(places), int(np.prod(extent)))
