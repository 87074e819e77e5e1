"""Regional work: each release of a site becomes a site of its own on a part of the elevation raster, and their maps are merged.

The folder of the sources has one site folder for each, with a site.yaml and its polygon, so that any command and any scheduler runs
them. Files that have not changed are not written again: a second call computes what is missing only. Sources run at the same time,
each in one process that keeps its libraries and kernels for the next ones.
"""

import io
import logging
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout import log
from runout.errors import ConfigError, ExitCode, InputError, RunoutError

if TYPE_CHECKING:
    import geopandas as gpd

    from runout.config.site import Site
    from runout.ensemble.workers import Share
    from runout.io.fingerprint import KnownFiles

LOGGER = logging.getLogger("runout.regional")
FOLDER, SOURCES, POLYGON = "regional", "sources", "release.fgb"
STAGES = ("terrain", "release", "ensemble", "hazard")
EXTENTS = "extents.json"  # extents of the sources, for the settings and the inputs that they follow from
SOURCES_PER_GPU = 4  # at the same time, so that it computes while others read and write
WHOLE = ("probes", "structures", "bed")  # blocks whose places may lie anywhere, so that a source keeps the extent of the site
_LOCAL = ("obstacles", "friction_zones", "friction_rasters")  # such blocks of the terrain
NAME, LONGEST = re.compile(r"[^A-Za-z0-9_-]+"), 60


@dataclass(frozen=True)
class Source:
    """A release of a site, or one polygon of it."""

    name: str  # name of its site
    settings: dict[str, Any]  # content of its site.yaml, with paths relative to the folder of the site that it is of
    # its polygon with all attributes; None for a raster of thickness
    polygon: "gpd.GeoDataFrame | None" = field(default=None, repr=False)


def sources_of(site: "Site", annual_rate: str | None = None) -> list[Source]:
    """The sources of a site: one for each polygon of its releases, and for each raster of thickness.

    Parameters
    ----------
    annual_rate : str or None
        Attribute of the polygons that holds the annual rate of the source [1/a]; it becomes a scenario of that rate.

    Raises
    ------
    ConfigError
        If the releases cannot stand alone: one waits for another one, a scenario lets several fail, the volume of several polygons
        is stated as a sum, there is an inflow, or a rate is missing.
    """
    _require_apart(site, annual_rate)
    found: list[Source] = []
    for number, stated in enumerate(site.stated()["release"]):
        for feature, (name, polygon) in enumerate(_features(site, number), 1):
            unique = name if name not in [one.name for one in found] else f"{name}_{feature}"
            rate = None if annual_rate is None else _rate(site, polygon, annual_rate, unique)
            found.append(Source(unique, _settings(site, stated, unique, rate), polygon))
    return found


def _require_apart(site: "Site", annual_rate: str | None) -> None:
    settings, file = site.settings, site.file
    if settings.inflow:
        raise ConfigError(f"{file}: an inflow is no release that stands alone; remove `inflow`, and run it as a site of its own")
    for release in settings.release:
        if release.starts_when:
            message = f"{file}: release {release.name} waits for {release.starts_when.arrives}, so that both fail together"
            raise ConfigError(f"{message}; remove starts_when, or run them as one site")
    for scenario in settings.ensemble.scenarios or ():
        if len(together := scenario.releases or ()) > 1:
            message = f"{file}: in scenario {scenario.name} {len(together)} releases fail together"
            raise ConfigError(f"{message}; give each release a scenario of its own, or run them as one site")
    if annual_rate is not None and (settings.ensemble.scenarios or settings.ensemble.table):
        raise ConfigError(f"--annual-rate {annual_rate}: {file} states scenarios or a table already; remove one of the two")


def _features(site: "Site", number: int) -> "Iterator[tuple[str, gpd.GeoDataFrame | None]]":
    """Name and polygon of each source of a release."""
    from runout.config.fetch import locate
    from runout.config.stated_at import stated_at
    from runout.io.polygons import read_frame

    release = site.settings.release[number]
    if release.polygons is None:
        yield release.name, None
        return
    with stated_at(site.file, "release", number, "polygons"):
        frame, _ = read_frame(Path(locate(release.polygons, site.folder)), release.layer, "release")
    if len(frame) > 1 and release.volume is not None:
        message = f"{site.file}: release {release.name} has one volume for {len(frame)} polygons, whose shares are not known"
        raise ConfigError(f"{message}; state the thickness, or an attribute that holds it")
    for row in range(len(frame)):
        yield _name(frame, row, release.name), frame.iloc[[row]]


def _name(frame: "gpd.GeoDataFrame", row: int, release: str) -> str:
    """Name of a polygon: its attribute ``name``, else the release, with its number among several."""
    stated = frame["name"].iloc[row] if "name" in frame and len(frame) > 1 else None
    cleaned = NAME.sub("_", str(stated)).strip("_-")[:LONGEST] if isinstance(stated, str) else ""
    return cleaned or (release if len(frame) == 1 else f"{release}_{row + 1:0{len(str(len(frame)))}d}")


def _rate(site: "Site", polygon: "gpd.GeoDataFrame | None", attribute: str, name: str) -> float:
    """Annual rate [1/a] of a source from an attribute of its polygon."""
    value = None if polygon is None or attribute not in polygon else polygon[attribute].iloc[0]
    try:
        rate = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        rate = 0.0
    if not 0.0 < rate < float("inf"):
        where = f"{site.file}: source {name}" if value is not None else f"{site.file}: source {name} has no such attribute"
        raise ConfigError(f"--annual-rate {attribute}: {where}, value {value}; a number of events in a year above 0 is needed")
    return rate


def _settings(site: "Site", stated: Mapping[str, Any], name: str, rate: float | None) -> dict[str, Any]:
    """Content of the site.yaml of a source."""
    content = deepcopy(site.stated())
    title = content.get("title") or site.name
    content |= {"name": name, "title": f"{title}: {name}", "release": [dict(stated)]}
    content["hazard"] = {"formats": "netcdf"} | dict(content.get("hazard") or {})
    content.pop("observations", None)  # of the event of all sources
    ensemble = content.get("ensemble", {})
    of_release = stated["name"]
    if "scenarios" in ensemble:
        own = [dict(one) for one in ensemble["scenarios"] if not one.get("releases") or one["releases"] == [of_release]]
        if not own:
            raise ConfigError(f"{site.file}: no scenario lets release {of_release} fail; add one, or remove the release")
        ensemble["scenarios"] = [{key: value for key, value in one.items() if key != "releases"} for one in own]
    if rate is not None:
        ensemble["scenarios"] = [{"name": "event", "annual_rate": rate}]
    return content


def write_sources(site: "Site", folder: Path, annual_rate: str | None = None) -> list[Path]:
    """Folders of the sites of all sources below ``folder``, after writing what has changed; the first is that of the first release.

    Each has the part of the elevation raster that its largest mass can reach, from the energy line at the least friction. Sites
    with probes, structures, an erodible bed, obstacles or friction zones keep the extent of the site.

    Raises ConfigError: see :func:`sources_of`. Raises InputError or StorageError if an input cannot be used, or the folder cannot
    be written.
    """
    if site.settings.observations:
        LOGGER.info("observations are left out: they are of all sources together")
    from runout.io.fingerprint import KnownFiles

    paths, known = [], KnownFiles(folder / EXTENTS)
    for source in sources_of(site, annual_rate):
        place = folder / SOURCES / source.name
        _make_folder(place / "inputs")
        content = moved(source.settings, site.folder, place)
        if source.polygon is not None:
            _write_polygon(source.polygon, place / "inputs" / POLYGON)
            content["release"][0] |= {"polygons": f"inputs/{POLYGON}"}
            content["release"][0].pop("layer", None)
        try:
            extent = _extent(site, content, place, known)
        except InputError as error:
            raise InputError(f"source {source.name}: {error}") from error
        if extent is not None:
            content["terrain"]["extent"] = extent
        _write_changed(place / "site.yaml", _yaml(content))
        paths.append(place)
    known.save()
    return paths


def _make_folder(path: Path) -> None:
    from runout.io.atomic import storage_error

    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(path, error) from error


def moved(content: Mapping[str, Any], old: Path, new: Path) -> dict[str, Any]:
    """Settings whose paths of input files are relative to a new folder; public files and samples keep their names."""
    from runout.config.site_files import named_inputs
    from runout.io.references import file_in, with_file

    result = deepcopy(dict(content))
    for location, value in named_inputs(content):
        if not isinstance(value, str) or value.startswith("matplotlib:") or Path(file_in(value)).is_absolute():
            continue
        block: Any = result
        for key in location[:-1]:
            block = block[key]
        path = os.path.relpath((old / file_in(value)).absolute(), new.absolute())
        block[location[-1]] = path if file_in(value) == value else with_file(value, Path(path))
    return result


def _extent(site: "Site", content: Mapping[str, Any], place: Path, known: "KnownFiles") -> list[float] | None:
    """West, south, east and north of the part of the raster of a source; None: that of the site."""
    from runout.io import source_code
    from runout.io.provenance import checksum
    from runout.io.references import is_mesh

    terrain = content["terrain"]
    if any(content.get(key) for key in WHOLE) or any(terrain.get(key) for key in _LOCAL) or is_mesh(site.settings.terrain.dem):
        return None
    inputs = [known.sha256(path) for path in (*site.inputs(), place / "inputs" / POLYGON) if path.is_file()]
    key = checksum([source_code.checksums().members, content, inputs])
    edges = known.value(place.name, key)
    if edges is None:
        edges = _derived(content, place)
        known.note(place.name, key, edges)
    if not edges:
        return None
    pairs = enumerate(zip(edges, terrain.get("extent") or edges, strict=True))
    return [round(max(a, b) if k < 2 else min(a, b), 6) for k, (a, b) in pairs]


def _derived(content: Mapping[str, Any], place: Path) -> list[float]:
    """Edges of the part of the raster within reach of a source; empty if it cannot be derived."""
    from runout.config.document import read_text
    from runout.config.extent import needed_extent
    from runout.config.read import FILE_NAME, checked

    derived = needed_extent(checked(read_text(_yaml(content), f"{place.name}/{FILE_NAME}"), place), place / FILE_NAME, largest=0)
    return list(derived.edges) if derived else []


def _write_polygon(polygon: "gpd.GeoDataFrame", path: Path) -> None:
    """Write a polygon as FlatGeobuf, whose bytes follow from its content alone, unless the file has these bytes."""
    import warnings

    from runout.io.part import part_folder

    with part_folder(path) as part, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="'crs' was not provided")  # a local system has none
        polygon.reset_index(drop=True).to_file(part / path.name, driver="FlatGeobuf", engine="pyogrio")
        if not path.is_file() or path.read_bytes() != (part / path.name).read_bytes():
            os.replace(part / path.name, path)


def _write_changed(path: Path, text: str) -> None:
    from runout.io.atomic import write_text

    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_text(text, path)


def _yaml(content: Mapping[str, Any]) -> str:
    """Settings as the text of a site.yaml."""
    from ruamel.yaml import YAML

    yaml: Any = YAML(typ="safe", pure=True)
    text = io.StringIO()
    yaml.default_flow_style, yaml.sort_base_mapping_type_on_output = False, False
    yaml.dump(dict(content), text)
    return text.getvalue()


def run_each(sites: Sequence[Path], run_one: Callable[[Path], int]) -> int:
    """Exit code of a command for sites one after the other: that of all sites that fail if it is one, else FAILURE.

    A site that fails does not keep the others from running; its error is logged.
    """
    codes = []
    for number, site in enumerate(sites, 1):
        LOGGER.info("site %d of %d: %s", number, len(sites), site)
        try:
            codes.append(run_one(site))
        except RunoutError as error:
            LOGGER.error("%s: %s", site, error)
            codes.append(error.exit_code)
    return _joined(codes)


def _joined(codes: Sequence[int]) -> int:
    """Exit code of several sites from those of each."""
    failed = {code for code in codes if code != ExitCode.OK}
    LOGGER.info("%d of %d sites done", codes.count(ExitCode.OK), len(codes))
    return failed.pop() if len(failed) == 1 else ExitCode.FAILURE if failed else ExitCode.OK


@dataclass(frozen=True)
class Place:
    """A source that a worker process runs: its number, from 1, and the folder of its site."""

    number: int
    folder: Path


def run_places(
    group: "Sequence[Place]", threads: int, *, progress: Callable[[int, float], None], device: str | None
) -> dict[int, RunoutError]:
    """Errors by number, after running sources in this process; a task of :mod:`runout.ensemble.worker`."""
    from runout.errors import PartialEnsembleError
    from runout.workflow import hazard_map

    errors: dict[int, RunoutError] = {}
    for place in group:
        with log.hidden_progress():
            outcome = hazard_map.run(place.folder, None, STAGES, workers=1, threads=threads, device=device or "cpu")
        if outcome.failed:
            number, reason = next(iter(outcome.failed.items()))
            errors[place.number] = PartialEnsembleError(f"{len(outcome.failed)} members failed; member {number}: {reason}")
    return errors


def _share(site: "Site", places: Sequence[Path], workers: int | None, threads: int | None, device: str) -> "Share":
    """How sources share this machine: one a core, or some on each GPU, and no more than memory holds of the largest extent."""
    from runout.config.site import read_site
    from runout.ensemble.workers import Capacity, pack
    from runout.workflow.plan import member_bytes

    def cells(place: Path) -> float:
        west, south, east, north = read_site(place).settings.terrain.extent or (0.0, 0.0, float("inf"), 1.0)
        return (east - west) * (north - south)

    here, count = Capacity.here(device), len(places)
    wanted = workers or (SOURCES_PER_GPU * len(here.devices) or None)
    if count < 2 or pack(here, count, wanted, threads).in_process:
        return pack(here, 1, 1, threads)
    largest = read_site(max(places, key=cells)).on_device(device)
    return pack(here, count, wanted, threads, member_bytes(largest, [0]))


def run_sources(site: "Site", places: Sequence[Path], workers: int | None, threads: int | None, device: str | None) -> int:
    """Exit code as of :func:`run_each`. The first source runs alone, which compiles the kernels of all."""
    from runout.ensemble.workers import in_workers
    from runout.workflow import hazard_map

    device = device or str(site.settings.simulation.device)
    share = _share(site, places, workers, threads, device)
    if share.in_process:
        choices: dict[str, Any] = {"workers": workers, "threads": threads, "device": device}
        return run_each(places, lambda place: hazard_map.run(place, None, STAGES, **choices).exit_code)
    LOGGER.info("%d sources, %s", len(places), share)
    code = run_each(places[:1], lambda place: hazard_map.run(place, None, STAGES, workers=workers, device=device).exit_code)
    groups: Any = [(Place(number, place),) for number, place in enumerate(places[1:], 2)]
    task: Any = partial(run_places, threads=share.threads)
    codes = [code]
    for done, outcome in enumerate(in_workers(task, groups, share.workers, share.threads, lambda *_: None, share.devices), 2):
        place: Any = outcome.member
        LOGGER.info("source %s: done in %.1f s, %d of %d", place.folder.name, outcome.seconds or 0.0, done, len(places))
        if outcome.error is not None:
            LOGGER.error("%s: %s", place.folder, outcome.error)
        codes.append(getattr(outcome.error, "exit_code", ExitCode.FAILURE) if outcome.error is not None else ExitCode.OK)
    return _joined(codes)


def run_regional(
    site: "Site",
    folder: Path,
    annual_rate: str | None = None,
    *,
    workers: int | None = None,
    threads: int | None = None,
    device: str | None = None,
) -> int:
    """Exit code, after running the sources of a site and merging the maps of those that have some.

    Parameters
    ----------
    workers : int, optional
        Sources at the same time. Default: one a core, or four on each GPU.
    threads, device
        As of :func:`runout.workflow.hazard_map.run`.
    """
    from runout.hazard.merging import write_merged

    places = write_sources(site, folder, annual_rate)
    code = run_sources(site, places, workers, threads, device)
    products = [place / "results" / "hazard.nc" for place in places]
    finished = [product for product in products if product.is_file()]
    if len(finished) < len(products):
        LOGGER.warning("%d of %d sources have no maps and are not in the merged ones", len(products) - len(finished), len(products))
    if finished:
        LOGGER.info("wrote %s", ", ".join(map(str, write_merged(finished, folder, title=site.settings.title or site.name)[:1])))
    return code
