"""A smooth surface over the plan: C1 biquadratic B-spline whose coefficients sit on a lattice."""

from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numpy as np

from runout.physics import bspline, heightfield

STRIP = 64  # rows of coefficients that are resampled at once
_EXTREMA = {"min": np.minimum, "max": np.maximum}


def _for_arrays(formula: Any, **formulas: Any) -> FunctionType:
    """A formula with extrema, for arrays; ``formulas`` are what it calls, for arrays."""
    return FunctionType(formula.__code__, {**formula.__globals__, **_EXTREMA, **formulas})


_smoothness, _spline_coefficient = _for_arrays(heightfield.smoothness), _for_arrays(heightfield.spline_coefficient)
_bend_smoothness = _for_arrays(heightfield.bend_smoothness, smoothness=_smoothness)
_resampled_coefficient = _for_arrays(heightfield.resampled_coefficient, spline_coefficient=_spline_coefficient)


@dataclass(frozen=True)
class Surface:
    """Elevation as a biquadratic B-spline.

    Parameters
    ----------
    coefficients : ndarray (nx, ny)
        Spline coefficients [m], float64, first index east, second north.
    spacing : tuple of float
        Lattice spacing east and north [m].
    origin : tuple of float
        Local position of ``coefficients[0, 0]`` [m].

    Points outside the lattice see its outermost patch continued.
    """

    coefficients: np.ndarray
    spacing: tuple[float, float]
    origin: tuple[float, float] = (0.0, 0.0)

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
        c = _coefficients(np.asarray(elevation, np.float64), averaged[0])
        c = _coefficients(c.T, averaged[1]).T
        return cls(np.ascontiguousarray(c), (float(spacing[0]), float(spacing[1])), (float(origin[0]), float(origin[1])))

    def on_nodes(self, spacing: tuple[float, float], first: tuple[int, int], shape: tuple[int, int]) -> "Surface":
        """The spline that follows this surface, whose coefficients sit on so many nodes of a grid from the ``first`` on.

        Exact for planes and parabolas. A coefficient is the same whatever nodes are asked for with it.
        """
        y = spacing[1] * (0.5 * np.arange(2 * shape[1] + 3) + (first[1] - 1))
        c = np.empty(shape)
        for row in range(0, shape[0], STRIP):
            rows = min(STRIP, shape[0] - row)
            x = spacing[0] * (0.5 * np.arange(2 * rows + 3) + (first[0] + row - 1))
            value, east, north = self._on_lattice(x, y)
            c[row : row + rows] = _resampled(_resampled(value.T, north.T).T, east[:, 2:-2:2])
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

    def on_lattice(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Elevation [m] at all pairs of local positions x (n,) and y (m,) [m]."""
        return self._on_lattice(x, y)[0]

    def _on_lattice(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """:meth:`evaluate` at all pairs of positions x (n,) and y (m,) [m], one axis after the other."""
        (i, fx), (j, fy) = self.patch(x[:, None], 0), self.patch(y, 1)
        low, high = j.min(), j.max() + 3
        rows = [self.coefficients[i[:, 0] + a, low:high] for a in range(3)]
        along, slope = (heightfield.interpolate(w, *rows) for w in (bspline.weights(fx), bspline.weight_slopes(fx)))
        columns = [np.take(along, j - low + b, axis=1) for b in range(3)]
        value = heightfield.interpolate(bspline.weights(fy), *columns)
        north = heightfield.interpolate(bspline.weight_slopes(fy), *columns)
        east = heightfield.interpolate(bspline.weights(fy), *(np.take(slope, j - low + b, axis=1) for b in range(3)))
        return value, east / self.spacing[0], north / self.spacing[1]

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


def smoothness_along(z: np.ndarray) -> np.ndarray:
    """How smooth elevations (n, m) are along axis 0 [1]; the ground goes on beyond the rim."""
    bends = np.pad(heightfield.second_difference(z[:-2], z[1:-1], z[2:]), ((3, 3), (0, 0)), mode="edge")
    return _smoothness(*(bends[k : k + len(z)] for k in range(5)))  # type: ignore[no-any-return]


def _coefficients(z: np.ndarray, averaged: int) -> np.ndarray:
    """Spline coefficients along axis 0 of elevations, each the mean of ``averaged`` values; the ground goes on beyond the rim."""
    after = 0.5 * np.diff(z, axis=0)
    before = -np.concatenate([after[:1], after])
    after = np.concatenate([after, after[-1:]])
    return _spline_coefficient(z, before, after, smoothness_along(z), heightfield.weight_of_means(averaged))  # type: ignore[no-any-return]


def _resampled(value: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Coefficients (n, m) along axis 0 from elevations [m] and slopes (2 n + 3, m) half a spacing apart."""
    last = len(value) - 4
    smooth = _bend_smoothness(*(slope[k : last + k : 2] for k in range(5)))
    return _resampled_coefficient(*(value[k : last + k : 2] for k in (1, 2, 3)), smooth)  # type: ignore[no-any-return]
