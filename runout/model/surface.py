"""A smooth surface over the plan: C1 biquadratic B-spline whose coefficients sit on a lattice."""

from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numpy as np

from runout.physics import bspline, heightfield

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

    def resampled(self, spacing: tuple[float, float], origin: tuple[float, float], shape: tuple[int, int]) -> "Surface":
        """The surface as contact sees it: the spline on a lattice of the grid's nodes that follows it.

        Exact for planes and parabolas, and for a surface on that lattice.
        """
        x, y = (o + h * (0.5 * np.arange(2 * n + 3) - 1.0) for o, h, n in zip(origin, spacing, shape, strict=True))
        value, east, north = self.evaluate(x[:, None], y[None, :])
        c = _resampled(value.T, north.T).T
        c = _resampled(c, east[:, 2:-2:2])
        return Surface(c, spacing, origin)

    def elevation(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Elevation [m] at local positions [m]."""
        return self.evaluate(x, y)[0]

    def evaluate(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Elevation [m] and its slopes east and north [1] at local positions [m] of any common shape."""
        i, wx, dx = self._weights(x, 0)
        j, wy, dy = self._weights(y, 1)
        value = east = north = np.zeros(np.broadcast(i, j).shape)
        for a in range(3):
            row = [self.coefficients[i + a, j + b] for b in range(3)]
            along = heightfield.interpolate(wy, row[0], row[1], row[2])
            value = value + wx[a] * along
            east = east + dx[a] * along
            north = north + wx[a] * heightfield.interpolate(dy, row[0], row[1], row[2])
        return value, east / self.spacing[0], north / self.spacing[1]

    def _weights(self, x: np.ndarray, axis: int) -> tuple[np.ndarray, tuple, tuple]:
        q = (np.asarray(x, np.float64) - self.origin[axis]) / self.spacing[axis]
        first = np.clip(np.floor(q - 0.5).astype(np.int64), 0, self.coefficients.shape[axis] - 3)
        f = q - first
        return first, bspline.weights(f), bspline.weight_slopes(f)


def _coefficients(z: np.ndarray, averaged: int) -> np.ndarray:
    """Spline coefficients along axis 0 of elevations, each the mean of ``averaged`` values; the ground goes on beyond the rim."""
    after = 0.5 * np.diff(z, axis=0)
    before = -np.concatenate([after[:1], after])
    after = np.concatenate([after, after[-1:]])
    bends = np.pad(heightfield.second_difference(z[:-2], z[1:-1], z[2:]), ((3, 3), (0, 0)), mode="edge")
    smooth = _smoothness(*(bends[k : k + len(z)] for k in range(5)))
    return _spline_coefficient(z, before, after, smooth, heightfield.weight_of_means(averaged))  # type: ignore[no-any-return]


def _resampled(value: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Coefficients (n, m) along axis 0 from elevations [m] and slopes (2 n + 3, m) half a spacing apart."""
    last = len(value) - 4
    smooth = _bend_smoothness(*(slope[k : last + k : 2] for k in range(5)))
    return _resampled_coefficient(*(value[k : last + k : 2] for k in (1, 2, 3)), smooth)  # type: ignore[no-any-return]
