"""Page of the coverage of the error bars: how many hold, and how wide they are beside the true difference."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from runout.studies.study_page import StudyPage, as_csv, as_png, download, markdown

NAMES = {"f99": "front of 99 % of the mass"}
COLUMNS = (
    *("site", "friction", "cell", "quantity", "coarse", "middle", "fine", "spread"),
    *("order", "converging", "error", "truth", "holds"),
)
OPENING = """# Coverage of the error bars

`runout verify SITE --convergence` gives each quantity an error bar from three grids. A bar should contain the value
of a grid twice as fine.

**{held} of {count} bars hold ({share:.0f} %)**: {sites}. Of the {trusted} bars whose grids show a converging order,
{trusted_held} hold.

![Difference from the value of the fine grid against the bar](error_bars.png)

*Below the line: the bar holds. Differences below 1e-4 are drawn at 1e-4.*

{table}

Bars and differences are medians, relative to the value of the finest grid of a case. The bars are wide because most
grids of the study are too coarse to show an order; the bar then assumes an order of 0.5.

The study uses a sequence of seven grids, each finer by the square root of two, with basal friction angles of
{frictions} deg, for 60 s. A case uses three neighbouring grids for the bar, and the grid twice as fine for the
true value. Cells of the finest grid of a case: {cells}.

## Full table

{cases}: values on the three grids, order, bar, true value

## How to make this page

    python -m runout.studies.error_bar_coverage DIR

It writes this page, its table, its figure and the record `error_bars.json`. `python -m runout.studies.documentation`
makes the same files again from the record in `tests/benchmarks/records/`.

Record: runout {runout}, commit {commit}, numba {numba}, NumPy {numpy}, backend scan, float32; {cores} cores
({architecture}), with other work, {seconds} s.
"""


def page(content: Mapping[str, Any]) -> StudyPage:
    """The page of a record of :mod:`runout.studies.error_bar_coverage`."""
    cases, versions = content["cases"], content["versions"]
    trusted = [case for case in cases if case["converging"]]
    heads = ("quantity", "bars that hold", "median bar", "median difference")
    text = OPENING.format(
        held=sum(case["holds"] for case in cases),
        count=len(cases),
        share=100 * sum(case["holds"] for case in cases) / len(cases),
        sites=", ".join(f"{site} {held} of {count}" for site, (held, count) in content["by_site"].items()),
        trusted=len(trusted),
        trusted_held=sum(case["holds"] for case in trusted),
        table=markdown(heads, (_row(name, _of(cases, "quantity", name)) for name in content["by_quantity"])),
        frictions=", ".join(f"{angle:g}" for angle in sorted({case["friction"] for case in cases})),
        cells="; ".join(f"{site} {_cells(_of(cases, 'site', site))} m" for site in content["by_site"]),
        cases=download("error_bars.csv", f"all {len(cases)} bars"),
        runout=content["version"],
        commit=content.get("commit") or "not recorded",
        seconds=content["seconds"],
        **{name: versions[name] for name in ("numba", "numpy")},
        **content["machine"],
    )
    table = as_csv(COLUMNS, ([case[name] for name in COLUMNS] for case in cases))
    return StudyPage("error_bars", text, {"error_bars.csv": table}, {"error_bars.png": _figure(cases)})


def _of(cases: Sequence[Mapping[str, Any]], key: str, value: str) -> list[Mapping[str, Any]]:
    return [case for case in cases if case[key] == value]


def _cells(cases: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(f"{size:.0f}" for size in sorted({case["cell"] for case in cases}, reverse=True))


def _row(name: str, cases: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    bar = median(case["error"] / abs(case["fine"]) for case in cases if case["fine"])
    difference = median(_difference(case) for case in cases if case["fine"])
    return named(name), f"{sum(c['holds'] for c in cases)} of {len(cases)}", f"{100 * bar:.2g} %", f"{100 * difference:.2g} %"


def named(name: str) -> str:
    """A quantity of the study of convergence in words."""
    return NAMES.get(name, name.replace("_", " "))


def _difference(case: Mapping[str, Any]) -> float:
    return float(abs(case["truth"] - case["fine"]) / abs(case["fine"]))


def _figure(cases: Sequence[Mapping[str, Any]]) -> bytes:
    """PNG of the difference from the true value against the bar, a mark a case and a colour a quantity."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(7.5, 4.2), layout="constrained")
    axes = canvas.add_subplot()
    for name in dict.fromkeys(case["quantity"] for case in cases):
        some = [case for case in _of(cases, "quantity", name) if case["fine"] and case["error"] > 0]
        bars, differences = [c["error"] / abs(c["fine"]) for c in some], [max(_difference(c), 1e-4) for c in some]
        axes.loglog(bars, differences, "o", markersize=4, alpha=0.7, label=named(name))
    low, high = axes.get_xlim()
    axes.plot([low, high], [low, high], color="0.4", lw=0.8)
    axes.set(xlabel="error bar, relative", ylabel="difference from the value of the fine grid, relative")
    axes.grid(color="0.9", which="major")
    canvas.legend(loc="outside right upper", fontsize=8, frameon=False)
    return as_png(canvas)
