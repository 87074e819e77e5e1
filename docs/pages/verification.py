"""Findings of the verification as a page and a figure."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.studies.verification_cases.finding import (
    SLACK,
    Bound,
    Convergence,
    Finding,
    measured_text,
    number_text,
    recorded,
    required_text,
)

WORST, BEST = "**no**", "yes"
COLUMNS = 2  # of the figure
SHOWN = 4  # orders of a case in the summary
HEADS = ("case", "subject", "quantities", "order measured (declared)", "closest to its bound: measured (required)", "holds")
OPENING = """# Verification

The scheme is compared with closed forms and manufactured solutions, and its orders of convergence are measured.

- Each case runs in CI on coarser grids with the same declared orders, in float64 on one thread.
- Bodies move in transfers as in a run: up to 4 substeps, one while nothing moves 0.01 cells in a step. U6 states its own.
- An order holds if the least-squares slope is at most {slack:g} below the declared order.
- Errors are relative unless a unit is given.

{verdict}

![Error against number of cells, one panel for each case with orders](images/verification.png)

*Measured errors (marks) and declared order (dashed).*

## Summary

{summary}

## Full tables

- {results}: measured value, required value, verdict
- {cases}

## How to make this page

    {command}

It writes the record `verification.json`. Copy it to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page,
its tables and its figure.

Record: runout {version}, commit {commit}.
"""


def page(content: Mapping[str, Any]) -> StudyPage:
    """The page of a record as :func:`runout.studies.verification.run` writes it, with its full tables and its figure."""
    findings = recorded(content)
    failed = [f.case.name for f in findings if not f.holds]
    left = [name for name in content["cases_asked"] if name not in {f.case.name for f in findings}]
    verdict = f"**Does not hold: {', '.join(failed)}.**" if failed else f"All {len(findings)} cases hold."
    text = OPENING.format(
        command=content["command"],
        version=content["version"],
        commit=content["commit"] or "unknown",
        slack=SLACK,
        verdict=f"{verdict} Not finished: {', '.join(left)}." if left else verdict,
        results=download("verification.csv", "all quantities"),
        cases=download("verification_cases.csv", "set-up and remarks of each case"),
        summary=markdown(HEADS, (_summary(f) for f in findings)),
    )
    tables = {"verification.csv": _results(findings), "verification_cases.csv": _cases(findings)}
    return StudyPage("verification", text, tables, {"images/verification.png": figure(findings)})


def _summary(finding: Finding) -> tuple[str, ...]:
    """Row of a case: its orders, and the number that is closest to its bound."""
    orders = [f"{r.order:.2f} ({r.declared:g})" for r in finding.results if isinstance(r, Convergence)]
    bounds = [r for r in finding.results if isinstance(r, Bound) and _share(r) is not None]
    closest = max(bounds, key=lambda r: _share(r) or 0.0, default=None)
    number = f"{closest.quantity}: {number_text(closest.value)} ({required_text(closest)})" if closest else ""
    case = finding.case
    shown = ", ".join(orders[:SHOWN]) + (", ..." if len(orders) > SHOWN else "")
    return case.name, case.title, str(len(finding.results)), shown, number, BEST if finding.holds else WORST


def _share(r: Bound) -> float | None:
    """Distance of a number from the middle of its range or from zero, relative to that of its bound; None without a bound."""
    if math.isfinite(r.low) and math.isfinite(r.high):
        return abs(2 * r.value - r.low - r.high) / (r.high - r.low)
    if math.isfinite(r.high):
        return r.value / r.high if r.high else 0.0
    return r.low / r.value if math.isfinite(r.low) and r.value > 0 else None


def _results(findings: Sequence[Finding]) -> str:
    """Every quantity of every case, as CSV."""
    rows = [
        (f.case.name, r.quantity, measured_text(r), required_text(r), BEST if r.holds else "no")
        for f in findings
        for r in f.results
    ]
    return as_csv(("case", "quantity", "measured", "required", "holds"), rows)


def _cases(findings: Sequence[Finding]) -> str:
    """Description of each case, as CSV."""
    rows = [(f.case.name, f.case.title, f.case.setup, f.case.remark, f"{f.seconds:.1f}") for f in findings]
    return as_csv(("case", "title", "set-up", "remark", "seconds"), rows)


def figure(findings: Sequence[Finding]) -> bytes:
    """PNG with one panel of errors over resolution for each case that has orders."""
    from matplotlib.figure import Figure

    shown = [f for f in findings if any(isinstance(r, Convergence) for r in f.results)]
    rows = max(1, math.ceil(len(shown) / COLUMNS))
    canvas = Figure(figsize=(4.6 * COLUMNS, 3.9 * rows), layout="constrained")
    for k, finding in enumerate(shown):
        _panel(canvas.add_subplot(rows, COLUMNS, k + 1), finding)
    return as_png(canvas)


def _panel(axes: Any, finding: Finding) -> None:
    for k, r in enumerate(r for r in finding.results if isinstance(r, Convergence)):
        colour = f"C{k}"
        label, mark = f"{r.quantity}: {r.order:.2f}", "osD^vP"[k % 6]
        axes.loglog(r.cells, r.errors, mark, color=colour, markerfacecolor="none", markersize=6, label=label)
        first, last = r.cells[0], r.cells[-1]
        axes.loglog([first, last], [r.errors[0], r.errors[0] * (last / first) ** -r.declared], "--", color=colour, linewidth=0.8)
    axes.set_title(f"{finding.case.name}: {finding.case.title}", fontsize=10)
    axes.set_xlabel("steps" if finding.case.name == "U10" else "cells", fontsize=9)
    axes.set_ylabel("relative error", fontsize=9)
    sizes = sorted({c for r in finding.results if isinstance(r, Convergence) for c in r.cells})
    axes.set_xticks(sizes, [f"{c:g}" for c in sizes], fontsize=8)
    axes.minorticks_off()
    low, high = axes.get_ylim()
    axes.set_ylim(low / (high / low) ** 0.6, high)  # room for the legend below
    axes.legend(fontsize=6.5, loc="lower left", title="measured order", title_fontsize=7, frameon=False)
    axes.grid(color="0.9")
