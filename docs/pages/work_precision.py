"""Error against time as a page of the documentation with its tables and figure, and as a table on the terminal."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.model.limits import CFL, PARTICLES_PER_CELL
from runout.release.arrangement import LEVEL
from tests.benchmarks.error_cases.choice import BASE, PLAN, REPEATED_BELOW
from tests.benchmarks.error_cases.curve import on_front

COLUMNS = 2  # of the figure
DECADE = 10.0  # from it on the powers of ten alone are labelled
OPENING = """# Error against time

Problems with a known answer run on successively finer grids. Each curve changes one choice from the defaults of
`runout.simulate`: {base}.

![Error against processor time, one panel for each problem](work_precision.png)

*Black: the defaults. Rings: Pareto front of a panel; no other point is both cheaper and more accurate. Dashed:
other choices.*

{problems}

## Cost at equal error

Processor time relative to the defaults at equal error: geometric mean over the grids of the defaults, with power laws
between grids. Values below 1 are cheaper than the defaults. A dash: the errors of the choice and of the defaults do not
overlap.

{ranking}

*hash* ran on the CPU; {{doc}}`gpu` has its speed on a GPU. *Contact at nodes* is the usual scheme, a condition on
the nodes below the surface, on the reference backend; compare it with *reference*. *Waves 3 times the flow* and
*strain by weight 3 %* are softer than the defaults: they hold back mass at dams, and on slopes near equilibrium they
let it settle too far ({{doc}}`../decisions/12-accuracy-and-time-step`).

## Defaults on the Pareto front

{places}

## Full tables

- {runs}: cells, particles, steps, blocks, wall and processor time, memory, quantity of interest, error
- {curves}: order and floor of the error, cost at equal error in particle-steps and in time

## How to make this page

    python -m tests.benchmarks.error_study --out DIR

It writes the record `work_precision.json`. Copy it to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page,
its tables and its figure.

Time is processor time of the steps on one thread, the shortest of {repeats} alternating runs (one run beyond
{repeated:g} s), on a machine with other load. Particle-steps in the tables measure the work independently of the
machine.

Record: runout {runout}, commit {commit}, numba {numba}, NumPy {numpy}, Python {python}; {cores} cores
({architecture}, vectors of {vector_bits} bits); seed {seed}; {created}.
"""
SLIGHTEST = 0.1  # orders below this are not stated
RUNS = (
    *("problem", "choice", "cell [m]", "particles", "steps", "blocks", "wall [s]", "processor [s]", "setup [s]", "memory [MB]"),
    *("quantity of interest", "error", "DoE = -log10(error x processor time)", "on the front by particle-steps"),
)
CURVES = (
    *("problem", "choice", "order", "floor"),
    *("particle-steps over the defaults", "processor time over the defaults"),
)


def page(content: Mapping[str, Any]) -> StudyPage:
    """The page of a record of :mod:`tests.benchmarks.error_against_time`, with its full tables and its figure."""
    versions, machine, problems = content["versions"], content["machine"], content["problems"]
    text = OPENING.format(
        base=f"{_count(PARTICLES_PER_CELL)} particles a cell (F5: {_count(LEVEL)}, solids: {_count(3 * (PLAN,))}), CFL {CFL:g}, "
        "float32, backend `scan`",
        problems=markdown(("problem", "", "error"), ((p["name"], p["title"], p["error"]) for p in problems)),
        ranking=rows(content),
        places=markdown(("problem", "grids", "on the front by processor time", "by particle-steps"), _places(content)),
        runs=download("work_precision_runs.csv", "every run"),
        curves=download("work_precision_curves.csv", "every curve"),
        full=" --full" if content["full"] else "",
        repeats=max(point["runs"] for p in problems for curve in p["curves"] for point in curve["points"]),
        repeated=REPEATED_BELOW,
        **{name: content[name] for name in ("seed", "created")},
        **{name: versions[name] for name in ("commit", "runout", "numba", "numpy", "python")},
        **machine,
    )
    tables = {"work_precision_runs.csv": _runs(content), "work_precision_curves.csv": _curves(content)}
    return StudyPage("work_precision", text, tables, {"work_precision.png": figure(problems)})


def rows(content: Mapping[str, Any]) -> str:
    """Processor time at equal error over that of the defaults: a table, a row a choice and a column a problem."""
    problems = content["problems"]
    names = dict.fromkeys(name for p in problems for name in p["cost_at_equal_error"])
    cells = ((name, *(_ratio(p["cost_at_equal_error"].get(name)) for p in problems)) for name in names)
    return markdown(("choice", *(p["name"] for p in problems)), cells)


def _ratio(found: Mapping[str, Any] | None) -> str:
    """Time relative to the defaults; empty if the choice was not run."""
    return "" if found is None else f"{found['seconds']:.2g}" if "seconds" in found else "-"


def _places(content: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Rows: on how many of its grids the front of a problem has the defaults, by time and by work."""
    for problem in content["problems"]:
        curves = {c["variation"]: c["points"] for c in problem["curves"]}
        if BASE.name in curves:
            rings = (sum(on_front(curves, cost)[BASE.name]) for cost in ("seconds", "particle_steps"))
            yield problem["name"], str(len(curves[BASE.name])), *map(str, rings)


def _count(particles: Sequence[int]) -> str:
    return " x ".join(map(str, particles))


def figure(problems: Sequence[Mapping[str, Any]]) -> bytes:
    """PNG of error against processor time, a panel a problem."""
    from matplotlib.figure import Figure

    lines = math.ceil(len(problems) / COLUMNS)
    canvas = Figure(figsize=(4.4 * COLUMNS, 3.2 * lines + 1.4), layout="constrained")
    styles = _styles(problems)
    for k, problem in enumerate(problems):
        _panel(canvas.add_subplot(lines, COLUMNS, k + 1), problem, styles)
    shown = {label: line for axes in canvas.axes for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    canvas.legend(list(shown.values()), list(shown), fontsize=8, frameon=False, loc="outside lower center", ncols=4)
    return as_png(canvas)


def _styles(problems: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Marker and colour of every choice, the same in all panels."""
    names = dict.fromkeys(c["variation"] for p in problems for c in p["curves"])
    styles = {
        name: {"marker": "sD^vP*X<>"[k % 9], "color": f"C{k % 10}", "linestyle": "--", "linewidth": 0.7, "markersize": 4}
        for k, name in enumerate(names)
    }
    return styles | {BASE.name: {"marker": "o", "color": "black", "linewidth": 1.8, "markersize": 5, "zorder": 3}}


def _panel(axes: Any, problem: Mapping[str, Any], styles: Mapping[str, Mapping[str, Any]]) -> None:
    """Curves of a problem over processor time, with rings on the Pareto front."""
    rings = on_front({c["variation"]: c["points"] for c in problem["curves"]}, "seconds")
    for curve in problem["curves"]:
        x, e = (np.array([p[key] for p in curve["points"]]) for key in ("seconds", "error"))
        axes.loglog(x, e, label=curve["variation"], **styles[curve["variation"]])
        best = np.array(rings[curve["variation"]])
        axes.loglog(x[best], e[best], "o", color="0.2", markerfacecolor="none", markersize=10, zorder=4)
    axes.set_title(f"{problem['name']}: {problem['title']}", fontsize=9)
    axes.set_xlabel("processor time [s]", fontsize=8)
    axes.set_ylabel("relative error", fontsize=8)
    axes.tick_params(labelsize=7, which="both")
    axes.grid(color="0.9", which="both")
    low, high = axes.get_xlim()
    if high > DECADE * low:
        axes.xaxis.set_minor_formatter("")


def _curves(content: Mapping[str, Any]) -> str:
    """Order, floor and cost of every curve, as CSV."""
    found = []
    for problem in content["problems"]:
        for curve in problem["curves"]:
            fit, cost = curve["fit"] or {}, problem["cost_at_equal_error"].get(curve["variation"], {})
            seen = fit.get("order", 0.0) >= SLIGHTEST
            order, floor = (f"{fit['order']:.2f}", f"{fit['floor']:.1e}") if seen else (None, None)
            costs = (_form(cost.get(name), ".3g") for name in ("particle_steps", "seconds"))
            found.append((problem["name"], curve["variation"], order, floor, *costs))
    return as_csv(CURVES, found)


def _runs(content: Mapping[str, Any]) -> str:
    """Every run, as CSV."""
    found = []
    for problem in content["problems"]:
        for curve in problem["curves"]:
            for p in curve["points"]:
                counts = (f"{p['cell']:.4g}", p["particles"], p["steps"], p["blocks"])
                seconds = tuple(f"{p[key]:.2g}" for key in ("wall", "seconds", "setup"))
                memory, value = _form(p["bytes"] and 1e-6 * p["bytes"], ".2f"), _form(p["value"], ".5g")
                last = (memory, value, f"{p['error']:.2e}", f"{p['doe']:.2f}", "yes" if p["front"] else "no")
                found.append((problem["name"], curve["variation"], *counts, *seconds, *last))
    return as_csv(RUNS, found)


def _form(value: float | None, form: str) -> str | None:
    return None if value is None else format(value, form)
