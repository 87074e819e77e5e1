"""One answer whatever the grid, as a page: run-out and area by grid spacing and by the place of the grid."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown

TITLES = {"frank_slide": "Frank Slide, raster of 20 m", "avakot": "avaKot, raster of 5 m", "made": "made raster of 5 m"}
QUANTITIES = {  # key of a run: name, factor to the unit of the table, format
    "centre": ("centre of the deposit [m]", 1.0, ".0f"),
    "area": ("area [ha]", 1e-4, ".1f"),
    "numerical": ("numerical dissipation [%]", 100.0, ".1f"),
}
TEXT = """# One answer whatever the grid

Does the run-out turn on the ratio of grid cell and raster cell, or on where the grid lies? Nine spacings from {first:g} to {last:g}
raster cells, and four places of the grid at two of them. Decision {{doc}}`../decisions/07-ground-surface` has the reasons.

![Deviation of run-out and area against cells of the grid over cells of the raster](one_answer.png)

*Deviation from the mean of a site; crosses: other places of the grid.*

{spacings}

*Centre of the deposit*: distance from the centre of the release. *Area*: peak thickness over {level:g} m. *Numerical dissipation*:
share of the potential energy set free. The made raster is rougher than terrain is.

## Spread

{spreads}

*Trend*: most less least over all spacings, over their mean. *Neighbours*: largest difference between two spacings that follow each
other. *Places*: most less least of the places of the grid, over their mean.

- On Frank Slide the raster holds little relief of a few cells, and coarse grids lag by their own dissipation.
- On the rough rasters the run-out falls with finer cells: the ground of a finer grid carries more of the relief that the raster
  has, and the flow loses energy on it. Wider filters would give one answer and take channels away.
- Area over a threshold needs cells through the flow: with 0.4 to 0.7 cells its outline is within a cell.

## Full table

{table}: every run

## How to make this page

    RUNOUT_DATA=DIR python -m tests.benchmarks.one_answer OUT --processes 16

Copy the record to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page, its table and its figure.

Record: runout {runout}, commit {commit}, {engine}, NumPy {numpy}; {cores} cores ({architecture}).
"""


def page(record: Mapping[str, Any]) -> StudyPage:
    """The page of a record."""
    runs = record["runs"]
    ratios = sorted({run["ratio"] for run in runs})
    sites = [site for site in TITLES if any(run["site"] == site for run in runs)]
    heads = ("site", "", *(f"{ratio:g}" for ratio in ratios))
    spread_heads = ("site", "trend", "neighbours", "area, neighbours", "places")
    text = TEXT.format(
        first=ratios[0],
        last=ratios[-1],
        spacings=markdown(heads, [row for site in sites for row in _rows(runs, site, ratios)]),
        spreads=markdown(spread_heads, [_spread(runs, site, ratios) for site in sites]),
        table=download("one_answer.csv", f"all {len(runs)} runs"),
        **{name: record["versions"][name] for name in ("runout", "commit", "numpy")},
        **{name: record["machine"][name] for name in ("cores", "architecture")},
        **{name: record[name] for name in ("engine", "level")},
    )
    names = ("site", "ratio", "place", "cell_size", *QUANTITIES)
    table = as_csv(names, [[run[name] for name in names] for run in runs])
    return StudyPage("one_answer", text, {"one_answer.csv": table}, {"one_answer.png": _figure(runs, sites, ratios)})


def _values(runs: Sequence[Mapping[str, Any]], site: str, ratios: Sequence[float], key: str) -> np.ndarray:
    """A quantity (ratios,) of the runs of a site whose grids lie at the corner of the raster."""
    by_ratio = {run["ratio"]: run[key] for run in runs if run["site"] == site and run["place"] == 0}
    return np.array([by_ratio[ratio] for ratio in ratios])


def _rows(runs: Sequence[Mapping[str, Any]], site: str, ratios: Sequence[float]) -> list[tuple[str, ...]]:
    return [
        (TITLES[site] if key == "centre" else "", name, *(format(factor * v, how) for v in _values(runs, site, ratios, key)))
        for key, (name, factor, how) in QUANTITIES.items()
    ]


def _spread(runs: Sequence[Mapping[str, Any]], site: str, ratios: Sequence[float]) -> tuple[str, ...]:
    """Trend, largest step between neighbours, and spread of the places [%]."""
    centre, area = (_values(runs, site, ratios, key) for key in ("centre", "area"))
    steps = (np.abs(np.diff(values) / values[1:]).max() for values in (centre, area))
    moved = sorted({run["ratio"] for run in runs if run["site"] == site and run["place"]})
    groups = ([run["centre"] for run in runs if (run["site"], run["ratio"]) == (site, ratio)] for ratio in moved)
    shares = (np.ptp(centre) / centre.mean(), *steps, max(np.ptp(group) / np.mean(group) for group in groups))
    return TITLES[site], *(f"{100 * share:.2g} %" for share in shares)


def _figure(runs: Sequence[Mapping[str, Any]], sites: Sequence[str], ratios: Sequence[float]) -> bytes:
    """Deviation [%] of each run from the mean of its site; crosses are the other places of the grid."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(9.0, 3.4), layout="constrained")
    for axes, key in zip(canvas.subplots(1, 2), ("centre", "area"), strict=True):
        for k, site in enumerate(sites):
            values = _values(runs, site, ratios, key)
            axes.plot(ratios, 100 * (values / values.mean() - 1), "o-", color=f"C{k}", markersize=4, label=TITLES[site])
            moved = [run for run in runs if run["site"] == site and run["place"]]
            others = np.array([run[key] for run in moved]) / values.mean() - 1
            axes.plot([run["ratio"] for run in moved], 100 * others, "x", color=f"C{k}")
        name = QUANTITIES[key][0].split(" [")[0]
        axes.set(xlabel="grid cell over raster cell", ylabel="deviation from the mean [%]", title=name, xscale="log")
        axes.set_xticks(ratios, [f"{ratio:g}" for ratio in ratios], fontsize=8)
        axes.minorticks_off()
        axes.grid(color="0.9")
    axes.legend(frameon=False, fontsize=8)
    return as_png(canvas)
