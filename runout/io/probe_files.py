"""Time series at probes as CF discrete sampling geometries (timeSeries), and as tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.io.atomic import whole_file
from runout.io.grid import crs_as_variable, grid_mapping
from runout.model.probes import Probes, ProbeSeries, ground_at
from runout.model.terrain import Terrain
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

POINTS, SECTIONS = "probe_points", "cross_sections"  # groups of a member's file
NAMES = {POINTS: "points", SECTIONS: "cross_sections"}  # ends of the names of files
FOLDER, SITE_STEM = "probes", "site_ensemble"  # of the files of the probes of site.yaml
SITE_FILES = {group: f"{FOLDER}/{SITE_STEM}_{name}.nc" for group, name in NAMES.items()}
CLOCK = {  # CF wants a date, and the release has none
    "axis": "T",
    "standard_name": "time",
    "units": "seconds since 1970-01-01 00:00:00",
    "calendar": "standard",
    "units_metadata": "leap_seconds: none",
    "comment": "1970-01-01 00:00:00 stands for the moment of the release, which has no date",
}
STATION, TIME, PERCENTILE = "station", "time", "percentile"
_PLACES = "time x y station_elevation station_name"


def series_datasets(series: ProbeSeries) -> "dict[str, xr.Dataset]":
    """Datasets of the points and of the cross-sections of a run, as far as there are any, by the names of their groups."""
    datasets = {}
    if series.probes.points:
        datasets[POINTS] = _filled(points_frame(series.probes, series.terrain, series.time), series.points, series.peaks)
    if series.probes.cross_sections:
        frame = sections_frame(series.probes, series.terrain, series.time)
        datasets[SECTIONS] = _filled(frame, series.cross_sections, series.section_peaks)
    return datasets


def points_frame(probes: Probes, terrain: Terrain, time: np.ndarray) -> "xr.Dataset":
    """Names and places of points, without values."""
    places = np.array([p.vertices[0] for p in probes.points])
    return _frame([p.name for p in probes.points], places, terrain, time)


def sections_frame(probes: Probes, terrain: Terrain, time: np.ndarray) -> "xr.Dataset":
    """Names, middles and vertices of cross-sections, without values; the vertices of all lines stand one behind another."""
    lines = probes.cross_sections
    dataset = _frame([line.name for line in lines], np.array([line.middle for line in lines]), terrain, time)
    vertices = np.concatenate([np.array(line.vertices) for line in lines])
    dataset["section_length"] = (STATION, np.array([line.length for line in lines]))
    counts = np.array([len(line.vertices) for line in lines], np.int32)
    dataset["node_count"] = (STATION, counts, {"long_name": "number of vertices"})
    for axis, values in zip("xy", vertices.T, strict=True):
        named = {"units": "m", "long_name": f"{axis} of the vertices of the lines, one line behind another"}
        dataset[f"node_{axis}"] = ("node", values, named)
    return dataset


def _frame(names: list[str], places: np.ndarray, terrain: Terrain, time: np.ndarray) -> "xr.Dataset":
    import xarray as xr

    dataset = crs_as_variable(xr.Dataset(coords=place_coordinates(places, STATION, terrain), attrs={"featureType": "timeSeries"}))
    text = VARIABLES["station_name"].attributes() | {"cf_role": "timeseries_id"}
    dataset = dataset.assign_coords(
        {
            TIME: (TIME, time, CLOCK),
            "station_name": (STATION, np.array(names, dtype=object), text),
            "station_elevation": (STATION, ground_at(terrain, places)),
        }
    )
    return dataset


def place_coordinates(places: np.ndarray, dim: str, terrain: Terrain) -> "dict[str, Any]":
    """Coordinates ``x`` and ``y`` [m] of places (n, 2) along a dimension, and ``crs`` unless the system is local."""
    import xarray as xr

    coordinates: dict[str, Any] = {}
    for axis, values, word in zip("xy", places.T, ("easting", "northing"), strict=True):
        named = {"units": "m", "standard_name": f"projection_{axis}_coordinate", "long_name": word}
        coordinates[axis] = xr.Variable(dim, values, named | {"coverage_content_type": "coordinate"})
    if terrain.crs is not None:
        coordinates["crs"] = xr.Variable((), np.int32(0), grid_mapping(terrain.crs))
    return coordinates


def _filled(dataset: "xr.Dataset", series: Mapping[str, np.ndarray], peaks: Mapping[str, np.ndarray]) -> "xr.Dataset":
    for name, values in {**series, **peaks}.items():
        add_values(dataset, name, values, (STATION, TIME)[: np.ndim(values)])
    return dataset


def add_values(dataset: "xr.Dataset", name: str, values: np.ndarray, dims: tuple[str, ...]) -> None:
    """Add values under a name of :data:`runout.variables.VARIABLES`, with what CF wants of a variable of stations."""
    variable = VARIABLES[name]
    dataset[name] = (dims, np.asarray(values).astype(variable.dtype), variable.attributes())
    timed = TIME in dims
    dataset[name].encoding["coordinates"] = _PLACES if timed else _PLACES.removeprefix("time ")
    if "crs" in dataset:
        dataset[name].encoding["grid_mapping"] = "crs"


def series_table(dataset: "xr.Dataset") -> "pd.DataFrame":
    """Series of all stations below each other: name, time, and a column for each quantity (and percentile) with its unit."""
    import pandas as pd

    names = [name for name, variable in dataset.data_vars.items() if TIME in variable.dims and STATION in variable.dims]
    stations, times = dataset.sizes[STATION], dataset.sizes[TIME]
    columns: dict[str, Any] = {"name": np.repeat(dataset["station_name"].values, times)}
    columns["time [s]"] = np.tile(dataset[TIME].values, stations)
    for one in names:
        columns |= _columns(dataset, str(one), stations * times)
    return pd.DataFrame(columns)


def peaks_table(dataset: "xr.Dataset") -> "pd.DataFrame":
    """A row for each station: name, place, and its largest values with their units."""
    import pandas as pd

    names = [n for n, v in dataset.data_vars.items() if STATION in v.dims and TIME not in v.dims and n != "node_count"]
    columns: dict[str, Any] = {"name": dataset["station_name"].values}
    for name in ("x", "y", "station_elevation"):
        columns[f"{name} [m]"] = dataset[name].values
    for one in names:
        columns |= _columns(dataset, str(one), dataset.sizes[STATION])
    return pd.DataFrame(columns)


def _columns(dataset: "xr.Dataset", name: str, count: int) -> dict[str, np.ndarray]:
    """Columns of a variable: one, or one for each percentile."""
    variable, units = dataset[name], VARIABLES[name].units
    if PERCENTILE not in variable.dims:
        return {f"{name} [{units}]": variable.values.reshape(count)}
    levels = dataset[PERCENTILE].values
    return {f"{name} p{q:g} [{units}]": variable.sel(percentile=q).values.reshape(count) for q in levels}


def write_table(table: "pd.DataFrame", path: Path) -> Path:
    """Write a table as CSV, completely or not at all; returns the path."""
    with whole_file(path) as temporary:
        table.to_csv(temporary, index=False, float_format="%.9g")
    return path
