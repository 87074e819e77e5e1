"""Where the particles live: arrays of slots, 109 bytes each in float32, and what never moves."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics.moments import momentum_at

PADDING = 64  # slots that vectors may read and write behind the last
SELDOM = 20  # steps: gaps are not closed more often, unless that takes a fifth more slots


def reserve(slots: int) -> int:
    """Free slots that a step may need for blocks that overflow."""
    return slots // 128 + 256


def capacity(slots: int) -> int:
    """Slots to allocate: some for blocks that grow, and for the gaps that they leave behind."""
    return slots + slots // 12 + 1024


@dataclass
class Store:
    """Slots of particles; a block owns a range of them. All end with some padding.

    Attributes
    ----------
    rec : (slots, 16)
        Records, see :mod:`runout.backends.scan.stencil`.
    state : (slots, 8)
        B = b_e - I (6), history variable of the law, stress-free volume [m3].
    who : (slots,) int32
        Row of the particle in ``radius`` and ``label``.
    cell : (slots,) uint8
        Cell in the block, 64 more if the particle leaves it.
    order : (slots,) int32
        Slots of the block's particles by cell.
    listed : (slots,) int32
        Contact particles; later in the step, particles that leave the block.
    contacts, measured, felt, given : (rows, 4), (rows / 16, 8, 16), (rows, 4), (rows, 4)
        Rows of contact particles during a step (:mod:`runout.backends.scan.contact_detection`).
    force : (n, 4)
        Stamp of the step in which the particle last touched the ground (:func:`stamp_of`), and the ground's force then [N].
    radius : (n,) [m]
    label : (n, 2) int32
        Release and identity.
    """

    rec: np.ndarray
    state: np.ndarray
    particle_index: np.ndarray
    cell: np.ndarray
    order: np.ndarray
    listed: np.ndarray
    contacts: np.ndarray
    measured: np.ndarray
    felt: np.ndarray
    given: np.ndarray
    force: np.ndarray
    radius: np.ndarray
    label: np.ndarray

    @classmethod
    def of(cls, slots: int, slot: np.ndarray, p: Particles, scene: Scene) -> "Store":
        """Particles in given slots (n,); the records hold no stress yet (time step 0)."""
        n = slots + PADDING
        rec, state = _zeros(n, 16, scene.dtype), _zeros(n, 8, scene.dtype)
        contacts, measured, felt, given = _rows_of_contacts(0, scene.dtype)
        particle_index, order, listed = (np.zeros(n, np.int32) for _ in range(3))
        label = np.stack([p.release, p.identity], axis=1).astype(np.int32)
        radius, force = p.radius.astype(scene.dtype), _zeros(len(p), 4, scene.dtype)
        force[:, 1:] = p.ground_force
        store = cls(
            rec, state, particle_index, np.zeros(n, np.uint8), order, listed, contacts, measured, felt, given, force, radius, label
        )
        store.particle_index[slot] = np.arange(len(p), dtype=np.int32)
        store._fill(slot, p, scene)
        return store

    @property
    def slots(self) -> int:
        """Number of slots."""
        return len(self.cell) - PADDING

    def grow(self, slots: int) -> None:
        """Make more slots at the end."""
        n, old = slots + PADDING, self.slots
        for name in ("rec", "state"):
            before = getattr(self, name)
            setattr(self, name, _zeros(n, before.shape[1], before.dtype))
            getattr(self, name)[:old] = before[:old]
        for name in ("particle_index", "cell", "order", "listed"):
            before = getattr(self, name)
            setattr(self, name, np.zeros(n, before.dtype))
            getattr(self, name)[:old] = before[:old]

    def make_contacts(self, wanted: int) -> None:
        """Room for so many rows of contacts; the old ones are forgotten."""
        self.contacts, self.measured, self.felt, self.given = _rows_of_contacts(wanted, self.rec.dtype)

    def ground_force(self, particle_index: np.ndarray, steps: int) -> np.ndarray:
        """Force of the ground [N] on particles (n,) in the last of so many steps: (n, 3), zero for those that did not touch it."""
        force = self.force[particle_index].astype(np.float64)
        return np.where(force[:, :1] == stamp_of(steps), force[:, 1:], 0.0)

    def _fill(self, slot: np.ndarray, p: Particles, scene: Scene) -> None:
        self.rec[slot, 0] = p.mass
        slopes = [p.mass * p.affine[:, :, j].T * scene.spacing[j] for j in range(3)]
        for j, slope in enumerate(slopes):
            self.rec[slot, 4 + 4 * j] = p.offset[:, j]
            self.rec[slot, 5 + 4 * j : 8 + 4 * j] = slope.T
        self.rec[slot, 1:4] = np.column_stack(momentum_at(p.mass * p.velocity.T, slopes[0], slopes[1], slopes[2], 1.0 - p.offset.T))
        self.state[slot, :6], self.state[slot, 6], self.state[slot, 7] = p.strain, p.history, p.volume

    def memory(self) -> dict[str, int]:
        """Bytes by array."""
        return {f.name: int(getattr(self, f.name).nbytes) for f in fields(self)}


def stamp_of(step: int) -> int:
    """Number of a step as single precision holds it exactly."""
    return step % 2**23


def _rows_of_contacts(rows: int, dtype: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    n = (rows + PADDING) & ~15
    measured = _zeros(n // 16, 128, dtype).reshape(-1, 8, 16)
    return _zeros(n, 4, dtype), measured, _zeros(n, 4, dtype), _zeros(n, 4, dtype)


def _zeros(n: int, width: int, dtype: Any) -> np.ndarray:
    """Zeros (n, width) that start on a cache line, so that a record is one line and not two halves."""
    size = np.dtype(dtype).itemsize * n * width
    room = np.zeros(size + 64, np.uint8)
    start = -room.ctypes.data % 64
    return room[start : start + size].view(dtype).reshape(n, width)
