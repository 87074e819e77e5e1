"""Errors of peak maps and convergence of inundation probabilities, as a page."""

from collections.abc import Mapping, Sequence
from typing import Any

from docs.pages.study_page import StudyPage, as_png, markdown

BEFORE, NOW = "boxes of one grid cell", "footprints"
TITLES = {"frank_slide": "Frank Slide", "jacksboro": "jacksboro"}
TEXT = """# Errors of peak maps

How much of the error of a map is that of the map, and does it converge? Maps of largest thickness, speed, pressure and momentum
flux of runs on coarser grids against those of a run on a fine grid: 14 m (Frank Slide) or 10 m (jacksboro). Decision
{{doc}}`../decisions/14-maps-and-reports` has the reasons for the estimator of columns.

![Error of the map of largest thickness against the cell size, before and now](peak_maps.png)

*Dashed: boxes of one grid cell on unfiltered ground. Lines: footprints on filtered ground.*

{tables}

Each number is the relative L1 error with the bias in brackets [%]; areas have their error [%].

## Part of the estimator

{estimator}

*Run*: maps of the run. *Estimator*: maps of the particles of the finest run by the estimator of the coarser grid. *Run alone*: the
run against the estimator. Flows thinner than the least thickness that a grid can show are missing on coarse grids: this outline is
more than half of the bias of speed and of the area over 0.1 m.

## Inundation probability

{probability}

Frank Slide, 8 members with basal friction angles from 10 to 20 degrees, 60 s, against the same members on 20 m. Each number is an
error [%]; *area of half*: area that at least half of the members reach.

## How to make this page

    RUNOUT_DATA=DIR python -m tests.benchmarks.peak_maps OUT
    RUNOUT_DATA=DIR python -m tests.benchmarks.peak_maps OUT --probability
    RUNOUT_DATA=DIR python -m tests.benchmarks.peak_map_estimator OUT

The scripts print the rows of the record `peak_maps.json`. `python -m docs.pages` writes this page and its figure from
`tests/benchmarks/records/`.
"""


def page(record: Mapping[str, Any]) -> StudyPage:
    """The page of a record."""
    tables = [f"## {TITLES[site]}\n\n{_now(record, site)}" for site in record[NOW]]
    parts = record["estimator"], record["probability"]
    estimator, probability = (markdown(part["columns"], part["frank_slide"]) for part in parts)
    text = TEXT.format(tables="\n\n".join(tables), estimator=estimator, probability=probability)
    return StudyPage("peak_maps", text, pictures={"peak_maps.png": _figure(record)})


def _now(record: Mapping[str, Any], site: str) -> str:
    """Rows of a site, with the thickness before."""
    before = {row[0]: row[1] for row in record[BEFORE][site]}
    heads = (*record["columns"][:1], "thickness, boxes", *record["columns"][1:])
    return markdown(heads, [(row[0], before.get(row[0], ""), *row[1:]) for row in record[NOW][site]])


def _figure(record: Mapping[str, Any]) -> bytes:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(8.0, 3.2), layout="constrained")
    for axes, site in zip(canvas.subplots(1, len(record[NOW])), record[NOW], strict=True):
        for version, style in ((BEFORE, "--"), (NOW, "-")):
            for column, colour in ((1, "C0"), (2, "C1")):
                axes.plot(*_errors(record[version][site], column), style, color=colour, marker="o", markersize=3)
        axes.set(xlabel="cell [m]", ylabel="relative L1 error [%]", title=TITLES[site], ylim=(0, None))
        axes.grid(color="0.9")
    canvas.legend(
        handles=axes.get_lines()[2:4], labels=["largest thickness", "largest speed"], loc="outside right upper", frameon=False
    )
    return as_png(canvas)


def _errors(rows: Sequence[Sequence[str]], column: int) -> tuple[list[float], list[float]]:
    """Cell sizes [m] and relative L1 errors [%] of a column."""
    return [float(row[0]) for row in rows], [float(row[column].split(" ")[0]) for row in rows]
