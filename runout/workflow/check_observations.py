"""Warnings of observations that cannot be what they are stated to be, or that score nothing."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from runout.config.stated_at import stated_place

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.model.release import Release
    from runout.model.terrain import Terrain
    from runout.scores.observations import Observations

LARGEST_GROWTH = 10.0  # deposited or eroded over released volume, with bulking and entrainment
SMALLEST_SHARE = 0.01  # the same; less is a wrong unit, or a survey of a small part of the event
SIDES = {"above": 1.0, "below": -1.0}
NEAR_GROUND = 0.1  # of the values, by which half of them differ at most from the elevation of the ground
SCORED = ("outline", "deposit", "difference", "gauges")


def warnings(
    site: "Site", observed: "Observations | None", terrain: "Terrain", releases: "Sequence[Release]", *, whole: bool = True
) -> Iterator[str]:
    """Warnings of the observations of a site that have been read; ``whole``: none was left out for a fault of its settings."""
    stated = site.settings.observations
    if stated is None:
        return
    if whole and not any(getattr(stated, name) for name in SCORED):
        held = "only a thalweg, which is no observation" if stated.thalweg else "nothing"
        yield _placed(site, "observations", "", f"holds {held}, so that nothing is scored; state {', '.join(SCORED)}, or remove it")
    if observed is None:
        return
    if observed.deposit is not None and stated.deposit is not None:
        yield from _raster(site, "deposit", str(stated.deposit.raster), _of_deposit(observed.deposit, terrain, releases))
    if observed.change is not None and stated.difference is not None:
        found = _of_change(observed.change, observed.detection_limit, terrain, releases)
        yield from _raster(site, "difference", str(stated.difference.raster), found)
    if observed.gauges is not None and stated.gauges is not None:
        for quantity, attribute in stated.gauges.attributes.items():
            values = observed.gauges.values[quantity]
            if not (np.nan_to_num(values) > 0).any():
                held = "0" if np.isfinite(values).any() else "empty"
                told = f"{stated.gauges.points}: attribute {attribute!r} is {held} at all {len(values)} points"
                yield _placed(site, "gauges", quantity, f"{told}; name that of the {quantity.replace('_', ' ')}, or none")


def _of_deposit(deposit: np.ndarray, terrain: "Terrain", releases: "Sequence[Release]") -> str | None:
    if not (np.nan_to_num(deposit) > 0).any():
        return "no cell has a deposit: all known values are 0; check the file, or remove the key"
    return _out_of_proportion(deposit, terrain, releases)


def _of_change(change: np.ndarray, limit: float, terrain: "Terrain", releases: "Sequence[Release]") -> str | None:
    if not (np.abs(np.nan_to_num(change)) >= max(limit, np.finfo(np.float32).tiny)).any():
        largest = np.nanmax(np.abs(change), initial=0.0)
        than = f"the largest is {largest:.3g} m, the detection_limit {limit:g} m" if largest else "all known values are 0"
        return f"no cell shows a change: {than}; check the file and the limit, or remove the key"
    return _out_of_proportion(change, terrain, releases)


def _out_of_proportion(change: np.ndarray, terrain: "Terrain", releases: "Sequence[Release]") -> str | None:
    """What is wrong with a change of the ground [m]: it holds elevations, or much more or less than a release can move."""
    elevations = _elevations(change, terrain)
    if elevations:
        return elevations
    released = sum(release.volume for release in releases)
    moved = {side: float(np.nan_to_num(np.maximum(sign * change, 0.0)).sum()) * terrain.cell_area for side, sign in SIDES.items()}
    side, volume = max(moved.items(), key=lambda one: one[1])
    if released and not SMALLEST_SHARE <= volume / released <= LARGEST_GROWTH:
        only = "only " if volume < released else ""
        told = f"it holds {only}{volume:.3g} m3 {side} the ground, {volume / released:.3g} times the release of {released:.3g} m3"
        return f"{told}; check its values, their unit and what marks cells without one"
    largest, relief = float(np.nanmax(np.abs(change))), float(np.nanmax(terrain.elevation) - np.nanmin(terrain.elevation))
    highest = relief + sum(float(release.thickness.max()) for release in releases)
    if largest > highest:
        told = f"its largest value is {largest:.3g} m, more than relief and release together ({highest:.3g} m)"
        return f"{told}; check its unit and what marks cells without a value"
    return None


def _elevations(change: np.ndarray, terrain: "Terrain") -> str | None:
    """Text about values of the size of the elevations of the ground, of either sign."""
    for sign in SIDES.values():
        known = (sign * np.nan_to_num(change) > 0) & np.isfinite(terrain.elevation)
        values, ground = sign * change[known], terrain.elevation[known]
        if values.size and np.median(np.abs(values - ground)) <= NEAR_GROUND * np.median(values):
            span = "{:.4g} to {:.4g} m".format(*sorted((sign * values.min(), sign * values.max())))
            return f"its values of {span} are elevations, like those of {terrain.source}; subtract the ground before the event"
    return None


def _raster(site: "Site", name: str, file: str, wrong: str | None) -> Iterator[str]:
    if wrong is not None:
        yield _placed(site, name, "raster", f"{file}: {wrong}")


def _placed(site: "Site", name: str, key: str, text: str) -> str:
    place = ("observations",) if name == "observations" else ("observations", name, key)
    return f"{stated_place(site.file, *place)}: {text}"
