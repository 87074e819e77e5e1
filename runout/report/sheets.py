"""Maps that a report prints, at most six, and those of a site with observations: variable, colours, title and caption."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runout.hazard.bed_maps import CHANGES, MEAN_CHANGE
from runout.quantities import ALL_QUANTITIES, FIRST_ARRIVAL, QUANTITIES, MapQuantity
from runout.report.study import Study
from runout.report.values import Window
from runout.report.wording import number, quantity

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Sheet:
    """One map of the report."""

    # title, caption: quantity and explanation
    title: str
    caption: str
    values: np.ndarray  # (rows, columns): cells to draw; NaN and 0 are transparent
    style: str  # key of :data:`runout.report.values.STYLES`
    top: float = 0.0  # largest value of a continuous scale that several maps share; 0: that of the style


def reached_window(study: Study) -> Window:
    """Window around all cells that any member reaches, the releases and what was observed."""
    shown = np.nan_to_num(study.hazard["members_reached"].values) > 0
    for name in ("observed_deposit_thickness", "observed_elevation_change"):
        if name in study.hazard:
            shown = shown | (np.nan_to_num(study.hazard[name].values) != 0)
    return study.basemap.window(shown)


def printed_sheets(study: Study) -> list[Sheet]:
    """Maps of the print: headline (of several members), peak thickness, peak speed, arrival, and deposit or change of elevation."""
    hazard = study.hazard
    return [
        *([] if study.is_single else [_headline(study)]),
        _highest_sheet(study, QUANTITIES["thickness"]),
        _highest_sheet(study, QUANTITIES["pressure" if study.loads is not None else "speed"]),
        _arrival_sheet(study),
        _ground_sheet(hazard),
    ]


def _headline(study: Study) -> Sheet:
    """Probability that the flow reaches the threshold of the maps."""
    hazard, shown = study.hazard, quantity(study.threshold, "m")
    mapped = ALL_QUANTITIES["thickness"]
    error, at = hazard[f"{mapped.name}_exceedance_rms_error"], {mapped.threshold: study.threshold}
    of = "the spread over blocks of the net" if "blocks" in error.attrs.get("estimator", "") else "independent members"
    given = "one of the scenarios" if "scenarios" in hazard.attrs else "the release"
    caption = (
        f"Conditional probability: the weighted fraction of the members whose {mapped.extreme} reaches {shown}, given that {given} "
        f"happens. Its standard error from the number of members alone is {number(float(error.sel(at)), 2)} (that of {of}, root "
        "mean square over these cells)."
    )
    values = hazard[f"{mapped.name}_exceedance_probability"].sel(at).values
    return Sheet(f"Probability of a {mapped.words} of {shown} or more", caption, values, "probability")


def _highest_sheet(study: Study, mapped: MapQuantity) -> Sheet:
    """Largest values over time: of a single member, or those that most members stay below, by the highest percentile."""
    hazard = study.hazard
    if study.is_single:
        return Sheet(f"Peak {mapped.words}", "Largest value over time; no colour means 0.", hazard[mapped.peak].values, mapped.name)
    level = float(hazard["percentile"].values.max())
    caption = (
        f"At least {level:g} % of the members (by weight) stay at or below the value shown, at most {100 - level:g} % pass it; no "
        "colour means 0."
    )
    values = hazard[mapped.percentile].sel(percentile=level).values
    return Sheet(f"Peak {mapped.words}, {level:g}th percentile of the members", caption, values, mapped.name)


def _arrival_sheet(study: Study) -> Sheet:
    least = study.run.get("configuration", {}).get("simulation", {}).get("arrival_threshold")
    thick = f", {quantity(least, 'm')} thick or more" if least else ""
    caption = f"Earliest time after the release at which the flow of any member arrives in a cell{thick}."
    return Sheet("First arrival", caption, study.hazard[FIRST_ARRIVAL].values, "time")


def _ground_sheet(hazard: "xr.Dataset") -> Sheet:
    """Mean deposit; of an erodible bed the mean change of elevation."""
    if MEAN_CHANGE in hazard and "mean_eroded_depth" in hazard:
        change = _without_zero(hazard[MEAN_CHANGE].values)
        return Sheet("Change of elevation, mean of the members", MODELLED, change, "difference", _largest_change(hazard))
    caption = "Weighted mean over the members of the thickness that lies in a cell at the end, the release area included."
    return Sheet("Deposit, mean of the members", caption, hazard["mean_deposit_thickness"].values, "deposit")


def _largest_change(hazard: "xr.Dataset") -> float:
    """End of the one scale of all maps of the change of elevation [m]: the 99th percentile of the cells with a change."""
    sizes = [np.abs(hazard[name].values) for name in CHANGES if name in hazard]
    changed = np.concatenate([size[size > 0.0] for size in sizes])
    return float(np.percentile(changed, 99)) if changed.size else 1.0


MODELLED = "Mean over the members: deposit minus release, and minus the eroded depth where there is a bed."


def observed_sheets(study: Study) -> Iterator[Sheet]:
    """Maps of a site with observed deposits or changes of elevation: observed, and modelled minus observed."""
    titles = {
        "observed_deposit_thickness": ("Observed deposit", "Cells without colour have none, or are unknown.", "deposit"),
        "deposit_thickness_difference": ("Deposit: difference", "Mean of the members minus observed.", "difference"),
        "observed_elevation_change": ("Observed change of elevation", "DEM of difference: later minus earlier.", "difference"),
        "mean_elevation_change": ("Modelled change of elevation", MODELLED, "difference"),
        "elevation_change_difference": ("Change of elevation: difference", "Mean of the members minus observed.", "difference"),
    }
    for name, (title, caption, style) in titles.items():
        if name in study.hazard:
            yield Sheet(title, caption, _without_zero(study.hazard[name].values), style)


def _without_zero(values: np.ndarray) -> np.ndarray:
    return np.where(values == 0, np.nan, values)
