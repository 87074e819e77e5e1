"""Findings of a case of verification: numbers with bounds and orders of convergence, as values and as JSON."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout import __version__

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
    """Errors on successively finer grids."""

    quantity: str  # quantity and norm of the errors
    cells: tuple[float, ...]  # resolutions: cells along the reference length, or steps
    errors: tuple[float, ...]  # one per resolution, relative
    declared: float  # order of the scheme; the least-squares slope may be smaller by :data:`SLACK`

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


def as_lines(finding: Finding) -> list[str]:
    """Lines for the terminal on a case."""
    head = f"{finding.case.name} {finding.case.title}: {'holds' if finding.holds else 'DOES NOT HOLD'} ({finding.seconds:.1f} s)"
    return [head, *(f"  {'' if r.holds else 'NOT: '}{r.quantity}: {measured_text(r)}; {required_text(r)}" for r in finding.results)]


def measured_text(r: Result) -> str:
    """What was measured, in words."""
    if isinstance(r, Bound):
        return number_text(r.value)
    errors = ", ".join(f"{c:g}: {e:.2g}" for c, e in zip(r.cells, r.errors, strict=True))
    return f"{errors}; order {r.order:.2f}"


def required_text(r: Result) -> str:
    """What is required, in words."""
    if isinstance(r, Convergence):
        return f"order {r.declared:g}"
    if math.isfinite(r.low) and math.isfinite(r.high):
        return f"{number_text(r.low)} to {number_text(r.high)}"
    if math.isfinite(r.low):
        return f"at least {number_text(r.low)}"
    return f"at most {number_text(r.high)}" if math.isfinite(r.high) else "reported"


def number_text(value: float) -> str:
    """A number with a few digits."""
    return f"{value:.4g}" if 1e-2 <= abs(value) < 1e4 or value == 0 else f"{value:.2g}"


def as_json(findings: Sequence[Finding], full: bool) -> dict[str, Any]:
    """All findings, ready for a JSON file; infinite bounds are None."""
    return {"version": __version__, "full": full, "holds": all(f.holds for f in findings), "cases": [_case(f) for f in findings]}


def finding_of(record: Mapping[str, Any], case: Case) -> Finding:
    """Finding of a case from the result of :func:`as_json`."""
    return Finding(case, tuple(_result_of(r) for r in record["results"]), record["seconds"])


def recorded(content: Mapping[str, Any]) -> list[Finding]:
    """All findings of a record, with the recorded names and texts."""
    return [finding_of(c, Case(c["name"], c["title"], c["setup"], lambda full: [], c["remark"])) for c in content["cases"]]


def _case(finding: Finding) -> dict[str, Any]:
    case = finding.case
    head = {"name": case.name, "title": case.title, "setup": case.setup, "holds": finding.holds, "seconds": finding.seconds}
    return {**head, "results": [_result(r) for r in finding.results], "remark": case.remark}


def _result(r: Result) -> dict[str, Any]:
    if isinstance(r, Convergence):
        sizes = {"cells": list(r.cells), "errors": list(r.errors)}
        return {"quantity": r.quantity, **sizes, "order": r.order, "declared_order": r.declared, "holds": r.holds}
    low, high = (b if math.isfinite(b) else None for b in (r.low, r.high))
    return {"quantity": r.quantity, "value": float(r.value), "low": low, "high": high, "holds": r.holds}


def _result_of(r: Mapping[str, Any]) -> Result:
    if "cells" in r:
        return Convergence(r["quantity"], tuple(r["cells"]), tuple(r["errors"]), r["declared_order"])
    high, low = (default if r[end] is None else r[end] for end, default in (("high", math.inf), ("low", -math.inf)))
    return Bound(r["quantity"], r["value"], high, low)
