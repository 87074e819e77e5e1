"""Probes, at which every member records time series: their settings in site.yaml, and their readers."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Discriminator, Field, Tag, model_validator

from runout.config.distributions import Settings, quantity, refuse, shape
from runout.config.document import Document, read_document
from runout.config.fetch import locate
from runout.config.quantities import Text
from runout.errors import ConfigError, Problem

if TYPE_CHECKING:
    from runout.config.schema import SiteSettings
    from runout.model.probes import Probe, Probes
    from runout.model.terrain import Terrain


class PointSettings(Settings):
    """One point."""

    name: str = quantity("name in files and figures", min_length=1)
    x: float = quantity("easting in the coordinates of the terrain", unit="m")
    y: float = quantity("northing in the coordinates of the terrain", unit="m")


PointList = Annotated[list[PointSettings], Field(min_length=1), Tag("<list>")]
Points = Annotated[Text | PointList, Discriminator(shape)]


class ProbeSettings(Settings):
    """Points and cross-sections at which every member records time series. A change of them runs the members anew."""

    points: Points | None = quantity(
        "points: a file (GeoPackage, Shapefile, GeoJSON) relative to this folder, or a list of {name, x, y}",
        None,
        examples=["inputs/probes.gpkg"],
    )
    points_layer: str | None = quantity("layer of that file; not needed when it has one only", None, examples=["points"])
    cross_sections: str | None = quantity(
        "lines across the flow: a file relative to this folder", None, min_length=1, examples=["inputs/sections.gpkg"]
    )
    cross_sections_layer: str | None = quantity("layer of that file; not needed when it has one only", None, examples=["sections"])
    interval: float | None = quantity("time between two values of a series; default: end_time / 200", None, unit="s", gt=0)

    @model_validator(mode="after")
    def _complete(self) -> "ProbeSettings":
        if self.points is None and self.cross_sections is None:
            raise refuse("neither points nor cross_sections are given", "add one of them, or remove probes")
        for layer, key in ((self.points_layer, "points"), (self.cross_sections_layer, "cross_sections")):
            if layer is not None and not isinstance(getattr(self, key), str):
                raise refuse(f"{layer!r} without a file of {key}", "remove it", f"{key}_layer")
        return self


PROBES = quantity(
    "points and cross-sections at which every member records time series; a change of them runs the members anew",
    None,
    examples=[{"points": "inputs/probes.gpkg", "cross_sections": "inputs/sections.gpkg", "interval": 1.0}],
)


def read_probes(settings: "SiteSettings", file: Path, terrain: "Terrain") -> "Probes | None":
    """The probes on a terrain; None if site.yaml states none.

    Raises ConfigError with all problems of points and lines, each with its line of site.yaml.
    """
    from runout.io import probe_layers

    probes = settings.probes
    if probes is None:
        return None
    choices = probes.model_dump(include={"points_layer", "cross_sections_layer", "interval"})
    points, cross_sections = _path(probes.points, file), _path(probes.cross_sections, file)
    try:
        return probe_layers.read_probes(terrain, points, cross_sections, site_points=_listed(probes), **choices)
    except ConfigError as error:
        document = read_document(file) if file.is_file() else Document(file.name)
        raise ConfigError([_placed(problem, probes, file, document) for problem in error.problems]) from None


def _listed(settings: ProbeSettings) -> "tuple[Probe, ...]":
    """Points that site.yaml itself lists."""
    from runout.model.probes import Probe

    places = enumerate([] if settings.points is None or isinstance(settings.points, str) else settings.points)
    return tuple(Probe(p.name, p.x, p.y, f"probes.points[{i}]") for i, p in places)


def _placed(problem: Problem, settings: ProbeSettings, file: Path, document: Document) -> Problem:
    """A problem with the line and the key of site.yaml that it is about, if it is about that file."""
    listed = settings.points if isinstance(settings.points, list) else []
    for i in range(len(listed)):
        if problem.file == f"probes.points[{i}]":
            place = ("probes", "points", i, *([problem.key] if problem.key else []))
            return document.problem(place, problem.message, problem.fix)
    for key in ("points", "cross_sections"):
        named = getattr(settings, key)
        path = _path(named, file)
        in_file = document.value(("probes", key)) == named  # else the command line names it
        if path is not None and in_file and problem.file.startswith(str(path)):
            said = ": ".join(part for part in (problem.file, problem.key, problem.message) if part)
            return document.problem(("probes", key), said, problem.fix)
    return problem


def _path(named: object, file: Path) -> Path | None:
    return Path(locate(named, file.parent)) if isinstance(named, str) else None


def probe_settings(
    folder: Path,
    points: Path | None,
    cross_sections: Path | None,
    *,
    points_layer: str | None = None,
    cross_sections_layer: str | None = None,
    interval: float | None = None,
) -> ProbeSettings:
    """Settings of probes from files of the command line; paths inside the site folder are named relative to it.

    Raises ConfigError if a file does not exist, a layer has no file, or the interval is not above 0.
    """
    from runout.config.read import nearest_file

    problems = []
    for path in (points, cross_sections):
        if path is not None and not path.exists():
            near = nearest_file(path)
            fix = f"did you mean {near}?" if near else "check the path"
            problems.append(Problem(str(path), None, "", "there is no such file", fix))
    for option, layer, path in (("points", points_layer, points), ("cross-sections", cross_sections_layer, cross_sections)):
        if layer is not None and path is None:
            fix = f"name the file with --{option}, or leave the layer out"
            problems.append(Problem("probe", None, f"--{option}-layer", f"{layer[:80]!r} without a file", fix))
    if interval is not None and not interval > 0:
        problems.append(Problem("probe", None, "--interval", f"{interval:g} s; it must be above 0", "leave it out for the default"))
    if problems:
        raise ConfigError(problems)
    named = {"points": points, "cross_sections": cross_sections}
    files = {key: _named(path, folder) for key, path in named.items() if path is not None}
    layers = {"points_layer": points_layer, "cross_sections_layer": cross_sections_layer}
    return ProbeSettings(**files, **layers, interval=interval)  # type: ignore[arg-type]


def _named(path: Path, folder: Path) -> str:
    absolute, root = Path(os.path.abspath(path)), Path(os.path.abspath(folder))
    return absolute.relative_to(root).as_posix() if absolute.is_relative_to(root) else str(absolute)
