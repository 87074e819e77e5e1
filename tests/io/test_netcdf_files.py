import gc
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import netCDF4
import numpy as np
import pyproj
import pytest
import rasterio
import xarray as xr

from runout.errors import StorageError
from runout.io import netcdf
from runout.io.grid import geo_transform, grid_mapping
from runout.io.map_layers import rename_attribute
from runout.io.member_maps import MemberMaps, read_maps
from runout.model.terrain import Terrain


def test_gdal_opens_every_map_north_up_in_its_place(terrain: Terrain, maps: dict, tmp_path: Path) -> None:
    path = netcdf.write(netcdf.map_dataset(terrain, maps, title="t"), tmp_path / "m.nc")
    for name, values in maps.items():
        with rasterio.open(f'NETCDF:"{path}":{name}') as raster:
            assert raster.transform.e < 0, "north up"
            np.testing.assert_allclose(raster.bounds, terrain.extent, atol=1e-6)
            assert raster.nodata == -9999
            assert raster.crs == (terrain.crs and rasterio.crs.CRS.from_wkt(terrain.crs))
            read = raster.read(1, masked=True)
            np.testing.assert_array_equal(read.mask, np.isnan(values))
            assert read[0, 0] == np.float32(values[0, 0])


def test_maps_come_back_as_they_went_in(terrain: Terrain, maps: dict, tmp_path: Path) -> None:
    path = netcdf.write(netcdf.map_dataset(terrain, maps, title="t", attrs={"member_key": "abc"}), tmp_path / "m.nc")
    read = netcdf.read(path)
    for name, values in maps.items():
        np.testing.assert_array_equal(read[name], values.astype(np.float32))
    np.testing.assert_array_equal(read["x"], terrain.easting)
    np.testing.assert_array_equal(read["y"], terrain.northing)
    assert read.attrs["member_key"] == "abc"
    assert ("crs" in read.data_vars) == (terrain.crs is not None)
    assert "crs" not in read["arrival_time"].coords, "the title of a plot would name it"
    netcdf.write(read, path)  # what was read can be written again
    np.testing.assert_array_equal(netcdf.read(path)["arrival_time"], maps["arrival_time"])


def test_files_are_compressed_in_chunks_and_mark_missing_values(terrain: Terrain, maps: dict, tmp_path: Path) -> None:
    path = netcdf.write(netcdf.map_dataset(terrain, maps, title="t"), tmp_path / "m.nc")
    with netCDF4.Dataset(path) as file:
        thickness = file["max_flow_thickness"]
        assert thickness.chunking() == [256, 30]
        assert thickness.filters()["zlib"]
        assert thickness.filters()["complevel"] == 1
        assert thickness.filters()["shuffle"]
        assert thickness.dtype == np.float32
        assert thickness._FillValue == np.float32(-9999)
        assert thickness.units == "m"
        assert file["x"].dtype == np.float64
        assert "_FillValue" not in file["x"].ncattrs()
        assert "_FillValue" not in file["y"].ncattrs()
        assert "standard_name" not in thickness.ncattrs()
        assert file["elevation"].standard_name == "surface_altitude"
        assert "coordinates" not in thickness.ncattrs()


def test_groups_are_described_from_the_same_table(terrain: Terrain, maps: dict, tmp_path: Path) -> None:
    ledger = xr.Dataset({"kinetic_energy": ("time", [0.0, 5.5])}, coords={"time": [0.0, 0.25]})
    snapshots = xr.Dataset({"flow_thickness": (("time", "y", "x"), np.ones((2, *terrain.shape)))}, coords={"time": [0.0, 10.0]})
    dataset = netcdf.map_dataset(terrain, maps, title="t")
    path = netcdf.write(dataset, tmp_path / "m.nc", groups={"ledger": ledger, "snapshots": snapshots})
    energy = netcdf.read(path, "ledger")["kinetic_energy"]
    assert energy.attrs["units"] == "J"
    np.testing.assert_array_equal(energy["time"], [0.0, 0.25])
    with netCDF4.Dataset(path) as file:
        assert file["snapshots/flow_thickness"].chunking() == [1, 256, 30]


def test_writing_asks_no_cluster_for_its_scheduler(
    terrain: Terrain, maps: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The question imports all of ``distributed``."""
    pytest.importorskip("dask")

    def asked(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr("dask.base.get_scheduler", asked)
    ledger = xr.Dataset({"kinetic_energy": ("time", [0.0, 5.5])}, coords={"time": [0.0, 0.25]})
    path = netcdf.write(netcdf.map_dataset(terrain, maps, title="t"), tmp_path / "m.nc", groups={"ledger": ledger})
    assert netcdf.read(path, "ledger")["kinetic_energy"].values[1] == 5.5


def test_wkt_is_kept_for_what_cf_cannot_hold() -> None:
    attributes = grid_mapping("EPSG:2056")
    assert attributes["azimuth"] == 90.0
    for wkt in (attributes["crs_wkt"], attributes["spatial_ref"]):
        assert pyproj.CRS(wkt).to_epsg() == 2056
    assert attributes["spatial_ref"].startswith("PROJCS"), "WKT1, which every GDAL reads"


def test_a_projection_that_cf_does_not_define_has_the_ellipsoid_of_its_datum() -> None:
    attributes = grid_mapping("EPSG:5514")  # Krovak
    assert (attributes["semi_major_axis"], attributes["reference_ellipsoid_name"]) == (pytest.approx(6377397.155), "Bessel 1841")
    assert pyproj.CRS(attributes["crs_wkt"]).to_epsg() == 5514


def test_a_vertical_datum_becomes_an_attribute(tmp_path: Path) -> None:
    compound = pyproj.CRS("EPSG:25832+7837").to_wkt()
    terrain = Terrain(np.ones((3, 4)), (1.0, 1.0), 5e5, 5e6, compound)
    path = netcdf.write(netcdf.map_dataset(terrain, {"elevation": terrain.elevation}, title="t"), tmp_path / "m.nc")
    with rasterio.open(f'NETCDF:"{path}":elevation') as raster:
        assert raster.crs.to_epsg() == 25832
    assert netcdf.read(path).attrs["vertical_datum"] == "DHHN2016 height"


def test_geographic_extent_contains_the_corners() -> None:
    terrain = Terrain(np.ones((30, 40)), (100.0, 100.0), 738_000.0, 4_020_000.0, pyproj.CRS("EPSG:32616").to_wkt())
    attributes = netcdf.map_dataset(terrain, {}, title="t").attrs
    longitude, latitude = pyproj.Transformer.from_crs("EPSG:32616", "EPSG:4326", always_xy=True).transform(738_000.0, 4_020_000.0)
    assert attributes["geospatial_lon_min"] == pytest.approx(longitude, abs=1e-3)
    assert attributes["geospatial_lat_min"] == pytest.approx(latitude, abs=1e-3)
    assert attributes["geospatial_lat_max"] > attributes["geospatial_lat_min"]


def test_geo_transform_starts_at_the_outer_north_west_corner() -> None:
    terrain = Terrain(np.ones((3, 4)), (10.0, 12.0), 100.0, 200.0)
    assert geo_transform(terrain) == "100.0 10.0 0.0 236.0 0.0 -12.0"


def test_a_map_of_another_shape_or_unknown_name_is_refused(terrain: Terrain) -> None:
    with pytest.raises(ValueError, match="max_speed has shape"):
        netcdf.map_dataset(terrain, {"max_speed": terrain.elevation.T}, title="t")
    with pytest.raises(ValueError, match=r"'mud_depth' is not in runout/variables\.py"):
        netcdf.map_dataset(terrain, {"mud_depth": terrain.elevation}, title="t")


def test_writing_leaves_the_dataset_in_memory_as_it_was(terrain: Terrain, maps: dict, tmp_path: Path) -> None:
    dataset = netcdf.map_dataset(terrain, maps, title="t")
    before = {name: (dict(dataset[name].attrs), dict(dataset[name].encoding)) for name in dataset.variables}
    netcdf.write(dataset, tmp_path / "m.nc")
    assert {name: (dataset[name].attrs, dataset[name].encoding) for name in dataset.variables} == before


def test_many_threads_can_write_and_read_at_once(terrain: Terrain, maps: dict, tmp_path: Path) -> None:
    gc.collect()  # files that earlier tests left open would be closed by any thread, without the lock

    def write_and_read(number: int) -> float:
        dataset = netcdf.map_dataset(terrain, {"max_speed": np.full(terrain.shape, number)}, title="t")
        return float(netcdf.read(netcdf.write(dataset, tmp_path / f"{number}.nc"))["max_speed"].mean())

    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(write_and_read, range(12))) == list(range(12))


def test_unreadable_files_are_named_with_a_remedy(terrain: Terrain, maps: dict, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.nc"
    damaged.write_bytes(b"no NetCDF")
    for reader in (netcdf.read, netcdf.read_attributes, read_maps):
        with pytest.raises(StorageError, match=r"damaged\.nc.*cannot be read.*run again"):
            reader(damaged)
        with pytest.raises(StorageError, match=r"absent\.nc.*cannot be read"):
            reader(tmp_path / "absent.nc")
    path = netcdf.write(netcdf.map_dataset(terrain, maps, title="t"), tmp_path / "m.nc")
    with MemberMaps(path) as member, pytest.raises(StorageError, match=r"m\.nc: max_speed cannot be read"):
        member.layer("max_speed", None)
    with pytest.raises(StorageError, match=r"m\.nc: group ledger cannot be read"):
        netcdf.read(path, "ledger")


def test_attributes_are_renamed_while_other_threads_use_memory(tmp_path):
    """Short-lived objects of another thread take the place of whatever was freed; encoded names were lost 460 times in 20 s."""
    interval, stop, renamed = sys.getswitchinterval(), threading.Event(), 0

    def use_memory() -> None:
        while not stop.is_set():
            [bytes([k + 20]) * 10 for k in range(40)]

    other = threading.Thread(target=use_memory)
    sys.setswitchinterval(1e-6)
    other.start()
    try:
        with netCDF4.Dataset(tmp_path / "renamed.nc", "w") as file:
            file.createDimension("x", 4)
            variable, names = file.createVariable("v", "f4", ("x",), fill_value=0.0), ["_FillValue", "unwritten"]
            end = time.monotonic() + 3.0
            while time.monotonic() < end:
                rename_attribute(variable, *names)
                names.reverse()
                renamed += 1
            assert variable.ncattrs() == names[:1]
    finally:
        stop.set()
        other.join()
        sys.setswitchinterval(interval)
    assert renamed > 100
