"""Relief that a grid can carry: elevations filtered by the spacing of the grid, and where those of the raster stay.

Relief of fewer than about four grid cells is not resolved. A flow meets it as friction, and as another one for each ratio of grid
and raster. So the grid gets the raster, without its waves of two cells, averaged at its own nodes over a triangle somewhat wider
than one of its cells. The raster itself remains where it is smooth; where its waves of two cells are resolved, unless it is rougher
than terrain is; and at what stands out of the roughness around it, since dams, gullies and cliffs are what a map is asked for.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from runout.model.surface import Surface, by_blocks
from runout.physics import bspline, heightfield
from runout.terrain.crests import Crests

HALF_WIDTH = (
    0.7  # of the filter, over the spacing of the grid: wider ones take channels, on narrower ones the place of the grid counts
)
SMOOTH = 8.0, 5.5  # cells in a wave, of the raster and of the grid: relief of longer ones than the one is smooth, of the other not
ROUGH = 0.65, 0.75  # two-cell share: up to the one it is that of terrain, from the other on more; white noise has 0.85
RESOLVED = 3.0, 4.0  # grid cells in a wave of two cells of the raster: up to the one it is filtered, from the other on it stays
NARROWEST = 0.05  # cells: narrower triangles make no difference, and their weights lose digits
AROUND = 11  # cells across the window of that share
STAND_OUT = 5.0, 10.0  # times the roughness: what differs from the ground around it by the one is filtered, by the other kept
WINDOW = 31  # cells across the window of the roughness
BESIDE = 3  # cells to the ground on each side
STRIP = 100_000  # numbers that are weighted at once
LEAST = 1e-9  # of all heights: differences that rounding makes


def half_width(spacing: Sequence[float]) -> tuple[float, float]:
    """Half-width [m] of the filter, east and north, for a grid of this ``spacing`` [m]."""
    return HALF_WIDTH * spacing[0], HALF_WIDTH * spacing[1]


def filtered(z: np.ndarray, half_width: float, places: np.ndarray) -> np.ndarray:
    """Means (k, m) of elevations (n, m) along axis 0 over a triangle around each of k ``places``: :func:`filter_weights`."""
    return np.asarray(filter_weights(len(z), half_width, places) @ z)


def filter_weights(count: int, half_width: float, places: np.ndarray) -> Any:
    """Sparse matrix (k, ``count``) of means of elevations over a triangle around each of k ``places``.

    The raster is taken as linear between the middles of its cells, without its waves of two cells. Planes stay; no extremum
    arises that the elevations do not have. Beyond the rim the ground is mirrored at the outermost cell.

    Parameters
    ----------
    count : int
        Cells of the raster.
    half_width : float
        Of the triangle [cells].
    places : ndarray (k,)
        [cells], 0 in the middle of the first cell.
    """
    half_width = max(half_width, NARROWEST)
    reach = int(np.ceil(half_width)) + 2
    cell = np.floor(places).astype(np.int64)[:, None] + np.arange(-reach, reach + 2)
    return _matrix(cell, _weights(cell - places[:, None], half_width), count)


def mean_weights(count: int, each: int) -> Any:
    """Sparse matrix (k, ``count``) of means of ``each`` cells; the last ones may lie beyond the rim."""
    cell = np.arange(0, count, each)[:, None] + np.arange(each)
    return _matrix(cell, np.full(cell.shape, 1.0 / each), count)


def spline_weights(surface: Surface, axis: int, positions: np.ndarray) -> Any:
    """Sparse matrix (k, n) of elevations at ``positions`` (k,) [m] from the n coefficients of a surface along an axis."""
    first, offset = surface.patch(positions, axis)
    weight = np.stack(bspline.weights(offset), axis=1)
    return _matrix(first[:, None] + np.arange(3), weight, surface.coefficients.shape[axis])


def _matrix(cell: np.ndarray, weight: np.ndarray, count: int) -> Any:
    """Sparse matrix (k, ``count``) with the ``weight`` (k, t) of each ``cell`` (k, t), mirrored at the outermost cells."""
    from scipy import sparse

    rim = np.where(cell < 0, 0, count - 1)
    beyond = (cell < 0) | (cell >= count)
    inside = np.clip(np.where(beyond, 2 * rim - cell, cell), 0, count - 1)
    row = np.broadcast_to(np.arange(len(cell))[:, None], cell.shape)
    entries = np.concatenate([np.where(beyond, -weight, weight).ravel(), 2.0 * weight[beyond]])
    at = np.concatenate([row.ravel(), row[beyond]]), np.concatenate([inside.ravel(), rim[beyond]])
    return sparse.csr_array((entries, at), shape=(len(cell), count))


def along_both(rows: Any, values: np.ndarray, columns: Any) -> np.ndarray:
    """Values (n, m) weighted along both axes by matrices (k, n) and (l, m): (k, l)."""
    result = np.empty((rows.shape[0], columns.shape[0]))
    for strip in strips(result.shape):
        result[strip] = (columns @ (rows[strip] @ values).T).T
    return result


def between(values: np.ndarray, places: Sequence[np.ndarray]) -> np.ndarray:
    """Values (nx, ny) of cells at all pairs of ``places`` [cells], linear between their middles."""
    weights = []
    for count, place in zip(values.shape, places, strict=True):
        first = np.clip(np.floor(place).astype(np.int64), 0, max(count - 2, 0))
        share = np.clip(place - first, 0.0, 1.0)
        weights.append(_matrix(first[:, None] + np.arange(2), np.stack([1.0 - share, share], axis=1), count))
    return along_both(weights[0], values, weights[1])


def strips(shape: tuple[int, ...]) -> Iterator[slice]:
    """Rows of an array that are made at once, so that they stay in the cache."""
    size = max(1, STRIP // shape[1])
    return (slice(first, first + size) for first in range(0, shape[0], size))


def _weights(x: np.ndarray, half_width: float) -> np.ndarray:
    """Weights of cells at distances ``x`` [cells] (rows add up to 1): triangle, linear raster, and [1 2 1]/4 of its cells."""
    cubic = [[np.abs(x + a + b * half_width) ** 3 for b in (-1, 0, 1)] for a in (-2, -1, 0, 1, 2)]
    over = [one[0] - 2.0 * one[1] + one[2] for one in cubic]  # |x|^3/12 is the fourfold integral of a point
    linear = [heightfield.second_difference(*over[k : k + 3]) for k in range(3)]
    weight = np.maximum(linear[1] + 0.25 * heightfield.second_difference(*linear), 0.0)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def two_cell_share(z: np.ndarray) -> np.ndarray:
    """Share of waves of two cells in the relief around each elevation (nx, ny), 0 to 1: sin^2(pi/n) for waves of n cells.

    The oscillation of two cells that the fourth differences show over that of the second ones, root mean squares in a window,
    along the axis where it is larger. 0 where the ground is plane.
    """
    least = (4 * AROUND) ** 2 * (1e-24 * float(np.square(np.ptp(z))) + 1e-300)
    beside = AROUND // 2 + 2
    return by_blocks(lambda part: np.maximum(_share_along(part, least), _share_along(part.T, least).T), z, (beside, beside))


def _share_along(z: np.ndarray, least: float) -> np.ndarray:
    """:func:`two_cell_share` along axis 0; where the sum of squares of bends is below the ``least`` [m2], the ground is plane."""
    bend = _bend(np.concatenate([2.0 * z[:1] - z[2:0:-1], z, 2.0 * z[-1:] - z[-2:-4:-1]]))
    squares = [window_sums(window_sums(v * v, AROUND).T, AROUND).T for v in (_bend(bend), bend[1:-1])]
    return np.asarray(0.25 * np.sqrt(squares[0] / np.maximum(squares[1], least)))  # second differences: 4 times the oscillation


def window_sums(values: np.ndarray, width: int) -> np.ndarray:
    """Sums (n, m) along axis 0 of ``width`` values around each; beyond the rim stand those of the outermost cells."""
    beside, count = width // 2, len(values)
    ends = [np.broadcast_to(end, (beside, *values.shape[1:])) for end in (values[:1], values[-1:])]
    part = np.concatenate([ends[0], values, ends[1]])  # sums of 1, 2, 4, ... values
    total, size = part[:count], 1
    for digit in f"{width >> 1:b}"[::-1]:
        part, size = part[:-size] + part[size:], 2 * size
        if digit == "1":
            first = width & (size - 1)
            total = total + part[first : first + count]
    return total


def resolved_in(spacing: Sequence[float], cell: Sequence[float]) -> float:
    """Part of the waves of two cells of a raster with ``cell`` [m] that a grid of this ``spacing`` [m] resolves, 0 to 1."""
    ratio = max(h / one for h, one in zip(spacing, cell, strict=True))
    return float(_ramp(np.asarray(2.0 / ratio), RESOLVED))


def stays(two_cell_share: np.ndarray, resolved: float, coarser: float = 1.0) -> np.ndarray:
    """How much of each elevation stays unfiltered, 0 to 1, by the share of waves of two cells.

    ``resolved`` is :func:`resolved_in`, ``coarser`` the ratio of the cells of the grid and those of the share. All of it
    stays where the ground is smooth, and where waves of two cells are resolved and no more than those of terrain.
    """
    long, short = (math.sin(math.pi / (cells * max(1.0, coarser))) ** 2 for cells in SMOOTH)
    smooth, terrain = 1.0 - _ramp(two_cell_share, (long, short)), 1.0 - _ramp(two_cell_share, ROUGH)
    return np.maximum(smooth, terrain * resolved)


def _ramp(value: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """0 up to the first end, 1 from the second one on."""
    return np.clip((value - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)


def standing_out(z: np.ndarray) -> np.ndarray:
    """How much of each elevation (nx, ny) [m] stays, 0 to 1, since it stands out of the roughness around: a dam, a gully, a cliff.

    By its difference from the ground on both sides over the roughness, a mean of these differences that hardly knows of few large
    ones: the mean of their fourth roots.
    """
    from scipy import ndimage

    falls = np.zeros(z.shape)
    for axis in (0, 1):
        rows = np.pad(np.moveaxis(z, axis, 0), ((BESIDE, BESIDE), (0, 0)), mode="reflect", reflect_type="odd")
        fall = 0.5 * np.abs(heightfield.second_difference(rows[: -2 * BESIDE], rows[BESIDE:-BESIDE], rows[2 * BESIDE :]))
        falls = np.maximum(falls, np.moveaxis(fall, 0, axis))
    falls = np.where(falls > LEAST * np.ptp(z), falls, 0.0)
    rough = np.maximum(ndimage.uniform_filter(np.sqrt(np.sqrt(falls)), WINDOW, mode="nearest"), 0.0) ** 4
    stands = _ramp(falls / np.maximum(rough, 1e-9 * np.maximum(falls, 1e-300)), STAND_OUT)
    return np.asarray(ndimage.maximum_filter(stands, 3, mode="nearest"))


def cells_of(crests: Crests, shape: tuple[int, int], size: tuple[float, float]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Cells (k,) east and north of crests: those to the south-west of points between cells, and those to the north-east."""
    x, y = (np.where(crests.axis == axis, crests.along, crests.across) / size[axis] for axis in (0, 1))

    def cells(place: np.ndarray, count: int) -> np.ndarray:
        return np.clip(np.floor(place).astype(np.int64), 0, count - 1)

    return [(cells(x + aside, shape[0]), cells(y + aside, shape[1])) for aside in (-1e-6, 1e-6)]


def _bend(z: np.ndarray) -> np.ndarray:
    """Second differences [m] along axis 0 of elevations (n, m): (n - 2, m)."""
    return heightfield.second_difference(z[:-2], z[1:-1], z[2:])  # type: ignore[no-any-return]
