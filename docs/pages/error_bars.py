"""Page of the coverage of the error bars: how many hold, and how wide they are beside the true difference."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from statistics import median
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.forecast.accuracy import BOUNDS, PRESETS
from runout.forecast.numerical_error import MAP, MAP_ORDER, MAP_SAFETY, ORDER, SAFETY, SCATTERS, SHARE
from runout.studies.convergence import COARSER, PAIRED

FILE = "error_bars.json"
COLUMNS = (
    *("site", "friction", "cells", "held_out", "quantity", "fine", "trend", "scatter", "ground", "error", "relative_error"),
    *("truth", "difference", "noise", "holds"),
)
HEADS = ("", "bars that hold", "", "median bar", "median difference", "ratio")
OPENING = """# Coverage of the error bars

`runout verify SITE --convergence` gives each quantity an error bar from {runs} runs: the grid of the site and cells
{coarser} times as large, each shifted against the terrain. {bounds}

A fit through the runs, of order {order:g} in the cell size, gives a trend, which is the difference from a grid of vanishing
cells, and the scatter of the runs. The order is given: one that is fitted to few runs turns with their scatter.

Coarse grids filter the relief of a few raster cells, and grids finer than 0.67 raster cells meet it again
({{doc}}`../decisions/07-ground-surface`). No trend through coarse grids shows that, and a fit through grids on both sides of this
change is wrong. So all runs have the ground of the site's grid. One more run, with cells {ground_ratio:g} times as large, has the
relief that this grid filters, or lacks that which it has. Where the grid filters it, the part of the ground is the whole difference
that the run makes. Where it resolves it, the part is that difference times the square of the cells of the grid over those of the
raster: waves of two raster cells then have an error of second order.

The bar of a quantity is {safety:g} times the root of the sum of squares of the trend, of {scatters:g} scatters, of the ground, and
of {share:g} of the error of its map. The last part holds where a quantity turns between the grids and has no trend.

The bar of a map comes from its distances to the maps of the coarser grids, by a fit of order {map_order:g}. It is the root of the
sum of squares of {map_safety:g} times their trend, as many times the noise that leaves a distance between equal grids, and
{safety:g} times the ground. No number in it is of a site. The option `--constants` of the study prints the coverage with others.

**{held} of {count} bars hold ({part:.0f} %). The median bar is {ratio:.1f} times the median difference.** The difference is
that from a finer grid with {truth:g} cells through the mean thickness of the release; the bars come from grids with {cells}. The
numbers in the bars were chosen before the part of the ground was added, and kept.
Of the cases that were held out ({outside}; among constants that the others rank alike, the choice saw them), {held_outside}
of {count_outside} bars hold ({part_outside:.0f} %), and the median bar is {ratio_outside:.1f} times the median difference.

![Difference from the value of the fine grid against the bar](error_bars.png)

*Below the line: the bar holds. Differences below 1e-4 are drawn at 1e-4.*

{quantities}

{sites}

{through}

{weakest}

{left_out}Bars and differences are medians, relative to the value on the finest grid of a case. Each true value is the mean of two
shifted runs; half their distance, its noise, has a median of {noise:.2g} %.

{split}## Expected errors

Medians of the bars, brought to the cells of a preset by first order. `runout check`, the report and
{{doc}}`../guide/choosing` state them for a site that is not measured.

{presets}

## Full table

{table}: value, trend, scatter, bar, true value

## How to make this page

    python -m tests.benchmarks.error_bar_coverage {options}

It writes the record `error_bars.json`. Copy it to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page,
its table and its figure.

Record: runout {runout}, commit {commit}, numba {numba}, NumPy {numpy}, {engines}, float32; flows of {end_time:g} s;
{processes} processes on {cores} cores ({architecture}), {run_seconds} s of runs.
"""


LEFT_OUT = """With one site left out, the others choose the tightest numbers that hold 9 of 10 of their bars. With these, the bars
of the site that was left out hold in {held} of {count} cases ({part} %):

{table}

"""
THIN = """## Speed of thin flows

{site}, {friction} deg, cells of {cell_size} m against {true_cell_size} m:

{table}

Maps of largest speed and pressure count flows from the arrival threshold on, 0.1 m thick by default. The fine grid shows flows that
are thinner than the least thickness of the coarse one; their cells make most of the bias. The rest is the tail of the mass. It
passes in thin layers, over cells that a thick flow has passed before, and it is often the fastest flow there. Grids with few cells
through it slow it down, all of them alike, so that coarse grids show no trend. The same tail decides the peak speed, and bars of
peak speed do not hold on Frank Slide. We keep the definition: a higher threshold takes thin flows out of inundation and area over
0.1 m, which converge. Momentum flux, thickness times square of speed, has its largest value in the thick flow; on Frank Slide
its map has a bias of at most 1.3 % ({{doc}}`peak_maps`). Take it where a load is asked for.

"""


def coverage(cases: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Number of bars, share of those that hold, and median bar over median difference."""
    bars, differences = (median(case[key] for case in cases) for key in ("relative_error", "difference"))
    held = sum(case["holds"] for case in cases)
    return {"bars": len(cases), "holds": held / len(cases), "bar": bars, "difference": differences, "ratio": bars / differences}


def page(content: Mapping[str, Any]) -> StudyPage:
    """The page of a record of ``tests/benchmarks/error_bar_coverage.py``."""
    cases, versions, machine, found = content["cases"], content["versions"], content["machine"], coverage(content["cases"])
    outside = [case for case in cases if case["held_out"]] or cases
    text = OPENING.format(
        runs=len(COARSER) + 1,
        coarser=", ".join(f"{ratio:g}" for ratio in sorted(set(COARSER))),
        bounds=BOUNDS,
        safety=SAFETY,
        map_safety=MAP_SAFETY,
        scatters=SCATTERS,
        share=SHARE,
        ground_ratio=PAIRED,
        order=ORDER,
        map_order=MAP_ORDER,
        held=sum(case["holds"] for case in cases),
        count=len(cases),
        part=100 * found["holds"],
        ratio=found["ratio"],
        outside=", ".join(f"{name} {_angles(some)} deg" for name, some in _groups(outside, "site").items()),
        held_outside=sum(case["holds"] for case in outside),
        count_outside=len(outside),
        part_outside=100 * coverage(outside)["holds"],
        ratio_outside=coverage(outside)["ratio"],
        cells=" to ".join(f"{limit(case['cells'] for case in cases):g}" for limit in (min, max)),
        quantities=_table(cases, "quantity", "title"),
        sites=_table(cases, "site", "site"),
        through=_table(cases, "cells", "cells", "cells through the thickness"),
        weakest=_weakest(cases),
        left_out=_left_out(content.get("left_out", ())),
        split=_split(content),
        noise=100 * median(case["noise"] for case in cases),
        presets=markdown(("preset", "cells through the thickness", "run-out", "thickness map"), _presets(content["expected"])),
        table=download("error_bars.csv", f"all {len(cases)} bars"),
        run_seconds=content["seconds"]["runs"],
        **{name: content[name] for name in ("engines", "processes", "truth", "end_time", "options")},
        **{name: versions[name] for name in ("runout", "commit", "numba", "numpy")},
        **{name: machine[name] for name in ("cores", "architecture")},
    )
    table = as_csv(COLUMNS, ([case[name] for name in COLUMNS] for case in cases))
    return StudyPage("error_bars", text, {"error_bars.csv": table}, {"error_bars.png": _figure(cases)})


def _angles(cases: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(f"{angle:g}" for angle in sorted({case["friction"] for case in cases}))


def _presets(expected: Mapping[str, float]) -> Iterator[tuple[str, ...]]:
    """Rows: expected error bars of each preset."""
    for name, preset in PRESETS.items():
        errors = (f"± {100 * expected[quantity] / preset.cells:.2g} %" for quantity in ("f99", MAP))
        yield f"`{name}`", f"{preset.cells:g}", *errors


def _groups(cases: Sequence[Mapping[str, Any]], key: str) -> dict[Any, list[Mapping[str, Any]]]:
    return {value: [case for case in cases if case[key] == value] for value in dict.fromkeys(case[key] for case in cases)}


def _table(cases: Sequence[Mapping[str, Any]], key: str, title: str, head: str = "") -> str:
    """Coverage by the values of a key, in Markdown."""
    rows = []
    for some in _groups(cases, key).values():
        found = coverage(some)
        numbers = f"{100 * found['holds']:.0f} %", f"{100 * found['bar']:.2g} %", f"{100 * found['difference']:.2g} %"
        rows.append((str(some[0][title]), f"{sum(c['holds'] for c in some)} of {len(some)}", *numbers, f"{found['ratio']:.1f}"))
    return markdown((head or key, *HEADS[1:]), rows)


def _weakest(cases: Sequence[Mapping[str, Any]]) -> str:
    """Sentence on the quantities of which fewer than nine of ten bars hold, with the misses of each site."""
    few = []
    for some in _groups(cases, "quantity").values():
        missed = Counter(case["site"] for case in some if not case["holds"])
        if missed.total() > 0.1 * len(some):
            places = ", ".join(f"{site} {count}" for site, count in missed.items())
            few.append(f"{some[0]['title']}, {len(some) - missed.total()} of {len(some)} (misses: {places})")
    return f"Of each quantity at least 9 of 10 bars hold{', but for ' if few else ''}{'; '.join(few)}."


def _left_out(sites: Sequence[Mapping[str, Any]]) -> str:
    """Coverage on each site with constants of the others, in Markdown; empty without."""
    if not sites:
        return ""
    names = "SAFETY", "MAP_SAFETY", "SCATTERS", "SHARE"
    rows = []
    for row in sites:
        held = f"{row['holds'] * row['bars']:.0f} of {row['bars']}", f"{100 * row['holds']:.0f} %", f"{row['ratio']:.1f}"
        rows.append((row["site"], *(f"{row[name]:g}" for name in names), *held))
    held, count = sum(row["holds"] * row["bars"] for row in sites), sum(row["bars"] for row in sites)
    heads = ("site left out", "trend", "map", "scatters", "share of the map", "bars that hold", "", "ratio")
    return LEFT_OUT.format(table=markdown(heads, rows), held=f"{held:.0f}", count=count, part=f"{100 * held / count:.0f}")


def _split(record: Mapping[str, Any]) -> str:
    """Section on the bias of speed and pressure by thickness, in Markdown; empty without."""
    content = record.get("bias_by_thickness")
    if not content:
        return ""
    rows = []
    for layer, above in zip(content["layers"], [*content["layers"][1:], None], strict=True):
        thick = f"{layer['least']:g} to {above['least']:g} m" if above else f"over {layer['least']:g} m"
        parts = (f"{100 * layer[name]:+.1f} %" for name in ("speed", "pressure", "bias_where_both"))
        rows.append((thick, str(layer["cells"]), str(layer["both"]), *parts))
    whole = (f"{100 * sum(layer[name] for layer in content['layers']):+.1f} %" for name in ("speed", "pressure"))
    rows.append(("all", *(str(sum(layer[name] for layer in content["layers"])) for name in ("cells", "both")), *whole, ""))
    heads = (
        "largest thickness on the fine grid",
        "cells",
        "reached by both",
        "part of bias, speed",
        "pressure",
        "speed where both",
    )
    numbers = {name: f"{content[name]:.3g}" for name in ("friction", "cell_size", "true_cell_size")}
    return THIN.format(site=content["site"], table=markdown(heads, rows), **numbers)


def _figure(cases: Sequence[Mapping[str, Any]]) -> bytes:
    """PNG of the difference from the true value against the bar, a mark a case and a colour a quantity."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(7.5, 4.2), layout="constrained")
    axes = canvas.add_subplot()
    for some in _groups(cases, "quantity").values():
        bars, differences = [c["relative_error"] for c in some], [max(c["difference"], 1e-4) for c in some]
        axes.loglog(bars, differences, "o", markersize=4, alpha=0.7, label=some[0]["title"])
    low, high = axes.get_xlim()
    axes.plot([low, high], [low, high], color="0.4", lw=0.8)
    axes.set(xlabel="error bar, relative", ylabel="difference from the value of the fine grid, relative")
    axes.xaxis.set_minor_formatter("")
    axes.grid(color="0.9", which="major")
    canvas.legend(loc="outside right upper", fontsize=8, frameon=False)
    return as_png(canvas)
