"""Reads a picture such as an orthophoto onto the window of a scene."""

from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import InputError
from runout.io.opening import open_raster

MOST_PIXELS = 2048  # along a side
STRETCH = (2.0, 98.0)  # percentiles that become black and white, of bands that are not bytes


def draped_image(path: Path, extent: tuple[float, float, float, float], crs: str | None, most: int = MOST_PIXELS) -> np.ndarray:
    """Colours (height, width, 3) of uint8 of a GeoTIFF in a window, north up; grey where the file has no pixels.

    The raster has one band (grey) or three (red, green, blue) in any coordinate system. The window, ``extent``, is west, south,
    east and north [m] in the system ``crs``, or in that of the file if it is None; its longer side gets at most ``most`` pixels.
    Raises InputError if the file cannot be read, states no coordinate system, or does not touch the window.
    """
    import rasterio

    try:
        with open_raster(path, InputError) as file:
            if file.crs is None and crs is not None:
                raise InputError(f"{path}: the image states no coordinate system; add one, for example with gdal_edit.py -a_srs")
            bands, known = _warped(file, extent, crs, most)
    except rasterio.errors.RasterioError as cause:
        raise InputError(f"{path}: cannot be read as an image ({cause}); give a GeoTIFF") from cause
    if not known.any():
        raise InputError(f"{path}: the image does not touch the window {tuple(round(edge) for edge in extent)}; check its place")
    colours = np.stack([_bytes(band, known) for band in bands], axis=-1)
    return np.where(known[..., None], colours, np.uint8(200))


def _warped(file: Any, extent: tuple[float, float, float, float], crs: str | None, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Three bands (3, height, width) on the window, and the pixels that the file covers."""
    from rasterio.enums import Resampling
    from rasterio.transform import from_bounds
    from rasterio.vrt import WarpedVRT

    west, south, east, north = extent
    scale = most / max(east - west, north - south)
    width, height = max(1, round((east - west) * scale)), max(1, round((north - south) * scale))
    place = {"crs": crs or file.crs, "transform": from_bounds(*extent, width, height), "width": width, "height": height}
    with WarpedVRT(file, resampling=Resampling.bilinear, add_alpha=file.nodata is None, **place) as window:
        bands = [1, 2, 3] if file.count >= 3 else [1, 1, 1]
        return window.read(bands), window.dataset_mask() > 0


def _bytes(band: np.ndarray, known: np.ndarray) -> np.ndarray:
    if band.dtype == np.uint8:
        return band
    low, high = np.percentile(band[known], STRETCH)
    scaled: np.ndarray = np.clip((band - low) / max(high - low, 1e-9) * 255, 0, 255).astype(np.uint8)
    return scaled
