"""Columns of the flow: sums on a lattice of half grid cells, smoothed over footprints of particles, mapped to the raster.

This is the one estimator of every map, probe and profile. A backend adds each particle, a box of one grid cell, to the lattice.
Mass, momentum and volume are then smoothed over more cells of the lattice (:func:`runout.physics.numerical_scales.footprint_area`):
over so many that few particles share them to find where the flow is, and over so many that more share them, inside that, to say how
much is there. The second are at least one and a half grid cells wide, since the particles of a cell stand above each other in few
columns: the largest thickness over time of narrower ones is too large. Every cell of the raster takes its share by area. Each stage
keeps the sums to rounding, and no order depends on threads.

Single particles, fewer than share the extent, are mass at a place, not a thickness there: the part of the volume that flows
(:func:`runout.physics.numerical_scales.flowing_part`) is a sum of its own.
"""

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends import column_peaks, column_shares, spreading
from runout.backends.compile import numba_binding, threads_at_most
from runout.backends.protocol import BoxSums, NodeSums, RasterSums
from runout.model.depth_resolution import SHARING as FEWEST
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.physics.numerical_scales import smoothed_area
from runout.quantities import peak_quantities

HALVES = 2  # cells of the lattice in a cell of the grid, along each axis


@dataclass(frozen=True)
class Footprint:
    """Footprints of a size such that a number of particles share each place."""

    sharing: float  # number of particles that share each place
    # squares [cells of the lattice] over which a box of one grid cell is smoothed, ascending; 1: not at all
    widths: tuple[int, ...]

    @property
    def areas(self) -> np.ndarray:
        """Area that each width makes of the box [grid cells], (number of widths,)."""
        return np.array([smoothed_area(width / HALVES) if width > 1 else 1.0 for width in self.widths])


EXTENT = Footprint(FEWEST, (1, 3, 5))  # extent of the flow
DEPTH = Footprint(16.0, (3, 5, 9))  # thickness within the extent
REACH = max(*EXTENT.widths, *DEPTH.widths) // 2  # cells of the lattice
SHARING = np.array([EXTENT.sharing, DEPTH.sharing])
AREAS = np.array([EXTENT.areas, DEPTH.areas])
STRIP = 64  # rows that are looked at together for where the mass ends
LARGE = 2**17  # cells of a window of which lanes are read where they lie: to copy them takes longer than all else
CELLS_OF_A_THREAD = 2**14  # of a loop: a thread of its own pays off for more
FINER = 2  # times that a raster is finer than the lattice from which on maps are kept on the lattice until the end


@dataclass(frozen=True)
class Lattice:
    """A window of the plan lattice of half grid cells, whose cell (0, 0) lies north-east of the local origin."""

    first: tuple[int, int]  # its first cell, east and north; may be negative
    shape: tuple[int, int]  # cells east and north
    cell: tuple[float, float]  # size [m]

    @classmethod
    def around(cls, scene: Scene, low: np.ndarray, high: np.ndarray) -> "Lattice":
        """Window of the footprints of particles whose boxes lie between the nodes ``low`` and ``high`` (2,) of the grid."""
        first, last = HALVES * np.asarray(low, int) - REACH, HALVES * np.asarray(high, int) + REACH
        (east, north), (columns, rows) = first.tolist(), (last - first).tolist()
        return cls((east, north), (columns, rows), lattice_cell(scene))


def lattice_cell(scene: Scene) -> tuple[float, float]:
    """Size [m] of the cells of the lattice."""
    return scene.spacing[0] / HALVES, scene.spacing[1] / HALVES


def keep_peaks(scene: Scene) -> bool:
    """Whether peaks are kept on the lattice: the raster is so much finer that what an observation costs would follow it."""
    return all(FINER * cell < size * (1 + 1e-9) for cell, size in zip(scene.raster.cell_size, lattice_cell(scene), strict=True))


def nothing() -> RasterSums:
    """Columns of a window without cells."""
    return RasterSums(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0, 3)))


@cache
def loops() -> SimpleNamespace:
    """The compiled loops of :mod:`runout.backends.spreading`, without fused operations."""
    binding = numba_binding(np.float64, False)
    formulas: list[Any] = [q.formula for q in peak_quantities()]  # the module of pressure has the strength of a house as well
    sources: dict[Any, None] = dict.fromkeys([column_peaks, column_shares, *map(inspect.getmodule, formulas)])
    peaks = binding.chain(column_peaks.raise_peaks, formulas[1:], 1)  # the loop itself raises the thickness
    shares = binding.chain(column_shares.least_share, formulas)
    return binding.kernels(spreading, sources=tuple(sources), raise_peaks=peaks, least_share=shares)


def loop(name: str, cells: int, *arguments: Any) -> None:
    """Run one of the compiled loops over so many cells, in as many threads as are worth their start: small windows take one."""
    with threads_at_most(cells // CELLS_OF_A_THREAD):
        getattr(loops(), name)(*arguments)


def spread(sums: np.ndarray, lattice: Lattice, raster: Raster, particle_volume: float, density: float = 0.0) -> RasterSums:
    """Columns over the cells of the lattice that lie on the raster; row 0 is the southernmost.

    ``sums`` (lanes, rows, columns) on the lattice, rows from the south, of particles of the mean volume [m3]: volume, momentum
    (3), and mass unless all have one ``density`` [kg/m3].
    """
    total = np.empty((len(sums) + 1, *sums.shape[1:]))
    loop("spread_bands", sums.size, sums, particle_volume / HALVES**2, SHARING, AREAS, total)
    return placed(total, lambda: sums, lattice, raster, density)


def placed(
    total: np.ndarray, boxes: Callable[[], np.ndarray], lattice: Lattice, raster: Raster, density: float = 0.0
) -> RasterSums:
    """Columns over the cells of the lattice that lie on the raster, from sums that have been spread.

    ``total`` (lanes + 1, rows, columns) are the lanes of :func:`spread` over their footprints, and the volume that flows; ``boxes``
    gives the lanes before. Both change: what lies beyond the raster is mirrored.
    """
    lanes, count = len(total) - 1, lattice_shape(raster, lattice.cell)
    north, east, total = _inside(total, lattice.first, count)
    mass = total[4] if lanes > 4 else density * total[0]
    inside = BoxSums(lambda: _inside(boxes(), lattice.first, count)[2], north, east, density)
    return RasterSums(total[0], mass, np.moveaxis(total[1:4], 0, -1), north, east, total[lanes], inside, total)


def with_mass(found: RasterSums) -> RasterSums:
    """The same columns over the part of their window that has mass, or over whole rows of it where it is large.

    A window for moving mass has margins. Whole rows lie one behind the other in memory.
    """
    south, north = _rows_with_mass(found.mass)
    west, east = _rows_with_mass(found.mass[south:north].T) if found.mass.size < LARGE else (0, found.mass.shape[1])
    if south >= north:
        return found
    part = slice(south, north), slice(west, east)
    lanes = found.volume[part], found.mass[part], found.momentum[part]
    return RasterSums(*lanes, found.row + south, found.column + west, found.depth_volume[part], found.boxes)


def _rows_with_mass(mass: np.ndarray) -> tuple[int, int]:
    """First row with any ``mass`` (rows, columns), and one past the last; looked for from the ends, so that few rows are read."""
    rows = len(mass)
    for low in range(0, rows, STRIP):
        if (reached := mass[low : low + STRIP].any(axis=1)).any():
            high = next(end for end in range(rows, 0, -STRIP) if mass[max(end - STRIP, 0) : end].any())
            last = np.flatnonzero(mass[max(high - STRIP, 0) : high].any(axis=1))[-1]
            return low + int(reached.argmax()), max(high - STRIP, 0) + int(last) + 1
    return 0, 0


def around_nodes(sums: np.ndarray, lattice: Lattice, raster: Raster, density: float = 0.0) -> NodeSums:
    """Sums around the nodes of the grid, from those of :func:`spread`: a node has the two cells on either side along each axis."""
    row, column, values = _inside(sums, lattice.first, lattice_shape(raster, lattice.cell))
    nx, ny = ((begin + n) // 2 + 1 - (begin + 1) // 2 for begin, n in zip((column, row), values.shape[:0:-1], strict=True))
    summed = np.empty((5, nx, ny))
    loop("sum_around_nodes", values[0].size, np.ascontiguousarray(values), column, row, density, summed)
    return NodeSums(((column + 1) // 2, (row + 1) // 2), summed)


def lattice_shape(raster: Raster, cell: tuple[float, float]) -> tuple[int, int]:
    """Rows and columns of the lattice of ``cell`` [m] over the whole raster."""
    (width, height), size = cell, raster.cell_size
    return math.ceil(raster.rows * size[1] / height - 1e-9), math.ceil(raster.columns * size[0] / width - 1e-9)


def on_raster(found: RasterSums, raster: Raster, cell: tuple[float, float]) -> RasterSums:
    """Columns over the cells of the raster under columns ``found`` on the lattice of ``cell`` [m]."""
    if not found.mass.size:
        return found
    lanes: np.ndarray | list[np.ndarray] | None = found.lanes
    if lanes is None:
        lanes = [found.volume, *np.moveaxis(found.momentum, -1, 0), found.mass, found.depth_volume]
    row, column, shared = shared_by_area(lanes, (found.row, found.column), raster, cell)
    mass = shared[4] if len(shared) > 5 or not found.boxes else found.boxes.density * shared[0]
    return RasterSums(shared[0], mass, np.moveaxis(shared[1:4], 0, -1), row, column, shared[-1], found.boxes)


def shared_by_area(
    sums: np.ndarray | Sequence[np.ndarray], first: tuple[int, int], raster: Raster, cell: tuple[float, float]
) -> tuple[int, int, np.ndarray]:
    """First row and column of the raster, and shares (lanes, rows, columns) in its cells, of ``sums`` on the lattice of ``cell``.

    ``sums``, (lanes, rows, columns) or several times (rows, columns), have their first row and column, from the south and the
    west, at ``first``.
    """
    (north, east), size, (rows, columns) = first, raster.cell_size, sums[0].shape
    column, *across = _shares(east, columns, cell[0], size[0], raster.columns)
    south, *along = _shares(north, rows, cell[1], size[1], raster.rows)
    along = [np.ascontiguousarray(values[::-1]) for values in along]  # rows of the raster are from the north
    found = np.empty((len(sums), len(along[0]), len(across[0])))
    if isinstance(sums, np.ndarray) or rows * columns < LARGE:
        loop("share", rows * columns, np.ascontiguousarray(sums), *along, *across, found)
        return raster.rows - south - found.shape[1], column, found
    for k, lane in enumerate(sums):
        loop("share", rows * columns, np.ascontiguousarray(lane)[None], *along, *across, found[k : k + 1])
    return raster.rows - south - found.shape[1], column, found


def on_whole(found: RasterSums, raster: Raster) -> RasterSums:
    """The same columns on all cells of the raster."""
    shape = raster.rows, raster.columns
    whole = RasterSums(np.zeros(shape), np.zeros(shape), np.zeros((*shape, 3)), 0, 0, np.zeros(shape), found.boxes)
    for name in ("volume", "mass", "momentum"):
        getattr(whole, name)[found.window] = getattr(found, name)
    whole.depth_volume[found.window] = found.depth_volume
    return whole


def columns_of(scene: Scene, particles: Particles, particle_volume: float) -> RasterSums:
    """Columns over all cells of the raster in plain NumPy, for the reference backend."""
    found = lattice_columns(scene, particles, particle_volume)
    return on_whole(on_raster(found, scene.raster, lattice_cell(scene)), scene.raster)


def lattice_columns(scene: Scene, particles: Particles, particle_volume: float) -> RasterSums:
    """Columns over the cells of the lattice that the particles reach, in plain NumPy."""
    if not len(particles):
        return nothing()
    lattice = _lattice_of(scene, particles)
    return spread(_box_sums(scene, particles, lattice), lattice, scene.raster, particle_volume)


def node_columns(scene: Scene, particles: Particles) -> NodeSums | None:
    """Sums around the nodes that the particles reach, in plain NumPy; None without particles."""
    if not len(particles):
        return None
    lattice = _lattice_of(scene, particles)
    return around_nodes(_box_sums(scene, particles, lattice), lattice, scene.raster)


def _lattice_of(scene: Scene, particles: Particles) -> Lattice:
    node = particles.node[:, :2]
    return Lattice.around(scene, node.min(axis=0), node.max(axis=0) + 2)


def _box_sums(scene: Scene, particles: Particles, lattice: Lattice) -> np.ndarray:
    """Volume, momentum (3) and mass (5, rows from the south, columns) on a lattice; a particle is a box of a grid cell."""
    p, x = particles, particles.position(np.array(scene.spacing))[:, :2] - np.multiply(lattice.first, lattice.cell)
    across, along = (_box_shares(x[:, d], scene.spacing[d], lattice.cell[d], lattice.shape[d]) for d in (0, 1))
    volume = p.mass / np.array([m.density for m in scene.materials])[p.release]
    return np.stack([along.T @ (v[:, None] * across) for v in (volume, *(p.mass * p.velocity.T), p.mass)])


def _box_shares(x: np.ndarray, width: float, cell: float, count: int) -> np.ndarray:
    """Shares (n, count) of intervals of ``width`` [m] around x (n,) [m] in cells; outer cells include parts beyond the ends."""
    edges = np.array([-np.inf, *(cell * np.arange(1, count)), np.inf])
    covered = np.minimum(x[:, None] + 0.5 * width, edges[1:]) - np.maximum(x[:, None] - 0.5 * width, edges[:-1])
    return np.maximum(covered, 0.0) / width  # type: ignore[no-any-return]


@lru_cache(maxsize=64)
def _shares(first: int, count: int, size: float, cell: float, cells: int) -> tuple[int, np.ndarray, np.ndarray]:
    """First cell of the raster under a row of the lattice; the first of the lattice (n,) in each and parts (n, m) from it on.

    The row has ``count`` cells of ``size`` [m] from ``first`` on, the raster ``cells`` of length ``cell`` [m].
    """
    low = min(math.floor(first * size / cell), cells - 1)
    high = min(max(math.ceil((first + count) * size / cell), low + 1), cells)
    edges = np.arange(low, high + 1) * (cell / size)
    if high == cells:
        edges[-1] = max(edges[-1], first + count)
    base = np.floor(edges[:-1]).astype(int)
    place = base[:, None] + np.arange(int(np.max(np.ceil(edges[1:]) - base)))
    part = np.maximum(np.minimum(edges[1:, None], place + 1) - np.maximum(edges[:-1, None], place), 0.0)
    part[(place < first) | (place >= first + count)] = 0.0
    return low, base - first, part


def _inside(values: np.ndarray, first: tuple[int, int], count: tuple[int, int]) -> tuple[int, int, np.ndarray]:
    """First row and column, and view (lanes, rows, columns), on a lattice of ``count`` rows and columns; the rest is mirrored.

    ``first`` is the cell of the lattice, east and north, of the first of the ``values``, which change.
    """
    row, values = _folded(values, 1, first[1], count[0])
    column, values = _folded(values, 2, first[0], count[1])
    return row, column, values


def _folded(values: np.ndarray, axis: int, first: int, count: int) -> tuple[int, np.ndarray]:
    """First cell, and the part of ``values`` (n along ``axis``) on a lattice of ``count`` cells, to which the rest is added."""
    low, high = max(first, 0), min(first + values.shape[axis], count)
    turned = np.moveaxis(values, axis, 0)
    inside = turned[low - first : high - first]
    for place in (*range(first, low), *range(high, first + values.shape[axis])):
        mirrored = -1 - place if place < 0 else 2 * count - 1 - place
        inside[min(max(mirrored, low), high - 1) - low] += turned[place - first]
    return low, np.moveaxis(inside, 0, axis)
