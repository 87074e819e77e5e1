"""Footprints of particles on rasters finer than the grid: sums on a lattice of half grid cells, smoothed, mapped to the raster.

A backend adds each particle, a box of one grid cell, to the lattice. Where particles have moved apart, their mass is smoothed
over more cells of the lattice (:func:`runout.physics.numerical_scales.footprint_area`), mass, momentum and volume alike: over so
many that few particles share them to find where the flow is, and over so many that more share them, inside that, to say how much is
there. Every cell of the raster then takes its share by area. Each stage keeps the sums to rounding, and no order depends on
threads.
"""

import math
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace

import numpy as np

from runout.backends import spreading
from runout.backends.compile import numba_binding
from runout.backends.protocol import RasterSums
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.physics.numerical_scales import smoothed_area

HALVES = 2  # cells of the lattice in a cell of the grid, along each axis


@dataclass(frozen=True)
class Footprint:
    """Footprints of a size such that a number of particles share each place.

    Attributes
    ----------
    sharing : float
        Number of particles that share each place.
    widths : tuple of int
        Squares [cells of the lattice] over which a box of one grid cell may be smoothed, ascending.
    """

    sharing: float
    widths: tuple[int, ...]

    @property
    def areas(self) -> np.ndarray:
        """Areas of the box and of what each width makes of it [grid cells], (1 + number of widths,)."""
        return np.array([1.0, *(smoothed_area(width / HALVES) for width in self.widths)])


EXTENT = Footprint(4.0, (3, 5))  # extent of the flow
DEPTH = Footprint(16.0, (3, 5, 9))  # thickness within the extent
REACH = max(*EXTENT.widths, *DEPTH.widths) // 2  # cells of the lattice


@dataclass(frozen=True)
class Lattice:
    """A window of the plan lattice of half grid cells, whose cell (0, 0) lies north-east of the local origin.

    Attributes
    ----------
    first : (int, int)
        Its first cell, east and north; may be negative.
    shape : (int, int)
        Cells east and north.
    cell : (float, float)
        Size [m].
    """

    first: tuple[int, int]
    shape: tuple[int, int]
    cell: tuple[float, float]

    @classmethod
    def around(cls, scene: Scene, low: np.ndarray, high: np.ndarray) -> "Lattice":
        """Window of the footprints of particles whose boxes lie between the nodes ``low`` and ``high`` (2,) of the grid."""
        first, last = HALVES * np.asarray(low, int) - REACH, HALVES * np.asarray(high, int) + REACH
        (east, north), (columns, rows) = first.tolist(), (last - first).tolist()
        return cls((east, north), (columns, rows), (scene.spacing[0] / HALVES, scene.spacing[1] / HALVES))


def apply_to(scene: Scene) -> bool:
    """Whether footprints are needed: cells of the raster are smaller than those of the grid."""
    return any(cell < h * (1 - 1e-9) for cell, h in zip(scene.raster.cell_size, scene.spacing[:2], strict=True))


def nothing() -> RasterSums:
    """Columns of a window without cells."""
    return RasterSums(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0, 3)))


@cache
def loops() -> SimpleNamespace:
    """The compiled loops of :mod:`runout.backends.spreading`, without fused operations."""
    return numba_binding(np.float64, False).kernels(spreading)


def on_raster(sums: np.ndarray, lattice: Lattice, raster: Raster, particle_volume: float) -> RasterSums:
    """Columns over the cells of the raster that the lattice covers.

    ``sums`` (rows from the north, columns, 5) on the lattice: volume, mass and momentum of particles of the mean volume [m3].
    """
    (east, north), cell, size = lattice.first, lattice.cell, raster.cell_size
    spread = _spread(np.ascontiguousarray(sums[::-1]), particle_volume)
    north, spread = _inside(spread, north, math.ceil(raster.rows * size[1] / cell[1] - 1e-9))
    east, turned = _inside(np.swapaxes(spread, 0, 1), east, math.ceil(raster.columns * size[0] / cell[0] - 1e-9))
    spread = np.ascontiguousarray(np.swapaxes(turned, 0, 1))
    column, *across = _shares(east, spread.shape[1], cell[0], size[0], raster.columns)
    south, *along = _shares(north, spread.shape[0], cell[1], size[1], raster.rows)
    found = np.empty((len(along[0]), len(across[0]), 5))
    loops().share(spread, *along, *across, found)
    found, row = found[::-1], raster.rows - south - len(found)
    return RasterSums(found[..., 0], found[..., 1], found[..., 2:], row, column)


def on_whole(found: RasterSums, raster: Raster) -> RasterSums:
    """The same columns on all cells of the raster."""
    shape = raster.rows, raster.columns
    whole = RasterSums(np.zeros(shape), np.zeros(shape), np.zeros((*shape, 3)))
    for name in ("volume", "mass", "momentum"):
        getattr(whole, name)[found.window] = getattr(found, name)
    return whole


def columns_of(scene: Scene, particles: Particles, particle_volume: float) -> RasterSums:
    """Columns over all cells of the raster in plain NumPy, for the reference backend."""
    raster = scene.raster
    if not apply_to(scene):
        sums = _box_sums(scene, particles, Lattice((0, 0), (raster.columns, raster.rows), raster.cell_size))
        return RasterSums(sums[..., 0], sums[..., 1], sums[..., 2:])
    if not len(particles):
        return on_whole(nothing(), raster)
    node = particles.node[:, :2]
    lattice = Lattice.around(scene, node.min(axis=0), node.max(axis=0) + 2)
    return on_whole(on_raster(_box_sums(scene, particles, lattice), lattice, raster, particle_volume), raster)


def _box_sums(scene: Scene, particles: Particles, lattice: Lattice) -> np.ndarray:
    """Volume, mass and momentum (rows from the north, columns, 5) in cells of a lattice; a particle is a box of a grid cell."""
    p, x = particles, particles.position(np.array(scene.spacing))[:, :2] - np.multiply(lattice.first, lattice.cell)
    across, along = (_box_shares(x[:, d], scene.spacing[d], lattice.cell[d], lattice.shape[d]) for d in (0, 1))
    volume = p.mass / np.array([m.density for m in scene.materials])[p.release]
    return np.stack([along[:, ::-1].T @ (v[:, None] * across) for v in (volume, p.mass, *(p.mass * p.velocity.T))], axis=-1)


def _box_shares(x: np.ndarray, width: float, cell: float, count: int) -> np.ndarray:
    """Shares (n, count) of intervals of ``width`` [m] around x (n,) [m] in cells; outer cells include parts beyond the ends."""
    edges = np.array([-np.inf, *(cell * np.arange(1, count)), np.inf])
    covered = np.minimum(x[:, None] + 0.5 * width, edges[1:]) - np.maximum(x[:, None] - 0.5 * width, edges[:-1])
    return np.maximum(covered, 0.0) / width  # type: ignore[no-any-return]


def _spread(sums: np.ndarray, particle_volume: float) -> np.ndarray:
    """Sums (rows, columns, 5) on the lattice with every mass over the footprint that the particles around it need."""
    one, covered, span = particle_volume / HALVES**2, np.ones(sums.shape[:2]), np.empty((len(sums), 2), np.int64)
    volume = np.ascontiguousarray(sums[..., :1])
    loops().find_spans(volume[..., 0], REACH, span)
    extent = _smoothed(volume, span, one, EXTENT, covered)[..., 0]
    loops().cover(extent, span, one, covered)
    return _smoothed(sums, span, one, DEPTH, covered)


def _smoothed(sums: np.ndarray, span: np.ndarray, one: float, footprint: Footprint, covered: np.ndarray) -> np.ndarray:
    """Sums (rows, columns, lanes) over footprints, inside the part of each cell that is ``covered`` (rows, columns).

    All mass lies :data:`REACH` cells or more inside the ``span`` (rows, 2) of columns of each row.
    """
    rows, columns, lanes = sums.shape
    around, total, part = np.zeros((rows, columns)), np.zeros_like(sums), np.empty_like(sums)
    weights = (one, footprint.sharing, footprint.areas)
    loops().smooth(np.ascontiguousarray(sums[..., 0]), span, 1, max(footprint.widths), around)
    for n, width in enumerate(footprint.widths, 1):
        mean = np.zeros((rows, columns))
        loops().smooth(covered, span, 1, width, mean)
        loops().take(sums, span, around, mean, *weights, n, part)
        loops().smooth(part.reshape(rows, -1), span, lanes, width, total.reshape(rows, -1))
    loops().take(sums, span, around, covered, *weights, 0, part)
    loops().confine(part, span, covered, total)
    return total


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


def _inside(values: np.ndarray, first: int, count: int) -> tuple[int, np.ndarray]:
    """First cell and values (n, ...) of a lattice of ``count`` cells; values beyond its ends are mirrored."""
    place = np.arange(first, first + len(values))
    if place[0] >= 0 and place[-1] < count:
        return first, values
    place = np.where(place < 0, -1 - place, np.where(place >= count, 2 * count - 1 - place, place)).clip(0, count - 1)
    folded = np.zeros((np.ptp(place) + 1, *values.shape[1:]))
    np.add.at(folded, place - place.min(), values)
    return int(place.min()), folded
