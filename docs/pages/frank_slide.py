"""Page of the case Frank Slide."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, draw_outline, markdown
from docs.pages.wording import ENDING, told
from runout.studies.validation_cases.frank_slide import LEVELS, SHALTOP_ENERGY

DIFFERENCES = """\
- **The mass moves alike.** Centroids differ by {centroid:.1f} cells at most. Kinetic energies from 10 to 30 s agree within
  {energy:.1f} %.
- **At 20 s and 15 deg the front lags by {lag:.0f} m and the rear is {ahead:.0f} m ahead: the mass is shorter, not slower.** Cells
  of {fine:g} m change the lag by {finer:.0f} m. Less internal friction does more. SHALTOP has hydrostatic pressure, which
  stretches the mass; {angle:g} deg of internal friction resist that. With {least:g} deg, the least that passes on 15 deg at the
  base, the lag is {least_lag:.0f} m at 20 s. At 30 s it is {later:.0f} m (negative: ahead) in place of {late:.0f} m, and CSI at 5
  m and 20 s is {csi_least:.2f} in place of {csi:.2f}.
- **{early_least:.0f} to {early_most:.0f} m of the lag arise in the first 10 s, with any of these internal frictions and cells.**
  The pile is up to {pile:.0f} m thick and steep there. In SHALTOP its full weight drives it at once, whatever its vertical
  acceleration. In three dimensions the mass has to fall first.
- No parameter was fitted to SHALTOP: {angle:g} deg is the value of `sites/frank_slide`.
- SHALTOP is a model, not an observation. The outline of the true deposit does not come with these data."""


def numbers(results: Mapping[str, Any]) -> dict[str, float]:
    """Numbers of the text: those of frames 1 to 3 are at 10, 20 and 30 s."""
    from runout.studies.validation_cases.frank_slide import SHALTOP_ENERGY

    runs, studies = results["runs"], results["studies"]
    run = next(r for r in runs if r["basal_friction_deg"] == 15)
    least = min(studies, key=lambda r: r["friction_angle_deg"])
    fine = min(studies, key=lambda r: r["cell_size"])
    known = np.array(SHALTOP_ENERGY[15])[1:4]
    apart = [np.abs(np.subtract(r["runout"]["centroid"], r["shaltop"]["centroid"])).max() for r in runs]
    early = [lag(r, 1) for r in (run, *studies)]
    return {
        "centroid": max(apart) / run["cell_size"],
        "energy": 100.0 * float(np.abs(np.array(run["kinetic_energy"])[1:4] / known - 1.0).max()),
        "lag": lag(run, 2), "ahead": run["runout"]["rear"][2] - run["shaltop"]["rear"][2],
        "fine": fine["cell_size"], "finer": abs(lag(fine, 2) - lag(run, 2)),
        "angle": run["friction_angle_deg"], "least": least["friction_angle_deg"],
        "least_lag": lag(least, 2), "late": lag(run, 3), "later": lag(least, 3),
        "csi": run["csi"][2][1], "csi_least": least["csi"][2][1],
        "early_least": min(early), "early_most": max(early), "pile": run["runout"]["thickest"][0],
    }  # fmt: skip


def lag(run: Mapping[str, Any], frame: int) -> float:
    """Distance [m] of the front of a run behind that of SHALTOP in a frame."""
    return float(run["shaltop"]["front"][frame] - run["runout"]["front"][frame])


COLOURS = {"runout": "#c1121f", "shaltop": "0.35"}
PARTS = ("front", "rear", "centroid", "thickest")
HEADS = (
    *("basal [deg]", "time [s]", "CSI 1 m", "CSI 5 m", "CSI 10 m"),
    *("front [m]", "SHALTOP", "rear [m]", "SHALTOP", "centroid [m]", "SHALTOP", "thickest [m]", "SHALTOP"),
)
OPENING = """# Frank Slide beside SHALTOP

The failed mass of 36.0 million m³ on its sliding surface (20 m cells, no coordinate system), Coulomb friction of 15 and 20 deg
at the base. SHALTOP is depth-averaged, with hydrostatic pressure and no internal friction. runout: cells of {cell:g} m, internal
friction {friction:g} deg, 2000 kg/m³, stiffness by default, {particles} particles, {seconds} s on one core.

Thickness is vertical: that of SHALTOP is divided by the cosine of the slope. Distances are along the line through the centroids of
SHALTOP. Front and rear: thickness of 5 m.

{frames}

Peak over all frames, CSI at 1, 5 and 10 m: {peaks}.

![Outlines at 5 m thickness, front and rear along the flow line, and energy](frank_slide.png)

*Outline at 5 m, runout in red, SHALTOP in grey; front, centroid and rear along the flow line; kinetic energy and loss of
potential energy over density.*

## Energy

{energy}

Over density, in 10⁹ m⁵/s². The kinetic energy of SHALTOP at 20 deg is not published with its frames.

## Differences, and their reasons

{differences}

{studies}

Data: tilupy (CeCILL-C), fetched by checksum or found below `RUNOUT_DATA`. {tables}.

"""


def page(record: Mapping[str, Any]) -> StudyPage:
    """Page of a record."""
    results = record["results"]
    runs, studies = results["runs"], results["studies"]
    text = OPENING.format(
        cell=runs[0]["cell_size"],
        friction=runs[0]["friction_angle_deg"],
        particles=runs[0]["particles"],
        seconds=" and ".join(f"{r['seconds']:.0f}" for r in runs),
        frames=markdown(HEADS, (row for run in runs for row in _frames(run))),
        peaks="; ".join(f"{r['basal_friction_deg']} deg {', '.join(f'{v:.2f}' for v in r['csi_of_peak'])}" for r in runs),
        energy=markdown(("basal [deg]", "time [s]", "kinetic", "SHALTOP", "potential, lost", "SHALTOP"), _energies(runs)),
        differences=told(record, DIFFERENCES, numbers),
        studies=markdown(STUDY_HEADS, [_study(r) for r in (runs[0], *studies)]) if studies else "",
        tables=download("frank_slide.csv", "All frames of all runs"),
    )
    rows = [(r["friction_angle_deg"], r["cell_size"], *row) for r in (*runs, *studies) for row in _frames(r)]
    table = as_csv(("internal friction [deg]", "cells [m]", *HEADS), rows)
    text += ENDING.format(command=record["command"])
    return StudyPage("frank_slide", text, {"frank_slide.csv": table}, {"frank_slide.png": _figure(runs)})


def _frames(run: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows: one a frame."""
    pairs = [(run["runout"][part], run["shaltop"][part]) for part in PARTS]
    return [
        (
            *(f"{run['basal_friction_deg']}", f"{time:.0f}"),
            *(f"{v:.2f}" for v in run["csi"][k]),
            *(f"{values[k]:.0f}" for pair in pairs for values in pair),
        )
        for k, time in enumerate(run["times"])
        if time <= 60 or time == run["times"][-1]
    ]


def _energies(runs: list[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Rows: energies [1e9 m5/s2] of both codes at 10 to 50 s."""
    rows = []
    for run in runs:
        known = SHALTOP_ENERGY.get(run["basal_friction_deg"], ())
        for k in range(1, 6):
            other = f"{known[k] / 1e9:.1f}" if known else ""
            fallen = [f"{run[code]['fallen'][k] / 1e9:.1f}" for code in COLOURS]
            rows.append((f"{run['basal_friction_deg']}", f"{10 * k}", f"{run['kinetic_energy'][k] / 1e9:.1f}", other, *fallen))
    return rows


STUDY_HEADS = (
    *("internal friction [deg]", "cells [m]", "front at 20 s [m]", "at 30 s", "at 50 s", "thickest at 20 s [m]"),
    *("length at 20 s [m]", f"CSI {LEVELS[1]:g} m at 20 s", "at 50 s", "processor [s]"),
)


def _study(run: Mapping[str, Any]) -> tuple[str, ...]:
    """Row of a run at 15 deg: front, largest thickness, length and CSI at the frames that differ most."""
    own = run["runout"]
    return (
        *(f"{run['friction_angle_deg']:g}", f"{run['cell_size']:g}"),
        *(f"{own['front'][k]:.0f}" for k in (2, 3, 5)),
        f"{own['thickest'][2]:.0f}",
        f"{own['front'][2] - own['rear'][2]:.0f}",
        *(f"{run['csi'][k][1]:.2f}" for k in (2, 5)),
        f"{run['seconds']:.0f}",
    )


def _figure(runs: list[Mapping[str, Any]]) -> bytes:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(14.0, 3.4 * len(runs)), layout="constrained")
    for row, run in enumerate(runs):
        for column, (time, outlines) in enumerate(run["outlines"].items()):
            axes = canvas.add_subplot(len(runs), 5, 5 * row + column + 1)
            for code, colour in COLOURS.items():
                draw_outline(axes, outlines[code], color=colour, linewidth=1.2)
            axes.set(title=f"{run['basal_friction_deg']} deg, {time} s", aspect="equal", xlim=(400, 3300), ylim=(1100, 3400))
            axes.tick_params(labelsize=7)
        _along(canvas.add_subplot(len(runs), 5, 5 * row + 4), run)
        _energy(canvas.add_subplot(len(runs), 5, 5 * row + 5), run)
    return as_png(canvas)


def _along(axes: Any, run: Mapping[str, Any]) -> None:
    for code, colour in COLOURS.items():
        for part, style in (("front", "-"), ("centroid", "--"), ("rear", ":")):
            label = f"{part}, {code.replace('shaltop', 'SHALTOP')}"
            axes.plot(run["times"][:7], run[code][part][:7], style, color=colour, label=label)
    axes.set(title="along the flow line [m]", xlabel="time [s]")
    axes.legend(frameon=False, fontsize=6)


def _energy(axes: Any, run: Mapping[str, Any]) -> None:
    times, known = run["times"][:7], SHALTOP_ENERGY.get(run["basal_friction_deg"], ())
    for code, colour in COLOURS.items():
        axes.plot(times, [e / 1e9 for e in run[code]["fallen"][:7]], "--", color=colour)
    axes.plot(times, [e / 1e9 for e in run["kinetic_energy"][:7]], color=COLOURS["runout"])
    axes.plot(times[: len(known)], [e / 1e9 for e in known], color=COLOURS["shaltop"])
    axes.set(title="kinetic (-), potential lost (--)", ylabel="energy over density [10⁹ m⁵/s²]", xlabel="time [s]")
    axes.title.set_fontsize(9)
