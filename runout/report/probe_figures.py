"""Figures of time series at probes and of profiles along lines, of a member or of the percentiles over the members.

A profile shows ground, flow surface and deposit to scale, and what the maps say along the line.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.hazard.profiles import DISTANCE
from runout.io.probe_files import PERCENTILE, POINTS, SECTIONS, TIME
from runout.report.figures import tidy
from runout.report.maps import WIDE
from runout.report.marks import INK
from runout.report.values import NORMAL, SMALL
from runout.report.wording import THIN, number, percent, unit
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

PANEL, HEAD = 1.45, 0.55  # heights [inch]
TO = f"{THIN}\u2013{THIN}"  # between the ends of a range
PANELS = {  # quantities of a figure: label and colour
    POINTS: {
        "flow_thickness": ("thickness", "#1f6f8b"), "speed": ("speed", "#a23b72"), "pressure": ("pressure \u03c1v²", "#c26a1b"),
    },
    SECTIONS: {
        "discharge": ("discharge", "#1f6f8b"), "passed_volume": ("passed volume", "#7a5c3e"),
        "largest_thickness": ("largest thickness", "#a23b72"), "flow_width": ("flow width", "#5b7f2b"),
    },
}  # fmt: skip
PEAKS = {  # quantities of the tables
    POINTS: ("max_flow_thickness", "max_speed", "max_pressure", "max_momentum_flux", "deposit_thickness", "arrival_time"),
    SECTIONS: ("max_discharge", "passed_volume", "max_flow_thickness", "arrival_time"),
}
HEADINGS = {
    "max_flow_thickness": "Thickness", "max_speed": "Speed", "max_pressure": "Pressure", "max_momentum_flux": "Momentum flux",
    "deposit_thickness": "Deposit", "arrival_time": "Arrival", "max_discharge": "Discharge", "passed_volume": "Passed volume",
}  # fmt: skip
WORDS = {POINTS: "point", SECTIONS: "cross-section"}
PROFILE_WIDTH, PROFILE_PANEL, MARGIN = 9.0, 1.35, 0.9  # [inch]
LOWEST, HIGHEST = 1.3, 16.0  # [inch] of the section
ROOM = 1.12  # height of the section over its relief
GROUND, FLOW, DEPOSIT = "#7d7468", "#1f6f8b", "#b3651d"
PROFILE_PANELS = {
    "max_flow_thickness": ("thickness", FLOW),
    "max_speed": ("speed", "#a23b72"),
    "arrival_time": ("arrival", "#5b7f2b"),
}


@dataclass(frozen=True)
class PeakTable:
    """Largest values at the probes of a kind, as text."""

    kind: str  # "point" or "cross-section"
    headings: list[tuple[str, str]]  # quantity and unit of each column after the name
    rows: list[list[str]]  # name, then values: one number, or median and range of the percentiles


def station_figure(dataset: "xr.Dataset", group: str, station: int, title: str = "") -> Any:
    """Figure of the series of one station: a panel for each quantity.

    Of an ensemble the line is the median and the band lies between the lowest and the highest percentile; of a member the line is
    its own.
    """
    from matplotlib.figure import Figure

    panels = PANELS[group]
    figure = Figure(figsize=(WIDE, HEAD + PANEL * len(panels)), layout="constrained")
    rows = figure.subplots(len(panels), sharex=True)
    for axes, (name, (label, colour)) in zip(rows, panels.items(), strict=True):
        draw_series(axes, dataset, name, station, colour)
        units, _ = VARIABLES[name].printed
        axes.set_ylabel(f"{label}\n[{unit(units)}]")
        tidy(axes, "time since release [s]" if axes is rows[-1] else "")
    name = str(dataset["station_name"].values[station])
    rows[0].set_title(title or f"{WORDS[group].capitalize()} {name}", loc="left", fontsize=NORMAL, color=INK)
    if PERCENTILE in dataset.dims:
        handles, labels = rows[0].get_legend_handles_labels()
        figure.legend(handles[::-1], labels[::-1], fontsize=SMALL, frameon=False, loc="outside upper left", ncols=2)
    return figure


def draw_series(axes: Any, dataset: "xr.Dataset", name: str, station: int, colour: str) -> None:
    """Line of a quantity over time; of an ensemble median and band."""
    time, values = dataset[TIME].values, dataset[name].isel(station=station) / VARIABLES[name].printed[1]
    if PERCENTILE in values.dims:
        levels = values[PERCENTILE].values
        low, high = float(levels.min()), float(levels.max())
        label = f"{low:g} to {high:g} %"
        edges = values.sel(percentile=low).values, values.sel(percentile=high).values
        axes.fill_between(time, *edges, color=colour, alpha=0.22, linewidth=0, label=label)
        middle = float(levels[np.argmin(np.abs(levels - 50.0))])
        axes.plot(time, values.sel(percentile=middle).values, color=colour, linewidth=1.6, label="median of the members")
    else:
        axes.plot(time, values.values, color=colour, linewidth=1.6)
    axes.set_xlim(0.0, max(float(time[-1]), 1e-9))
    if float(values.min()) >= 0.0:
        axes.set_ylim(bottom=0.0)


def peak_table(dataset: "xr.Dataset", group: str) -> PeakTable:
    """Table of the largest values at all stations of a group; of an ensemble the median, and the range of the percentiles."""
    headings, columns = [], []
    for name in PEAKS[group]:
        if name not in dataset:
            continue
        units, divisor = VARIABLES[name].printed
        values = dataset[name].isel(time=-1) if TIME in dataset[name].dims else dataset[name]
        headings.append((HEADINGS[name], unit(units)))
        columns.append([_range(values.isel(station=k), divisor) for k in range(dataset.sizes["station"])])
    if "arrival_probability" in dataset:
        headings.append(("Arrives", "of the members"))
        columns.append([percent(float(share)) for share in dataset["arrival_probability"].values])
    names = [str(name) for name in dataset["station_name"].values]
    return PeakTable(WORDS[group], headings, [list(row) for row in zip(names, *columns, strict=True)])


def _range(values: "xr.DataArray", divisor: float) -> str:
    if PERCENTILE not in values.dims:
        return number(float(values) / divisor)
    levels = values[PERCENTILE].values
    low, middle, high = (float(values.sel(percentile=q)) / divisor for q in (levels.min(), levels[len(levels) // 2], levels.max()))
    if np.isnan([low, high]).all():
        return number(middle)
    if np.isnan(high):  # of an arrival that some members do not have
        return f"{number(middle)} (from {number(low)})"
    return f"{number(middle)} ({number(low)}{TO}{number(high)})"


def profile_figure(dataset: "xr.Dataset", title: str, member: "xr.Dataset | None" = None) -> Any:
    """Figure of a profile: the section without vertical exaggeration, then peak thickness and deposit, speed and arrival.

    Of an ensemble lines are those of one ``member``, since no member has a profile of percentiles; bands lie between the lowest
    and the highest percentile of each place.
    """
    lines = dataset if member is None else member
    from matplotlib.figure import Figure

    section = float(np.clip((PROFILE_WIDTH - MARGIN) * ROOM * relief(dataset) / max(length(dataset), 1e-9), LOWEST, HIGHEST))
    figure = Figure(figsize=(PROFILE_WIDTH, section + MARGIN + PROFILE_PANEL * len(PROFILE_PANELS)), layout="constrained")
    axes = figure.subplots(1 + len(PROFILE_PANELS), height_ratios=[section, *(PROFILE_PANEL for _ in PROFILE_PANELS)], sharex=True)
    draw_section(axes[0], dataset, lines)
    axes[0].set_title(title, loc="left", fontsize=NORMAL, color=INK)
    for one, (name, (label, colour)) in zip(axes[1:], PROFILE_PANELS.items(), strict=True):
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
