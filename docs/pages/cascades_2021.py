"""Page of the case Cascades 2021."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from docs.pages.wording import ENDING, told
from runout.studies.validation_cases.cascades_2021 import BED, COMPARED, DETECTED

HEADS = (
    *("basal [deg]", "cells [m]", "reach [m]", "fall of the centroid [m]", "eroded [m³]", "deposited [m³]"),
    *("CSI of erosion", "CSI of deposition", "RMSE [m]", "cells through the depth", "processor [s]"),
)
BED_HEADS = (
    *("model", "basal [deg]", "cells [m]", "bed [m]", "taken from the bed [m³]", "eroded [m³]", "deposited [m³]"),
    *("CSI", "agreement within a cell", "reach error [m³]", "processor [s]"),
)
REACH_HEADS = ("model", "basal [deg]", "cells [m]", "bed [m]")
OPENING = """# Cascades 2021 beside the DEM of difference

A landslide near Mount St. Helens, December 2021: source of 22 481 m³, mapped, up to 15.7 m deep, on a DEM of 10 m. Observed is the
difference of elevations after and before. runout: the inputs of the site `sites/cascades_2021`, over its range of basal friction.

{runs}

- Changes below {limit:g} m do not count. CSI: area eroded, or deposited, in both over that in either.
- *Reach*: plan distance from the highest released cell to the farthest deposit. *Fall*: height between the centroids of source and
  deposit.
- *RMSE*: change of elevation, over the cells that changed in either.

![Observed and modelled change of elevation](cascades_2021.png)

*Change of elevation [m], observed and modelled ({shown}); grid cells of the DEM, 10 m.*

{beds}## Differences, and their reasons

{differences}

Data: landlab (MIT), fetched by checksum or found below `RUNOUT_DATA`. {tables}.

"""
BEDS = """## With an erodible bed, and beside landlab

landlab: MassWastingRunout with the parameters of its tutorial, which are fitted to this event, on the cells of the DEM. Beds of
runout: law `ramms` with its default parameters; nothing is fitted.

{runs}

Net change of volume by reach [m³]; a reach is a band of rows of the raster, which the channel goes down from north to south:

{reaches}

- *Eroded*, *deposited*: volumes below and above the ground of before. *Taken from the bed*: also where deposits cover it now.
- *CSI*, *agreement within a cell*: of the area that is lowered or raised by {compared:g} m or more ({{doc}}`../guide/scores`).
- *Reach error*: sum over the reaches of the absolute difference from the observed volume.
- **A bed mends a part of the eroded volume, not the places of the deposits.** With cells of {bed_cells:g} m it raises the eroded
  volume from {bare_eroded:.0f} to {bed_eroded:.0f} m³ (observed {eroded:.0f} m³) and the CSI from {bare_csi:.2f} to {bed_csi:.2f};
  the reach error is {bare_error:.0f} and {bed_error:.0f} m³. landlab, which is fitted to the event, has a CSI of
  {landlab_csi:.2f} and a reach error of {landlab_error:.0f} m³.
- **A model that conserves volume cannot fit both volumes**: the survey has {lacking:.0f} m³ less deposited than eroded.

"""
DIFFERENCES = """\
- **No single friction gives the observed deposits.** They lie in four places from the foot of the scar to the outlet. With 15 deg
  nearly all of the mass stops within {short_least:.0f} to {short_most:.0f} m. With 12 deg it reaches the outlet, {far_least:.0f}
  to {far_most:.0f} m too far, and leaves the upper places empty. The event was wet; the model is dry, with one friction
  everywhere.
- **Without a bed the CSI of erosion is {erosion_most:.2f} at most, with any friction**: the observed area that was lowered is
  {lowered:.1f} times the mapped source, because the flow eroded its path.
- **The flow is thin: {least_cells:.1f} to {most_cells:.1f} cells through a depth of {least_depth:.0f} to {most_depth:.0f} m.**
  The CSI of deposition at 12 deg is {coarse_csi:.2f} with cells of 5 m and {fine_csi:.2f} with 3 m; at 15 deg and 3 m it is
  {other_csi:.2f}. So cells matter as much as the friction. Four cells at 12 deg would need a spacing of about {needed:.1f} m. So
  this case measures the limit for thin flows; it does not show the method resolved."""


def page(record: Mapping[str, Any]) -> StudyPage:
    """Page of a record."""
    results = record["results"]
    rows, shown = [_row(r) for r in results["runs"]], results["shown"]
    observed = results["observed"]
    numbers = [f"{observed[k]:.0f}" for k in ("reach", "fall", "erosion_volume", "deposition_volume")]
    last = ("**observed**", "", *numbers, *[""] * 5)
    text = OPENING.format(
        runs=markdown(HEADS, [*rows, last]),
        limit=DETECTED,
        shown=f"{shown['basal_friction_deg']:g} deg, cells of {shown['cell_size']:g} m",
        beds=_beds(record),
        differences=told(record, DIFFERENCES, _numbers),
        tables=download("cascades_2021.csv", "All runs"),
    )
    text += ENDING.format(command=record["command"])
    return StudyPage("cascades_2021", text, {"cascades_2021.csv": as_csv(HEADS, rows)}, {"cascades_2021.png": _figure(results)})


def _beds(record: Mapping[str, Any]) -> str:
    """Section on the runs with a bed and on landlab's; empty for a record of the coarse size, which has not all of them."""
    results = record["results"]
    if not record["full"]:
        return ""
    runs, observed = results["beds"], results["observed"]
    finest = min(run["cell_size"] for run in runs if "cell_size" in run)
    bare, bed = (next(run for run in runs if run.get("cell_size") == finest and run["bed"] == depth) for depth in (0.0, BED))
    (landlab,) = (run for run in runs if run["model"] == "landlab")
    volumes = [_setup(run) + _whole(*run["reach_volumes"]) for run in runs]
    heads = (*REACH_HEADS, *(f"rows {first} to {last}" for first, last in results["reach_rows"]))
    of_survey = ("**observed**", *[""] * 4, *_whole(observed["erosion_volume"], observed["deposition_volume"]), *[""] * 4)
    return BEDS.format(
        runs=markdown(BED_HEADS, [*map(_bed_row, runs), of_survey]),
        reaches=markdown(heads, [*volumes, ("**observed**", *[""] * 3, *_whole(*observed["reach_volumes"]))]),
        compared=COMPARED,
        bed_cells=finest,
        eroded=observed["erosion_volume"],
        lacking=observed["erosion_volume"] - observed["deposition_volume"],
        **_named("bare", bare), **_named("bed", bed), **_named("landlab", landlab),
    )  # fmt: skip


def _numbers(results: Mapping[str, Any]) -> dict[str, float]:
    """Numbers of the text."""
    runs = {(run["basal_friction_deg"], run["cell_size"]): run for run in results["runs"]}
    short, far = ([run["reach"] for (angle, _), run in runs.items() if angle == chosen] for chosen in (15, 12))
    observed = results["observed"]
    cells, depths = ([run[key] for run in runs.values()] for key in ("cells_through_depth", "depth"))
    return {
        "short_least": min(short), "short_most": max(short),
        "far_least": min(far) - observed["reach"], "far_most": max(far) - observed["reach"],
        "erosion_most": max(run["erosion_csi"] for run in runs.values()),
        "lowered": observed["lowered_area"] / observed["source_area"],
        "least_cells": min(cells), "most_cells": max(cells), "least_depth": min(depths), "most_depth": max(depths),
        "coarse_csi": runs[12, 5]["deposition_csi"], "fine_csi": runs[12, 3]["deposition_csi"],
        "other_csi": runs[15, 3]["deposition_csi"], "needed": runs[12, 3]["depth"] / 4,
    }  # fmt: skip


def _named(name: str, run: Mapping[str, Any]) -> dict[str, float]:
    return {f"{name}_eroded": run["erosion_volume"], f"{name}_csi": run["csi"], f"{name}_error": run["reach_error"]}


def _bed_row(run: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        *_setup(run),
        f"{run['entrained_volume']:.0f}" if "entrained_volume" in run else "",
        *_whole(run["erosion_volume"], run["deposition_volume"]),
        *(f"{run[key]:.2f}" for key in ("csi", "agreement")),
        *_whole(run["reach_error"], run["seconds"]),
    )


def _setup(run: Mapping[str, Any]) -> tuple[str, ...]:
    numbers = (f"{run[key]:g}" if key in run else "" for key in ("basal_friction_deg", "cell_size", "bed"))
    return (run["model"], *numbers)


def _whole(*values: float) -> tuple[str, ...]:
    return tuple(f"{value:.0f}" for value in values)


def _row(run: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        *(f"{run['basal_friction_deg']:g}", f"{run['cell_size']:g}"),
        *(f"{run[key]:.0f}" for key in ("reach", "fall", "erosion_volume", "deposition_volume")),
        *(f"{run[key]:.2f}" for key in ("erosion_csi", "deposition_csi", "rmse")),
        *(f"{run['cells_through_depth']:.1f}", f"{run['seconds']:.0f}"),
    )


def _figure(results: Mapping[str, Any]) -> bytes:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(8.0, 6.0), layout="constrained")
    for axes, cells, title in zip(
        canvas.subplots(1, 2), (results["observed_change"], results["shown"]["change"]), ("observed", "runout"), strict=True
    ):
        image = axes.imshow(_dense(cells, results["shape"]), cmap="RdBu", vmin=-8, vmax=8)
        axes.set(title=title, xticks=[], yticks=[])
    canvas.colorbar(image, ax=canvas.axes, shrink=0.6, label="change of elevation [m]")
    return as_png(canvas)


def _dense(cells: Sequence[Sequence[float]], shape: Sequence[int]) -> np.ndarray:
    """Map (rows, columns) of the cells that changed; NaN elsewhere."""
    found = np.full(tuple(shape), np.nan)
    for row, column, value in cells:
        found[int(row), int(column)] = value
    return found
