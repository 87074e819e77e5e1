"""Page of the case Cascades 2021."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from docs.pages.wording import ENDING, told
from runout.studies.validation_cases.cascades_2021 import DETECTED

HEADS = (
    *("basal [deg]", "cells [m]", "reach [m]", "fall of the centroid [m]", "eroded [m³]", "deposited [m³]"),
    *("CSI of erosion", "CSI of deposition", "RMSE [m]", "cells through the depth", "processor [s]"),
)
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

## Differences, and their reasons

{differences}

Data: landlab (MIT), fetched by checksum or found below `RUNOUT_DATA`. {tables}.

"""
DIFFERENCES = """\
- **No single friction gives the observed deposits.** They lie in four places from the foot of the scar to the outlet. With 15 deg
  nearly all of the mass stops within {short_least:.0f} to {short_most:.0f} m. With 12 deg it reaches the outlet, {far_least:.0f}
  to {far_most:.0f} m too far, and leaves the upper places empty. The event was wet; the model is dry, with one friction
  everywhere.
- **The CSI of erosion is {erosion_most:.2f} at most, with any friction**: the observed area that was lowered is {lowered:.1f}
  times the mapped source, because the flow eroded its path. These runs have no erodible bed, which also explains the smaller
  eroded volume.
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
        differences=told(record, DIFFERENCES, _numbers),
        tables=download("cascades_2021.csv", "All runs"),
    )
    text += ENDING.format(command=record["command"])
    return StudyPage("cascades_2021", text, {"cascades_2021.csv": as_csv(HEADS, rows)}, {"cascades_2021.png": _figure(results)})


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
