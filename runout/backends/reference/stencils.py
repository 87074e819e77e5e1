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

    Attributes
    ----------
    first : (3,) int
        Grid node of the first corner; may be negative.
    size : int
        Number of nodes of the grid.
    node : (n, 27) int
        Position of the nodes in the flattened grid.
    weight : (n, 27) [1]
    arm : (n, 27, 3) [m]
        Vectors from the particle to the nodes.
    slope : (n, 27, 3) [1/m]
        Gradients of the weights.
    """

    def __init__(self, particles: Particles, spacing: np.ndarray, period: np.ndarray):
        self.first = particles.node.min(axis=0).astype(np.int64)
        shape = np.minimum(particles.node.max(axis=0) + 3 - self.first, period)
        self.size = int(np.prod(shape))
        if self.size > LARGEST_GRID:
            raise CapacityError(f"the reference backend would need {self.size} nodes, at most {LARGEST_GRID} fit; use 'scan'")
        i, j, k = np.moveaxis(((particles.node - self.first)[:, None, :] + STENCIL) % period, -1, 0)
        self.node = (i * shape[1] + j) * shape[2] + k
        w = np.stack(bspline.weights(particles.offset), axis=-1)
        self.weight = w[:, 0, STENCIL[:, 0]] * w[:, 1, STENCIL[:, 1]] * w[:, 2, STENCIL[:, 2]]
        slopes = np.stack(bspline.weight_slopes(particles.offset), axis=-1) / spacing[:, None]
        parts = [slopes[:, j, STENCIL[:, j]] for j in range(3)]
        along = [w[:, j, STENCIL[:, j]] for j in range(3)]
        self.slope = np.stack([parts[j] * along[j - 1] * along[j - 2] for j in range(3)], axis=-1)
        self.arm = (STENCIL - particles.offset[:, None, :]) * spacing

    def scatter(self, values: np.ndarray, chosen: Any = slice(None)) -> np.ndarray:
        """Weighted sum over particles of values (n, k) or at their nodes (n, 27, k): (nodes, k)."""
        parts = self.weight[chosen][..., None] * (values if values.ndim == 3 else values[:, None, :])
        place = self.node[chosen].ravel()
        return np.stack([np.bincount(place, part.ravel(), self.size) for part in np.moveaxis(parts, -1, 0)], axis=-1)

    def gather(self, values: np.ndarray, chosen: Any = slice(None)) -> np.ndarray:
        """Weighted mean of nodal values (nodes, k) at the particles: (n, k)."""
        return np.einsum("pn,pnk->pk", self.weight[chosen], values[self.node[chosen]])

    def scatter_slopes(self, tensors: np.ndarray) -> np.ndarray:
        """Sum over particles of tensors (n, 3, 3) times the gradients of their weights: (nodes, 3)."""
        parts = np.einsum("pij,pnj->pni", tensors, self.slope).reshape(-1, 3)
        return np.stack([np.bincount(self.node.ravel(), part, self.size) for part in parts.T], axis=-1)

    def gradient(self, values: np.ndarray) -> np.ndarray:
        """Gradient of nodal values (nodes, k) at the particles: (n, k, 3)."""
        return np.einsum("pnk,pnj->pkj", values[self.node], self.slope)

    def average(self, share: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Mean (nodes, 1) over particles of values (n,), each with its weight times its share (n,); zero where nobody is."""
        total, sums = self.scatter(np.column_stack([share, share * values])).T
        return np.divide(sums, total, out=np.zeros_like(sums), where=total > 0.0)[:, None]
