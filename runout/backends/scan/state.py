"""Phase "state": where the particles are stored, in slots of 109 bytes in float32.

A block owns a range of slots, in which its particles lie in any order.

    slots     | block 4 .. | free | block 0 ... | free | block 9 .. | free |   ...   | end: reserve       | padding |
    rec       m | p (3)  |  fx | A column 0 (3)  |  fy | A column 1 (3)  |  fz | A column 2 (3)     one cache line in float32
    state     B - I (6)  |  history  |  volume                                                      half a cache line
    particle_index, cell, order, listed: one number a slot
    pores (numbers, slots): pore pressure, as far as particles differ in it

    by particle_index, which never moves:  force: stamp | f (3)     radius     label: release | identity
"""

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends.compile import numba_binding
from runout.backends.scan import groups, records
from runout.backends.scan.pore_pressure import diffuses
from runout.model.particles import ARRAYS, Particles
from runout.model.scene import Scene

PADDING = 64  # slots after the last that vectors may read and write
LONGEST_LIST = 1024  # of holes between the slots of blocks
BY_SLOT: dict[str, tuple[int, Any]] = {  # arrays of slots: numbers a slot, and their type if it is not that of the scene
    "rec": (16, None), "state": (8, None), "particle_index": (0, np.int32), "cell": (0, np.uint8), "order": (0, np.int32),
    "listed": (0, np.int32),
}  # fmt: skip
OF_PORES = 3  # numbers of pore pressure that particles may differ in: what remains, excess at the start, release
SELDOM = 20  # steps: gaps are not closed more often, unless that takes a fifth more slots
NO_STAMP = -1  # of a substep whose forces nothing starts from


def ranges(first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Numbers first, first + 1, ... of ranges of ``count`` (n,), one behind the other."""
    return np.repeat(first - (np.cumsum(count) - count), count) + np.arange(int(count.sum()))  # type: ignore[no-any-return]


def reserve(slots: int) -> int:
    """Free slots that a step may need for blocks that overflow."""
    return slots // 128 + 256


def capacity(slots: int) -> int:
    """Slots to allocate: some for blocks that grow, and for the gaps that they leave."""
    return slots + slots // 12 + 1024


@dataclass
class Store:
    """The particles of a run."""

    particles: groups.Particles  # arrays by slot and by particle (:class:`runout.backends.scan.groups.Particles`)
    radius: np.ndarray  # (particles,): touching radius of every particle [m]
    # n, end: particles in the domain; first slot behind all blocks
    n: int
    end: int
    # holes, n_holes (some, 2): first slot and size of the gaps that blocks have left
    holes: np.ndarray
    n_holes: int
    surge: int  # fresh slots that a step needed of late
    # closed_at, closed_end: step in which the gaps were closed, and ``end`` then
    closed_at: int
    closed_end: int
    largest_radius: float  # [m]
    # pore_left (releases,), pore_excess (1,): pore pressure (:class:`runout.backends.scan.pore_pressure.Pores`); empty where it
    # lies by slot, None in a dry scene
    pore_left: np.ndarray | None = None
    pore_excess: np.ndarray | None = None

    @classmethod
    def of(cls, slots: int, end: int, n: int, scene: Scene) -> "Store":
        """Storage of ``n`` particles in slots before ``end``, of so many, for :meth:`put`."""
        radius = np.zeros(n, scene.dtype)
        particles = empty_slots(slots, scene)._replace(
            force=_zeros(n, 4, scene.dtype), radius=radius, label=np.zeros((n, 2), np.int32)
        )
        store = cls(particles, radius, n, end, np.zeros((LONGEST_LIST, 2), np.int64), 0, 0, 0, n, 0.0)
        if scene.is_wet:
            store.pore_left = store.pore_excess = np.zeros(0, scene.dtype)
            store.particles = particles._replace(pores=_numbers(OF_PORES, slots, scene.dtype))
        return store

    def put(self, particle_index: np.ndarray, slots: np.ndarray, p: Particles, scene: Scene) -> None:
        """Put particles with some indices (m,) into the ``slots`` of all; the records hold no stress yet (time step 0)."""
        names = "release", "identity", "mass", "volume", "radius", "offset", "strain"
        radius = _loops().put_particles(self.particles, particle_index, slots, *(_plain(p, name) for name in names))
        self.largest_radius = max(self.largest_radius, radius)
        if self.pore_left is not None:
            self.particles.pores[:, slots[particle_index]] = p.pore_left, p.pore_excess, p.release
        if not p.rests:
            moving = (_plain(p, name) for name in ("mass", "offset", "velocity", "affine", "history", "ground_force"))
            _loops().set_in_motion(self.particles, particle_index, slots, *moving, scene.spacing)

    def join(self, slots: np.ndarray, blocks: groups.Blocks, p: Particles, scene: Scene, stamp: int) -> None:
        """Put more particles into their ``slots`` (m,), which the ``blocks`` list, after a step with this ``stamp``."""
        old, loaded, total = self.particles, len(self.particles.label), len(self.particles.label) + len(p)
        old.rec[slots], old.state[slots] = 0, 0
        force, label = _zeros(total, 4, scene.dtype), np.zeros((total, 2), np.int32)
        force[:loaded], force[loaded:, 0], label[:loaded] = old.force, stamp, old.label
        self.radius = np.concatenate([self.radius, np.zeros(len(p), scene.dtype)])
        self.particles = old._replace(force=force, radius=self.radius, label=label)
        held = self.occupied(blocks)
        if self.pore_left is not None:
            pores, before = _numbers(OF_PORES, self.slots, scene.dtype), np.setdiff1d(held, slots)
            pores[:, before] = *self.pores_at(before), self.release_at(before)
            self.particles = self.particles._replace(pores=pores)
        by_index = np.zeros(total, np.int32)
        by_index[loaded:] = slots
        self.put(np.arange(loaded, total, dtype=np.int32), by_index, p, scene)
        self.share_numbers(held, scene)
        self.n += len(p)

    def occupied(self, blocks: groups.Blocks) -> np.ndarray:
        """Slots of the particles of all ``blocks``, block by block in the order of cells."""
        return self.particles.order[ranges(blocks.first[: blocks.nown], blocks.held[: blocks.nown])]

    def share_numbers(self, slots: np.ndarray, scene: Scene) -> None:
        """Once all particles are in their ``slots`` (n,): one number for all radii and excess pressures that are the same.

        The part of the excess that remains is one number for each release where its particles have the same, and no mass drains by
        the thickness of its layer.
        """
        self.particles = self.particles._replace(radius=_one_for_all(self.radius))
        if self.pore_left is not None:
            pores, none = self.particles.pores, np.zeros(0, scene.dtype)
            left, excess, release = pores[:, slots]
            alike, of_releases = _one_for_all(excess), _parts_by_release(left, release.astype(np.int64), scene)
            self.pore_excess = alike.copy() if len(alike) == 1 else none
            self.pore_left = none if of_releases is None else of_releases
            own = [of_releases is None, len(self.pore_excess) == 0, len(scene.materials) > 1]
            kept = _numbers(sum(own), self.slots, scene.dtype)
            kept[:] = pores[own]
            self.particles = self.particles._replace(pores=kept)

    @property
    def drains_alike(self) -> bool:
        """Whether all particles of a release drain alike."""
        return self.pore_left is not None and len(self.pore_left) > 0

    def release_at(self, slots: np.ndarray) -> np.ndarray:
        """Release of the particles in ``slots`` (n,)."""
        return self.particles.label[self.particles.particle_index[slots], 0]

    def pores_at(self, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Part that remains and excess at the start [1] of the particles in ``slots`` (n,), of a wet scene."""
        assert self.pore_left is not None
        assert self.pore_excess is not None
        pores, alike = self.particles.pores, self.drains_alike
        left = self.pore_left[self.release_at(slots)] if alike else pores[0, slots]
        excess = np.repeat(self.pore_excess, len(slots)) if len(self.pore_excess) else pores[int(not alike), slots]
        return left, excess

    @property
    def slots(self) -> int:
        """Number of slots."""
        return len(self.particles.cell) - PADDING

    def grow(self, slots: int) -> None:
        """Make more slots at the end."""
        old, p = self.slots, self.particles
        grown: dict[str, np.ndarray] = {}
        for name in BY_SLOT:
            before = getattr(p, name)
            grown[name] = _slots(slots, before.shape[1:], before.dtype)
            grown[name][:old] = before[:old]
        if len(p.pores):
            grown["pores"] = _numbers(len(p.pores), slots, p.pores.dtype)
            grown["pores"][:, : p.pores.shape[1]] = p.pores
        self.particles = p._replace(**grown)

    def move(self, source: np.ndarray, target: np.ndarray) -> None:
        """Move the particles of the slots ``source`` (m,) to the free slots ``target`` (m,)."""
        for name in ("rec", "state", "particle_index", "cell"):
            values = getattr(self.particles, name)
            values[target] = values[source]
        if len(pores := self.particles.pores):
            pores[:, target] = pores[:, source]

    def leave_hole(self, first: int, slots: int) -> None:
        """Note so many slots that a block has left, if the list has room."""
        if slots > 0 and self.n_holes < len(self.holes):
            self.holes[self.n_holes] = first, slots
            self.n_holes += 1

    def ground_force(self, particle_index: np.ndarray, steps: int) -> np.ndarray:
        """Force of the ground [N] on particles (n,) in the last of so many steps: (n, 3), zero for those that did not touch it."""
        force = self.particles.force[particle_index].astype(np.float64)
        return np.where(force[:, :1] == stamp_of(steps), force[:, 1:], 0.0)

    def memory(self) -> dict[str, int]:
        """Bytes by array."""
        return bytes_of(self.particles._replace(radius=self.radius), holes=self.holes)


def empty_slots(slots: int, scene: Scene) -> groups.Particles:
    """Storage of so many slots without particles."""
    by_slot = {name: _slots(slots, (width,) if width else (), kind or scene.dtype) for name, (width, kind) in BY_SLOT.items()}
    nobody = {"force": _zeros(0, 4, scene.dtype), "radius": np.zeros(0, scene.dtype), "label": np.zeros((0, 2), np.int32)}
    nobody["pores"] = _zeros(0, 1, scene.dtype)
    return groups.Particles(**by_slot, **nobody)


def _one_for_all(values: np.ndarray) -> np.ndarray:
    """One number (1,) where all of (n,) are the same, else the numbers as they are."""
    return values[:1] if len(values) and (values == values[0]).all() else values


def _parts_by_release(left: np.ndarray, release: np.ndarray, scene: Scene) -> np.ndarray | None:
    """Part (releases,) of the excess that remains [1], 1 of a release without particles, from that of particles (n,).

    None where particles of a release differ in it, or will.
    """
    parts = np.ones(len(scene.materials), left.dtype)
    if not len(left) or diffuses(scene.pore_table()):
        return None
    parts[release] = left
    return parts if (parts[release] == left).all() else None


def _numbers(count: int, slots: int, real: Any) -> np.ndarray:
    """Place for so many numbers by slot (count, slots and some more)."""
    return _zeros(count, (slots + PADDING + 15) & ~15, real)


def _slots(slots: int, width: tuple[int, ...], kind: Any) -> np.ndarray:
    return _zeros(slots + PADDING, width[0], kind) if width else np.zeros(slots + PADDING, kind)


@cache
def _loops() -> SimpleNamespace:
    """The compiled loops of :mod:`runout.backends.scan.records`."""
    return numba_binding(np.float64, contract=False).kernels(records, nogil=True)


def _plain(p: Particles, name: str) -> np.ndarray:
    """An array of particles in the one form that compiled loops take."""
    return np.require(getattr(p, name), ARRAYS[name][0], ("C", "W"))


def bytes_of(*parts: Any, **arrays: np.ndarray) -> dict[str, int]:
    """Bytes of the arrays in groups, and of others, by name; an array that occurs twice counts once."""
    named = {f"{type(part).__name__}.{name}": value for part in parts for name, value in part._asdict().items()} | arrays
    own = {id(array): name for name, array in reversed(named.items()) if isinstance(array, np.ndarray)}
    return {name: int(named[name].nbytes) for name in own.values()}


def stamp_of(step: int) -> int:
    """Number of a step as single precision holds it exactly."""
    return step % 2**23


def _zeros(n: int, width: int, dtype: Any) -> np.ndarray:
    """Zeros (n, width) that start on a cache line, so that a record is one line and not two halves."""
    size = np.dtype(dtype).itemsize * n * width
    room = np.zeros(size + 64, np.uint8)
    start = -room.ctypes.data % 64
    return room[start : start + size].view(dtype).reshape(n, width)
