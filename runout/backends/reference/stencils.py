"""Weights of a dense grid, and sums with them, in plain NumPy."""

from typing import Any

import numpy as np

from runout.errors import CapacityError
from runout.model.particles import Particles
from runout.physics import bspline

LARGEST_GRID = 30_000_000  # nodes; about 3 GB
STENCIL = np.array([(i, j, k) for i in range(3) for j in range(3) for k in range(3)])


class Stencils:
    """The 27 nodes that each particle sees on a dense grid that repeats after ``period`` (3,) nodes, and its weights there.

    ``shape`` (3,) is the size of the grid, ``size`` its number of nodes, ``height`` that of a column, ``first`` (3,) its first
    node, which may be negative. ``node`` (n, 27) are places in the flattened grid, ``weight`` (n, 27) [1], ``arm`` (n, 27, 3) [m]
    vectors from the particle to the nodes.
    """

    def __init__(self, particles: Particles, spacing: np.ndarray, period: np.ndarray):
        self.first = particles.node.min(axis=0).astype(np.int64)
        shape = np.minimum(particles.node.max(axis=0) + 3 - self.first, period)
        self.shape, self.size, self.height = tuple(shape.tolist()), int(np.prod(shape)), int(shape[2])
        if self.size > LARGEST_GRID:
            raise CapacityError(f"the reference backend would need {self.size} nodes, at most {LARGEST_GRID} fit; use 'scan'")
        i, j, k = np.moveaxis(((particles.node - self.first)[:, None, :] + STENCIL) % period, -1, 0)
        self.node = (i * shape[1] + j) * shape[2] + k
        w = np.stack(bspline.weights(particles.offset), axis=-1)[:, range(3), STENCIL]
        self.weight = w.prod(axis=2)
        self.arm = (STENCIL - particles.offset[:, None, :]) * spacing

    def scatter(self, values: np.ndarray, chosen: Any = slice(None)) -> np.ndarray:
        """Weighted sum over particles of values (n, k) or at their nodes (n, 27, k): (nodes, k)."""
        parts = self.weight[chosen][..., None] * (values if values.ndim == 3 else values[:, None, :])
        place = self.node[chosen].ravel()
        return np.stack([np.bincount(place, part.ravel(), self.size) for part in np.moveaxis(parts, -1, 0)], axis=-1)

    def gather(self, values: np.ndarray, chosen: Any = slice(None)) -> np.ndarray:
        """Weighted mean of nodal values (nodes, k) at the particles: (n, k)."""
        return np.einsum("pn,pnk->pk", self.weight[chosen], values[self.node[chosen]])


def quotient(sums: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Nodal sums (nodes, k) by nodal mass (nodes, 1); zero where there is none, as at the very rim of a stencil."""
    return np.divide(sums, mass, out=np.zeros(sums.shape), where=mass > 0.0)
