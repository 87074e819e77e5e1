"""Marks of the explorer: outlines, structures, probes, profiles and observations, and what opens with each."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import StorageError
from runout.hazard.profiles import DISTANCE
from runout.io.probe_files import PERCENTILE, TIME
from runout.report.marks import INK, OBSERVED, OBSTACLE, PROBE, RELEASE, Mark
from runout.report.probe_figures import DEPOSIT, FLOW, GROUND, PANELS, PROFILE_PANELS
from runout.report.structures import LoadError, structure_section
from runout.report.study import Study
from runout.report.tables import cells_through
from runout.report.wording import percent, unit
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

OUTLINE = "#8c1a4b"
PROFILES = "profiles"  # folder that `runout profile` writes
MOST_PLACES = 600  # of a line in a chart
DIGITS = 4
LABELLED = 0.12  # of the length of a line


def marks(study: Study, settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Groups of marks: ``name``, ``colour``, whether it is ``shown`` at first, and ``items``.

    An item has a ``label``, a ``kind`` (polygon, linestring or point), ``parts`` of coordinates [m] and ``details``: None, a table,
    or charts.
    """
    basemap, cell = study.basemap, min(study.basemap.cell_size)
    of_structure, of_probe = _loads(study, settings), _series(study)
    groups: list[tuple[str, str, bool, list[tuple[Mark, dict[str, Any] | None]]]] = [
        ("Releases and inflows", RELEASE, True, [(Mark(outline, "release or inflow"), None) for outline in basemap.outlines]),
        ("Outlines of the ensemble", OUTLINE, False, [(mark, None) for mark in _inundation(study, cell)]),
        ("Obstacles and structures", OBSTACLE, True, [(mark, of_structure(mark.label)) for mark in basemap.obstacles]),
        ("Friction zones", INK, False, [(mark, None) for mark in basemap.zones]),
        ("Observed", OBSERVED, True, [(mark, None) for mark in basemap.observed]),
        ("Probes", PROBE, True, [(mark, of_probe(mark)) for mark in basemap.probes]),
        ("Profiles", GROUND, True, list(_profiles(study))),
    ]
    return [
        {"name": name, "colour": colour, "shown": shown, "items": [_item(*one) for one in items if not one[0].geometry.is_empty]}
        for name, colour, shown, items in groups
        if items
    ]


def _inundation(study: Study, cell: float) -> Iterator[Mark]:
    """Outlines within which the flow arrives with a probability, without the corners on straight edges."""
    for feature in study.inundation if "inundation_probability" in study.hazard else ():
        yield Mark(feature["geometry"].simplify(0.01 * cell), f"probability {percent(float(feature['probability']))}")


def _loads(study: Study, settings: Mapping[str, Any]) -> Callable[[str], dict[str, Any] | None]:
    """Function that gives the table of the facades of a structure."""
    section = (
        structure_section(study.loads, LoadError.of(study.convergence, cells_through(study, settings))) if study.loads else None
    )
    if section is None:
        return lambda name: None
    headings = [f"{heading} [{units}]" if units else heading for heading, units in section["headings"]]
    names = {str(name) for name in section_names(study)}

    def of(name: str) -> dict[str, Any] | None:
        rows = [list(zip(headings[1:], row[1:], strict=True)) for row in section["rows"] if row[0] == name]
        remark = section["rounding"] if rows else "No member reaches it."
        return {"tables": rows, "remark": remark} if name in names else None

    return of


def section_names(study: Study) -> np.ndarray:
    """Names of the structures whose forces are known."""
    return study.loads.over["structure_name"].values.astype(str) if study.loads else np.array([], str)


def _series(study: Study) -> Callable[[Mark], dict[str, Any] | None]:
    """Function that gives the charts of a probe."""
    stations = {
        (group == "cross_sections", str(name)): (group, dataset, k)
        for group, dataset in study.probes.items()
        for k, name in enumerate(dataset["station_name"].values)
    }

    def of(mark: Mark) -> dict[str, Any] | None:
        key = mark.geometry.geom_type != "Point", mark.label
        if key not in stations:
            return None
        group, dataset, k = stations[key]
        station, x = dataset.isel(station=k), dataset[TIME].values
        panels = [_chart(label, name, x, station, colour) for name, (label, colour) in PANELS[group].items()]
        return {"charts": panels, "along": "time since release [s]", "remark": _remark(station, len(x))}

    return of


def _profiles(study: Study) -> Iterator[tuple[Mark, dict[str, Any]]]:
    """Lines of `runout profile` with their charts."""
    from shapely import LineString

    from runout.io import netcdf

    for path in sorted((study.results / PROFILES).glob("*.nc")):
        dataset = netcdf.read(path)
        if not {DISTANCE, "bed_elevation", "ground_elevation"} <= set(dataset.variables):
            raise StorageError(f"{path}: not a file of `runout profile`; remove it")
        x = dataset[DISTANCE].values
        ground = [("ground", "ground_elevation", GROUND), ("ground without the release", "bed_elevation", INK)]
        section = {
            "title": "elevation", "unit": "m", "x": _thin(x),
            "lines": [{"name": words, "colour": colour, "y": _thin(dataset[name].values)} for words, name, colour in ground],
        }  # fmt: skip
        panels = PROFILE_PANELS | {"deposit_thickness": ("deposit", DEPOSIT)}
        charts = [section, *(_chart(label, name, x, dataset, colour) for name, (label, colour) in panels.items())]
        line = LineString(np.stack([dataset["x"].values, dataset["y"].values], axis=1)).simplify(0.01)
        words = f"{dataset.attrs.get('line', path.stem)} ({path.stem})"
        yield Mark(line, words), {"charts": charts, "along": "distance along the line [m]", "remark": _remark(dataset, len(x))}


def _chart(title: str, name: str, x: np.ndarray, dataset: "xr.Dataset", colour: str = FLOW) -> dict[str, Any]:
    """A chart of a quantity: a line, or the median and the band of the percentiles."""
    units, divisor = VARIABLES[name].printed
    values = dataset[name] / divisor
    chart: dict[str, Any] = {"title": title, "unit": unit(units), "x": _thin(x)}
    if PERCENTILE not in values.dims:
        return chart | {"lines": [{"name": "", "colour": colour, "y": _thin(values.values)}]}
    levels = values[PERCENTILE].values
    middle, low, high = (
        _thin(values.sel({PERCENTILE: q}).values) for q in (levels[np.abs(levels - 50).argmin()], levels.min(), levels.max())
    )
    return chart | {"lines": [{"name": "", "colour": colour, "y": middle}], "band": {"low": low, "high": high}}


def _remark(dataset: "xr.Dataset", places: int) -> str:
    """Sentences on what lines and bands are."""
    step, sentences = -(-places // MOST_PLACES), []
    if PERCENTILE in dataset.dims:
        levels = dataset[PERCENTILE].values
        sentences.append(f"Line: median of the members, each place for itself. Band: {levels.min():g} to {levels.max():g} %.")
    return " ".join([*sentences, f"One in {step} values is drawn."] if step > 1 else sentences)


def _thin(values: np.ndarray) -> list[float | None]:
    """At most :data:`MOST_PLACES` of the values with four digits; None where there is none."""
    step = -(-len(values) // MOST_PLACES)
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in np.asarray(values, float)[::step]]


def _item(mark: Mark, details: dict[str, Any] | None) -> dict[str, Any]:
    kind = mark.geometry.geom_type.removeprefix("Multi").lower()
    parts = [_rounded(part) for part in _parts(mark.geometry)]
    shape = mark.geometry
    middle = shape.interpolate(LABELLED, normalized=True) if shape.geom_type == "LineString" else shape.representative_point()
    return {
        "label": mark.label,
        "kind": kind,
        "parts": parts,
        "middle": [round(middle.x, 2), round(middle.y, 2)],
        "details": details,
    }


def _parts(geometry: Any) -> Iterator[Any]:
    """Lines of coordinates: rings, lines and points."""
    for part in getattr(geometry, "geoms", [geometry]):
        if part.geom_type == "Polygon":
            yield from (ring.coords for ring in (part.exterior, *part.interiors))
        else:
            yield part.coords


def _rounded(coordinates: Sequence[Any]) -> list[list[float]]:
    """Eastings and northings."""
    return [[round(float(place[axis]), 2) for place in coordinates] for axis in (0, 1)]
