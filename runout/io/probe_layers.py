"""Reads points and lines of vector files as probes, and reports all their problems together."""

from collections.abc import Iterator
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ConfigError, InputError, Problem
from runout.io.polygon_reproject import polygons_on_terrain
from runout.io.polygons import read_frame
from runout.model.probes import CrossSection, Probe, Probes, name_problems, place_problems, vertex_problems
from runout.model.terrain import Terrain

POINTS, LINES = "point", "line"
REMEDIES = {POINTS: "draw a point, or split it", LINES: "draw a line without branches or gaps"}
TYPES = {POINTS: ("Point",), LINES: ("LineString", "LinearRing")}
PREFIXES = {POINTS: "p", LINES: "x"}


def read_probes(
    terrain: Terrain,
    points: str | PathLike[str] | None = None,
    cross_sections: str | PathLike[str] | None = None,
    *,
    points_layer: str | None = None,
    cross_sections_layer: str | None = None,
    interval: float | None = None,
    site_points: tuple[Probe, ...] = (),
) -> Probes:
    """Probes of vector files, checked on the terrain (see :meth:`runout.Probes.from_vector`).

    ``site_points``: points beside those of the file, in map coordinates. Raises ConfigError with all problems of all files.
    """
    layers = [(points, points_layer, POINTS), (cross_sections, cross_sections_layer, LINES)]
    probes: dict[str, list[Any]] = {POINTS: list(site_points), LINES: []}
    problems: list[Problem] = []
    changes: tuple[str, ...] = ()
    for path, layer, what in layers:
        if path is not None:
            key = "points_layer" if what == POINTS else "cross_sections_layer"
            of_layer, notes, wrong = _read(Path(path), terrain, layer, what, key)
            probes[what] += of_layer
            changes += notes
            problems += wrong
    for several in probes.values():
        problems += [*name_problems(several), *(p for one in several for p in place_problems(one, terrain))]
    if problems:
        raise ConfigError(problems)
    return Probes(tuple(probes[POINTS]), tuple(probes[LINES]), interval, changes)


def read_lines(
    path: str | PathLike[str], terrain: Terrain, layer: str | None = None, key: str = "cross_sections_layer"
) -> tuple[tuple[CrossSection, ...], tuple[str, ...]]:
    """Lines of a vector file, checked on the terrain, and sentences on changes; they may cross cells without elevation.

    ``key`` is what messages call the choice of a layer. Raises ConfigError with all problems of the file.
    """
    lines, notes, problems = _read(Path(path), terrain, layer, LINES, key)
    known = replace(terrain, elevation=np.nan_to_num(terrain.elevation))
    problems += [*name_problems(lines), *(p for one in lines for p in place_problems(one, known))]
    if problems:
        raise ConfigError(problems)
    return tuple(lines), notes


def _read(path: Path, terrain: Terrain, layer: str | None, what: str, key: str) -> tuple[list[Any], tuple[str, ...], list[Problem]]:
    """Probes of a layer in the map coordinates of the terrain, sentences on changes, and problems."""
    try:
        frame, driver = read_frame(path, layer, what, key)
        if not len(frame):
            return [], (), [Problem(str(path), None, "", "the layer is empty", f"draw at least one {what} in it")]
        frame, notes = polygons_on_terrain(path, frame, driver, terrain)
    except InputError as error:
        return [], (), [Problem(*_divided(str(error), str(path)))]
    probes, problems = [], []
    for one in _features(path, frame, what):
        wrong = [one] if isinstance(one, Problem) else list(vertex_problems(one)) if isinstance(one, CrossSection) else []
        problems += wrong
        probes += [] if wrong else [one]
    return probes, notes, problems


def _divided(text: str, path: str) -> tuple[str, None, str, str, str]:
    """The parts of a :class:`Problem` from the message of an error that begins with the name of its file."""
    message, _, fix = text.removeprefix(f"{path}: ").partition("; ")
    return path, None, "", message, fix


def _features(path: Path, frame: Any, what: str) -> Iterator[Probe | CrossSection | Problem]:
    """The feature of each row, or what is wrong with it."""
    import shapely

    names = _names(frame, what)
    for number, (geometry, name) in enumerate(zip(shapely.force_2d(frame.geometry.to_numpy()), names, strict=True), 1):
        source = f"{path}: feature {number}"
        if geometry is None or geometry.is_empty:
            yield Problem(source, None, "", f"{name!r} has no geometry", "delete it or draw it")
            continue
        merged = shapely.line_merge(geometry) if geometry.geom_type == "MultiLineString" else geometry
        parts = shapely.get_parts(geometry if merged.is_empty else merged)  # a line of one place merges to nothing
        if len(parts) != 1 or parts[0].geom_type not in TYPES[what]:
            several = f" of {len(parts)} parts" if len(parts) > 1 else ""
            yield Problem(source, None, "", f"{name!r} is a {geometry.geom_type}{several}, not a single {what}", REMEDIES[what])
            continue
        vertices = tuple((float(x), float(y)) for x, y in shapely.get_coordinates(parts[0]))
        if what == POINTS and not np.isfinite(vertices).all():
            yield Problem(source, None, "", f"{name!r}: a coordinate is not finite", "draw the point again")
            continue
        yield Probe(name, *vertices[0], source) if what == POINTS else CrossSection(name, vertices, source)


def _names(frame: Any, what: str) -> list[str]:
    """Names of the features: their attribute ``name``, else their kind and number."""
    column = next((c for c in frame.columns if str(c).lower() == "name"), None)
    numbered = [f"{PREFIXES[what]}{number}" for number in range(1, len(frame) + 1)]
    if column is None:
        return numbered
    entries = frame[column]
    return [str(name) if known else other for name, known, other in zip(entries, entries.notna(), numbered, strict=True)]
