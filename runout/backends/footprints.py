"""Footprints of particles on a raster finer than the grid: sums on a lattice of half grid cells, spread, brought to the raster.

A backend adds each particle, a box of one grid cell, to the lattice. Where particles have moved apart, their mass is smoothed
over more cells of the lattice (:func:`runout.physics.resolution.footprint_area`), mass, momentum and volume alike. Every cell
of the raster then takes its share by area. Each stage keeps the sums to rounding, and no order depends on threads.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.backends.protocol import Columns
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.physics.resolution import footprint_area, part_beyond, smoothed_area

HALVES = 2  # cells of the lattice in a cell of the grid, along each axis
WIDTHS = (3, 5)  # cells of the lattice over which mass is smoothed
REACH = max(WIDTHS) // 2  # cells of the lattice
AREAS = (1.0, *(smoothed_area(width / HALVES) for width in WIDTHS))


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
        """The window over which particles spread whose boxes lie between the nodes ``low`` and ``high`` (2,) of the grid."""
        first, last = HALVES * np.asarray(low, int) - REACH, HALVES * np.asarray(high, int) + REACH
        (east, north), (columns, rows) = first.tolist(), (last - first).tolist()
        return cls((east, north), (columns, rows), (scene.spacing[0] / HALVES, scene.spacing[1] / HALVES))


def apply_to(scene: Scene) -> bool:
    """Whether cells of the raster are smaller than those of the grid; else a particle's box of one cell is fine enough."""
    return any(cell < h * (1 - 1e-9) for cell, h in zip(scene.raster.cell_size, scene.spacing[:2], strict=True))


def mean_volume(scene: Scene, particles: Particles) -> float:
    """Mean volume of a particle at rest [m3]; 0 without any."""
    density = np.array([m.density for m in scene.materials])[particles.release]
    return float(np.mean(particles.mass / density)) if len(particles) else 0.0


def nothing() -> Columns:
    """Columns of a window without cells."""
    return Columns(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0, 3)))


def on_raster(sums: np.ndarray, lattice: Lattice, raster: Raster, particle_volume: float) -> Columns:
    """Columns over the cells of the raster that the lattice covers.

    ``sums`` (rows from the north, columns, 5) on the lattice: volume, mass and momentum of particles of the mean volume [m3].
    """
    spread = _spread(np.ascontiguousarray(np.moveaxis(sums[::-1], 1, 0)), particle_volume)
    for axis, count in enumerate((raster.columns, raster.rows)):
        first, spread = _shared(spread, lattice.first[axis], lattice.cell[axis], raster.cell_size[axis], count)
        if axis == 0:
            column, spread = first, np.ascontiguousarray(np.moveaxis(spread, 1, 0))
    row = raster.rows - first - len(spread)
    spread = spread[::-1]
    return Columns(spread[..., 0], spread[..., 1], spread[..., 2:], row, column)


def on_whole(found: Columns, raster: Raster) -> Columns:
    """The same columns on all cells of the raster."""
    shape = raster.rows, raster.columns
    whole = Columns(np.zeros(shape), np.zeros(shape), np.zeros((*shape, 3)))
    for name in ("volume", "mass", "momentum"):
        getattr(whole, name)[found.window] = getattr(found, name)
    return whole


def columns_of(scene: Scene, particles: Particles, particle_volume: float) -> Columns:
    """Columns over all cells of the raster, in plain NumPy: what the reference backend gives."""
    raster = scene.raster
    if not apply_to(scene):
        sums = _box_sums(scene, particles, Lattice((0, 0), (raster.columns, raster.rows), raster.cell_size))
        return Columns(sums[..., 0], sums[..., 1], sums[..., 2:])
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
    """Shares (n, count) of intervals of ``width`` [m] around x (n,) [m] in cells; what lies beyond is of the outer ones."""
    edges = np.array([-np.inf, *(cell * np.arange(1, count)), np.inf])
    covered = np.minimum(x[:, None] + 0.5 * width, edges[1:]) - np.maximum(x[:, None] - 0.5 * width, edges[:-1])
    return np.maximum(covered, 0.0) / width  # type: ignore[no-any-return]


def _spread(sums: np.ndarray, particle_volume: float) -> np.ndarray:
    """Sums (columns, rows, 5) on the lattice with every mass over the footprint that the particles around it need."""
    around = _smoothed(sums[..., 0], max(WIDTHS))
    count = np.full(around.shape, np.inf)
    np.divide(around, particle_volume / HALVES**2, out=count, where=around > 0)
    area = footprint_area(count)
    beyond = [np.asarray(part_beyond(area, *pair))[..., None] for pair in itertools.pairwise(AREAS)]
    spread = (1.0 - beyond[0]) * sums
    for width, part, further in zip(WIDTHS, beyond, (*beyond[1:], 0.0), strict=True):
        spread += _smoothed((part - further) * sums, width)
    return spread


def _smoothed(values: np.ndarray, width: int) -> np.ndarray:
    """Means over squares of ``width`` cells around each (columns, rows, ...); what is beyond the rim counts as nothing."""
    for axis in (0, 1):
        total = np.zeros_like(values)
        source, target = np.moveaxis(values, axis, 0), np.moveaxis(total, axis, 0)
        for shift in range(-(width // 2), width // 2 + 1):
            n = len(source) - abs(shift)
            target[max(-shift, 0) :][:n] += source[max(shift, 0) :][:n]
        values = total / width
    return values


def _shared(values: np.ndarray, first: int, size: float, cell: float, count: int) -> tuple[int, np.ndarray]:
    """First of the cells of the raster under the first axis of values (n, ...), and their shares by length.

    The lattice starts at its cell ``first`` of ``size`` [m]; the raster has ``count`` cells of length ``cell`` [m]. What hangs
    over its edge is mirrored.
    """
    first, values = _inside(values, first, math.ceil(count * cell / size - 1e-9))
    low = min(math.floor(first * size / cell), count - 1)
    high = min(max(math.ceil((first + len(values)) * size / cell), low + 1), count)
    edges: Any = np.arange(low, high + 1) * (cell / size)
    if high == count:
        edges[-1] = max(edges[-1], first + len(values))
    begin, end = edges[:-1, None], edges[1:, None]
    base = np.floor(edges[:-1]).astype(int)
    shares = np.zeros((len(base), values[0].size))
    flat = values.reshape(len(values), -1)
    for k in range(int(np.max(np.ceil(edges[1:]) - base))):
        place = base[:, None] + k
        part = np.maximum(np.minimum(end, place + 1) - np.maximum(begin, place), 0.0)
        part[(place < first) | (place >= first + len(values))] = 0.0
        shares += part * flat[np.clip(place[:, 0] - first, 0, len(values) - 1)]
    return low, shares.reshape(-1, *values.shape[1:])


def _inside(values: np.ndarray, first: int, count: int) -> tuple[int, np.ndarray]:
    """First cell and values (n, ...) of a lattice of ``count`` cells; what lies beyond its ends is mirrored at them."""
    place = np.arange(first, first + len(values))
    if place[0] >= 0 and place[-1] < count:
        return first, values
    place = np.where(place < 0, -1 - place, np.where(place >= count, 2 * count - 1 - place, place)).clip(0, count - 1)
    folded = np.zeros((np.ptp(place) + 1, *values.shape[1:]))
    np.add.at(folded, place - place.min(), values)
    return int(place.min()), folded
