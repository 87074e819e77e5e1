"""Terrains and files that the tests of releases share."""

import os
import warnings
from pathlib import Path

import numpy as np
import pyproj
import pytest

from runout.materials.drucker_prager import DruckerPrager
from runout.model.terrain import Terrain

UTM_16 = pyproj.CRS("EPSG:32616").to_wkt()


@pytest.fixture
def terrain():
    """A gentle plane of 40 x 60 cells of 5 m in UTM zone 16 north."""
    z = 100.0 + 0.2 * np.add.outer(np.arange(40.0)[::-1], np.arange(60.0))
    return Terrain(z, (5.0, 5.0), 500_000.0, 4_000_000.0, UTM_16, "plane.tif")


@pytest.fixture
def material():
    return DruckerPrager(density=2000.0, youngs_modulus=5e6, friction_angle=30.0)


@pytest.fixture
def write_polygons(tmp_path):
    """Writes polygons given in local metres from the corner of the terrain; returns the path."""
    import geopandas
    import shapely

    def write(polygons, name="release.gpkg", crs="EPSG:32616", origin=(500_000.0, 4_000_000.0), **attributes):
        moved = [shapely.transform(p, lambda c: c + np.array(origin)) for p in polygons]
        frame = geopandas.GeoDataFrame(attributes, geometry=moved, crs="EPSG:32616")
        path = tmp_path / name
        frame = frame.to_crs(crs) if crs else frame.set_crs(None, allow_override=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # some tests want a file without a coordinate system
            frame.to_file(path, driver="GeoJSON" if path.suffix == ".geojson" else None, engine="pyogrio")
        return path

    return write


@pytest.fixture
def write_raster(tmp_path):
    """Writes a thickness raster (rows, columns) whose south-west corner lies at a local position."""
    import rasterio
    from rasterio.transform import from_origin

    def write(values, cell=5.0, corner=(0.0, 0.0), crs="EPSG:32616", nodata=None, name="thickness.tif"):
        values = np.asarray(values, np.float64)
        transform = from_origin(500_000.0 + corner[0], 4_000_000.0 + corner[1] + values.shape[0] * cell, cell, cell)
        path = tmp_path / name
        shape = {"height": values.shape[0], "width": values.shape[1], "count": 1, "dtype": "float64"}
        with rasterio.open(path, "w", driver="GTiff", transform=transform, crs=crs, nodata=nodata, **shape) as raster:
            raster.write(values, 1)
        return path

    return write


@pytest.fixture
def real_data():
    """Folder of the real data sets."""
    folder = os.environ.get("RUNOUT_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("RUNOUT_DATA does not name the folder of the real data sets")
    return Path(folder)


@pytest.fixture
def real_terrain(real_data):
    """Reads a real DEM into a terrain."""
    import rasterio

    def read(name, crs=None):
        with rasterio.open(real_data / name) as raster:
            z = raster.read(1, masked=True).astype(np.float64).filled(np.nan)
            stated = raster.crs.to_wkt() if raster.crs else None
            corner = raster.bounds.left, raster.bounds.bottom
            return Terrain(z, raster.res, *corner, pyproj.CRS(crs).to_wkt() if crs else stated, name)

    return read
