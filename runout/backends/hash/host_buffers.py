"""Memory of the host that a GPU copies to while both go on: it takes long to get, and is kept."""

from __future__ import annotations

from collections import defaultdict

import warp as wp


class HostBuffers:
    """Arrays of whole numbers on the host, by size; pinned for a GPU."""

    def __init__(self) -> None:
        self.free: dict[int, list[wp.array]] = defaultdict(list)

    def lend(self, size: int, pinned: bool) -> wp.array:
        """An array of at least ``size`` numbers, until it is taken back."""
        room = 1 << max(size - 1, 1).bit_length()
        kept = self.free[room]
        return kept.pop() if kept else wp.empty(room, dtype=wp.int64, device="cpu", pinned=pinned)

    def take_back(self, array: wp.array) -> None:
        """Keep an array for the next one who needs it."""
        self.free[len(array)].append(array)
