"""Page of the case avaKot."""

from collections.abc import Mapping
from typing import Any

from runout.studies.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.studies.validation_cases.drawing import draw_outline
from runout.studies.validation_cases.wording import ENDING

HEADS = (
    *("friction", "code", "cells [m]", "front [m]", "area [ha]", "largest speed [m/s]", "thickest [m]", "CSI"),
    "processor [s]",
)
OPENING = """# AvaFrame's avaKot with its own friction

A slab 1 m thick normal to the slope ({volume:.0f} m³) on the terrain of the Kontertal (cells of 5 m). Friction: samosAT with the
coefficients of AvaFrame's standard test of this site (mu = 0.155), and Voellmy with AvaFrame's defaults (mu = 0.155,
xi = 4000 m/s²). runout: snow of 200 kg/m³, internal friction 30 deg, drag over the column,
four levels of particles through the slab.

{rows}

Front: farthest place along AvaFrame's path with a peak speed above 1 m/s. Area and CSI: peak thickness of 0.1 m, normal to the
slope.

![Outlines at 0.1 m peak thickness](avakot.png)

*Outlines at 0.1 m: runout in red, com1DFA in grey.*

## Differences

- **Front and speed agree**: fronts 16 m and 34 m short of com1DFA's 1.6 to 1.8 km, largest speeds within 6 %. Fast parts of a flow
  leave rough ground in 3D. The drag of the law acts there too, since depth-averaged models let no mass leave the ground.
- **runout is thicker.** Internal friction resists the spreading of a flow ({{doc}}`idealized_topo`), and mass in
  flight has no friction. What else makes this flow thicker is open.
- **With Voellmy the area is larger by 28 %**: part of the flow leaves the gully to the west where it bends (figure).
- Artificial viscosity of com1DFA costs 5 m/s and makes its area smaller by a fifth; its term of curvature changes little.

## What is not comparable

- AvaFrame's reference of this test is a run of com1DFA, not an observation. No outline of an avalanche comes with the site.
- samosAT needs the thickness. runout takes it from the load of each contact, com1DFA from its depth-averaged field.
- com1DFA has artificial viscosity, its own stop rule (1 % of the largest kinetic energy) and no internal friction.
- Newer versions choose samosATSmall (mu = 0.22) for this volume; the standard test keeps samosAT.

{tables}.

"""


def page(record: Mapping[str, Any]) -> StudyPage:
    """Page of a record."""
    results = record["results"]
    rows = [row for run in results["runs"] for row in _rows(run, results["com1dfa"][run["law"]])]
    text = OPENING.format(volume=results["volume"], rows=markdown(HEADS, rows), tables=download("avakot.csv", "All runs"))
    text += ENDING.format(command=record["command"])
    return StudyPage("avakot", text, {"avakot.csv": as_csv(HEADS, rows)}, {"avakot.png": _figure(results)})


def _rows(run: Mapping[str, Any], other: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of runout and of com1DFA with one law, and of com1DFA without one of its terms."""
    keys = (("front", ".0f"), ("area", ".1f"), ("speed", ".1f"), ("thickest", ".1f"))
    own = (*(f"{run[key]:{how}}" for key, how in keys), f"{run['csi']:.2f}", f"{run['seconds']:.0f}")
    others = {"com1DFA": other, **{f"com1DFA, {what}": numbers for what, numbers in other.get("variants", {}).items()}}
    rows = [(run["law"], "runout", f"{run['cell_size']:g}", *own)]
    return rows + [(run["law"], code, "5", *(f"{found[key]:{how}}" for key, how in keys), "", "") for code, found in others.items()]


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
