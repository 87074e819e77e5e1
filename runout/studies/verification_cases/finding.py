"""Findings of a case of verification: numbers with bounds, and orders of convergence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

SLACK = 0.2  # largest shortfall of an observed order against the declared one


@dataclass(frozen=True)
class Bound:
    """A number that must lie between ``low`` and ``high``; ``quantity`` states its unit."""

    quantity: str
    value: float
    high: float = np.inf
    low: float = -np.inf

    @property
    def holds(self) -> bool:
        """Whether the number is within its bounds; False for NaN."""
        return bool(self.low <= self.value <= self.high)


@dataclass(frozen=True)
class Convergence:
    """Errors on successively finer grids.

    Parameters
    ----------
    quantity : str
        Quantity and norm of the errors.
    cells : tuple of float
        Resolutions: cells along the reference length, or steps.
    errors : tuple of float
        One per resolution, relative.
    declared : float
        Order of the scheme; the least-squares slope may be smaller by :data:`SLACK`.
    """

    quantity: str
    cells: tuple[float, ...]
    errors: tuple[float, ...]
    declared: float

    @property
    def order(self) -> float:
        """Least-squares slope of log error over log resolution, positive when errors fall."""
        return float(-np.polyfit(np.log(self.cells), np.log(self.errors), 1)[0])

    @property
    def holds(self) -> bool:
        """Whether the observed order reaches the declared one."""
        return self.order >= self.declared - SLACK


Result = Bound | Convergence


@dataclass(frozen=True)
class Case:
    """One case: ``measure(full)`` runs it, coarse for CI or to the sizes of the documentation."""

    name: str
    title: str
    setup: str
    measure: Callable[[bool], Sequence[Result]]
    remark: str = ""


@dataclass(frozen=True)
class Finding:
    """Findings of a case, and its duration [s]."""

    case: Case
    results: tuple[Result, ...]
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether every bound and order holds."""
        return all(r.holds for r in self.results)
