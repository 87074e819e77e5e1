"""Nodes of the plan: columns of the flow around them, sums by area, and the particles that they give for what is eroded."""

from dataclasses import dataclass

import numpy as np

from runout.backends.protocol import NodeSums
from runout.model.nodal_surface import NodalSurface
from runout.model.scene import Raster, Scene
from runout.release import stagger

POOL_WIDTHS = 2, 4, 8, 16  # nodes
DITHER = 0.35  # particles by which the rounding of a pool differs from a half at most
THINNEST = 1e-6  # [m] of a bed; less is rounding


@dataclass
class Columns:
    """Sums over the flow around nodes of the plan, from node ``first`` on.

    Attributes
    ----------
    first : tuple of int
    volume, mass : ndarray (nx, ny)
        [m3], [kg]
    momentum : ndarray (3, nx, ny)
        [kg m/s]
    """

    first: tuple[int, int]
    volume: np.ndarray
    mass: np.ndarray
    momentum: np.ndarray

    @classmethod
    def of(cls, found: NodeSums) -> "Columns":
        """From sums of a backend."""
        return cls(found.first, found.sums[0], found.sums[4], found.sums[1:4])

    @property
    def speed(self) -> np.ndarray:
        """Mean speed (nx, ny) [m/s]; 0 without mass."""
        return np.sqrt((self.momentum**2).sum(axis=0)) / np.maximum(self.mass, np.finfo(float).tiny)  # type: ignore[no-any-return]

    def speed_at(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """Mean speed (n,) [m/s] at nodes ``i``, ``j`` (n,) of the grid; 0 beyond the window."""
        a, b = i - self.first[0], j - self.first[1]
        inside = (a >= 0) & (a < self.mass.shape[0]) & (b >= 0) & (b < self.mass.shape[1])
        speed = np.zeros(len(i))
        speed[inside] = self.speed[a[inside], b[inside]]
        return speed

    def window(self, first: tuple[int, int], shape: tuple[int, int]) -> "Columns | None":
        """The part within so many nodes from another ``first``; None without one."""
        low = [max(a, b) for a, b in zip(self.first, first, strict=True)]
        high = [min(a + n, b + m) for a, n, b, m in zip(self.first, self.volume.shape, first, shape, strict=True)]
        if low[0] >= high[0] or low[1] >= high[1]:
            return None
        own = tuple(slice(a - start, b - start) for a, b, start in zip(low, high, self.first, strict=True))
        return Columns((low[0], low[1]), self.volume[own], self.mass[own], self.momentum[:, *own])


class GroundSlopes:
    """Slopes of the ground at the nodes of a window, found where they are asked for and kept until the ground changes there.

    Parameters
    ----------
    ground : NodalSurface
    first, shape : tuple of int
        First node and number of nodes.
    """

    def __init__(self, ground: NodalSurface, first: tuple[int, int], shape: tuple[int, int]):
        self.ground, self.first = ground, first
        self.known = np.full((*shape, 2), np.nan)

    def at(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """Slopes (n, 2) [1] east and north at nodes ``i``, ``j`` (n,) of the window."""
        new = np.isnan(self.known[i, j, 0])
        a, b = i[new], j[new]
        dx, dy = self.ground.spacing
        _, east, north = self.ground.evaluate((self.first[0] + a) * dx, (self.first[1] + b) * dy)
        self.known[a, b] = np.column_stack([east, north])
        return self.known[i, j]  # type: ignore[no-any-return]

    def forget(self, along: slice, across: slice) -> None:
        """The ground of a part of the window changes, and with it the slopes one node around."""
        self.known[max(along.start - 1, 0) : along.stop + 1, max(across.start - 1, 0) : across.stop + 1] = np.nan


def _pooled(values: np.ndarray, size: int) -> np.ndarray:
    """Values (nx, ny) of nodes by square pools, ``size`` nodes wide: (pools, nodes); 0 beyond the window."""
    padded = np.pad(values, [(0, -n % size) for n in values.shape])
    nx, ny = padded.shape[0] // size, padded.shape[1] // size
    return padded.reshape(nx, size, ny, size).transpose(0, 2, 1, 3).reshape(nx * ny, size * size)


def _unpooled(pools: np.ndarray, size: int, shape: tuple[int, int]) -> np.ndarray:
    """Values (nx, ny) of nodes from those by pools."""
    nx, ny = (-(-n // size) for n in shape)
    whole = pools.reshape(nx, ny, size, size).transpose(0, 2, 1, 3).reshape(nx * size, ny * size)
    return whole[: shape[0], : shape[1]]


def rounding_of(first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    """What is added to the particles that a pool owes before they are rounded down, half a particle in the mean, by nodes (nx, ny).

    It differs from node to node by :data:`DITHER`, so that a flow that is the same everywhere does not grow in jumps.
    """
    i, j = (start + np.arange(n) for start, n in zip(first, shape, strict=True))
    return 0.5 + DITHER * (1.0 - 2.0 * ((i[:, None] * stagger.PLASTIC[0] + j * stagger.PLASTIC[1]) % 1.0))  # type: ignore[no-any-return]


def births(
    owed: np.ndarray, left: np.ndarray, takes: np.ndarray, rounding: np.ndarray, late: float, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Number of particles (nx, ny) that are born at each node, and the depth (nx, ny) [m] that each node gives for them.

    A square pool of nodes gives birth to what it owes, rounded to whole particles at the node that owes most, upwards only where
    its nodes have so much left. Births come so often that no pool owes ``late`` more than at the last; those that need no more than
    a quarter of that are due, so that births are about as often early as late.

    Parameters
    ----------
    owed, left, takes : ndarray (nx, ny)
        Depth [m] that nodes owe, that is not eroded yet, and that a particle takes.
    rounding : ndarray (nx, ny)
        Of the first node of a pool [particles]; 0: rounded down.
    late : float
        [particles]
    size : int
        Nodes of a pool along each axis.
    """
    count, given = np.zeros(owed.shape, np.int64), np.zeros(owed.shape)
    places = np.indices(owed.shape)
    pools, room, each, rounding, i, j = (_pooled(values, size) for values in (owed, left, takes, rounding, *places))
    due = np.maximum(pools, 0.0)
    owing = np.flatnonzero(due.any(axis=1))
    most = owing, pools[owing].argmax(axis=1)
    due, each, i, j = due[owing], each[most], i[most], j[most]
    particles = np.maximum(pools[owing].sum(axis=1), 0.0) / each + 1e-9
    rounded = particles + rounding[owing, 0] + 0.25 * late
    if not (rounded >= 1.0).any():
        return count, given
    part_of_due, number = due / due.sum(axis=1, keepdims=True), np.floor(rounded)
    fits = (part_of_due * (number * each)[:, None] <= due + room[owing] + 1e-12).all(axis=1)
    number = np.where(fits, number, np.floor(particles)).astype(np.int64)
    count[i, j] = number
    by_pool = np.zeros(pools.shape)
    by_pool[owing] = part_of_due * (number * each)[:, None]
    return count, _unpooled(by_pool, size, owed.shape)


@dataclass
class AreaSums:
    """Sums over cells of one lattice, of which those over cells of another are taken by area.

    Attributes
    ----------
    total : ndarray (nx + 1, ny + 1)
        Sum over all cells south-west of each corner.
    begin, size : tuple of float
        First corner and size of the cells [m].
    """

    total: np.ndarray
    begin: tuple[float, float]
    size: tuple[float, float]

    @classmethod
    def of(cls, sums: np.ndarray, begin: tuple[float, float], size: tuple[float, float]) -> "AreaSums":
        """From sums (nx, ny) over cells."""
        return cls(np.pad(sums.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))), begin, size)

    @classmethod
    def of_raster(cls, depth: np.ndarray, scene: Scene) -> "AreaSums":
        """From depths (rows, columns) [m] on the raster."""
        size = scene.raster.cell_size
        return cls.of(depth[::-1].T * (size[0] * size[1]), (0.0, 0.0), size)

    @classmethod
    def of_nodes(cls, depth: np.ndarray, first: tuple[int, int], spacing: tuple[float, float, float]) -> "AreaSums":
        """From depths (nx, ny) [m] at nodes from ``first`` on."""
        dx, dy, _ = spacing
        return cls.of(depth * (dx * dy), ((first[0] - 0.5) * dx, (first[1] - 0.5) * dy), (dx, dy))

    def within(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Sums (n - 1, m - 1) over the cells between ascending edges x (n,) and y (m,) [m]."""
        total = self.total
        for axis, edges in enumerate((x, y)):
            count = self.total.shape[axis] - 1
            q = np.clip((edges - self.begin[axis]) / self.size[axis], 0.0, count)
            low = np.minimum(q.astype(np.int64), count - 1)
            share = (q - low).reshape((-1, 1) if axis == 0 else (1, -1))
            total = (1.0 - share) * np.take(total, low, axis) + share * np.take(total, low + 1, axis)
        return np.diff(np.diff(total, axis=0), axis=1)

    def nodes(self, spacing: tuple[float, float, float]) -> tuple[tuple[int, int], tuple[int, int]]:
        """First node and number of nodes along each axis of those with a sum."""
        lengths = [(n - 1) * size for n, size in zip(self.total.shape, self.size, strict=True)]
        edges = [(np.arange(round(length / h) + 3) - 0.5) * h for length, h in zip(lengths, spacing, strict=False)]
        there = self.within(*edges) > THINNEST * spacing[0] * spacing[1]
        along, across = (np.flatnonzero(there.any(axis=axis)) for axis in (1, 0))
        if not len(along):
            return (0, 0), (1, 1)
        return (int(along[0]), int(across[0])), (int(np.ptp(along)) + 1, int(np.ptp(across)) + 1)

    def on_nodes(self, first: tuple[int, int], shape: tuple[int, int], spacing: tuple[float, float, float]) -> np.ndarray:
        """Depths (nx, ny) [m] of nodes from ``first`` on."""
        x, y = ((np.arange(n + 1) + start - 0.5) * h for n, start, h in zip(shape, first, spacing, strict=False))
        depth = self.within(x, y) / (spacing[0] * spacing[1])
        return np.where(depth > THINNEST, depth, 0.0)

    def on_raster(self, raster: Raster) -> np.ndarray:
        """Depths (rows, columns) [m] on the cells of a raster; those at its rim have what lies beyond."""
        dx, dy = raster.cell_size
        x, y = np.arange(raster.columns + 1) * dx, np.arange(raster.rows + 1) * dy
        for edges in (x, y):
            edges[0], edges[-1] = -np.inf, np.inf
        return np.maximum(self.within(x, y), 0.0).T[::-1] / (dx * dy)  # rounding may leave less than nothing
