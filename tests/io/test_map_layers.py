"""Chunks of maps that hold nothing take no room in a file, and are read as what they hold."""

import netCDF4
import numpy as np
import pytest
import rasterio

from runout.io import netcdf
from runout.model.terrain import Terrain

WET = (slice(600, 640), slice(700, 760))


def written(folder, size):
    """File with a flow thickness, an arrival time and a count of members on size x size cells, and these maps."""
    thickness, arrival = np.zeros((size, size), np.float32), np.full((size, size), np.nan, np.float32)
    thickness[WET], arrival[WET] = 2.5, 30.0
    thickness[0, 0], thickness[300, 300] = np.nan, -0.0
    counts = (thickness > 0).astype(np.int32)
    terrain = Terrain(np.zeros((size, size)), (5.0, 5.0), 500000.0, 5000000.0, "EPSG:32632", "synthetic", ())
    maps = {"peak_flow_thickness": thickness, "first_arrival_time": arrival, "members_reached": counts}
    path = folder / f"{size}.nc"
    return netcdf.write(netcdf.map_dataset(terrain, maps, title="synthetic"), path), maps


def test_all_cells_are_read_as_they_were_written(tmp_path):
    path, maps = written(tmp_path, 1000)
    found = netcdf.read(path)
    for name, values in maps.items():
        np.testing.assert_array_equal(found[name].values, values)
    assert np.signbit(found["peak_flow_thickness"].values[300, 300])
    with netCDF4.Dataset(path) as file:
        assert all(file[name]._FillValue == -9999 for name in maps)


def test_a_gis_reads_dry_cells_as_zero_and_missing_ones_as_missing(tmp_path):
    path, maps = written(tmp_path, 1000)
    with rasterio.open(f'NETCDF:"{path}":peak_flow_thickness') as raster:
        values = raster.read(1, masked=True)
    assert values.mask.sum() == 1
    np.testing.assert_array_equal(values.filled(np.nan), maps["peak_flow_thickness"])


@pytest.mark.parametrize("name", ["peak_flow_thickness", "first_arrival_time", "members_reached"])
def test_the_room_of_a_map_follows_the_flow_not_the_raster(tmp_path, name):
    """Four times the raster: as many chunks are stored."""
    stored = []
    for size in (1000, 2000):
        path, maps = written(tmp_path, size)
        alone = netCDF4.Dataset(path)
        alone.set_auto_maskandscale(False)
        chunk = alone[name].chunking()[-1]
        blank = -9999 if name == "first_arrival_time" else 0
        cells = np.where(np.isnan(maps[name]), -9999, maps[name])
        tiles = [cells[r : r + chunk, c : c + chunk] for r in range(0, size, chunk) for c in range(0, size, chunk)]
        stored.append(sum((tile != blank).any() for tile in tiles))
        stored.append(path.stat().st_size)
    assert stored[2] == stored[0]
    assert stored[3] < stored[1] + 20_000  # longer coordinates
