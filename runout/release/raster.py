"""Thickness rasters as arrays with local edges."""

from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.io.boundary import exists
from runout.io.georeference import require_usable
from runout.io.opening import open_raster
from runout.model.limits import LIMITS
from runout.model.terrain import Terrain
from runout.release.crs import to_terrain
from runout.release.reproject import raster_on_terrain


def read_thickness(path: Path, terrain: Terrain) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[str, ...]]:
    """Values (nx, ny) from the south-west, 0 where nodata; local edges ``(x, y)`` [m]; what was assumed.

    Raises
    ------
    ReleaseError
        Missing or unreadable file, several bands, rotated or without georeference, a system without known transformation.
    """
    if not exists(path):
        raise ReleaseError(f"{path}: no such file; check the path of the thickness raster")
    with open_raster(path, ReleaseError) as raster:
        require_usable(tuple(raster.transform)[:6], path, ReleaseError)
        values = _values(path, raster)
        transform, crs = raster.transform, raster.crs.to_wkt() if raster.crs else None
    if transform.is_identity or not transform.is_rectilinear or transform.a <= 0:
        raise ReleaseError(f"{path}: has no georeference or is rotated; warp it to the terrain: gdalwarp {path} warped.tif")
    rows, columns = values.shape
    x, y = transform.c + np.arange(columns + 1) * transform.a, transform.f + np.arange(rows + 1) * transform.e
    if transform.e < 0:
        values, y = values[::-1], y[::-1]
    found = to_terrain(path, crs, terrain, (x[0], y[0], x[-1], y[-1]), "gdalwarp")
    if found.forward is not None:
        return raster_on_terrain(np.ascontiguousarray(values.T), (x, y), found, terrain, path)
    return np.ascontiguousarray(values.T), (x - terrain.west, y - terrain.south), found.sentences


def _values(path: Path, raster: Any) -> np.ndarray:
    if raster.count != 1:
        raise ReleaseError(
            f"{path}: has {raster.count} bands; keep that of the thickness: gdal_translate -b 1 {path} thickness.tif"
        )
    values = raster.read(1, masked=True).astype(np.float64).filled(0.0)
    values[np.isnan(values)] = 0.0
    if np.isinf(values).any():
        raise ReleaseError(f"{path}: {int(np.isinf(values).sum())} cells are infinite; mark them as nodata")
    _require_in_limits(path, raster, values)
    return values


def _require_in_limits(path: Path, raster: Any, values: np.ndarray) -> None:
    """ReleaseError if a cell is no possible thickness, of either sign; names the first, which often marks missing values."""
    valid = LIMITS["thickness"]
    beyond = np.argwhere(np.abs(values) > valid.high)
    if not len(beyond):
        return
    row, column = beyond[0]
    value, (east, north) = values[row, column], raster.xy(row, column)
    raise ReleaseError(
        f"{path}: thickness is {value:g} m at row {row}, column {column} (easting {east:.2f}, northing {north:.2f}), {len(beyond)} "
        f"cells in all; {valid.allowed()}; if {value:g} marks cells without a release, declare it: "
        f"gdal_edit.py -a_nodata {value:.9g} {path}"
    )
