"""Arrays that belong to the blocks of one index, and sums over blocks; a step writes into them and makes none."""

from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np

from runout.backends.scan.domain import Domain
from runout.backends.scan.index import Index
from runout.backends.scan.particles_to_grid import SHARES
from runout.backends.scan.schedule import Schedule
from runout.backends.scan.state import _zeros
from runout.backends.scan.stencil import ARENA

SUMS = 7  # mass, momentum, kinetic, potential and elastic energy


@dataclass
class Arenas:
    """Scratch of the steps between two rebuilds of the index.

    Attributes
    ----------
    number, lent : (nown,) int32
        Place among the arenas of each owner that gives to nodes, and of each with contacts, for their impulses.
    arenas : (some, ARENA)
        What the particles of such an owner give to the nodes that they reach; as many for each thread, and the last is empty.
    free : (threads, some) int32
        Arenas of each thread that may be used again.
    reached, pressed : (nown,) uint8
        Parts of such an arena that its particles reach, and its contacts (:mod:`runout.backends.scan.particles_to_grid`).
    shares, sharer : (some, SHARES), (nown,) int32
        Weights of the contacts of an owner at the nodes that they reach, the last without any; the place of the owner among these.
    grid : (nall, 256)
        Mass, or contact compliance where contacts reach, and velocity of the 64 nodes of each block.
    shared, inverse : (nall,) bool, (nall, 64)
        Blocks of nodes that contacts reach, and one over the mass of their nodes [1/kg].
    tiles, planes, bounds : (nown, 36), (nown, 48), (nown, 2)
        The ground, see :func:`runout.backends.scan.ground.cut_tiles`.
    touching, candidates : (nown,) int64
        Particles that touch the ground, and that were measured.
    place : (nown,) int64
        First row of a block among the contacts.
    leaving, arrivals, before : (nown,) int64
        Particles that leave and enter; first slot before they do.
    shifted : (nown,) int64
        Particles that change their cell and stay in the block.
    changed : (nown,) int64
        Bit q is set if a particle moves to destination q: to a neighbour, or, 13, to another cell of the block.
    rim : (nown,) bool
        Whether particles of the block may leave the domain.
    motion : (nown, 4)
        Largest speed squared, longest move [cells], dissipated energy [J], refused moves.
    ground : (nown, 4)
        Work of the ground [J] and its impulse [N s].
    asleep, calm : (nown,) bool, (nown,) int64
        Whether a block sleeps, and the steps in a row in which it was slow.
    falling, moving, giving : (nown,) int64
        Particles of blocks that fall asleep, that move, and that give to nodes; the last two are all where no block may sleep.
    sums : (nown, 7)
        What :mod:`runout.backends.scan.observe` adds up.
    total, nothing : (7,)
        Sums over the blocks, and over none.
    """

    number: np.ndarray
    lent: np.ndarray
    arenas: np.ndarray
    free: np.ndarray
    reached: np.ndarray
    pressed: np.ndarray
    shares: np.ndarray
    sharer: np.ndarray
    grid: np.ndarray
    shared: np.ndarray
    inverse: np.ndarray
    tiles: np.ndarray
    planes: np.ndarray
    bounds: np.ndarray
    touching: np.ndarray
    candidates: np.ndarray
    place: np.ndarray
    leaving: np.ndarray
    arrivals: np.ndarray
    before: np.ndarray
    shifted: np.ndarray
    changed: np.ndarray
    rim: np.ndarray
    motion: np.ndarray
    ground: np.ndarray
    asleep: np.ndarray
    calm: np.ndarray
    falling: np.ndarray
    moving: np.ndarray
    giving: np.ndarray
    sums: np.ndarray
    total: np.ndarray
    nothing: np.ndarray

    @classmethod
    def of(cls, index: Index, schedule: Schedule, real: Any, domain: Domain, sleeps: bool, sharers: int = 0) -> "Arenas":
        """Arrays for the blocks of an index, which may sleep, and room for some shares; particles leave the ``domain``."""
        n = index.nown
        capacity, threads = _roomy(schedule.most_arenas(index.held)), len(schedule.cuts) - 1
        count = partial(np.zeros, n, np.int64)
        return cls(
            number=np.zeros(n, np.int32), lent=np.zeros(n, np.int32), arenas=_zeros(threads * capacity + 1, ARENA, real),
            free=np.zeros((threads, capacity), np.int32), reached=np.zeros(n, np.uint8), pressed=np.zeros(n, np.uint8),
            shares=np.zeros((sharers, SHARES), real), sharer=np.zeros(n, np.int32), grid=_zeros(index.nall, 256, real),
            shared=np.zeros(index.nall, np.bool_), inverse=_zeros(index.nall, 64, real), tiles=np.empty((n, 36), real),
            planes=np.empty((n, 48), real), bounds=np.empty((n, 2), real), touching=count(), candidates=count(), place=count(),
            leaving=count(), arrivals=count(), before=count(), shifted=count(), changed=count(),
            rim=domain.at_edge(index.bxyz[:n]), motion=np.zeros((n, 4)), ground=np.zeros((n, 4)), asleep=np.zeros(n, np.bool_),
            calm=count() if sleeps else index.held, falling=count() if sleeps else index.held,
            moving=index.held.copy() if sleeps else index.held, giving=index.held.copy() if sleeps else index.held,
            sums=np.zeros((n, SUMS)), total=np.zeros(SUMS), nothing=np.zeros(SUMS),
        )  # fmt: skip

    def make_arenas(self, wanted: int) -> None:
        """More arenas for each thread."""
        threads, capacity = len(self.free), _roomy(wanted)
        self.arenas = _zeros(threads * capacity + 1, ARENA, self.arenas.dtype)
        self.free = np.zeros((threads, capacity), np.int32)

    def make_shares(self, wanted: int) -> None:
        """Shares of so many blocks, and empty ones."""
        self.shares = np.zeros((wanted + 1, SHARES), self.shares.dtype)

    def memory(self) -> dict[str, int]:
        """Bytes by array; those of the index do not count."""
        borrowed = ("calm", "falling", "moving", "giving") if self.moving is self.giving else ()
        return {f.name: int(getattr(self, f.name).nbytes) for f in fields(self) if f.name not in borrowed}


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


def total_held(held, nown):
    """The same, of an index."""
    return _total_held(held, nown)


def total_rows(rows, chosen, nown, total):
    """Sums of the rows of the blocks that hold something of what is ``chosen``."""
    for k in range(rows.shape[1]):
        total[k] = 0.0
    for b in range(nown):
        if chosen[b] > 0:
            for k in range(rows.shape[1]):
                total[k] += rows[b, k]


def total_escaped(movers, leaving, first, nown, outside):
    """Number of particles that leave the domain in this step."""
    n = 0
    for b in range(nown):
        for t in range(leaving[b]):
            n += (movers[first[b] + t] >> 6) & outside > 0
    return n
