"""Error against time as a page of the documentation, as a table on the terminal and as figures."""

from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np

from pipelines.error_cases.choice import BASE, PLAN, REPEATED_BELOW
from pipelines.error_cases.curve import Fit, on_front
from runout.accuracy import CFL, PARTICLES_PER_CELL
from runout.release.arrangement import LEVEL

OPENING = """# Error against time

Written by `runout bench --error{full} --out docs/benchmarks`; do not edit. Problems with a known answer, on finer and finer
grids; a curve is what one change from the defaults of `runout.simulate` ({base})
makes of them.
Commit {commit}, runout {runout}, numba {numba}, NumPy {numpy}, Python {python}; {cores} cores
({architecture}, vectors of {vector_bits} bits), with other work on them; seed {seed}.

Time is processor time of the steps on one thread, the shortest of the runs that took turns (once only beyond {repeated:g} s). It is
still that of a machine; **particle-steps** are the work without its noise. Rings mark the Pareto front of a panel: no other
point is both cheaper and more accurate; the table of all runs takes particle-steps for it.
*hash* runs on the CPU here; no GPU was at hand, its throughput is in {{doc}}`gpu`.
*Contact at nodes* is the usual scheme, a condition on nodes below the surface, on the reference backend: compare with *reference*.

## What each choice costs at equal error

Cost over that of the defaults at the errors that they reach, between grids by power laws; geometric means,
particle-steps (processor time). Less than one: cheaper than the defaults. A dash: never as accurate as their coarsest grid,
or always better than their finest.

{ranking}

## Where the defaults lie on the Pareto front

One rule serves all problems. The largest cost of every other choice over that of the defaults, at equal error and in
processor time: {rivals}.

{places}
"""
SLIGHTEST = 0.1  # order below which none is seen
ROWS = (
    "problem",
    "choice",
    "h [m]",
    "N",
    "steps",
    "blocks",
    "wall [s]",
    "processor [s]",
    "setup [s]",
    "memory [MB]",
    "QoI",
    "error",
)


def rows(content: Mapping[str, Any]) -> str:
    """Cost at equal error: a table, a row a choice and a column a problem."""
    problems = content["problems"]
    names = list(dict.fromkeys(name for p in problems for name in p["cost_at_equal_error"]))
    lines = ["| choice | " + " | ".join(p["name"] for p in problems) + " |", "|---" * (len(problems) + 1) + "|"]
    for name in names:
        cells = [_ratio(p["cost_at_equal_error"].get(name)) for p in problems]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def as_markdown(content: Mapping[str, Any]) -> str:
    """The whole study as a page; figures lie beside it."""
    versions, machine = content["versions"], content["machine"]
    text = OPENING.format(
        full=" --full" if content["full"] else "",
        base=f"{_count(PARTICLES_PER_CELL)} particles a cell, on the level ground of F5 {_count(LEVEL)}, "
        f"in solids {_count(3 * (PLAN,))}; CFL {CFL:g}, float32, backend scan",
        repeated=REPEATED_BELOW,
        ranking=rows(content),
        rivals=_rivals(content),
        places="\n".join(_places(content)),
        seed=content["seed"],
        **{name: versions[name] for name in ("commit", "runout", "numba", "numpy", "python")},
        **machine,
    )
    parts = [text]
    parts.append("\n".join(_presets(content["presets"])) + "\n")
    for problem in content["problems"]:
        parts.append(f"## {problem['name']}: {problem['title']}\n")
        parts.append(f"Error: {problem['error']}. {problem['remark']}".strip() + "\n")
        parts.append(f"![Error against time, work and size of cells](work_precision_{problem['name']}.png)\n")
        parts.append("\n".join(_fits(problem)) + "\n")
    parts.append("## All runs\n\nMemory: all arrays of the backend. DoE = -log10(error times processor time).\n")
    parts.append("\n".join(_points(content)) + "\n")
    return "\n".join(parts)


def _rivals(content: Mapping[str, Any]) -> str:
    """The largest cost in time of each choice over that of the defaults, and where."""
    found = []
    for name in dict.fromkeys(name for p in content["problems"] for name in p["cost_at_equal_error"]):
        costs = {p["name"]: p["cost_at_equal_error"].get(name, {}).get("seconds", 0.0) for p in content["problems"]}
        worst = max(costs, key=lambda problem: costs[problem])
        if name != BASE.name and costs[worst]:
            found.append(f"{name} {costs[worst]:.2g} ({worst})")
    return ", ".join(found)


def _places(content: Mapping[str, Any]) -> Iterator[str]:
    """On how many of its grids the front of a problem has the defaults, by time and by work."""
    yield "| problem | grids | on the front by processor time | by particle-steps |"
    yield "|---|---|---|---|"
    for problem in content["problems"]:
        curves = {c["variation"]: c["points"] for c in problem["curves"]}
        if BASE.name in curves:
            rings = [sum(on_front(curves, cost)[BASE.name]) for cost in ("seconds", "particle_steps")]
            yield f"| {problem['name']} | {len(curves[BASE.name])} | {rings[0]} | {rings[1]} |"


def _count(particles: Sequence[int]) -> str:
    return " x ".join(map(str, particles))


def figure(problem: Mapping[str, Any]) -> bytes:
    """PNG of error against processor time, particle-steps and size of cells of one problem."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(15.0, 4.2), layout="constrained")
    panels = canvas.subplots(1, 3, sharey=True)
    for axes, key, label in zip(
        panels, ("seconds", "particle_steps", "cell"), ("processor time [s]", "particle-steps", "size of cells [m]"), strict=True
    ):
        _panel(axes, problem, key)
        axes.set_xlabel(label)
        axes.grid(color="0.9", which="both")
        _label_decades(axes.xaxis)
    _label_decades(panels[0].yaxis)
    sizes = sorted({p["cell"] for curve in problem["curves"] for p in curve["points"]})
    panels[2].set_xticks(sizes, [f"{size:.3g}" for size in sizes], fontsize=8)
    panels[2].set_xticks([], minor=True)
    panels[0].set_ylabel("relative error")
    canvas.legend(*panels[2].get_legend_handles_labels(), fontsize=8, frameon=False, loc="outside right upper")
    canvas.suptitle(f"{problem['name']}: {problem['title']}; {problem['error']}", fontsize=10)
    picture = BytesIO()
    canvas.savefig(picture, format="png", dpi=80)
    return picture.getvalue()


def _label_decades(axis: Any) -> None:
    """Numbers at the decades of a logarithmic axis; at 2 and 5 besides where it spans few."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    few = high < 300 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    axis.set_minor_formatter(NullFormatter())
    if few and low > 1e-4 and high < 1e4:
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _panel(axes: Any, problem: Mapping[str, Any], key: str) -> None:
    """Curves over one number of their points, with rings by that number where it is a cost."""
    rings = on_front({c["variation"]: c["points"] for c in problem["curves"]}, key)
    for k, curve in enumerate(problem["curves"]):
        points = curve["points"]
        x, e = np.array([p[key] for p in points]), np.array([p["error"] for p in points])
        style = {"marker": "osD^vP*X"[k % 8], "color": f"C{k % 10}", "linestyle": ":" if k >= 10 else "-"}
        axes.loglog(x, e, markersize=5, linewidth=1.0, label=curve["variation"], **style)
        best = np.array(rings[curve["variation"]])
        if key == "cell" and curve["variation"] == BASE.name and curve["fit"] and curve["fit"]["order"] >= SLIGHTEST:
            fit, fine = Fit(**curve["fit"]), np.geomspace(x.min() / 2, x.max(), 50)
            floor = f", floor {fit.floor:.1e}" if fit.floor else ""
            axes.loglog(fine, [fit.at(c) for c in fine], "--", color="0.4", label=f"order {fit.order:.2f}{floor}")
        elif key != "cell" and best.any():
            axes.loglog(x[best], e[best], "o", color="black", markerfacecolor="none", markersize=11)


def _presets(presets: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """What the presets of accuracy gave."""
    if not presets:
        return
    yield "## Presets of accuracy\n"
    yield "Two sites, 60 s, with `accuracy=...` alone. Errors: distance from `high` with half its cells plus what that has left by"
    yield "the order that these two and `standard` show (safety factor 1.25), or by the last distance where none between 0.5 and 3"
    yield "is seen. Other sites have other errors, `runout verify SITE --convergence` tells.\n"
    heads = ("site", "preset", "cells [m]", "particles", "steps", "work over standard", "processor [s]", "error of the map")
    yield "| " + " | ".join((*heads, "order", "error of the run-out", "order")) + " |"
    yield "|---" * 11 + "|"
    for p in presets:
        orders = ["none" if p[key] is None else f"{p[key]:.2f}" for key in ("map_order", "runout_order")]
        yield (
            f"| {p['site']} | {p['name']} | {' x '.join(f'{x:g}' for x in p['cell_size'])} | {p['particles']} | {p['steps']} | "
            f"{p['particle_steps']:.2g} | {p['seconds']:.3g} | {100 * p['map_error']:.2g} % | {orders[0]} | "
            f"{100 * p['runout_error']:.2g} % | {orders[1]} |"
        )


def _fits(problem: Mapping[str, Any]) -> Iterator[str]:
    """Order, floor and index of every curve of a problem."""
    yield "| choice | order | floor | GCI of the QoI on the finest grid |"
    yield "|---|---|---|---|"
    for curve in problem["curves"]:
        fit, gci = curve["fit"], curve["gci"]
        order, floor = ("none", "-") if fit is None or fit["order"] < SLIGHTEST else (f"{fit['order']:.2f}", "none seen")
        floor = f"{fit['floor']:.1e}" if fit and fit["floor"] else floor
        index = (
            "-" if gci is None else f"{100 * gci['relative']:.2g} % ({'order ' if gci['converging'] else 'range, no order seen'}"
        )
        index += "" if gci is None else f"{gci['order']:.1f})" if gci["converging"] else ")"
        yield f"| {curve['variation']} | {order} | {floor} | {index} |"
    yield ""
    yield f"Compiling, or loading what was compiled, took {problem['jit_seconds']:.2g} s beside the above."


def _points(content: Mapping[str, Any]) -> Iterator[str]:
    """Every run, as a row."""
    yield "| " + " | ".join((*ROWS, "DoE", "front")) + " |"
    yield "|---" * (len(ROWS) + 2) + "|"
    for problem in content["problems"]:
        for curve in problem["curves"]:
            for p in curve["points"]:
                numbers = (f"{p['cell']:.4g}", f"{p['particles']}", f"{p['steps']}", f"{p['blocks']}")
                seconds = tuple(f"{p[key]:.2g}" for key in ("wall", "seconds", "setup"))
                memory, value = _or_dash(p["bytes"] and 1e-6 * p["bytes"], ".2f"), _or_dash(p["value"], ".5g")
                last = (memory, value, f"{p['error']:.2e}", f"{p['doe']:.2f}", "yes" if p["front"] else "")
                yield "| " + " | ".join((problem["name"], curve["variation"], *numbers, *seconds, *last)) + " |"


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _ratio(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return ""
    if "particle_steps" not in found:
        return "-"
    seconds = f" ({found['seconds']:.2g})" if "seconds" in found else ""
    return f"{found['particle_steps']:.2g}{seconds}"
