"""Figure of a profile: ground, flow surface and deposit to scale, and what the maps say along the line."""

from typing import TYPE_CHECKING, Any

import numpy as np

from runout.hazard.profiles import DISTANCE
from runout.io.probe_files import PERCENTILE
from runout.report.figures import tidy
from runout.report.marks import INK
from runout.report.values import NORMAL, SMALL
from runout.report.wording import unit
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

WIDTH, PANEL, MARGIN = 9.0, 1.35, 0.9  # [inch]
LOWEST, HIGHEST = 1.3, 16.0  # [inch] of the section
ROOM = 1.12  # height of the section over its relief
GROUND, FLOW, DEPOSIT = "#7d7468", "#1f6f8b", "#b3651d"
PANELS = {"max_flow_thickness": ("thickness", FLOW), "max_speed": ("speed", "#a23b72"), "arrival_time": ("arrival", "#5b7f2b")}


def profile_figure(dataset: "xr.Dataset", title: str, member: "xr.Dataset | None" = None) -> Any:
    """Figure of a profile: the section without vertical exaggeration, then peak thickness and deposit, speed and arrival.

    Of an ensemble lines are those of one ``member``, since no member has a profile of percentiles; bands lie between the lowest
    and the highest percentile of each place.
    """
    lines = dataset if member is None else member
    from matplotlib.figure import Figure

    section = float(np.clip((WIDTH - MARGIN) * ROOM * relief(dataset) / max(length(dataset), 1e-9), LOWEST, HIGHEST))
    figure = Figure(figsize=(WIDTH, section + MARGIN + PANEL * len(PANELS)), layout="constrained")
    axes = figure.subplots(1 + len(PANELS), height_ratios=[section, *(PANEL for _ in PANELS)], sharex=True)
    draw_section(axes[0], dataset, lines)
    axes[0].set_title(title, loc="left", fontsize=NORMAL, color=INK)
    for one, (name, (label, colour)) in zip(axes[1:], PANELS.items(), strict=True):
        draw_quantity(one, dataset, lines, name, colour, label)
        if name == "max_flow_thickness":
            draw_quantity(one, dataset, lines, "deposit_thickness", DEPOSIT, "deposit")
            one.legend(fontsize=SMALL, frameon=False, loc="upper right")
        one.set_ylim(bottom=0.0)
        one.set_ylabel(f"{label}\n[{unit(VARIABLES[name].printed[0])}]")
    for one in axes:
        tidy(one, "distance along the line [m]" if one is axes[-1] else "")
    axes[0].set_xlim(0.0, length(dataset))
    set_equal_scales(figure, axes[0], dataset)
    return figure


def set_equal_scales(figure: Any, axes: Any, dataset: "xr.Dataset") -> None:
    """Give the section the elevations that its height shows at the scale of the distances."""
    figure.draw_without_rendering()
    box = axes.get_window_extent()
    shown = length(dataset) * box.height / box.width
    bed = dataset["bed_elevation"].values
    lowest = float(np.nanmin(bed)) if np.isfinite(bed).any() else 0.0
    axes.set_ylim(lowest - 0.5 * (shown - relief(dataset)), lowest + 0.5 * (shown + relief(dataset)))
    figure.draw_without_rendering()
    figure.set_layout_engine("none")


def length(dataset: "xr.Dataset") -> float:
    """Length of the line [m]."""
    return float(dataset[DISTANCE].values[-1])


def relief(dataset: "xr.Dataset") -> float:
    """Difference between the highest and the lowest place of the section [m]."""
    ground, bed = dataset["ground_elevation"].values, dataset["bed_elevation"].values
    top = np.fmax(ground, bed + np.nan_to_num(layers(dataset, "max_flow_thickness")[-1]))
    return float(np.nanmax(top) - np.nanmin(bed)) if np.isfinite(bed).any() else 1.0


def layers(dataset: "xr.Dataset", name: str) -> np.ndarray:
    """Values (1 or percentiles, n) of a quantity along the line."""
    return np.atleast_2d(dataset[name].values)


def draw_section(axes: Any, dataset: "xr.Dataset", lines: "xr.Dataset") -> None:
    """Ground, highest flow surface and deposit of ``lines``, with equal scales; of an ensemble the highest percentile too."""
    distance, ground, bed = (lines[name].values for name in (DISTANCE, "ground_elevation", "bed_elevation"))
    flow, deposit = (lines[name].values for name in ("max_flow_thickness", "deposit_thickness"))
    bottom = np.nanmin(bed) - length(dataset) - relief(dataset)
    axes.fill_between(distance, bottom, bed, color=GROUND, alpha=0.35, linewidth=0)
    axes.fill_between(distance, bed, bed + np.nan_to_num(deposit), color=DEPOSIT, alpha=0.9, linewidth=0, label="deposit")
    axes.plot(distance, _surface(bed, flow), color=FLOW, linewidth=1.2, label="highest flow surface")
    if PERCENTILE in dataset.dims:
        label = f"{float(dataset[PERCENTILE].values[-1]):g} % of members, each place for itself"
        highest = _surface(bed, layers(dataset, "max_flow_thickness")[-1])
        axes.plot(distance, highest, color=FLOW, linewidth=0.8, linestyle=":", label=label)
    axes.plot(distance, ground, color=INK, linewidth=0.9)
    if np.nanmax(ground - bed, initial=0.0) > 0.0:
        axes.plot(distance, bed, color=INK, linewidth=0.8, linestyle="--", label="ground without the release")
    axes.set_ylabel("elevation [m]")
    axes.legend(fontsize=SMALL, frameon=False, loc="upper right")


def _surface(bed: np.ndarray, thickness: np.ndarray) -> np.ndarray:
    """Surface of the flow where it is; its bed where it begins and ends."""
    wet = np.nan_to_num(thickness) > 0.0
    beside = wet | np.roll(wet, 1) | np.roll(wet, -1)
    return np.where(beside, bed + np.nan_to_num(thickness), np.nan)  # type: ignore[no-any-return]


def draw_quantity(axes: Any, dataset: "xr.Dataset", lines: "xr.Dataset", name: str, colour: str, label: str) -> None:
    """Line of a quantity along the profile; of an ensemble the band of its percentiles as well."""
    distance, divisor = dataset[DISTANCE].values, VARIABLES[name].printed[1]
    if PERCENTILE in dataset.dims:
        values = layers(dataset, name) / divisor
        axes.fill_between(distance, values[0], values[-1], color=colour, alpha=0.2, linewidth=0)
    axes.plot(distance, lines[name].values / divisor, color=colour, linewidth=1.4, label=label)
