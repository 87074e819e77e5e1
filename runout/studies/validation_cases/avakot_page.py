"""Page of the case avaKot."""

from collections.abc import Mapping
from typing import Any

from runout.studies.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.studies.validation_cases.avakot_text import DIFFERENCES, ENERGY_HEADS, energy_rows, numbers
from runout.studies.validation_cases.drawing import draw_outline
from runout.studies.validation_cases.wording import ENDING, told

HEADS = (
    *("friction", "code", "cells [m]", "front [m]", "area [ha]", "> 0.5 m [ha]", "> 4 m [ha]", "largest speed [m/s]"),
    *("thickest [m]", "CSI"),
)
OPENING = """# AvaFrame's avaKot with its own friction

A slab 1 m thick normal to the slope ({volume:.0f} m³) on the terrain of the Kontertal (cells of 5 m). Friction: samosAT with the
coefficients of AvaFrame's standard test of this site (mu = 0.155), and Voellmy with AvaFrame's defaults (mu = 0.155,
xi = 4000 m/s²). runout: snow of 200 kg/m³, internal friction 30 deg where no other is named, drag over the column,
with cells of 5 m four levels of particles through the slab.

{rows}

Front: farthest place along AvaFrame's path with a peak speed above 1 m/s. Area: peak thickness above 0.1 m, then above 0.5 m and
4 m, normal to the slope. CSI: area of 0.1 m against com1DFA with the same friction. Both codes state thickness as volume over area.

![Outlines at 0.1 m peak thickness](avakot.png)

*Outlines at 0.1 m: runout in red, com1DFA in grey.*

## Differences

{differences}

## What is not comparable

- AvaFrame's reference of this test is a run of com1DFA, not an observation. No outline of an avalanche comes with the site.
- samosAT needs the thickness. runout takes it from the load of each contact, com1DFA from its depth-averaged field.
- com1DFA has artificial viscosity, its own stop rule (1 % of the largest kinetic energy) and no internal friction.
- Newer versions choose samosATSmall (mu = 0.22) for this volume; the standard test keeps samosAT.

{tables}.

"""
COM1DFA = """
`tests/benchmarks/avakot_com1dfa.py` makes the numbers of com1DFA. Its first lines state the commands and the environment.
"""


def page(record: Mapping[str, Any]) -> StudyPage:
    """Page of a record."""
    results = record["results"]
    rows = [row for run in results["runs"] for row in _rows(run, results["com1dfa"][run["law"]])]
    rows += [_row(r["law"], f"runout, {r['friction_angle_deg']:g} deg", r["cell_size"], r) for r in results["studies"]]
    text = OPENING.format(
        volume=results["volume"],
        rows=markdown(HEADS, rows),
        tables=download("avakot.csv", "All runs"),
        differences=told(record, DIFFERENCES, _differences),
    )
    text += ENDING.format(command=record["command"]) + COM1DFA
    return StudyPage("avakot", text, {"avakot.csv": as_csv(HEADS, rows)}, {"avakot.png": _figure(results)})


def _differences(results: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of the text, with the table of energies."""
    return {**numbers(results), "energy": markdown(ENERGY_HEADS, energy_rows(results))}


def _rows(run: Mapping[str, Any], other: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of runout and of com1DFA with one law, and of com1DFA without one of its terms."""
    others = {"com1DFA": other, **{f"com1DFA, {what}": numbers for what, numbers in other["variants"].items()}}
    rows = [_row(run["law"], "runout", run["cell_size"], run)]
    return rows + [_row(run["law"], code, 5.0, found) for code, found in others.items()]


def _row(law: str, code: str, cell_size: float, flow: Mapping[str, Any]) -> tuple[str, ...]:
    return law, code, f"{cell_size:g}", *_numbers(flow), f"{flow['csi']:.2f}" if "csi" in flow else ""


def _numbers(flow: Mapping[str, Any]) -> tuple[str, ...]:
    half, four = flow["areas"]
    return (
        *(f"{flow['front']:.0f}", f"{flow['area']:.1f}", f"{half:.1f}", f"{four:.2f}", f"{flow['speed']:.1f}"),
        f"{flow['thickest']:.1f}",
    )


def _figure(results: Mapping[str, Any]) -> bytes:
    from matplotlib.figure import Figure

    runs = results["runs"]
    canvas = Figure(figsize=(5.0 * len(runs), 6.0), layout="constrained")
    for column, run in enumerate(runs):
        axes = canvas.add_subplot(1, len(runs), column + 1)
        draw_outline(axes, results["com1dfa"][run["law"]]["outline"], color="0.4", linewidth=1.4)
        draw_outline(axes, run["outline"], color="#c1121f", linewidth=1.2)
        axes.set(title=run["law"], aspect="equal", xlabel="easting [m]", ylabel="northing [m]")
        axes.tick_params(labelsize=7)
        axes.locator_params(axis="x", nbins=4)
    return as_png(canvas)
