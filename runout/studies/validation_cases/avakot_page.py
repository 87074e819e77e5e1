"""Page of the case avaKot."""

from collections.abc import Mapping
from typing import Any

from runout.studies.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.studies.validation_cases.drawing import draw_outline
from runout.studies.validation_cases.wording import ENDING

HEADS = (
    *("friction", "code", "cells [m]", "front [m]", "area [ha]", "> 0.5 m [ha]", "> 4 m [ha]", "largest speed [m/s]"),
    *("thickest [m]", "CSI", "processor [s]"),
)
OPENING = """# AvaFrame's avaKot with its own friction

A slab 1 m thick normal to the slope ({volume:.0f} m³) on the terrain of the Kontertal (cells of 5 m). Friction: samosAT with the
coefficients of AvaFrame's standard test of this site (mu = 0.155), and Voellmy with AvaFrame's defaults (mu = 0.155,
xi = 4000 m/s²). runout: snow of 200 kg/m³, internal friction 30 deg, drag over the column,
four levels of particles through the slab.

{rows}

Front: farthest place along AvaFrame's path with a peak speed above 1 m/s. Area: peak thickness above 0.1 m, then above 0.5 m and
4 m, normal to the slope. CSI: area of 0.1 m against com1DFA with the same friction. Both codes state thickness as volume over area.

![Outlines at 0.1 m peak thickness](avakot.png)

*Outlines at 0.1 m: runout in red, com1DFA in grey.*

## Differences

- **Front and speed agree**: fronts 29 m and 17 m short of com1DFA's 1.6 to 1.8 km, largest speeds within 6 %.
- **In 3D the mass leaves the ground.** At 40 m/s crests with a radius below 160 m lift it. Up to {lifted:.0f} % of the particles
  are more than 5 m over the ground (Voellmy); of single points that slide on this terrain and land inelastically, 31 %. Drag
  acts on mass in flight too, friction does not.
- **com1DFA keeps all mass on the ground, and its speed where the ground turns it.** Without friction and artificial viscosity it
  loses below 1 % of the potential energy in 20 s; such points lose 32 %, runout, with internal friction, 49 %.
- **runout is thicker in the gully only**: on {four:.2f} ha it exceeds 4 m, com1DFA on {other_four:.2f} ha; above 0.5 m its area is
  smaller. There the mass is loose: its mean height is 2.2 to 3.5 times half its thickness. So little pressure spreads it.
  com1DFA without pressure and viscosity exceeds 4 m on {free_four:.2f} ha. Internal friction is not the reason: with 12 and
  45 deg the thickest place has 11.3 and 9.5 m. It grows with finer cells: 7.4 m with 10 m, 11.5 m with 3.3 m.
- **With Voellmy the area is larger by {more:.0f} %**, between com1DFA with artificial viscosity and without it. Part of the flow
  leaves the gully to the west where it bends (figure). It is thin: the median of the peaks outside of com1DFA's area is 0.2 m,
  and 13 % of the volume stops there. With internal friction of 12 and 45 deg the area is 25.6 and 18.8 ha, with cells of 10 and
  3.3 m 21.8 and 24.0 ha.
- **Artificial viscosity holds com1DFA's flow together**: without it the area of com1DFA is larger by 25 % (samosAT) and 71 %
  (Voellmy). CSI of com1DFA without it against com1DFA is below that of runout.

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
    text = OPENING.format(
        volume=results["volume"], rows=markdown(HEADS, rows), tables=download("avakot.csv", "All runs"), **_differences(results)
    )
    text += ENDING.format(command=record["command"])
    return StudyPage("avakot", text, {"avakot.csv": as_csv(HEADS, rows)}, {"avakot.png": _figure(results)})


def _differences(results: Mapping[str, Any]) -> dict[str, float]:
    """Numbers of the text, with Voellmy friction."""
    run, other = next(run for run in results["runs"] if run["law"] == "Voellmy"), results["com1dfa"]["Voellmy"]
    free = other["variants"]["no artificial viscosity, no pressure"]
    return {
        "lifted": 100.0 * run["lifted"],
        "four": run["areas"][1],
        "other_four": other["areas"][1],
        "free_four": free["areas"][1],
        "more": 100.0 * (run["area"] / other["area"] - 1.0),
    }


def _rows(run: Mapping[str, Any], other: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of runout and of com1DFA with one law, and of com1DFA without one of its terms."""
    own = (*_numbers(run), f"{run['csi']:.2f}", f"{run['seconds']:.0f}")
    others = {"com1DFA": other, **{f"com1DFA, {what}": numbers for what, numbers in other["variants"].items()}}
    rows = [(run["law"], "runout", f"{run['cell_size']:g}", *own)]
    for code, found in others.items():
        csi = f"{found['csi']:.2f}" if "csi" in found else ""
        rows.append((run["law"], code, "5", *_numbers(found), csi, ""))
    return rows


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
