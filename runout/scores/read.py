"""Reads observations: outlines, rasters, points with attributes, and thalwegs."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import DemError, ObservationError, ReleaseError
from runout.io.polygon_reproject import polygons_on_terrain
from runout.io.polygons import PolygonLayer, read_frame, read_polygons
from runout.model.terrain import Terrain
from runout.quantities import QUANTITIES
from runout.scores.flow import IN_FILES, OF_BED_MEMBER, OF_MEMBER
from runout.scores.grid import Grid
from runout.scores.points import POINT_UNITS, Gauges
from runout.scores.thalweg import Thalweg
from runout.terrain.prepare import LARGEST_NUMBER, known_or_nan
from runout.terrain.source import Quantity, north_up_in_unit_of, open_source

LARGEST_PRESSURE = 1e12  # [Pa] beyond this a number marks an unknown cell


class Nodata(StrEnum):
    """What cells without a value mean."""

    UNKNOWN = "unknown"  # excluded from all scores and counted
    ZERO = "zero"  # nothing happened there


@contextmanager
def observation_errors() -> Iterator[None]:
    """Context that turns the errors of the readers of releases and elevations into those of observations."""
    try:
        yield
    except (ReleaseError, DemError) as error:
        raise ObservationError(str(error)) from error


def read_map(
    path: Path, nodata: Nodata = Nodata.UNKNOWN, *, quantity: str = "thickness"
) -> tuple[np.ndarray, Grid, tuple[str, ...]]:
    """Values of a raster (rows, columns), north up, its grid, and sentences on changes.

    ``nodata``: "unknown": cells without a value are NaN; "zero": they are 0, or never reached. Stated units such as ft or kPa are
    converted to SI. ``quantity``: what it shows. Only values of "change" (a DEM of difference) may be negative. Raises
    ObservationError: missing or unreadable file, several bands, no georeference, rotated, or negative values where there are none.
    """
    of_member = OF_MEMBER | OF_BED_MEMBER
    of_runout = [of_member[quantity]] if quantity in of_member else []
    of_runout += [QUANTITIES[quantity].stem] if quantity in QUANTITIES else []
    shown = Quantity(quantity, IN_FILES[quantity], ObservationError, (quantity, *of_runout, "band1"))
    with observation_errors(), open_source(path, shown) as source:
        raster = source.read(None)
        values, blank = known_or_nan(raster.values, str(path), LARGEST_PRESSURE if quantity == "pressure" else LARGEST_NUMBER)
        raster = north_up_in_unit_of(replace(raster, values=values, changes=(*raster.changes, *blank)), shown)
    crs = raster.crs.to_wkt() if raster.crs else None
    values = raster.values
    if quantity != "change" and (values < 0).any():
        remedy = f"values of {quantity} are 0 or more; declare those that mark cells without a value: gdal_edit.py -a_nodata"
        raise ObservationError(f"{path}: {int((values < 0).sum())} cells are negative, the least {np.nanmin(values):g}; {remedy}")
    a, _, c, _, e, f = raster.transform
    grid = Grid(c, f + e * values.shape[0], (a, -e), values.shape, crs, str(path))  # type: ignore[arg-type]
    return where_dry(values, quantity) if nodata is Nodata.ZERO else values, grid, raster.changes


def where_dry(values: np.ndarray, quantity: str) -> np.ndarray:
    """A map whose unknown cells hold what nothing leaves there: 0, for an arrival time infinity."""
    return np.where(np.isnan(values), np.inf if quantity == "arrival" else 0.0, values)


def read_outline(path: Path, terrain: Terrain, layer: str | None = None) -> tuple[Any, tuple[str, ...]]:
    """Polygons of a vector file united (shapely, map coordinates of the terrain), and sentences on changes.

    Raises ObservationError if the file cannot be read, holds no valid polygons, or none lies on the terrain.
    """
    import shapely

    with observation_errors():
        layer_polygons = read_polygons(path, terrain, layer, "outline")
    outline = shapely.union_all(layer_polygons.polygons)
    if not shapely.intersects(outline, shapely.box(*terrain.extent)):
        raise ObservationError(f"{path}: no outline lies on {terrain.source}; check the coordinate system of both")
    return outline, layer_polygons.changes


def read_thalweg(path: Path, terrain: Terrain, layer: str | None = None) -> tuple[Thalweg, tuple[str, ...]]:
    """Line of a vector file, and sentences on changes. It is turned if it is drawn uphill.

    Raises ObservationError if the file cannot be read, does not hold one connected line, or that lies beside the terrain.
    """
    import shapely

    frame, changes = _features(path, terrain, layer, "thalweg")
    kinds = {str(g.geom_type) for g in frame.geometry if g is not None}
    lines = shapely.force_2d(frame.geometry.to_numpy()) if kinds <= {"LineString", "MultiLineString"} else []
    line = shapely.line_merge(shapely.union_all(lines))  # no union of polygons, which fails if one crosses itself
    if line.geom_type != "LineString" or line.is_empty:
        content = f"holds {len(frame)} features ({', '.join(sorted(kinds))})"
        raise ObservationError(f"{path}: {content}; a thalweg is one line without branches or gaps")
    if not shapely.intersects(line, shapely.box(*terrain.extent)):
        raise ObservationError(f"{path}: the thalweg does not meet {terrain.source}; check the coordinate system of both")
    points = shapely.get_coordinates(line)
    first, last = (_elevation_at(terrain, points[k]) for k in (0, -1))
    if last > first:
        changes = (*changes, f"{path}: the line runs uphill, from {first:.4g} to {last:.4g} m; it is read from its other end.")
        points = points[::-1]
    return Thalweg(points), changes


def read_gauges(
    path: Path, terrain: Terrain, attributes: Mapping[str, str], layer: str | None = None
) -> tuple[Gauges, tuple[str, ...]]:
    """Points of a vector file with observed values, and sentences on changes.

    ``attributes``: attribute that holds ``arrival_time`` [s], ``thickness`` [m, vertical] or ``speed`` [m/s]; empty values are
    unknown. Raises ObservationError if the file cannot be read, holds other geometries, an attribute is missing or negative, or no
    point lies on the terrain.
    """
    import shapely

    frame, changes = _features(path, terrain, layer, "gauge")
    points = frame.geometry.to_numpy()
    wrong = sorted({str(g.geom_type) for g in points if g is not None} - {"Point"})
    if wrong or shapely.is_missing(points).any():
        raise ObservationError(f"{path}: holds {' and '.join(wrong) or 'features without a geometry'}; gauges are single points")
    place = shapely.get_coordinates(points)
    west, south, east, north = terrain.extent
    outside = int(((place[:, 0] < west) | (place[:, 0] > east) | (place[:, 1] < south) | (place[:, 1] > north)).sum())
    if outside == len(place):
        raise ObservationError(f"{path}: no gauge lies on {terrain.source}; check the coordinate system of both")
    if outside:
        changes = (*changes, f"{path}: {outside} of {len(place)} gauges lie outside of {terrain.source}; they are not scored.")
    table = PolygonLayer(path, points, frame.drop(columns=frame.geometry.name))
    values = {quantity: _numbers(table, attribute, quantity) for quantity, attribute in attributes.items()}
    return Gauges(place[:, 0], place[:, 1], values), changes


def _numbers(table: PolygonLayer, attribute: str, quantity: str) -> np.ndarray:
    """Values (n,) of an attribute, NaN where it is empty."""
    column = table.attributes.get(attribute)
    with observation_errors():
        if column is None:
            table.numbers(attribute, quantity.replace("_", " "))  # its message names what is there
        known = column.notna().to_numpy()
        values = np.full(len(known), np.nan)
        if known.any():
            chosen = PolygonLayer(table.source, table.polygons[known], table.attributes[known].reset_index(drop=True))
            values[known] = chosen.numbers(attribute, quantity.replace("_", " "))
    if (values < 0).any():
        unit = POINT_UNITS[quantity]
        raise ObservationError(f"{table.source}: attribute {attribute!r} holds {np.nanmin(values):g} {unit}; it must be 0 or more")
    return values


def _features(path: Path, terrain: Terrain, layer: str | None, what: str) -> tuple[Any, tuple[str, ...]]:
    """Frame of a layer in the map coordinates of the terrain, and sentences on changes."""
    with observation_errors():
        frame, driver = read_frame(path, layer, what)
        if not len(frame):
            raise ObservationError(f"{path}: the layer is empty; draw the {what} in it")
        return polygons_on_terrain(path, frame, driver, terrain)


def _elevation_at(terrain: Terrain, place: np.ndarray) -> float:
    """Elevation [m] of the cell nearest to a place."""
    row = int(np.argmin(np.abs(terrain.northing - place[1])))
    column = int(np.argmin(np.abs(terrain.easting - place[0])))
    return float(terrain.elevation[row, column])
