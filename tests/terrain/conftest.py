"""Rasters for the tests: written small, in every form that an analyst may bring."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

UTM = "EPSG:32632"
TRANSFORM = (10.0, 0.0, 600000.0, 0.0, -10.0, 5200000.0)


@pytest.fixture
def slope() -> np.ndarray:
    """Elevation (6, 8) [m], different in every cell, falling to the east and south; a marker of 1999 m in the north-west."""
    z = 1500.0 - 5.0 * np.arange(6)[:, None] - 3.0 * np.arange(8)[None, :]
    z[0, 0] = 1999.0
    return z


@pytest.fixture
def geotiff(tmp_path: Path) -> Callable[..., Path]:
    """Writer of GeoTIFFs: values (rows, columns) or (bands, rows, columns), transform, crs, nodata, unit, scale, offset, mask."""
    import rasterio
    from rasterio.transform import Affine

    def write(
        values: np.ndarray, transform: tuple[float, ...] | None = TRANSFORM, crs: Any = UTM, name: str = "dem.tif", **more: Any
    ) -> Path:
        bands = values if values.ndim == 3 else values[None]
        mask, unit = more.pop("mask", None), more.pop("unit", None)
        packing = more.pop("scale", None), more.pop("offset", None)
        place = {} if transform is None else {"transform": Affine(*transform)}
        shape = {"count": bands.shape[0], "height": bands.shape[1], "width": bands.shape[2], "dtype": bands.dtype}
        with rasterio.open(tmp_path / name, "w", driver="GTiff", crs=crs, **shape, **place, **more) as dataset:
            dataset.write(bands)
            if mask is not None:
                dataset.write_mask(mask)
            if unit is not None:
                dataset.units = [unit] * bands.shape[0]
            if packing != (None, None):
                dataset.scales, dataset.offsets = [packing[0]], [packing[1]]
        return tmp_path / name

    return write


@pytest.fixture
def measured() -> Callable[[str], Path]:
    """Path of a raster of the validation data; skips where the data are absent."""

    def find(name: str) -> Path:
        folder = os.environ.get("RUNOUT_DATA")
        if not folder or not (Path(folder) / name).exists():
            pytest.skip(f"validation data {name} not found; set RUNOUT_DATA to the folder that holds it")
        return Path(folder) / name

    return find
