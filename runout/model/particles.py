"""Particles in the form that backends exchange: float64 arrays, with one table of types."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from runout.errors import CapacityError

INDEX_CELLS = 4 * 2**20 - 16  # cells from the origin that signed block coordinates of 21 bits cover, with blocks of 4 cells
AXES = ("east-west", "north-south", "height")
CHUNK = 2**13  # particles that are passed on at once: their arrays fit into the cache
ARRAYS = {  # name: (dtype, trailing shape)
    "node": (np.int32, (3,)),
    "offset": (np.float64, (3,)),
    "velocity": (np.float64, (3,)),
    "affine": (np.float64, (3, 3)),
    "strain": (np.float64, (6,)),
    "history": (np.float64, ()),
    "mass": (np.float64, ()),
    "volume": (np.float64, ()),
    "radius": (np.float64, ()),
    "ground_force": (np.float64, (3,)),
    "pore_excess": (np.float64, ()),
    "pore_left": (np.float64, ()),
    "release": (np.int32, ()),
    "identity": (np.int64, ()),
}
PLACED = ("node", "offset", "mass", "volume", "radius")  # what particles at rest have without stress, beside their numbers


class Sums(NamedTuple):
    """Sums over particles."""

    mass: float  # [kg]
    mean_volume: float  # stress-free [m3], 0 without particles


def joined_mean(mean: float, count: int, more: float, others: int) -> float:
    """Mean over ``count`` values with one mean and ``others`` with another, ``more``; 0 without any."""
    return (count * mean + others * more) / max(count + others, 1)


@dataclass
class Particles:
    """State of ``n`` particles.

    Attributes
    ----------
    node : (n, 3) int32
        First of the three nodes per axis in the support of the particle.
    offset : (n, 3) float64
        Offset from that node [cells], 0.5 <= offset < 1.5. Position = (node + offset) * spacing.
    velocity : (n, 3) [m/s]
    affine : (n, 3, 3)
        Velocity gradient C of APIC [1/s], ``C[i, j] = dv_i/dx_j``.
    strain : (n, 6)
        Elastic left Cauchy-Green tensor minus identity, B = b_e - I [1]; xx, yy, zz, xy, yz, zx.
    history : (n,)
        History variable of the law (Drucker-Prager: log volume gained at the apex [1]).
    mass : (n,) [kg]
    volume : (n,)
        Volume in the stress-free state [m3].
    radius : (n,)
        Distance from the ground, along its normal, at which the particle touches [m]: half the spacing of particle heights.
    ground_force : (n, 3)
        Force of the ground in the last step [N], zero without contact; initial value of the contact solution.
    pore_excess : (n,)
        Pore pressure ratio at the start over the one to which it relaxes [1] (:mod:`runout.physics.pore_pressure`).
    pore_left : (n,)
        The part E of the excess that remains [1], 1 at the start; 0 for a mass without pore pressure.
    release : (n,) int32
        Index of the release it belongs to.
    identity : (n,) int64
        Permanent number of the particle.
    """

    node: np.ndarray
    offset: np.ndarray
    velocity: np.ndarray
    affine: np.ndarray
    strain: np.ndarray
    history: np.ndarray
    mass: np.ndarray
    volume: np.ndarray
    radius: np.ndarray
    ground_force: np.ndarray
    pore_excess: np.ndarray
    pore_left: np.ndarray
    release: np.ndarray
    identity: np.ndarray

    @classmethod
    def zeros(cls, n: int) -> "Particles":
        """``n`` numbered particles; all other arrays are zero."""
        arrays = {name: np.zeros((n, *shape), dtype) for name, (dtype, shape) in ARRAYS.items()}
        arrays["identity"] = np.arange(n, dtype=np.int64)
        return cls(**arrays)

    @classmethod
    def at_rest(cls, n: int) -> "Particles":
        """``n`` numbered particles of release 0 without stress, history, motion and forces; the other arrays have no content.

        The zeros are shared and cannot be written.
        """
        zero = _zeros(1 << n.bit_length())
        arrays = {name: np.empty((n, *shape), dtype) for name, (dtype, shape) in ARRAYS.items() if name in PLACED}
        for name in ARRAYS.keys() - set(PLACED):
            shape = (n, *ARRAYS[name][1])
            arrays[name] = zero[: math.prod(shape)].reshape(shape)
        arrays["release"], arrays["identity"] = np.zeros(n, np.int32), np.arange(n, dtype=np.int64)
        return cls(**arrays)

    @classmethod
    def at(cls, position: np.ndarray, spacing: np.ndarray) -> "Particles":
        """Particles at local positions (n, 3) [m] on a grid of ``spacing`` (3,) [m]; other arrays are zero."""
        q = np.asarray(position, np.float64) / np.asarray(spacing, np.float64)
        particles = cls.zeros(len(q))
        first = np.floor(q - 0.5)
        particles.node[:] = first
        particles.offset[:] = q - first
        return particles

    def __len__(self) -> int:
        return len(self.mass)

    @property
    def is_still(self) -> bool:
        """Whether the velocity is the zeros of :meth:`at_rest`."""
        return self.velocity.base is _zeros(1 << len(self).bit_length())

    @property
    def rests(self) -> bool:
        """Whether velocity, affine matrix, history and force of the ground are the zeros of :meth:`at_rest`."""
        zero = _zeros(1 << len(self).bit_length())
        return all(values.base is zero for values in (self.velocity, self.affine, self.history, self.ground_force))

    def position(self, spacing: np.ndarray) -> np.ndarray:
        """Local positions (n, 3) [m], float64."""
        return (self.node + self.offset) * np.asarray(spacing, np.float64)

    def take(self, index: np.ndarray | slice) -> "Particles":
        """Particles selected by an index, a mask or a slice."""
        return Particles(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def chunks(self, stressed: bool = True) -> Iterator["Particles"]:
        """The particles in their order, :data:`CHUNK` at a time (:class:`runout.model.particle_source.ParticleSource`)."""
        for first in range(0, len(self), CHUNK):
            yield self.take(slice(first, first + CHUNK))

    def content(self) -> Iterator[np.ndarray]:
        """All arrays."""
        yield from vars(self).values()

    def sums(self, density: np.ndarray) -> Sums:
        """Sums over all particles, of releases with a ``density`` (releases,) [kg/m3]."""
        return Sums(float(self.mass.sum()), float(np.mean(self.mass / density[self.release])) if len(self) else 0.0)

    def joined(self, more: "Particles") -> "Particles":
        """These particles and ``more`` behind them; all keep their numbers."""
        return Particles(**{name: np.concatenate([getattr(self, name), getattr(more, name)]) for name in ARRAYS})

    @staticmethod
    def concatenate(parts: "list[Particles]") -> "Particles":
        """All particles of several sets, renumbered."""
        arrays = {name: np.concatenate([getattr(p, name) for p in parts]) for name in ARRAYS}
        arrays["identity"] = np.arange(len(arrays["mass"]), dtype=np.int64)
        return Particles(**arrays)


@lru_cache(maxsize=4)
def _zeros(n: int) -> np.ndarray:
    """Zeros for the arrays of ``n`` particles that nobody may write."""
    zero = np.zeros(9 * n)
    zero.flags.writeable = False
    return zero


def node_range(node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest of at least one node (n, 3) along each axis, (3,) int64."""
    low, high = ([int(extreme(node[:, axis])) for axis in range(3)] for extreme in (np.min, np.max))  # faster than by rows
    return np.array(low), np.array(high)


def require_index_range(node: np.ndarray, spacing: tuple[float, float, float], origin: np.ndarray | None = None) -> None:
    """Raise an error unless block indices from the node ``origin`` (3,), by default the lowest, cover particles of nodes (n, 3).

    Raises CapacityError with the largest admissible extent [m].
    """
    if not len(node):
        return
    low, high = node_range(node)
    start = low if origin is None else origin
    cells = np.maximum(np.abs(low - start), np.abs(high - start))
    worst = int(np.argmax(cells))
    if cells[worst] > INDEX_CELLS:
        h = spacing[worst]
        raise CapacityError(
            f"a particle lies beyond the index range, {cells[worst] * h:.7g} m from where blocks are counted ({AXES[worst]}); "
            f"the largest admissible extent is {INDEX_CELLS * h:.7g} m with cells of {h:g} m (21 bits): use larger cells"
        )
