"""Statistics over weighted members, cell by cell."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

_ROUNDING = 1e-12  # summed weights of equal members reach 1/2 exactly
_SUMMED = 2**15  # values, in double precision at a time


def normalised(weights: Sequence[float] | np.ndarray, count: int) -> np.ndarray:
    """Weights (count,) of sum 1."""
    w = np.asarray(weights, dtype=np.float64)
    if count == 0 or w.shape != (count,):
        raise ValueError(f"{count} members and {w.size} weights; at least one member, and a weight for each, are needed")
    if not (np.isfinite(w).all() and w.min() >= 0 and w.sum() > 0):
        raise ValueError(f"weights range from {w.min():g} to {w.max():g}; they must be finite, not negative, and not all 0")
    return w / w.sum()


def effective_sample_size(weights: np.ndarray) -> float:
    """Number of equally weighted members that would be as certain, 1 / sum(w^2), for weights of sum 1."""
    return float(1.0 / np.sum(np.square(weights)))


def weighted_percentiles(values: np.ndarray, weights: np.ndarray, percentiles: Sequence[float] | np.ndarray) -> np.ndarray:
    """Percentiles (k, cells) over the first axis of ``values`` (members, cells), for weights of sum 1.

    The smallest value at which the summed weight reaches the percentile (the inverted distribution function).
    """
    order = np.argsort(values, axis=0)
    reached = np.cumsum(weights[order], axis=0)
    ranks = [np.argmax(reached >= q / 100.0 - _ROUNDING, axis=0) for q in percentiles]
    index = np.stack([np.take_along_axis(order, rank[None], axis=0)[0] for rank in ranks])
    return np.take_along_axis(values, index, axis=0)


def equal(weights: np.ndarray) -> bool:
    """Whether all weights are the same, so that the values of a cell need be sorted only."""
    return bool(weights.min() == weights.max())


@dataclass(frozen=True)
class CellValues:
    """Values of the members in some cells, none below 0; cells of which a value is NaN have no meaning.

    The members that have no values here count as ``absent``, the least or the largest possible value.
    """

    values: np.ndarray  # (cells, members with values): float32; sorted in place where the weights are equal
    members: np.ndarray  # (members with values,): their numbers
    weights: np.ndarray  # (members,): weights of all members; their sum is 1
    absent: float = 0.0  # 0, or infinity for a time that never comes; then only :meth:`percentiles` has a meaning

    def __post_init__(self) -> None:
        if self.alike:
            self.values.sort(axis=1)

    @cached_property
    def alike(self) -> bool:
        """Whether all members have the same weight."""
        return equal(self.weights)

    @property
    def others(self) -> int:
        """Number of the members without values."""
        return len(self.weights) - len(self.members)

    @cached_property
    def peak(self) -> np.ndarray:
        """Largest values (cells,)."""
        largest: np.ndarray = self.values[:, -1] if self.alike else self.values.max(axis=1)
        return largest

    @property
    def mean(self) -> np.ndarray:
        """Weighted means (cells,)."""
        return self._weight_of(self.values)

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation (cells,) that the members have, with Bessel's correction for weights; NaN of a single member."""
        members = effective_sample_size(self.weights)
        if members <= 1.0:
            return np.full(len(self.values), np.nan)
        variance = self._weight_of(np.square(self.values)) - self.mean**2
        deviation: np.ndarray = np.sqrt(np.maximum(variance, 0.0) * members / (members - 1.0))
        return deviation

    def percentiles(self, percentiles: Sequence[float] | np.ndarray) -> np.ndarray:
        """Percentiles (k, cells) as :func:`weighted_percentiles` has them."""
        if not self.alike:
            nothing = np.full((1, len(self.values)), self.absent, self.values.dtype)
            weights = np.concatenate([[np.delete(self.weights, self.members).sum()], self.weights[self.members]])
            return weighted_percentiles(np.concatenate([nothing, self.values.T]), weights, percentiles)
        reached = np.cumsum(self.weights)
        below = 0 if self.absent > 0 else self.others
        ranks = [int(np.argmax(reached >= q / 100.0 - _ROUNDING)) - below for q in percentiles]
        absent, ranks_of_members = np.full_like(self.peak, self.absent), range(len(self.members))
        return np.stack([self.values[:, rank] if rank in ranks_of_members else absent for rank in ranks])

    def count(self, limit: np.floating) -> np.ndarray:
        """Number of the members that reach ``limit`` (cells,)."""
        others = self.others if limit <= 0 else 0
        if not self.alike:
            return (self.values >= limit).sum(axis=1) + others
        return self.values.shape[1] - _below(self.values, limit) + others

    def probability(self, limit: np.floating) -> np.ndarray:
        """Summed weight of the members that reach ``limit`` (cells,)."""
        if self.alike:
            return self.count(limit) / len(self.weights)
        others = np.delete(self.weights, self.members).sum() if limit <= 0 else 0.0
        return np.clip(self._weight_of(self.values >= limit) + others, 0.0, 1.0)

    def _weight_of(self, values: np.ndarray) -> np.ndarray:
        """Sum of the members' values times their weights, one after another, so that members with 0 change no bit of it."""
        weights, cells = self.weights[self.members], max(1, _SUMMED // len(self.members))
        sums = np.empty(len(values))
        for first in range(0, len(values), cells):
            weighted = values[first : first + cells] * weights
            sums[first : first + cells] = np.cumsum(weighted, axis=1, out=weighted)[:, -1]
        return sums


def _below(values: np.ndarray, limit: np.floating) -> np.ndarray:
    """Number of values below ``limit`` in each row of sorted ``values`` (cells, members), by bisection."""
    low, high = np.zeros(len(values), np.intp), np.full(len(values), values.shape[1], np.intp)
    rows = np.arange(len(values))
    for _ in range(values.shape[1].bit_length()):
        middle = (low + high) // 2
        less = (middle < high) & (values[rows, np.minimum(middle, values.shape[1] - 1)] < limit)
        low, high = np.where(less, middle + 1, low), np.where(less, high, middle)
    return low
