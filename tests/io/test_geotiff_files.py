from pathlib import Path

import numpy as np
import pyproj
import pytest
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


@pytest.mark.parametrize(
    "name", ["inundation_probability", "speed_exceedance_standard_error", "peak_pressure", "deposit_thickness_percentile"]
)
def test_overviews_invent_no_value(name: str, tmp_path: Path) -> None:
    own = np.random.default_rng(3).choice([0.0, 0.05, 0.25, 0.5, 1.0], (700, 600)).astype(np.float32)
    own[:, :40] = np.nan
    terrain = Terrain(np.ones(own.shape), (1.0, 1.0), 5e5, 5e6)
    path = write_cog(netcdf.map_dataset(terrain, {name: own}, title="t"), name, tmp_path / "a.tif")
    with rasterio.open(path) as raster:
        values = set(np.unique(raster.read(1)))
    with rasterio.open(path, overview_level=0) as overview:
        coarse = overview.read(1)
    assert coarse.shape == (350, 300)
    assert set(np.unique(coarse)) == values


def test_overviews_of_the_ground_are_means(tmp_path: Path) -> None:
    elevation = 100.0 + np.indices((700, 600)).sum(axis=0) % 2
    terrain = Terrain(elevation, (1.0, 1.0), 5e5, 5e6)
    path = write_cog(netcdf.map_dataset(terrain, {"elevation": elevation}, title="t"), "elevation", tmp_path / "a.tif")
    with rasterio.open(path, overview_level=0) as overview:
        assert (overview.read(1) == 100.5).all()


def test_statistics_are_those_of_the_known_cells(tmp_path: Path) -> None:
    terrain = Terrain(np.ones((3, 4)), (1.0, 1.0))
    speed = np.arange(12.0).reshape(3, 4)
    speed[0, :3] = np.nan
    path = write_cog(netcdf.map_dataset(terrain, {"max_speed": speed}, title="t"), "max_speed", tmp_path / "a.tif")
    with rasterio.open(path) as raster:
        found = {name: float(value) for name, value in raster.tags(1).items() if name.startswith("STATISTICS")}
    assert found == {
        "STATISTICS_MINIMUM": 3.0,
        "STATISTICS_MAXIMUM": 11.0,
        "STATISTICS_MEAN": 7.0,
        "STATISTICS_STDDEV": pytest.approx(np.std(np.arange(3, 12))),
        "STATISTICS_VALID_PERCENT": 75.0,
    }
    nothing = netcdf.map_dataset(terrain, {"max_speed": np.full((3, 4), np.nan)}, title="t")
    with rasterio.open(write_cog(nothing, "max_speed", tmp_path / "b.tif")) as raster:
        assert not [name for name in raster.tags(1) if name.startswith("STATISTICS")]
