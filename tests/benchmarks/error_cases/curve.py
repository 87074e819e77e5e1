"""Curves of error against cell size and time: order, floor and Pareto front."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

SAME = 1e-3  # relative difference of errors that is rounding
HIDDEN = 0.3  # floors below this share of the smallest error count as none


@dataclass(frozen=True)
class Fit:
    """Errors e(h) = sqrt((C h^p)^2 + f^2): order p, factor C, floor f (0 where none is seen)."""

    order: float
    factor: float
    floor: float

    def at(self, cell: float) -> float:
        """Error on cells of a size in the unit of the fit."""
        return float(np.hypot(self.factor * cell**self.order, self.floor))


def fitted(cells: Sequence[float], errors: Sequence[float]) -> Fit | None:
    """Fit of errors over sizes of cells (in any unit), relative deviations least; None with fewer than two grids.

    A floor is sought from four grids on: three points would always lie on the curve.
    """
    h, e = np.asarray(cells, float), np.asarray(errors, float)
    if len(h) < 2 or not (e > 0).all():
        return None
    slope, start = np.polyfit(np.log(h), np.log(e), 1)
    plain = Fit(float(slope), float(np.exp(start)), 0.0)
    if len(h) < 4:
        return plain

    def off(x: np.ndarray) -> np.ndarray:
        return 0.5 * np.log(np.exp(2 * (x[1] + x[0] * np.log(h))) + np.exp(2 * x[2])) - np.log(e)

    tries = [least_squares(off, [max(slope, 1.0), start, np.log(share * e.min())]) for share in (0.1, 0.9)]
    p, factor, floor = min(tries, key=lambda t: t.cost).x
    if np.exp(floor) < HIDDEN * e.min() or not 0 < p < 6:
        return plain
    return Fit(float(p), float(np.exp(factor)), float(np.exp(floor)))


def front(costs: Sequence[float], errors: Sequence[float]) -> list[bool]:
    """Points on the Pareto front: no other point has lower cost and error, or equals one and improves the other."""
    c, e = np.asarray(costs, float), np.asarray(errors, float)
    return [not bool(((c <= a) & (e <= b) & ((c < a) | (e < b))).any()) for a, b in zip(c, e, strict=True)]


def on_front(curves: Mapping[str, Sequence[Mapping[str, Any]]], cost: str = "particle_steps") -> dict[str, list[bool]]:
    """Which points of each curve are on the Pareto front of error over a cost, among those of all curves."""
    everything = [p for curve in curves.values() for p in curve]
    best = iter(front([p[cost] for p in everything], [p["error"] for p in everything]))
    return {name: [next(best) for _ in curve] for name, curve in curves.items()}


def cost_at(error: float, costs: Sequence[float], errors: Sequence[float]) -> float | None:
    """Cost at which a curve reaches an error, between its points (log-log); None where it never does, or starts below it.

    Errors beyond an end of the curve by less than :data:`SAME` count as that end.
    """
    order = np.argsort(costs)
    c, e = np.log(np.asarray(costs, float)[order]), np.log(np.asarray(errors, float)[order])
    wanted, nearest = np.log(error), np.clip(np.log(error), e.min(), e.max())
    if abs(wanted - nearest) > np.log1p(SAME):
        return None
    for k in range(len(e) - 1):
        if e[k] >= nearest >= e[k + 1] and e[k] > e[k + 1]:
            share = (e[k] - nearest) / (e[k] - e[k + 1])
            return float(np.exp(c[k] + share * (c[k + 1] - c[k])))
    return None
