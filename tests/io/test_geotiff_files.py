from pathlib import Path

import numpy as np
import pyproj
import rasterio

from runout.io import netcdf
from runout.io.geotiff import write_cog
from runout.model.terrain import Terrain


def test_a_cog_keeps_place_values_and_what_they_mean(terrain: Terrain, maps: dict, tmp_path: Path) -> None:
    dataset = netcdf.map_dataset(terrain, maps, title="A valley")
    for name, values in maps.items():
        with rasterio.open(write_cog(dataset, name, tmp_path / f"{name}.tif")) as raster:
            assert raster.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
            assert raster.crs == (terrain.crs and rasterio.crs.CRS.from_wkt(terrain.crs))
            assert raster.transform.e < 0
            np.testing.assert_allclose(raster.bounds, terrain.extent, atol=1e-6)
            assert raster.nodata == -9999
            assert raster.units[0] == dataset[name].attrs["units"]
            assert raster.descriptions[0] == dataset[name].attrs["long_name"]
            assert raster.tags()["title"] == "A valley"
            read = raster.read(1, masked=True)
            np.testing.assert_array_equal(read.filled(np.nan), values.astype(np.float32))


def test_large_maps_have_overviews_and_blocks(tmp_path: Path) -> None:
    terrain = Terrain(np.ones((700, 600)), (1.0, 1.0), 5e5, 5e6, pyproj.CRS("EPSG:32616").to_wkt())
    dataset = netcdf.map_dataset(terrain, {"max_speed": np.ones(terrain.shape)}, title="t")
    with rasterio.open(write_cog(dataset, "max_speed", tmp_path / "a.tif")) as raster:
        assert raster.overviews(1)
        assert raster.block_shapes == [(256, 256)]
        assert raster.compression.value == "DEFLATE"


def test_a_layer_is_chosen_by_its_threshold(tmp_path: Path) -> None:
    terrain = Terrain(np.ones((3, 4)), (1.0, 1.0))
    dataset = netcdf.map_dataset(terrain, {}, title="t").assign_coords(speed_threshold=[1.0, 5.0])
    layers = np.stack([np.full((3, 4), 0.75), np.full((3, 4), 0.25)])
    netcdf.add_map(dataset, "speed_exceedance_probability", layers, ("speed_threshold",))
    path = write_cog(dataset, "speed_exceedance_probability", tmp_path / "p.tif", speed_threshold=5.0)
    with rasterio.open(path) as raster:
        assert (raster.read(1) == 0.25).all()
        assert raster.tags()["speed_threshold"] == "5 m s-1"
