"""What the verification found, as JSON, as a page of the documentation and as a figure."""

import math
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

from pipelines.verification_cases.finding import Bound, Case, Convergence, Finding, Result
from runout import __version__

WORST, BEST = "**no**", "yes"
COLUMNS = 3  # of the figure
OPENING = """# Verification

Closed forms, manufactured solutions and convergence orders of the scheme. Written by `{command}`{code}; do not edit. Every case
runs in CI on coarser grids, with the same declared orders, in float64 on one thread. An order counts as reached when the
least-squares slope is at most {slack:g} below the declared one. Errors are relative unless a unit is given.

{verdict}

![Errors over resolution, one panel a case](images/verification.png)

*Measured errors (marks) and the declared order (dashed).*
"""


def as_json(findings: Sequence[Finding], full: bool) -> dict[str, Any]:
    """Everything measured, ready for a JSON file; infinite bounds are None."""
    return {"version": __version__, "full": full, "holds": all(f.holds for f in findings), "cases": [_case(f) for f in findings]}


def kept(record: Mapping[str, Any], case: Case) -> Finding:
    """The finding of a case from what :func:`as_json` made of it."""
    return Finding(case, tuple(_kept_result(r) for r in record["results"]), record["seconds"])


def as_markdown(
    findings: Sequence[Finding], command: str, slack: float, left: Sequence[str] = (), commit: str | None = None
) -> str:
    """The page: a section a case with its set-up, its table and what does not hold; names the cases that are ``left``."""
    failed = [f.case.name for f in findings if not f.holds]
    verdict = f"**Does not hold: {', '.join(failed)}.**" if failed else f"All {len(findings)} cases hold."
    if left:
        verdict += f" Not finished: {', '.join(left)}."
    code = f" at commit {commit}" if commit else ""
    parts = [OPENING.format(command=command, code=code, slack=slack, verdict=verdict)]
    for finding in findings:
        case = finding.case
        parts.append(f"## {case.name}: {case.title}\n\n{_sentence(case.setup)} ({finding.seconds:.1f} s.)\n")
        parts.append(_table(finding.results))
        if case.remark:
            parts.append(case.remark + "\n")
    return "\n".join(parts)


def as_lines(finding: Finding) -> list[str]:
    """What the terminal says of a case."""
    head = f"{finding.case.name} {finding.case.title}: {'holds' if finding.holds else 'DOES NOT HOLD'} ({finding.seconds:.1f} s)"
    return [head, *(f"  {'' if r.holds else 'NOT: '}{r.quantity}: {_measured(r)}; {_required(r)}" for r in finding.results)]


def figure(findings: Sequence[Finding]) -> bytes:
    """PNG with one panel of errors over resolution for each case that has orders."""
    from matplotlib.figure import Figure

    shown = [f for f in findings if any(isinstance(r, Convergence) for r in f.results)]
    rows = max(1, math.ceil(len(shown) / COLUMNS))
    canvas = Figure(figsize=(4.6 * COLUMNS, 3.9 * rows), layout="constrained")
    for k, finding in enumerate(shown):
        _panel(canvas.add_subplot(rows, COLUMNS, k + 1), finding)
    picture = BytesIO()
    canvas.savefig(picture, format="png", dpi=100)
    return picture.getvalue()


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


def _table(results: Sequence[Result]) -> str:
    lines = ["| quantity | measured | required | holds |", "|---|---|---|---|"]
    lines += [f"| {r.quantity} | {_measured(r)} | {_required(r)} | {BEST if r.holds else WORST} |" for r in results]
    return "\n".join(lines) + "\n"


def _measured(r: Result) -> str:
    if isinstance(r, Bound):
        return _number(r.value)
    errors = ", ".join(f"{c:g}: {e:.2g}" for c, e in zip(r.cells, r.errors, strict=True))
    return f"{errors}; order {r.order:.2f}"


def _required(r: Result) -> str:
    if isinstance(r, Convergence):
        return f"order {r.declared:g}"
    if math.isfinite(r.low) and math.isfinite(r.high):
        return f"{_number(r.low)} to {_number(r.high)}"
    if math.isfinite(r.low):
        return f"at least {_number(r.low)}"
    return f"at most {_number(r.high)}" if math.isfinite(r.high) else "reported"


def _number(value: float) -> str:
    return f"{value:.4g}" if 1e-2 <= abs(value) < 1e4 or value == 0 else f"{value:.2g}"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


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
