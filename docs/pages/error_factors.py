"""What the error of a map is made of, as a page."""

from collections.abc import Mapping, Sequence
from typing import Any

from docs.pages.study_page import StudyPage, as_png, markdown
from tests.benchmarks.error_factors import FACTORS, FOOTPRINT, GROUND

FLOWS = {
    "frank_slide": "Frank Slide, 15°", "frank_slide_20": "Frank Slide, 20°", "jacksboro": "jacksboro, 15°",
    "jacksboro_25": "jacksboro, 25°", "coulomb_only": "CoulombOnly",
}  # fmt: skip
COARSE = next(iter(FACTORS))
OPENING = """# What limits next

Which choice of the grid makes the error of a map? Each row refines one of them and leaves the others: relative L1 [%] of the map of
largest thickness, and of the thickness at 60 s, against a grid about three times finer or more.

![Share of the error that is left with one choice refined](error_factors.png)

## Map of largest thickness

{peak}

## Thickness at 60 s

{at_end}

- *Coarse grid*: {cells}. Four substeps of a transfer, default particles.
- *{ground}*: no coarse run, but the reference on the ground that the
  coarse grid filters: its error is relief that the coarse grid does not resolve. Rasters coarser than the filter have none.
- *{footprint}*: no coarse run either, but the map of the reference, spread as the
  coarse grid spreads its particles in plan. It is what a map of this resolution cannot show.
- Errors of choices do not add up: each may hide another, and finer cells upwards also hold more particles.

{verdict}

## How to make this page

    RUNOUT_DATA=DIR python -m tests.benchmarks.error_factors OUT --backend hash --device cuda:0

Copy `error_factors.json` to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page and its figure.

Record: runout {runout}, commit {commit}, NumPy {numpy}, backend {backend} ({device}).
"""


def page(record: Mapping[str, Any]) -> StudyPage:
    """The page of a record."""
    errors: dict[str, dict[str, Mapping[str, Any]]] = {}
    for row in record["rows"]:
        errors.setdefault(row["site"], {})[row["factor"]] = row
    cells = ", ".join(
        f"{FLOWS[site]} {rows[COARSE]['cell']:g} m against {rows[COARSE]['reference']:g} m" for site, rows in errors.items()
    )
    text = OPENING.format(
        peak=_table(errors, "peak"), at_end=_table(errors, "at_end"), cells=cells, ground=GROUND.capitalize(),
        footprint=FOOTPRINT.capitalize(), verdict=_verdict(errors), commit=record["commit"], **record["engine"],
        **{name: record["versions"][name] for name in ("runout", "numpy")},
    )  # fmt: skip
    return StudyPage("error_factors", text, {}, {"error_factors.png": _figure(errors)})


def _table(errors: Mapping[str, Mapping[str, Mapping[str, Any]]], of_map: str) -> str:
    heads = ("refined", *(FLOWS[site] for site in errors))
    shown = [
        (factor, *(f"{100 * rows[factor][of_map]:.1f}" if factor in rows else "" for rows in errors.values()))
        for factor in _factors(errors)
    ]
    return markdown(heads, shown)


def _factors(errors: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> list[str]:
    """Names of all rows, in their order; a flow on a coarse raster lacks that of the filtered ground."""
    return list(max(errors.values(), key=len))


def _verdict(errors: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """The choice that takes most of the error away in each flow, beside what all of them take away."""
    alone = [name for name in FACTORS if name not in (COARSE, "half the cells in all directions", "another seed")]
    lines = []
    for site, rows in errors.items():
        before = rows[COARSE]["peak"]
        best = min(alone, key=lambda name: rows[name]["peak"])
        share_of_best, whole = rows[best]["peak"] / before, rows["half the cells in all directions"]["peak"] / before
        lines.append((FLOWS[site], best, f"{share_of_best:.2f}", f"{whole:.2f}"))
    heads = "flow", "choice that takes most away", "error left", "left with half the cells in all directions"
    return "## The next factor\n\n" + markdown(heads, lines)


def _figure(errors: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> bytes:
    """PNG of the error of the largest thickness by factor, over that of the coarse grid."""
    from matplotlib.figure import Figure

    factors: Sequence[str] = _factors(errors)[1:][::-1]
    canvas = Figure(figsize=(8.0, 4.6), layout="constrained")
    axes = canvas.add_subplot()
    for site, rows in errors.items():
        shares = {k: rows[name]["peak"] / rows[COARSE]["peak"] for k, name in enumerate(factors) if name in rows}
        axes.plot(list(shares.values()), list(shares), "o", label=FLOWS[site], alpha=0.8)
    axes.axvline(1.0, color="0.4", lw=0.8)
    axes.set_yticks(range(len(factors)), factors)
    axes.set(xlabel="error of the largest thickness over that of the coarse grid", xlim=(0.0, None))
    axes.grid(axis="x", alpha=0.3)
    axes.legend(frameon=False, fontsize=8)
    return as_png(canvas)
