"""HDF5 files whose numbers lie in other files are refused before the library opens them; files of their own are read."""

import base64
import os
import zlib

import numpy as np
import pytest
import xarray as xr
from hdf5_files import ELSEWHERE

from runout import Terrain
from runout.errors import DemError
from runout.io import opening


def write(path, name):
    path.write_bytes(zlib.decompress(base64.b85decode(ELSEWHERE[name])))
    return path


@pytest.mark.parametrize("name", ELSEWHERE)
def test_numbers_in_another_file_are_refused(tmp_path, name):
    path = write(tmp_path / "dem.nc", name)
    for stated in (path, f'NETCDF:"{path}":elevation'):
        with pytest.raises(DemError, match=f"holds {name.split(',')[0]}: numbers that lie in another file"):
            Terrain.from_raster(stated)


@pytest.mark.parametrize("length", range(0, 20, 3))
def test_a_file_that_ends_within_its_superblock_is_left_to_the_library(tmp_path, length):
    (tmp_path / "dem.nc").write_bytes((opening.SIGNATURE + bytes(20))[:length])
    opening.require_own_storage(tmp_path / "dem.nc", DemError)
    with pytest.raises(DemError, match=r"dem\.nc: (is empty|cannot be read as NetCDF)"):
        Terrain.from_raster(tmp_path / "dem.nc")


def test_the_library_would_have_read_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret.bin").write_bytes(np.arange(20.0).tobytes())
    with xr.open_dataset(write(tmp_path / "dem.nc", "external storage"), engine="netcdf4") as dataset:
        assert dataset["elevation"].values[0, 3] == 3.0


@pytest.mark.parametrize("kind", ["f4", "i2", "u1"])
def test_files_of_their_own_pass_whatever_their_numbers(tmp_path, kind, monkeypatch):
    monkeypatch.setattr(opening, "PIECE", 10_000)
    z = (np.arange(40_000) % 251).reshape(200, 200).astype(kind)
    made = xr.Dataset(
        {"elevation": (("y", "x"), z, {"note": "a" * 3000})}, {"x": 5e5 + 10.0 * np.arange(200), "y": 10.0 * np.arange(200)}
    )
    made.to_netcdf(tmp_path / "dem.nc", engine="netcdf4")
    assert Terrain.from_raster(tmp_path / "dem.nc").shape == (200, 200)


def test_a_file_is_looked_at_again_after_a_change(tmp_path):
    path = tmp_path / "dem.nc"
    x = 5e5 + 10.0 * np.arange(5)
    xr.Dataset({"elevation": (("y", "x"), np.ones((4, 5)))}, {"x": x, "y": x[:4]}).to_netcdf(path, engine="netcdf4")
    assert Terrain.from_raster(path).shape == (4, 5)
    write(tmp_path / "other.nc", "a virtual dataset")
    os.replace(tmp_path / "other.nc", path)
    with pytest.raises(DemError, match="virtual dataset"):
        Terrain.from_raster(path)
