"""Maps of the report in their order: variable, colours, title and caption."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.report.maps import Window, draw_location
from runout.report.picture import png
from runout.report.study import Study
from runout.report.wording import number, quantity
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

HEADLINE_THICKNESS = 0.5  # [m] the first map of the report has the threshold nearest to this
LARGEST_SHARE = 0.5  # share of the raster; the report locates smaller windows on a map of the whole terrain
EXCEEDANCES = {  # start of the title by variable; the threshold follows
    "thickness": "Probability of a flow thickness of",
    "speed": "Probability of a flow speed of",
    "pressure": "Probability of a dynamic pressure of",
}


@dataclass(frozen=True)
class Sheet:
    """One map of the report.

    Parameters
    ----------
    title, caption : str
        Quantity and explanation.
    values : ndarray (rows, columns)
        Cells to draw; NaN and 0 are transparent.
    style : str
        Key of :data:`runout.report.maps.STYLES`.
    """

    title: str
    caption: str
    values: np.ndarray
    style: str


def reached_window(study: Study) -> Window:
    """Window around all cells that any member reaches, and the releases."""
    return study.basemap.window(study.hazard["members_reached"].fillna(0).values > 0)


def location(study: Study, window: Window) -> bytes | None:
    """PNG of the whole terrain with the frame of the maps; None if the maps show most of the terrain."""
    shown = (window[0].stop - window[0].start) * (window[1].stop - window[1].start)
    if shown > LARGEST_SHARE * study.basemap.elevation.size:
        return None
    return png(draw_location(study.basemap, window))


def headline_sheets(study: Study) -> list[Sheet]:
    """First maps of the report."""
    hazard = study.hazard
    levels = hazard["thickness_threshold"].values
    first = float(levels[np.argmin(np.abs(levels - HEADLINE_THICKNESS))])
    return [
        exceedance_sheet(hazard, "thickness", first),
        *_percentile_sheets(hazard, "flow_thickness_percentile", "Peak flow thickness", "thickness"),
        *_percentile_sheets(hazard, "speed_percentile", "Peak flow speed", "speed"),
        _arrival_sheet(hazard),
        *_deposit_sheets(hazard),
    ]


def further_sheets(study: Study, headline: list[Sheet]) -> list[Sheet]:
    """Further maps of the report: exceedance of all other thresholds, and peak dynamic pressure."""
    titles = {sheet.title for sheet in headline}
    exceedances = [
        exceedance_sheet(study.hazard, name, float(level))
        for name in EXCEEDANCES
        if f"{name}_threshold" in study.hazard.coords
        for level in study.hazard[f"{name}_threshold"].values
    ]
    pressure = Sheet(
        "Peak dynamic pressure, worst member",
        "Density times speed squared, the largest of all members. "
        "It is the pressure of the undisturbed flow, not the load on an obstacle.",
        study.hazard["peak_pressure"].values,
        "pressure",
    )
    return [sheet for sheet in exceedances if sheet.title not in titles] + [pressure]


def exceedance_sheet(hazard: "xr.Dataset", name: str, level: float) -> Sheet:
    """Map of the probability that the maximum reaches ``level`` (in the unit of the variable)."""
    units, divisor = VARIABLES[f"{name}_threshold"].printed
    shown = quantity(level / divisor, units)
    at = {f"{name}_threshold": level}
    error = hazard[f"{name}_exceedance_rms_error"]
    of = "the spread over blocks of the net" if "blocks" in error.attrs.get("estimator", "") else "independent members"
    return Sheet(
        f"{EXCEEDANCES[name]} {shown} or more",
        f"Conditional probability: the weighted fraction of the members whose maximum reaches {shown}, given that the release "
        f"happens. Its standard error from the number of members alone is {number(float(error.sel(at)), 2)} (that of {of}, "
        "root mean square over these cells).",
        hazard[f"{name}_exceedance_probability"].sel(at).values,
        "probability",
    )


def _percentile_sheets(hazard: "xr.Dataset", name: str, words: str, style: str) -> Iterator[Sheet]:
    levels = hazard["percentile"].values
    middle, top = float(levels[np.argmin(np.abs(levels - 50))]), float(levels.max())
    for level in dict.fromkeys((middle, top)):
        label = "median of the members" if level == 50 else f"{level:g}th percentile of the members"
        caption = (
            f"At least {level:g} % of the members (by weight) stay at or below the value shown, "
            f"at most {100 - level:g} % pass it; no colour means 0."
        )
        yield Sheet(f"{words}, {label}", caption, hazard[name].sel(percentile=level).values, style)


def _arrival_sheet(hazard: "xr.Dataset") -> Sheet:
    return Sheet(
        "First arrival",
        "Earliest time after the release at which the flow of any member arrives in a cell.",
        hazard["first_arrival_time"].values,
        "time",
    )


def _deposit_sheets(hazard: "xr.Dataset") -> Iterator[Sheet]:
    caption = "Weighted mean over the members of the thickness that lies in a cell at the end, the release area included."
    yield Sheet("Deposit, mean of the members", caption, hazard["mean_deposit_thickness"].values, "deposit")


def hazard_extent(hazard: "xr.Dataset", values: Any, least: float) -> float:
    """Area [km2] of the cells with at least ``least``."""
    cell = abs(float(hazard["x"][1] - hazard["x"][0]) * float(hazard["y"][1] - hazard["y"][0]))
    return float(np.nansum(np.asarray(values) >= least)) * cell / 1e6
