"""Page of the case avaKot."""

from collections.abc import Mapping
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, draw_outline, markdown
from docs.pages.wording import ENDING, told
from runout.model.numerics import Scheme

DIFFERENCES = """\
- **Front and speed agree**: fronts within {apart:.0f} m of com1DFA's {front_samos:.0f} m (samosAT) and
  {front_voellmy:.0f} m (Voellmy), largest speeds within {speed:.0f} %.
- **In 3D the mass leaves the ground.** At its largest speed crests with a radius below {radius:.0f} m lift it. With Voellmy up to
  {lifted:.0f} % of the particles are more than 5 m over the ground. Of single points with the same friction, which slide on this
  terrain and land inelastically, it is {points_lifted:.0f} %. Drag acts on mass in flight too, friction does not.
- **com1DFA keeps all mass on the ground, and its speed where the ground turns it.** runout loses energy there, see below.
- **runout is thicker in the gully only**: on {four:.2f} ha it exceeds 4 m, com1DFA on {other_four:.2f} ha.
  There the mass is loose: its mean height is {loose_least:.1f} to {loose_most:.1f} times half its thickness. So
  little pressure spreads it. com1DFA without pressure and viscosity exceeds 4 m on {free_four:.2f} ha. Internal friction is not
  the reason: with {weak:g} and {strong:g} deg the thickest place has {weak_thickest:.1f} and {strong_thickest:.1f} m. It grows
  with finer cells: {coarse_thickest:.1f} m with {coarse:g} m, {fine_thickest:.1f} m with {fine:g} m.
- **With Voellmy the area is larger by {more:.0f} %**; that of com1DFA without artificial viscosity is by {free_voellmy:.0f} %. Part
  of the flow leaves the gully to the west where it bends (figure). It is thin: the median of the peaks outside of com1DFA's area is
  {peak_outside:.2f} m, and {volume_outside:.0f} % of the volume stops there. With internal friction of {weak:g} and {strong:g}
  deg the area is {weak_area:.1f} and {strong_area:.1f} ha, with cells of {coarse:g} and {fine:g} m {coarse_area:.1f} and
  {fine_area:.1f} ha. CSI is {coarse_csi:.2f} with cells of {coarse:g} m and
  {fine_csi:.2f} with {fine:g} m.
- **Artificial viscosity holds com1DFA's flow together**: without it the area of com1DFA is larger by {free_samos:.0f} % (samosAT)
  and {free_voellmy:.0f} % (Voellmy).{csi_below}

## Energy lost without friction at the base

{energy}

Shares of the potential energy set free in 20 s. *Ground*: cells over which the raster is averaged. *Points*: single points
without a grid, which land inelastically. *Rest*: what closes the energy budget.

- **The loss follows the ground, not the cells.** On ground of 10 m runout loses {same_fine:.0f} % with cells of 5 m and
  {same_coarse:.0f} % with 10 m. On ground of 5, 10 and 20 m it loses {grounds}, the points {points}. So most of the loss is
  landing on rough ground. Finer cells lose more because their ground is rougher.
- **The rest stands mainly for impact.** Loose mass carries no stress, so its impact is no plastic work. Velocities that differ
  within a cell become one in the transfers, as in a plastic impact. On the same ground the rest does not depend on the cells:
  {rest_fine:.0f} and {rest_coarse:.0f} %.
- **Transfers decide how fast they become one.** With one substep there are up to four times as many transfers: the rest is
  {rest_single:.0f} in place of {rest:.0f} % and the loss {lost_single:.0f} in place of {lost:.0f} %. With the fewer transfers of
  the default less is damped. The flow spreads more, as that of com1DFA does without artificial viscosity: CSI at 0.1 m is
  {csi_samos:.2f} (samosAT) and {csi_voellmy:.2f} (Voellmy), with one substep {single_samos:.2f} and {single_voellmy:.2f}. Which is
  nearer to snow is not known: no observation comes with the site."""
ENERGY_HEADS = (
    *("ground [m]", "cells [m]", "substeps", "points [%]", "runout [%]", "plastic [%]", "at the ground [%]", "rest [%]"),
)


def energy_rows(results: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the table of energies."""
    shares = ("points", "lost", "plastic", "basal", "numerical")
    return [
        (f"{row['ground']:g}", f"{row['cell_size']:g}", f"{row['substeps']}", *(f"{100 * row[key]:.0f}" for key in shares))
        for row in results["energy"]
    ]


def numbers(results: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of the text; where no law is named, with Voellmy friction."""
    others, runs = results["com1dfa"], {run["law"]: run for run in results["runs"]}
    run, other, single = runs["Voellmy"], others["Voellmy"], {row["law"]: row for row in results["one_substep"]}
    free = other["variants"]["no artificial viscosity, no pressure"]
    apart = max(abs(others[law]["front"] - own["front"]) for law, own in runs.items())
    return {
        "apart": apart,
        "front_samos": others["samosAT"]["front"], "front_voellmy": other["front"],
        "speed": 100.0 * max(abs(own["speed"] / others[law]["speed"] - 1.0) for law, own in runs.items()),
        "radius": run["speed"] ** 2 / 9.81, "lifted": 100.0 * run["lifted"], "points_lifted": 100.0 * results["points_lifted"],
        "csi_samos": runs["samosAT"]["csi"], "csi_voellmy": run["csi"],
        "single_samos": single["samosAT"]["csi"], "single_voellmy": single["Voellmy"]["csi"],
        "four": run["areas"][1], "other_four": other["areas"][1], "free_four": free["areas"][1],
        "loose_least": min(run["looseness"]), "loose_most": max(run["looseness"]),
        "more": 100.0 * (run["area"] / other["area"] - 1.0),
        "peak_outside": run["peak_outside"], "volume_outside": 100.0 * run["volume_outside"],
        "free_samos": _widened(others["samosAT"]), "free_voellmy": _widened(other),
    } | _studies(results) | _energies(results) | {"csi_below": _below(results)}  # fmt: skip


def _widened(other: Mapping[str, Any]) -> float:
    """By how much [%] the area of com1DFA is larger without artificial viscosity."""
    return 100.0 * (float(other["variants"]["no artificial viscosity"]["area"]) / float(other["area"]) - 1.0)


def _below(results: Mapping[str, Any]) -> str:
    """A sentence if CSI of com1DFA without artificial viscosity is below that of runout with both laws."""
    free = {law: other["variants"]["no artificial viscosity"]["csi"] for law, other in results["com1dfa"].items()}
    below = all(free[run["law"]] < run["csi"] for run in results["runs"])
    return " CSI of com1DFA without it against com1DFA is below that of runout." if below else ""


def _studies(results: Mapping[str, Any]) -> dict[str, float]:
    """Of the runs with other cells and internal frictions."""
    angles = sorted(results["studies"], key=lambda row: row["friction_angle_deg"])
    cells = sorted(results["studies"], key=lambda row: row["cell_size"])
    chosen = {"weak": angles[0], "strong": angles[-1], "coarse": cells[-1], "fine": cells[0]}
    found: dict[str, float] = {}
    for name, row in chosen.items():
        key = "friction_angle_deg" if name in ("weak", "strong") else "cell_size"
        found |= {name: row[key], f"{name}_thickest": row["thickest"], f"{name}_area": row["area"], f"{name}_csi": row["csi"]}
    return found


def _energies(results: Mapping[str, Any]) -> dict[str, Any]:
    """Of the runs without friction at the base, in percent."""
    rows = {(row["ground"], row["cell_size"], row["substeps"]): row for row in results["energy"]}
    usual = Scheme.substeps
    grounds = [rows[size, 5.0, usual] for size in (5.0, 10.0, 20.0)]
    first, single = grounds[0], rows[5.0, 5.0, 1]

    def listed(key: str) -> str:
        one, two, three = (f"{100 * row[key]:.0f}" for row in grounds)
        return f"{one}, {two} and {three} %"

    return {
        "same_fine": 100 * rows[10.0, 5.0, usual]["lost"], "same_coarse": 100 * rows[10.0, 10.0, usual]["lost"],
        "grounds": listed("lost"), "points": listed("points"),
        "rest_fine": 100 * rows[10.0, 5.0, usual]["numerical"], "rest_coarse": 100 * rows[10.0, 10.0, usual]["numerical"],
        "rest": 100 * first["numerical"], "rest_single": 100 * single["numerical"],
        "lost": 100 * first["lost"], "lost_single": 100 * single["lost"],
    }  # fmt: skip


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
    rows += [_row(r["law"], "runout, one substep", r["cell_size"], r) for r in results["one_substep"]]
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
