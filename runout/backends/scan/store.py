"""Where the particles live: arrays of slots, 112 bytes each in float32 and half of that again to sort in."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from runout.backends.scan.motion import DEAD, TILE
from runout.model.particles import Particles
from runout.model.scene import Scene


@dataclass
class Store:
    """Slots of particles; a block owns a range of them. All arrays end with a tile of padding.

    Attributes
    ----------
    rec : (slots, 16)
        Records, see :mod:`runout.backends.scan.stencil`.
    state : (slots, 8)
        B = b_e - I (6), history variable of the law, stress-free volume [m3].
    radius : (slots, 1) [m]
    label : (slots, 2) int32
        Release and identity.
    cell : (slots,) uint8
        Cell in the block, or a mark that the slot is free.
    order : (slots,) int32
        Slots of the block's particles by cell.
    listed : (slots,) int32
        Contact particles; later in the step, particles that leave the block.
    spare : (slots, 16)
        Contacts during a step; room to sort in when the index is made anew.
    """

    rec: np.ndarray
    state: np.ndarray
    radius: np.ndarray
    label: np.ndarray
    cell: np.ndarray
    order: np.ndarray
    listed: np.ndarray
    spare: np.ndarray

    @classmethod
    def empty(cls, slots: int, dtype: Any) -> "Store":
        """Free slots."""
        n = slots + TILE
        rec, state, radius, spare = (_zeros(n, width, dtype) for width in (16, 8, 1, 16))
        label, order, listed = np.zeros((n, 2), np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
        return cls(rec, state, radius, label, np.full(n, DEAD, np.uint8), order, listed, spare)

    @property
    def slots(self) -> int:
        """Number of slots."""
        return len(self.cell) - TILE

    def grown(self, slots: int) -> "Store":
        """The same with more slots at the end."""
        more = Store.empty(slots, self.rec.dtype)
        for f in fields(self):
            getattr(more, f.name)[: self.slots] = getattr(self, f.name)[: self.slots]
        return more

    def fill(self, slot: np.ndarray, p: Particles, scene: Scene) -> None:
        """Put particles into slots (n,); the records hold no stress yet (time step 0)."""
        self.rec[slot, 0] = p.mass
        self.rec[slot, 1:4] = p.mass[:, None] * p.velocity
        for j in range(3):
            self.rec[slot, 4 + 4 * j] = p.offset[:, j]
            self.rec[slot, 5 + 4 * j : 8 + 4 * j] = p.mass[:, None] * p.affine[:, :, j] * scene.spacing[j]
        self.state[slot, :6], self.state[slot, 6], self.state[slot, 7] = p.strain, p.history, p.volume
        self.radius[slot, 0], self.label[slot, 0], self.label[slot, 1] = p.radius, p.release, p.identity

    def memory(self) -> dict[str, int]:
        """Bytes by array."""
        return {f.name: int(getattr(self, f.name).nbytes) for f in fields(self)}


def _zeros(n: int, width: int, dtype: Any) -> np.ndarray:
    """Zeros (n, width) that start on a cache line, so that a record is one line and not two halves."""
    size = np.dtype(dtype).itemsize * n * width
    room = np.zeros(size + 64, np.uint8)
    start = -room.ctypes.data % 64
    return room[start : start + size].view(dtype).reshape(n, width)
