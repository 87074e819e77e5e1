"""A smooth surface over the plan: C1 biquadratic B-spline whose coefficients sit on a lattice."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from runout.model.registered_law import for_arrays
from runout.physics import bspline, heightfield

STRIP = 64  # rows and columns of coefficients that are resampled at once
BLOCK = 144  # rows and columns of a block whose intermediate arrays fit into the cache of a core
MANY = 0.5  # of all cells: so many that are not smooth are not looked up one by one
REACH = 3  # cells on each side that a coefficient depends on
_smoothness, _spline_coefficient = for_arrays(heightfield.smoothness), for_arrays(heightfield.spline_coefficient)
_bend_smoothness = for_arrays(heightfield.bend_smoothness, smoothness=_smoothness)
_resampled_coefficient = for_arrays(heightfield.resampled_coefficient, spline_coefficient=_spline_coefficient)


@dataclass(frozen=True)
class Surface:
    """Elevation as a biquadratic B-spline.

    Points outside the lattice see its outermost patch continued.
    """

    coefficients: np.ndarray  # (nx, ny): spline coefficients [m], float64, first index east, second north
    spacing: tuple[float, float]  # lattice spacing east and north [m]
    origin: tuple[float, float] = (0.0, 0.0)  # local position of `coefficients[0, 0]` [m]

    @classmethod
    def through(
        cls,
        elevation: np.ndarray,
        spacing: tuple[float, float],
        origin: tuple[float, float] = (0.0, 0.0),
        averaged: tuple[int, int] = (1, 1),
    ) -> "Surface":
        """Surface through lattice elevations (nx, ny) [m]: exact for planes and parabolas away from the rim.

        Each elevation is the mean of ``averaged`` point values along each axis.
        """
        c = np.asarray(elevation, np.float64)
        c = by_blocks(lambda part: _coefficients(part, averaged[0], 0), c, (REACH, 0))
        c = by_blocks(lambda part: _coefficients(part, averaged[1], 1), c, (0, REACH))
        return cls(c, (float(spacing[0]), float(spacing[1])), (float(origin[0]), float(origin[1])))

    def on_nodes(self, spacing: tuple[float, float], first: tuple[int, int], shape: tuple[int, int]) -> "Surface":
        """The spline that follows this surface, whose coefficients sit on so many nodes of a grid from the ``first`` on.

        Exact for planes and parabolas. A coefficient is the same whatever nodes are asked for with it.
        """
        c = np.empty(shape)
        for corner in product(*(range(0, count, STRIP) for count in shape)):
            part = c[corner[0] : corner[0] + STRIP, corner[1] : corner[1] + STRIP]
            starts = zip(spacing, part.shape, first, corner, strict=True)
            part[:] = self._resampled(*(h * (0.5 * np.arange(2 * count + 3) + (one + low - 1)) for h, count, one, low in starts))
        return Surface(c, (float(spacing[0]), float(spacing[1])), (first[0] * float(spacing[0]), first[1] * float(spacing[1])))

    def elevation(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Elevation [m] at local positions [m]."""
        return self.evaluate(x, y)[0]

    def evaluate(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Elevation [m] and its slopes east and north [1] at local positions [m] of any common shape."""
        (i, fx), (j, fy) = self.patch(x, 0), self.patch(y, 1)
        columns = self.coefficients.shape[1]
        value, east, north = spline_at(self.coefficients.reshape(-1), i * columns + j, columns, fx, fy)
        return value, east / self.spacing[0], north / self.spacing[1]

    def _resampled(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Coefficients (n, m) of a spline that follows the surface, from positions x (2 n + 3,) and y (2 m + 3,) [m]."""
        (i, fx), (j, fy) = self.patch(x[:, None], 0), self.patch(y, 1)
        low, high = j.min(), j.max() + 3
        rows = [self.coefficients[i[:, 0] + a, low:high] for a in range(3)]
        along = heightfield.interpolate(bspline.weights(fx), *rows)
        columns = [np.take(along, j - low + b, axis=1) for b in range(3)]
        value, north = (heightfield.interpolate(w, *columns) for w in (bspline.weights(fy), bspline.weight_slopes(fy)))
        slope, own = heightfield.interpolate(bspline.weight_slopes(fx), *rows), slice(2, -2, 2)
        beside = (np.take(slope, j[own] - low + b, axis=1) for b in range(3))
        east = heightfield.interpolate(bspline.weights(fy[own]), *beside) / self.spacing[0]
        return _resampled(_resampled(value.T, north.T / self.spacing[1]).T, east)

    def patch(self, x: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """First of the three coefficients along an axis that count at local positions [m], and offsets from it [spacings]."""
        q = (np.asarray(x, np.float64) - self.origin[axis]) / self.spacing[axis]
        first = np.clip(np.floor(q - 0.5).astype(np.int64), 0, self.coefficients.shape[axis] - 3)
        return first, q - first


def spline_at(
    c: np.ndarray, begins: np.ndarray, stride: int, fx: np.ndarray, fy: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevation and its slopes by the two coordinates [m/spacing], of points ``fx``, ``fy`` [spacings] from the first of nine.

    The nine coefficients of a point are three by three in the flat ``c``, from where it ``begins``, rows ``stride`` apart.
    """
    wx, dx, wy, dy = bspline.weights(fx), bspline.weight_slopes(fx), bspline.weights(fy), bspline.weight_slopes(fy)
    value = east = north = np.zeros(np.shape(begins))
    for a in range(3):
        row = [c[begins + (a * stride + b)] for b in range(3)]
        along = heightfield.interpolate(wy, row[0], row[1], row[2])
        value = value + wx[a] * along
        east = east + dx[a] * along
        north = north + wx[a] * heightfield.interpolate(dy, row[0], row[1], row[2])
    return value, east, north


def by_blocks(formula: Callable[[np.ndarray], np.ndarray], z: np.ndarray, reach: tuple[int, int]) -> np.ndarray:
    """Values (n, m) that a ``formula`` makes of an array (n, m), block by block, so that its intermediate arrays stay small.

    The blocks do not change a value that depends on cells at most ``reach`` rows and columns away.
    """
    result = np.empty(z.shape)
    sizes = [-(-count // -(-count // BLOCK)) for count in z.shape]
    for block in product(*(range(0, count, size) for count, size in zip(z.shape, sizes, strict=True))):
        start = [max(0, low - beside) for low, beside in zip(block, reach, strict=True)]
        sides = list(zip(block, start, sizes, reach, strict=True))
        part = formula(z[tuple(slice(first, low + size + beside) for low, first, size, beside in sides)])
        own = tuple(slice(low - first, low - first + size) for low, first, size, _ in sides)
        result[tuple(slice(low, low + size) for low, _, size, _ in sides)] = part[own]
    return result


def smoothness_along(z: np.ndarray) -> np.ndarray:
    """How smooth elevations (n, m) are along axis 0 [1]; the ground goes on beyond the rim."""
    bends = np.pad(heightfield.second_difference(z[:-2], z[1:-1], z[2:]), ((3, 3), (0, 0)), mode="edge")
    return _smoothness(*(bends[k : k + len(z)] for k in range(5)))  # type: ignore[no-any-return]


def _coefficients(z: np.ndarray, averaged: int, axis: int) -> np.ndarray:
    """Spline coefficients (n, m) along an axis of elevations, each the mean of ``averaged`` values, as beyond the rim.

    The ground goes on beyond the rim with its slope. Where it is smooth, the bounds are not needed.
    """
    along = np.moveaxis(z, axis, 0)
    after = 0.5 * np.diff(along, axis=0)
    before = -np.concatenate([after[:1], after])
    after = np.concatenate([after, after[-1:]])
    here, before, after, smooth = (np.moveaxis(v, 0, axis).ravel() for v in (along, before, after, smoothness_along(along)))
    weight, rough = heightfield.weight_of_means(averaged), np.flatnonzero(smooth < 1.0)
    if len(rough) > MANY * z.size:
        return _spline_coefficient(here, before, after, smooth, weight).reshape(z.shape)  # type: ignore[no-any-return]
    c = heightfield.smooth_coefficient(here, before, after, weight)
    c[rough] = _spline_coefficient(*(v[rough] for v in (here, before, after, smooth)), weight)
    return c.reshape(z.shape)  # type: ignore[no-any-return]


def _resampled(value: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Coefficients (n, m) along axis 0 from elevations [m] and slopes (2 n + 3, m) half a spacing apart."""
    last = len(value) - 4
    smooth = _bend_smoothness(*(slope[k : last + k : 2] for k in range(5)))
    return _resampled_coefficient(*(value[k : last + k : 2] for k in (1, 2, 3)), smooth)  # type: ignore[no-any-return]
