"""Reads thickness rasters as arrays with local edges."""

from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.io.band import unpacked
from runout.io.boundary import exists
from runout.io.georeference import require_usable
from runout.io.layer_crs import ToTerrain, to_terrain
from runout.io.opening import open_raster, require_room
from runout.io.polygon_reproject import raster_on_terrain
from runout.io.window import LARGEST_WHOLE, Bounds, Part, bounds_of, part_of
from runout.model.limits import LIMITS
from runout.model.terrain import Terrain

MARGIN = 8  # cells of a huge raster that are read around the terrain, to detect a release that extends beyond it
EDGE_POINTS = 33  # points along each side of the terrain: straight edges become curves in another system


def read_thickness(path: Path, terrain: Terrain) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[str, ...]]:
    """Values (nx, ny) from the south-west, 0 for nodata; local edges ``(x, y)`` [m]; sentences on assumptions.

    Raises
    ------
    ReleaseError
        Missing or unreadable file, several bands, rotated or without georeference, a system without known transformation.
    """
    if not exists(path):
        raise ReleaseError(f"{path}: no such file; check the path of the thickness raster")
    with open_raster(path, ReleaseError) as raster:
        require_usable(tuple(raster.transform)[:6], path, ReleaseError)
        _require_one_band(path, raster)
        whole, crs = raster.transform, raster.crs.to_wkt() if raster.crs else None
        if whole.is_identity or not whole.is_rectilinear or whole.a <= 0:
            raise ReleaseError(f"{path}: has no georeference or is rotated; warp it to the terrain: gdalwarp {path} warped.tif")
        found = to_terrain(path, crs, terrain, bounds_of(tuple(whole)[:6], raster.shape), "gdalwarp")
        part, sentences = _needed(path, raster, found, terrain)
        values, converted = _values(path, raster, part)
    a, _, c, _, e, f = part.transform(tuple(whole)[:6])
    x, y = c + np.arange(part.columns + 1) * a, f + np.arange(part.rows + 1) * e
    if e < 0:
        values, y = values[::-1], y[::-1]
    if found.forward is not None:
        values, edges, said = raster_on_terrain(np.ascontiguousarray(values.T), (x, y), found, terrain, path)
        return values, edges, (*sentences, *converted, *said)
    return np.ascontiguousarray(values.T), (x - terrain.west, y - terrain.south), (*sentences, *converted, *found.sentences)


def _needed(path: Path, raster: Any, found: ToTerrain, terrain: Terrain) -> tuple[Part, tuple[str, ...]]:
    """Part of a raster that is read, and a sentence unless it is all: of huge rasters only the cells on and near the terrain."""
    transform, shape = tuple(raster.transform)[:6], raster.shape
    extent, said = None, ""
    if shape[0] * shape[1] > LARGEST_WHOLE:
        extent = _around(terrain, found, transform)
        said = f"{path}: of its {shape[0]} x {shape[1]} cells those on the terrain are read; releases elsewhere are left out."
    part = part_of(transform, shape, extent, path, ReleaseError)
    require_room(part.rows, part.columns, path, ReleaseError)
    return part, (said,) if said else ()


def _around(terrain: Terrain, found: ToTerrain, transform: tuple[float, ...]) -> Bounds:
    """Extent of a terrain and :data:`MARGIN` cells around it, in the coordinates of a raster."""
    west, south, east, north = terrain.extent
    along = np.linspace(0.0, 1.0, EDGE_POINTS)
    x, y = west + along * (east - west), south + along * (north - south)
    rim = np.concatenate([np.column_stack((x, np.full_like(x, edge))) for edge in (south, north)])
    rim = np.concatenate([rim, *(np.column_stack((np.full_like(y, edge), y)) for edge in (west, east))])
    there = rim if found.inverse is None else found.inverse(rim)
    more = MARGIN * np.abs([transform[0], transform[4]])
    low, high = there.min(axis=0) - more, there.max(axis=0) + more
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _require_one_band(path: Path, raster: Any) -> None:
    if raster.count != 1:
        raise ReleaseError(
            f"{path}: has {raster.count} bands; keep that of the thickness: gdal_translate -b 1 {path} thickness.tif"
        )


def _values(path: Path, raster: Any, part: Part) -> tuple[np.ndarray, tuple[str, ...]]:
    """Thickness [m], 0 for nodata, and sentences on changes."""
    stored = raster.read(1, window=part.window, masked=True).astype(np.float64)
    values, said = unpacked(raster, stored, path, "thickness", ReleaseError)
    values = np.ma.filled(values, 0.0)
    values[np.isnan(values)] = 0.0
    if np.isinf(values).any():
        raise ReleaseError(f"{path}: {int(np.isinf(values).sum())} cells are infinite; mark them as nodata")
    _require_in_limits(path, raster, values, stored.data, part)
    return values, said


def _require_in_limits(path: Path, raster: Any, values: np.ndarray, stored: np.ndarray, part: Part) -> None:
    """Raise ReleaseError if the absolute value of a cell exceeds the largest thickness; often it marks missing values."""
    valid = LIMITS["thickness"]
    beyond = np.argwhere(np.abs(values) > valid.high)
    if not len(beyond):
        return
    value, number = values[tuple(beyond[0])], stored[tuple(beyond[0])]
    row, column = beyond[0] + (part.row, part.column)
    east, north = raster.xy(row, column)
    raise ReleaseError(
        f"{path}: thickness is {value:g} m at row {row}, column {column} (easting {east:.2f}, northing {north:.2f}), {len(beyond)} "
        f"cells in all; {valid.allowed()}; if {number:g} marks cells without a release, declare it: "
        f"gdal_edit.py -a_nodata {number:.9g} {path}"
    )
