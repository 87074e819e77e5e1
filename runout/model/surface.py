"""A smooth surface over the plan: C1 biquadratic B-spline whose coefficients sit on a lattice."""

from dataclasses import dataclass

import numpy as np

from runout.physics import bspline, heightfield


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
    def through(cls, elevation: np.ndarray, spacing: tuple[float, float], origin: tuple[float, float] = (0.0, 0.0)) -> "Surface":
        """Surface through lattice elevations (nx, ny) [m]: exact for planes and parabolas away from the rim."""
        z = np.pad(np.asarray(elevation, np.float64), 1, mode="reflect", reflect_type="odd")
        c = heightfield.quasi_interpolant(z[:-2], z[1:-1], z[2:])
        c = heightfield.quasi_interpolant(c[:, :-2], c[:, 1:-1], c[:, 2:])
        return cls(np.ascontiguousarray(c), (float(spacing[0]), float(spacing[1])), (float(origin[0]), float(origin[1])))

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
