"""Converts findings of the verification to JSON and back."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from runout import __version__
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Finding, Result


def as_json(findings: Sequence[Finding], full: bool) -> dict[str, Any]:
    """All findings, ready for a JSON file; infinite bounds are None."""
    return {"version": __version__, "full": full, "holds": all(f.holds for f in findings), "cases": [_case(f) for f in findings]}


def kept(record: Mapping[str, Any], case: Case) -> Finding:
    """Finding of a case from the result of :func:`as_json`."""
    return Finding(case, tuple(_kept_result(r) for r in record["results"]), record["seconds"])


def recorded(content: Mapping[str, Any]) -> list[Finding]:
    """All findings of a record, with the recorded names and texts."""
    return [kept(c, Case(c["name"], c["title"], c["setup"], lambda full: [], c["remark"])) for c in content["cases"]]


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


def _kept_result(r: Mapping[str, Any]) -> Result:
    if "cells" in r:
        return Convergence(r["quantity"], tuple(r["cells"]), tuple(r["errors"]), r["declared_order"])
    high, low = (default if r[end] is None else r[end] for end, default in (("high", math.inf), ("low", -math.inf)))
    return Bound(r["quantity"], r["value"], high, low)
