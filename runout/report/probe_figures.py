"""Figures of time series at probes: one a probe, of a member or of the percentiles over the members."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

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
