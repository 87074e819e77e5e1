"""Thickness rasters as arrays with local edges."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.model.terrain import Terrain
from runout.release.crs import require_terrain_crs


def read_thickness(path: Path, terrain: Terrain) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[str, ...]]:
    """Values (nx, ny) from the south-west, 0 where nodata; local edges ``(x, y)`` [m]; what was assumed.

    Raises
    ------
    ReleaseError
        Missing or unreadable file, several bands, rotated or without georeference, another coordinate system.
    """
    import rasterio

    if not path.exists():
        raise ReleaseError(f"{path}: no such file; check the path of the thickness raster")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(path) as raster:
                values = _values(path, raster)
                transform, crs = raster.transform, raster.crs.to_wkt() if raster.crs else None
    except rasterio.errors.RasterioIOError as error:
        raise ReleaseError(f"{path}: cannot be read as a raster ({error}); use GeoTIFF or ESRI ASCII") from error
    if transform.is_identity or not transform.is_rectilinear or transform.a <= 0:
        raise ReleaseError(f"{path}: has no georeference or is rotated; warp it to the terrain: gdalwarp {path} warped.tif")
    changes = require_terrain_crs(path, crs, terrain, "gdalwarp")
    rows, columns = values.shape
    x = transform.c - terrain.west + np.arange(columns + 1) * transform.a
    y = transform.f - terrain.south + np.arange(rows + 1) * transform.e
    if transform.e < 0:
        values, y = values[::-1], y[::-1]
    return np.ascontiguousarray(values.T), (x, y), changes


def _values(path: Path, raster: Any) -> np.ndarray:
    if raster.count != 1:
        raise ReleaseError(
            f"{path}: has {raster.count} bands; keep that of the thickness: gdal_translate -b 1 {path} thickness.tif"
        )
    values = raster.read(1, masked=True).astype(np.float64).filled(0.0)
    values[np.isnan(values)] = 0.0
    if np.isinf(values).any():
        raise ReleaseError(f"{path}: {int(np.isinf(values).sum())} cells are infinite; mark them as nodata")
    return values
