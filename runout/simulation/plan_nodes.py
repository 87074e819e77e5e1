"""Nodes of the plan: columns of the flow around them, their ground, and sums by area."""

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace

import numpy as np

from runout.backends import bed_loops
from runout.backends.compile import numba_binding, threads_at_most
from runout.backends.protocol import NodeSums
from runout.model.nodal_surface import TILE, WIDTH, NodalSurface
from runout.model.scene import Raster, Scene

POOL_WIDTHS = 2, 4, 8, 16  # nodes
THINNEST = 1e-6  # [m] of a bed; less is rounding
NODES_OF_A_THREAD = 2**13  # that are worth a thread of their own: one that sleeps takes as long to wake as a pass over them


@dataclass
class Columns:
    """The part of the sums of a flow around nodes of the plan that lies in a window of nodes."""

    sums: np.ndarray  # (5, NX, NY): volume [m3], momentum (3) [kg m/s] and mass [kg], also beyond the window
    begin: tuple[int, int]  # where the part begins in ``sums``
    # first, shape: its first node, counted from that of the plan, and its nodes
    first: tuple[int, int]
    shape: tuple[int, int]

    @classmethod
    def within(cls, node_sums: NodeSums, first: tuple[int, int], shape: tuple[int, int]) -> "Columns | None":
        """The part of sums of a backend within so many nodes from ``first`` on; None without one."""
        low = [max(a, b) for a, b in zip(node_sums.first, first, strict=True)]
        high = [min(a + n, b + m) for a, n, b, m in zip(node_sums.first, node_sums.sums.shape[1:], first, shape, strict=True)]
        if low[0] >= high[0] or low[1] >= high[1]:
            return None
        begin = low[0] - node_sums.first[0], low[1] - node_sums.first[1]
        return cls(np.ascontiguousarray(node_sums.sums), begin, (low[0], low[1]), (high[0] - low[0], high[1] - low[1]))

    @property
    def mass(self) -> np.ndarray:
        """[kg] of the part (nx, ny)."""
        (i, j), (n, m) = self.begin, self.shape
        return self.sums[4, i : i + n, j : j + m]


class GroundCoefficients:
    """Coefficients of the ground at the nodes of a window, without its change, made where mass comes and kept.

    Parameters
    ----------
    ground : NodalSurface
    first, shape : tuple of int
        First node and number of nodes.

    Attributes
    ----------
    values : ndarray (nx + 2, ny + 2)
        [m], at these nodes and one around; NaN where no mass has come.
    """

    def __init__(self, ground: NodalSurface, first: tuple[int, int], shape: tuple[int, int]):
        self.ground, self.first = ground, (first[0] - 1, first[1] - 1)
        self.values = np.full((shape[0] + 2, shape[1] + 2), np.nan)
        self.begin = self.first[0] // TILE, self.first[1] // TILE  # tile of the first value
        last = [(one + n - 1) // TILE for one, n in zip(self.first, self.values.shape, strict=True)]
        self.known = np.zeros([end - begin + 1 for begin, end in zip(self.begin, last, strict=True)], bool)

    def make(self, mass: np.ndarray, first: tuple[int, int]) -> None:
        """Make those around the nodes (nx, ny), from the ``first`` on, that have a ``mass`` [kg]."""
        low = [(one - 1) // TILE for one in first]
        high = [(one + n - 2) // TILE + 1 for one, n in zip(first, mass.shape, strict=True)]
        own = tuple(slice(a - begin, b - begin) for a, b, begin in zip(low, high, self.begin, strict=True))
        if self.known[own].all():
            return
        begins = [n * TILE + 1 - one for n, one in zip(low, first, strict=True)]  # of the first tile among the nodes
        missing = []
        for i, j in np.argwhere(~self.known[own]).tolist():
            a, b = begins[0] + TILE * i, begins[1] + TILE * j
            if mass[max(a, 0) : a + TILE, max(b, 0) : b + TILE].any():
                missing.append((low[0] + i, low[1] + j))
        if missing:
            self._resample(np.array(missing))

    def _resample(self, tiles: np.ndarray) -> None:
        """Make the tiles (n, 2) of the ground, as far as they lie in the window."""
        surface, begins = self.ground.surface, tiles * TILE - self.first
        windows = np.stack([np.maximum(begins, 0), np.minimum(begins + WIDTH, self.values.shape)], axis=1)
        numbers = (np.array(values, np.float64) for values in (surface.origin, surface.spacing, self.ground.spacing))
        lattice = bed_loops.Lattice(np.ascontiguousarray(surface.coefficients, np.float64), *numbers)
        with threads_at_most(len(tiles)):
            plan_loops().resample_windows(lattice, np.array(self.first, np.int64), windows, self.values)
        self.known[*(tiles - self.begin).T] = True


@cache
def plan_loops() -> SimpleNamespace:
    """The compiled loops of :mod:`runout.backends.bed_loops` that know no law."""
    return numba_binding(np.float64, False).kernels(bed_loops)


@dataclass
class AreaSums:
    """Sums over cells of one lattice, of which those over cells of another are taken by area."""

    total: np.ndarray  # (nx + 1, ny + 1): sum over all cells south-west of each corner
    # begin, size: first corner and size of the cells [m]
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
