"""Maps of the report in their order: variable, colours, title and caption."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.hazard.bed_maps import CHANGES, MEAN_CHANGE, MEAN_SHARE
from runout.hazard.boundary import DEVIATION
from runout.hazard.joint import conditions_of
from runout.quantities import ALL_QUANTITIES, ARRIVAL_PERCENTILE, CHANGE_PERCENTILE, FIRST_ARRIVAL, QUANTITIES, MapQuantity
from runout.report.maps import Basemap, draw_location
from runout.report.picture import png
from runout.report.study import Study
from runout.report.values import Window
from runout.report.wording import number, quantity
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

HEADLINE_THICKNESS = 0.5  # [m] the first map of the report has the threshold nearest to this
LARGEST_SHARE = 0.5  # share of the raster; the report locates smaller windows on a map of the whole terrain
HEADLINES = ("thickness", "speed")  # quantities whose percentiles are among the first maps


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
        Key of :data:`runout.report.values.STYLES`.
    top : float
        Largest value of a continuous scale that several maps share; 0: that of the style.
    """

    title: str
    caption: str
    values: np.ndarray
    style: str
    top: float = 0.0


def reached_window(study: Study) -> Window:
    """Window around all cells that any member reaches, the releases and what was observed."""
    shown = study.hazard["members_reached"].fillna(0).values > 0
    for name in ("observed_deposit_thickness", "observed_elevation_change"):
        if name in study.hazard:
            shown = shown | (study.hazard[name].fillna(0).values != 0)
    return study.basemap.window(shown)


def location(basemap: Basemap, window: Window) -> bytes | None:
    """PNG of the whole terrain with the frame of the maps; None if the maps show most of the terrain."""
    shown = (window[0].stop - window[0].start) * (window[1].stop - window[1].start)
    if shown > LARGEST_SHARE * basemap.elevation.size:
        return None
    return png(draw_location(basemap, window))


def headline_sheets(study: Study) -> list[Sheet]:
    """First maps of the report."""
    hazard = study.hazard
    levels = hazard["thickness_threshold"].values
    first = float(levels[np.argmin(np.abs(levels - HEADLINE_THICKNESS))])
    return [
        exceedance_sheet(hazard, "thickness", first),
        *_return_period_sheets(hazard, QUANTITIES["thickness"]),
        *(sheet for name in HEADLINES for sheet in _percentile_sheets(hazard, QUANTITIES[name])),
        _arrival_sheet(hazard),
        *_deposit_sheets(hazard),
        *_bed_sheets(hazard),
        *_boundary_sheets(hazard),
    ]


def further_sheets(study: Study, headline: list[Sheet]) -> list[Sheet]:
    """Further maps of the report: exceedance of all other thresholds and of joint conditions, other extremes, arrival."""
    titles, hazard = {sheet.title for sheet in headline}, study.hazard
    asked = [q for q in ALL_QUANTITIES.values() if q.thresholds or q.threshold in hazard.coords]  # not those of criteria alone
    levels = [(q.name, float(level)) for q in asked if q.threshold in hazard.coords for level in hazard[q.threshold].values]
    if "scenarios" in hazard.attrs:  # the annual rates are the probabilities times the rate of all scenarios
        exceedances = [sheet for q in asked for sheet in (*_annual_sheets(hazard, q), *_return_period_sheets(hazard, q))]
    else:
        exceedances = [exceedance_sheet(hazard, name, level) for name, level in levels]
    joint = [joint_sheet(hazard, number, condition) for number, condition in enumerate(conditions_of(hazard), 1)]
    shown = [q for q in asked if q.name not in HEADLINES and q.peak in hazard]
    peaks = [*(_peak_sheet(hazard, quantity) for quantity in shown), *_bed_percentile_sheets(hazard)]
    return [sheet for sheet in (*exceedances, *joint, *peaks, *_arrival_percentile_sheets(hazard)) if sheet.title not in titles]


def exceedance_sheet(hazard: "xr.Dataset", name: str, level: float) -> Sheet:
    """Map of the probability that a quantity reaches ``level`` (in the unit of the variable)."""
    mapped = ALL_QUANTITIES[name]
    shown = _limit(name, level)
    caption = (
        f"Conditional probability: the weighted fraction of the members whose {mapped.extreme} reaches {shown}, given that "
        f"{_given(hazard)} happens. "
    )
    return _probability_sheet(hazard, name, {mapped.threshold: level}, f"a {mapped.words} of {shown} or more", caption)


def _given(hazard: "xr.Dataset") -> str:
    """What conditional probabilities suppose."""
    return "one of the scenarios" if "scenarios" in hazard.attrs else "the release"


def _annual_sheets(hazard: "xr.Dataset", mapped: MapQuantity) -> Iterator[Sheet]:
    """Annual rates at which thresholds are reached; none without annual rates of the members."""
    for level in hazard[mapped.threshold].values if mapped.annual_exceedance in hazard else ():
        shown = _limit(mapped.name, float(level))
        caption = (
            f"Annual rate: expected events in a year in which the {mapped.extreme} reaches {shown}, over all scenarios "
            f"({hazard.attrs['scenarios']}). 1/100 is once in 100 years in the mean."
        )
        values = hazard[mapped.annual_exceedance].sel({mapped.threshold: level}).values
        yield Sheet(f"Annual rate of a {mapped.words} of {shown} or more", caption, values, "annual_rate")


def _return_period_sheets(hazard: "xr.Dataset", mapped: MapQuantity) -> Iterator[Sheet]:
    """Values at return periods; none without annual rates of the members."""
    if mapped.at_return_period not in hazard:
        return
    for years in hazard["return_period"].values:
        caption = (
            f"Largest {mapped.words} that is reached at least once in {years:g} years in the mean; no colour means that the flow "
            "arrives less often, not that it never does."
        )
        values = hazard[mapped.at_return_period].sel(return_period=years).values
        yield Sheet(f"Peak {mapped.words}, return period {years:g} years", caption, values, mapped.name)


def joint_sheet(hazard: "xr.Dataset", number: int, condition: Mapping[str, float]) -> Sheet:
    """Map of the probability of joint condition ``number``."""
    parts = " and ".join(f"{ALL_QUANTITIES[name].words} of {_limit(name, level)} or more" for name, level in condition.items())
    caption = (
        "Conditional probability that the maxima of a member reach all of these values. Each maximum counts at its own time: the "
        "probability that they are reached at the same time is at most this. "
    )
    return _probability_sheet(hazard, "joint", {"joint": number}, parts, caption)


def _limit(name: str, level: float) -> str:
    """A threshold with its printed unit."""
    units, divisor = VARIABLES[ALL_QUANTITIES[name].threshold].printed
    return quantity(level / divisor, units)


def _probability_sheet(hazard: "xr.Dataset", name: str, at: dict[str, float], what: str, caption: str) -> Sheet:
    error = hazard[f"{name}_exceedance_rms_error"]
    of = "the spread over blocks of the net" if "blocks" in error.attrs.get("estimator", "") else "independent members"
    return Sheet(
        f"Probability of {what}",
        f"{caption}Its standard error from the number of members alone is {number(float(error.sel(at)), 2)} (that of {of}, "
        "root mean square over these cells).",
        hazard[f"{name}_exceedance_probability"].sel(at).values,
        "probability",
    )


def _peak_sheet(hazard: "xr.Dataset", mapped: MapQuantity) -> Sheet:
    caption = f"{mapped.described[:1].upper()}{mapped.described[1:]}, the largest of all members. {mapped.remark}".rstrip()
    what = f"Largest {mapped.words}" if mapped.of_bed else f"Peak {mapped.words}"
    return Sheet(f"{what}, worst member", caption, hazard[mapped.peak].values, mapped.name)


def _percentile_sheets(hazard: "xr.Dataset", mapped: MapQuantity) -> Iterator[Sheet]:
    levels = hazard["percentile"].values
    for level in dict.fromkeys((_middle(levels), float(levels.max()))):
        caption = (
            f"At least {level:g} % of the members (by weight) stay at or below the value shown, "
            f"at most {100 - level:g} % pass it; no colour means 0."
        )
        values = hazard[mapped.percentile].sel(percentile=level).values
        what = f"Peak {mapped.words}" if mapped.formula else mapped.words.capitalize()
        yield Sheet(f"{what}, {_rank(level)}", caption, values, mapped.name)


def _arrival_percentile_sheets(hazard: "xr.Dataset") -> Iterator[Sheet]:
    levels = hazard["percentile"].values
    for level in dict.fromkeys((float(levels.min()), _middle(levels))):
        caption = (
            f"The flow of {level:g} % of the members (by weight) has arrived by the time shown. Members that never arrive count: "
            f"no colour means that fewer than {level:g} % arrive."
        )
        yield Sheet(f"Arrival, {_rank(level)}", caption, hazard[ARRIVAL_PERCENTILE].sel(percentile=level).values, "time")


def _middle(levels: np.ndarray) -> float:
    """The percentile next to the median."""
    return float(levels[np.argmin(np.abs(levels - 50))])


def _rank(level: float) -> str:
    return "median of the members" if level == 50 else f"{level:g}th percentile of the members"


def _arrival_sheet(hazard: "xr.Dataset") -> Sheet:
    return Sheet(
        "First arrival",
        "Earliest time after the release at which the flow of any member arrives in a cell.",
        hazard[FIRST_ARRIVAL].values,
        "time",
    )


def _deposit_sheets(hazard: "xr.Dataset") -> Iterator[Sheet]:
    caption = "Weighted mean over the members of the thickness that lies in a cell at the end, the release area included."
    yield Sheet("Deposit, mean of the members", caption, hazard["mean_deposit_thickness"].values, "deposit")


def _bed_sheets(hazard: "xr.Dataset") -> Iterator[Sheet]:
    """Maps of an ensemble with an erodible bed."""
    if MEAN_SHARE not in hazard:  # a site with observations has the change of elevation without a bed too
        return
    caption = "Weighted mean over the members of the depth of the bed that the flow took up."
    yield Sheet("Eroded depth, mean of the members", caption, hazard["mean_eroded_depth"].values, "eroded_depth")
    change = _without_zero(hazard[MEAN_CHANGE].values)
    yield Sheet("Change of elevation, mean of the members", MODELLED, change, "difference", _largest_change(hazard))
    caption = (
        "Mass of the bed over mass of the deposit, members weighted by their deposit: 0 is mass of the release alone, 1 of the bed "
        "alone. Cells without deposit have no colour."
    )
    yield Sheet("Share of the bed in the deposit", caption, hazard[MEAN_SHARE].values, "share")


def _boundary_sheets(hazard: "xr.Dataset") -> Iterator[Sheet]:
    """How far the boundary of the flow moves from member to member."""
    if DEVIATION not in hazard:
        return
    width = hazard[DEVIATION].attrs.get("along_the_median_outline", "")
    caption = (
        "Standard deviation over the members of the distance of a cell to the boundary of the flow: by so many metres the boundary "
        f"shown on other maps may lie elsewhere. {width[:1].upper()}{width[1:]}{'.' if width else ''}".rstrip()
    )
    yield Sheet("Position of the boundary", caption, hazard[DEVIATION].values, "distance")


def _bed_percentile_sheets(hazard: "xr.Dataset") -> Iterator[Sheet]:
    """Percentiles of the eroded depth, and of the change of elevation on the scale of its mean."""
    if CHANGE_PERCENTILE not in hazard:
        return
    levels = hazard["percentile"].values
    yield from _percentile_sheets(hazard, ALL_QUANTITIES["eroded_depth"])
    for level in dict.fromkeys((float(levels.min()), _middle(levels), float(levels.max()))):
        caption = (
            f"At least {level:g} % of the members (by weight) stay at or below the value shown; less than 0 is erosion. "
            "All maps of the change of elevation have one scale."
        )
        values = _without_zero(hazard[CHANGE_PERCENTILE].sel(percentile=level).values)
        yield Sheet(f"Change of elevation, {_rank(level)}", caption, values, "difference", _largest_change(hazard))


def _largest_change(hazard: "xr.Dataset") -> float:
    """End of the one scale of all maps of the change of elevation [m]: the 99th percentile of the cells with a change."""
    sizes = [np.abs(hazard[name].values) for name in CHANGES if name in hazard]
    changed = np.concatenate([size[size > 0.0] for size in sizes])
    return float(np.percentile(changed, 99)) if changed.size else 1.0


MODELLED = "Mean over the members: deposit minus release, and minus the eroded depth where there is a bed."


def observed_sheets(study: Study) -> list[Sheet]:
    """Maps of a site with observed deposits or changes of elevation: observed, and modelled minus observed."""
    titles = {
        "observed_deposit_thickness": ("Observed deposit", "Cells without colour have none, or are unknown.", "deposit"),
        "deposit_thickness_difference": ("Deposit: difference", "Mean of the members minus observed.", "difference"),
        "observed_elevation_change": ("Observed change of elevation", "DEM of difference: later minus earlier.", "difference"),
        "mean_elevation_change": ("Modelled change of elevation", MODELLED, "difference"),
        "elevation_change_difference": ("Change of elevation: difference", "Mean of the members minus observed.", "difference"),
    }
    present = [(name, *words) for name, words in titles.items() if name in study.hazard]
    return [Sheet(title, caption, _without_zero(study.hazard[name].values), style) for name, title, caption, style in present]


def _without_zero(values: np.ndarray) -> np.ndarray:
    return np.where(values == 0, np.nan, values)


def hazard_extent(hazard: "xr.Dataset", values: Any, least: float) -> float:
    """Area [km2] of the cells with at least ``least``."""
    cell = abs(float(hazard["x"][1] - hazard["x"][0]) * float(hazard["y"][1] - hazard["y"][0]))
    return float(np.nansum(np.asarray(values) >= least)) * cell / 1e6
