"""The products of an ensemble: members.nc, structures.nc, run.json, and the hazard maps in every format of the writers."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.hazard import RETURN_PERIODS, stated_conditions
from runout.config.site_files import OF_MEMBERS, OF_PRODUCTS
from runout.ensemble.design import nets_of
from runout.errors import ConfigError, PartialEnsembleError, StorageError
from runout.forecast.stiffness import RECORDED, extremes
from runout.hazard import second_grid, writers
from runout.hazard.bed_maps import BedMaps
from runout.hazard.boundary import BoundaryMaps
from runout.hazard.danger import DangerClasses
from runout.hazard.exceedance import aggregate, stated_thresholds
from runout.hazard.frequency import Frequencies
from runout.hazard.members import Ensemble, members_file
from runout.hazard.observed import scored
from runout.hazard.reach import representative
from runout.hazard.readme import write_readme
from runout.hazard.sampling import Estimator
from runout.hazard.structure_products import write_structures
from runout.io import netcdf, source_code
from runout.io.atomic import write_json
from runout.io.member_maps import SNAPSHOTS, MemberMaps
from runout.io.netcdf import study_attributes
from runout.io.provenance import file_record
from runout.model.depth_resolution import worst
from runout.model.limits import spacing_of
from runout.model.release import Release, thickness_of
from runout.model.terrain import Terrain
from runout.quantities import INFLOW_MAP
from runout.release.statements import record, start_sentences
from runout.scores.observations import Observations
from runout.terrain.open_edge import continued
from runout.terrain.prepare import steepness
from runout.terrain.relief import half_width
from runout.terrain.roughness import of_ground

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from runout.config.site import Site
    from runout.ensemble.run import EnsembleReport


def write_products(
    site: "Site", results: Path, members: "pd.DataFrame", report: "EnsembleReport | Mapping[int, str] | None" = None
) -> list[Path]:
    """Paths of all products, after writing each as a whole; ``run.json`` comes last.

    Parameters
    ----------
    site : Site
        Its folder, name, settings, input files, terrain, releases and resolved configuration are used.
    results : Path
        Folder that holds ``members/`` and takes the products.
    members : pandas.DataFrame
        One row a planned member, indexed by its number: sampled parameters, ``weight``, ``seed`` and ``file``, as of
        :func:`runout.ensemble.member.planned_table`.
    report : EnsembleReport or mapping of int to str, optional
        Which members are valid and which failed, or the state of each ("done", "failed", "left"). Without it every
        file in ``members/`` counts.

    Raises
    ------
    PartialEnsembleError
        If no member is valid.
    StorageError
        If a member's file cannot be read or a product cannot be written.
    """
    results = Path(results)
    ensemble = replace(Ensemble.of(results, members, _states(report)), growth=getattr(report, "growth", ""))
    if not ensemble.files:
        raise PartialEnsembleError(
            f"{results / 'members'}: {ensemble.statement()}; no map can be made, mend what failed and run again"
        )
    terrain = site.terrain()
    releases = site.releases()
    origin = _origin(site, ensemble, terrain, releases)
    attributes = _attributes(site, ensemble, origin)
    inflow = sum(one["volume"] for one in origin.get("inflows", []))
    hazard, of_members, snapshots = _write_members(site, ensemble, terrain, releases, attributes, results / "members.nc", inflow)
    shown = of_members.pop("representative_member")
    origin |= {name: values for name, values in of_members.items() if values} | {"representative_member": shown}
    origin |= _relief(hazard, terrain, origin)
    _add_second_grid(hazard, site, ensemble, results, _spacing(origin))
    observed = site.files.observations().require()
    if observed is not None:
        origin["observations"] = _score(observed, site, ensemble, terrain, releases, results, hazard)
        origin["changes"] = [*origin["changes"], *observed.changes]
    built = write_structures(site, ensemble, terrain, attributes, results)
    origin["changes"] = [*origin["changes"], *built.changes]
    outdated = writers.earlier(results)
    products = writers.Products(
        hazard, ensemble, site, terrain, releases, observed, built, results, shown, snapshots.get(shown, ())
    )
    written = writers.write_all(products)
    paths = [results / "members.nc", *built.paths, *(path for files in written.values() for path in files)]
    paths.append(write_readme(products, written))
    paths.append(_write_origin(origin, paths, results))
    for path in outdated - set(paths):
        path.unlink(missing_ok=True)
    return paths


def _write_members(
    site: "Site",
    ensemble: Ensemble,
    terrain: Terrain,
    releases: Sequence[Release],
    attrs: Mapping[str, Any],
    path: Path,
    inflow: float,
) -> "tuple[xr.Dataset, dict[str, Any], dict[int, tuple[float, ...]]]":
    """The content of ``hazard.nc``, what ``run.json`` says of the members, and times of their snapshots [s] by member.

    ``members.nc`` is written on the way. The file of each member is opened once. ``run.json`` has the worst resolution, extremes of
    stiffness and the member that stands for all. ``inflow`` [m3] is the volume of the inflows without factors.
    """  # fmt: skip
    resolution: dict[str, float] = {}
    stiffness: list[dict[str, Any]] = []
    snapshots: dict[int, tuple[float, ...]] = {}
    numbers = list(ensemble.files)
    of_bed = BedMaps(ensemble.weights)
    boundary = BoundaryMaps(ensemble.weights, min(site.settings.hazard.thickness_thresholds))
    title = f"{_title(site)}: members of the ensemble"
    with members_file(ensemble, path, terrain, netcdf.global_attributes(terrain, title) | dict(attrs)) as members:

        def each(number: int, member: MemberMaps) -> None:
            resolution.update(worst([resolution, member.attributes]))
            stiffness.append({name: member.attributes[name] for name in RECORDED if name in member.attributes})
            if SNAPSHOTS in member.file.groups:
                snapshots[numbers[number]] = tuple(map(float, member.file.groups[SNAPSHOTS]["time"][:]))
            members.copy(numbers[number], member)
            of_bed.take(number, member)
            boundary.take(number, member)

        hazard = hazard_dataset(site, ensemble, terrain, releases, attrs, folder=path.parent, each=each)
        of_bed.add_to(hazard)
        boundary.add_to(hazard)
        figures = members.add_figures(hazard, inflow)
    shown = representative(figures.assign(weight=ensemble.table["weight"]))
    return hazard, {"resolution": resolution, "stiffness": extremes(stiffness), "representative_member": shown}, snapshots


def _add_second_grid(hazard: "xr.Dataset", site: "Site", ensemble: Ensemble, results: Path, spacing: tuple[float, float]) -> None:
    """Put in the numerical errors, if all valid members ran on the second grid as well; ``spacing`` of the first is east, north."""
    second = second_grid.of_members(ensemble, results, site)
    if second is None:
        return
    maps = aggregate(
        list(second.files.values()), second.weights, _thresholds(site), [50.0], joint=stated_conditions(site.settings.hazard)
    )
    second_grid.add_errors(hazard, maps, (second_grid.RATIO * spacing[1], second_grid.RATIO * spacing[0]))


def _relief(hazard: "xr.Dataset", terrain: Terrain, origin: Mapping[str, Any]) -> dict[str, Any]:
    """Entry of ``run.json`` on the relief of the ground that members reached, at their largest speeds there."""
    reached = hazard["members_reached"].values > 0
    speed = float(np.sqrt(np.mean(np.square(hazard["peak_speed"].values[reached])))) if reached.any() else 0.0
    relief = of_ground(terrain, _spacing(origin), reached, speed)
    return {"relief": relief.record()} if relief else {}


def _spacing(origin: Mapping[str, Any]) -> tuple[float, float]:
    """Spacing of the grid [m], east and north."""
    return spacing_of(origin["configuration"]["simulation"]["cell_size"])[:2]


def hazard_dataset(
    site: "Site",
    ensemble: Ensemble,
    terrain: Terrain,
    releases: Sequence[Release],
    attrs: Mapping[str, Any],
    *,
    folder: Path | None = None,
    each: Callable[[int, MemberMaps], None] | None = None,
) -> "xr.Dataset":
    """The content of ``hazard.nc``: maps over the valid members, counts, terrain and release.

    ``folder`` and ``each`` are those of :func:`runout.hazard.exceedance.aggregate`.
    """
    settings = site.settings.hazard
    maps = {
        "elevation": terrain.elevation,
        "ground_slope": ground_slope(terrain),
        "release_thickness": terrain.where_known(thickness_of(releases, terrain)),
    }
    if site.settings.inflow:
        maps[INFLOW_MAP] = terrain.where_known(thickness_of(site.masses()[len(releases) :], terrain))
    dataset = netcdf.map_dataset(terrain, maps, title=f"{_title(site)}: hazard maps", attrs=attrs)
    files = list(ensemble.files.values())
    estimator = Estimator.of(ensemble.table, ensemble.files, nets_of(site.settings.ensemble, len(ensemble.table)))
    joint = stated_conditions(settings)
    frequencies = ensemble.frequencies
    over_members = aggregate(
        files,
        ensemble.weights,
        _thresholds(site),
        settings.percentiles,
        joint=joint,
        estimator=estimator,
        frequencies=frequencies,
        return_periods=_return_periods(settings, frequencies),
        danger=DangerClasses.of(site, frequencies),
        folder=folder,
        each=each,
    )
    if not (np.array_equal(over_members["x"], dataset["x"]) and np.array_equal(over_members["y"], dataset["y"])):
        raise StorageError(f"{files[0]}: its grid is not that of {terrain.source}; remove the members and run the ensemble again")
    return dataset.merge(over_members, join="exact", compat="override", combine_attrs="override").assign(ensemble.counts())


def _thresholds(site: "Site") -> dict[str, list[float]]:
    return stated_thresholds(site.settings.hazard, bed=getattr(site.settings, "bed", None) is not None)


def _return_periods(settings: Any, frequencies: Frequencies | None) -> Sequence[float]:
    """Return periods [a] of the maps: none without annual rates, unless they are asked for, which is refused."""
    stated: Sequence[float] | None = getattr(settings, "return_periods", None)
    if frequencies is None and stated is not None:
        raise ConfigError("hazard.return_periods: the ensemble has no annual rates; state ensemble.scenarios, or remove the key")
    return () if frequencies is None else RETURN_PERIODS if stated is None else stated


def ground_slope(terrain: Terrain) -> np.ndarray:
    """Slope of the ground (rows, columns) [degree], one-sided beside unknown cells, NaN on them."""
    ground = continued(terrain.elevation, terrain.cell_size, max(terrain.cell_size))
    return terrain.where_known(np.degrees(np.arctan(steepness(ground, terrain.cell_size))))


def _score(
    observed: Observations,
    site: "Site",
    ensemble: Ensemble,
    terrain: Terrain,
    releases: Sequence[Release],
    results: Path,
    hazard: "xr.Dataset",
) -> dict[str, Any]:
    """Scores for ``run.json``, after adding the maps of observations and the volumes by reach to the dataset."""
    found = scored(observed, site, ensemble, terrain, releases, results)
    found.add_to(hazard)
    return found.record


def _origin(site: "Site", ensemble: Ensemble, terrain: Terrain, releases: Sequence[Release]) -> dict[str, Any]:
    settings = site.settings
    origin = site.provenance(site.files.paths(*OF_MEMBERS, *OF_PRODUCTS), settings.ensemble.seed)
    state = ensemble.counts() | {"failures": {str(m): reason for m, reason in ensemble.failed.items()}, "not_run": ensemble.missing}
    zones = site.files.zones()
    changes = [*terrain.changes, *(c for release in releases for c in release.changes), *(zones.changes if zones else ())]
    study = stated_metadata(site)
    origin |= {"metadata": study} if study else {}
    origin["releases"] = {
        "masses": [record(release) for release in releases],
        "start": list(start_sentences(releases, _by_scenario(settings))),
    }
    if inflows := site.files.inflows().require():
        spacing = spacing_of(origin["configuration"]["simulation"]["cell_size"])
        origin["inflows"] = [{"name": one.name, **one.record(), "statement": one.statement(spacing)} for one in inflows]
    state |= {"growth": ensemble.growth} if ensemble.growth else {}
    if ensemble.frequencies is not None:
        state |= {"annual_rates": dict(ensemble.frequencies.scenario_rates)}
    return origin | {"changes": changes, "ensemble": state | {"statement": ensemble.statement()}}


def _by_scenario(settings: Any) -> bool:
    """Whether the scenario of a member decides which releases fail."""
    return bool(getattr(settings.ensemble, "fail_apart", False))


def _attributes(site: "Site", ensemble: Ensemble, origin: Mapping[str, Any]) -> dict[str, Any]:
    description = getattr(site.settings, "description", None) or ""
    checksum = origin["configuration_sha256"]
    changes = {"changes_of_inputs": "; ".join(origin["changes"])} if origin["changes"] else {}
    smoothing = origin["configuration"].get("terrain", {}).get("smoothing")
    changes |= {"terrain_smoothing": smoothing} if smoothing else {}
    return {
        "id": f"{site.name}-{checksum[:16]}",
        "summary": f"{description} ".lstrip()
        + "Hazard maps of a gravitational mass movement from an ensemble of three-dimensional material point simulations. "
        f"Probabilities are conditional on {_given(ensemble)} and on the stated distributions of the parameters.",
        "processing_level": "maps over the members of an ensemble of simulations",
        "history": f"{origin['created']} {origin['command']} (runout {origin['runout']})",
        "site": site.name,
        "ensemble": ensemble.statement(),
        **({"scenarios": ensemble.frequencies.statement()} if ensemble.frequencies else {}),
        "seed": np.int64(origin["seed"] or 0),
        "configuration_sha256": checksum,
        "inputs": json.dumps(origin["inputs"]),
        "versions": json.dumps(origin["versions"]),
        "device": origin["device"],
        "site_settings": json.dumps(site.stated()),
        "source_code_sha256": source_code.checksums().products,
        "ground_filter_half_width": np.array(half_width(_spacing(origin))),
        "command": origin["command"],
    } | (changes | study_attributes(stated_metadata(site)))


def _given(ensemble: Ensemble) -> str:
    """What conditional probabilities suppose."""
    return "one of the scenarios to happen" if ensemble.frequencies else "the release"


def stated_metadata(site: "Site") -> dict[str, str]:
    """What site.yaml says under ``metadata``; empty where it says nothing."""
    settings = site.settings.metadata
    return settings.model_dump(exclude_none=True) if settings else {}


def _write_origin(origin: Mapping[str, Any], products: Iterable[Path], results: Path) -> Path:
    records = [file_record(path, results) for path in products]
    return write_json(dict(origin) | {"products": records}, results / "run.json")


def _states(report: "EnsembleReport | Mapping[int, str] | None") -> Mapping[int, str] | None:
    if report is None or isinstance(report, Mapping):
        return report
    return dict.fromkeys(report.valid, "done") | dict.fromkeys(report.failed, "failed")


def _title(site: "Site") -> str:
    return getattr(site.settings, "title", None) or site.name
