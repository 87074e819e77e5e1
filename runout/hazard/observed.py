"""Scores of an ensemble and of its members against the observations of a site, and maps of both together."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.member_arguments import failing
from runout.config.scenarios import FAILS
from runout.errors import StorageError
from runout.forecast.numerical_error import read_convergence
from runout.hazard.members import Ensemble
from runout.hazard.order import weighted_percentiles
from runout.io import netcdf
from runout.io.member_maps import MemberMaps
from runout.model.release import Release, thickness_of
from runout.model.terrain import Terrain
from runout.quantities import CHANGE
from runout.scores.assessment import Assessment, Setting, against_observations, values_at_gauges
from runout.scores.contingency import reached
from runout.scores.elevation_change import elevation_change
from runout.scores.energy_line import release_point
from runout.scores.error_bars import ErrorBars
from runout.scores.flow import OF_MEMBER, Flow
from runout.scores.observations import Observations
from runout.scores.points import arrival_or_never
from runout.scores.reaches import ReachErrors
from runout.simulation.entering import never_started

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site

OUTLINE_PROBABILITY = 0.5
SCORED = ("thickness", "deposit")


@dataclass
class Observed:
    """Scores and maps of a site with observations."""

    record: dict[str, Any]  # entry ``observations`` of ``run.json``
    maps: dict[str, np.ndarray]  # maps for ``hazard.nc`` by their names in the table of variables
    # volumes by reach of each valid member; empty for a site without reaches
    reaches: dict[int, ReachErrors] = field(default_factory=dict)

    def add_to(self, dataset: "xr.Dataset") -> None:
        """Put maps and volumes by reach into the content of ``hazard.nc``."""
        for name, values in self.maps.items():
            netcdf.add_map(dataset, name, values)
        if self.reaches:
            first = next(iter(self.reaches.values()))
            dataset.coords["realization"] = np.array(list(self.reaches), np.int32)
            ends = np.array(first.ends)
            dataset.coords["reach_start"], dataset.coords["reach_end"] = ("reach", ends[:-1]), ("reach", ends[1:])
            dataset["observed_reach_volume"] = ("reach", first.observed)
            dataset["reach_volume"] = (("realization", "reach"), np.stack([one.modelled for one in self.reaches.values()]))


@dataclass
class _Means:
    """Weighted sums over the members: probabilities, mean deposit and change, and the values at the gauges."""

    probabilities: dict[tuple[str, float], np.ndarray] = field(default_factory=dict)
    maps: dict[str, np.ndarray] = field(default_factory=dict)
    gauges: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(self, flow: Flow, change: np.ndarray, weight: float, observed: Observations, thresholds: Sequence[float]) -> None:
        """Add a member."""
        for key in ((quantity, threshold) for quantity in SCORED for threshold in thresholds):
            self.probabilities[key] = self.probabilities.get(key, 0.0) + weight * reached(flow.maps[key[0]], key[1])
        for name, values in (("deposit", flow.maps["deposit"]), ("change", change)):
            self.maps[name] = self.maps.get(name, 0.0) + weight * values
        if observed.gauges is not None:
            for name, values in values_at_gauges(flow, observed.gauges).items():
                self.gauges.setdefault(name, []).append(values)

    def medians(self, weights: np.ndarray) -> dict[str, np.ndarray]:
        """Weighted medians over the members of the values at the gauges (n,)."""
        return {name: weighted_percentiles(np.stack(values), weights, [50.0])[0] for name, values in self.gauges.items()}


def scored(
    observed: Observations, site: "Site", ensemble: Ensemble, terrain: Terrain, releases: Sequence[Release], results: Path
) -> Observed:
    """Scores of the ensemble and of each valid member.

    The ensemble is scored by the outlines that half of its weight reaches, its mean deposit and change, and the medians at the
    gauges.

    Raises StorageError if a member's file cannot be read.
    """
    setting = _setting(observed, site, terrain, releases, results)
    means, members, reaches = _Means(), {}, {}
    for (member, path), weight in zip(ensemble.files.items(), ensemble.weights, strict=True):
        flow, change = member_flow(path, observed, releases, ensemble.table.loc[member])
        means.add(flow, change, float(weight), observed, setting.thresholds)
        assessment = against_observations(flow, observed, setting, change)
        members[str(member)] = [score.stored() for score in assessment.scores]
        if assessment.reaches is not None:
            reaches[int(member)] = assessment.reaches
    whole = Flow(observed.grid, {"deposit": means.maps["deposit"]}, means.probabilities, OUTLINE_PROBABILITY)
    total = against_observations(whole, observed, setting, means.maps["change"], means.medians(ensemble.weights))
    return Observed(_record(observed, total, members, setting), dict(_maps(observed, means, terrain)), reaches)


def _setting(observed: Observations, site: "Site", terrain: Terrain, releases: Sequence[Release], results: Path) -> Setting:
    released = thickness_of(site.masses() if site.settings.inflow else releases, terrain)
    start = None
    if observed.thalweg is not None:
        start = release_point(terrain.easting, terrain.northing, terrain.elevation, released)
    thresholds, bars = site.settings.hazard.thickness_thresholds, ErrorBars(read_convergence(results))
    return Setting(thresholds, bars, observed.thalweg, start, terrain.elevation)


def member_flow(
    path: Path, observed: Observations, releases: Sequence[Release], sample: Mapping[str, Any]
) -> tuple[Flow, np.ndarray]:
    """Maps of a member on the cells of observations, and its change of elevation (rows, columns) [m].

    Parameters
    ----------
    path : Path
        Its file.
    observed : Observations
    releases : sequence of Release
        With a volume factor of 1.
    sample : mapping
        Parameters of the member by name; NaN for those of the site.

    Raises
    ------
    StorageError
        If the file cannot be read, or is of another grid.
    """
    with MemberMaps(path) as file:
        if file.shape != observed.grid.shape:
            remedy = "remove the members and run the ensemble again"
            raise StorageError(f"{path}: its grid is not that of {observed.grid.source}; {remedy}")
        known = file.known()
        maps = {quantity: file.layer(name, known).astype(np.float64) for quantity, name in OF_MEMBER.items()}
        change = file.layer(CHANGE, known).astype(np.float64) if CHANGE in file.held() else None
        waited = never_started(file.attributes)
    maps["arrival"] = arrival_or_never(maps["arrival"], maps["thickness"])
    if change is None:
        factor = float(sample.get("release_volume_factor", 1.0))
        sources = {str(name): value for name, value in sample.items() if str(name).endswith(FAILS)}
        started = [release for release in failing(releases, sources) if release.name not in waited]
        change = elevation_change(maps["deposit"], removed(started, 1.0 if math.isnan(factor) else factor))
    return Flow(observed.grid, maps), change


def removed(releases: Sequence[Release], factor: float = 1.0) -> np.ndarray:
    """Thickness (rows, columns) [m] by which releases of a volume factor lower the ground of before the event.

    An excavated mass leaves its scar; a mass on the surface leaves the ground below it, which the elevations show.
    """
    scaled = (release.scaled(factor) if factor != 1.0 else release for release in releases)
    return np.sum([one.excavation if one.excavation.any() else one.thickness for one in scaled], axis=0)  # type: ignore[no-any-return]


def _record(observed: Observations, total: Assessment, members: dict[str, Any], setting: Setting) -> dict[str, Any]:
    return {
        "statement": observed.statement(),
        "probability": OUTLINE_PROBABILITY,
        "energy_line_from": "top of the release" if setting.start else None,
        "ensemble": total.stored(),
        "members": members,
    }


def _maps(observed: Observations, means: _Means, terrain: Terrain) -> Iterator[tuple[str, np.ndarray]]:
    """Observed maps and the differences of the mean of the members from them."""
    if observed.deposit is not None:
        yield "observed_deposit_thickness", observed.deposit
        yield "deposit_thickness_difference", means.maps["deposit"] - observed.deposit
    if observed.change is not None:
        yield "observed_elevation_change", observed.change
        yield "mean_elevation_change", terrain.where_known(means.maps["change"])
        yield "elevation_change_difference", means.maps["change"] - observed.change


def observed_layers(observed: Observations) -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Layers for ``outlines.gpkg``: type of geometry, and rows with attributes and ``geometry``."""
    from shapely import LineString, Point

    layers: dict[str, tuple[str, list[dict[str, Any]]]] = {}
    if observed.outline is not None:
        layers["observed_outline"] = ("MultiPolygon", [{"shows": observed.outline_shows, "geometry": observed.outline}])
    if observed.thalweg is not None:
        line = LineString(observed.thalweg.points)
        layers["thalweg"] = ("LineString", [{"length_m": observed.thalweg.length, "geometry": line}])
    if observed.gauges is not None:
        gauges = observed.gauges
        rows = [
            {name: float(values[k]) for name, values in gauges.values.items()} | {"label": gauges.label(k), "geometry": Point(x, y)}
            for k, (x, y) in enumerate(zip(gauges.easting, gauges.northing, strict=True))
        ]
        layers["gauges"] = ("Point", rows)
    return layers
