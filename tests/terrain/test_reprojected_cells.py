"""Rasters on their way to UTM: cells on the map, longitudes beyond 180, rims without elevation."""

import numpy as np
import pytest
from pyproj import CRS, Geod

from runout.errors import DemError
from runout.io.elevation_raster import ElevationRaster
from runout.terrain import prepare

WGS, UTM_32 = CRS("EPSG:4326"), CRS("EPSG:32632")


def degrees(west=9.0, north=46.0, cell=(0.01, 0.02), shape=(4, 6)):
    return ElevationRaster(np.zeros(shape), (cell[0], 0.0, west, 0.0, -cell[1], north), WGS, "m", "dem.tif")


def test_a_cell_on_the_map_is_as_wide_and_high_as_on_the_ground():
    raster = degrees()
    x, y = raster.centre
    ground = Geod(ellps="WGS84")
    width = ground.inv(x - 0.005, y, x + 0.005, y)[2] * 0.9996
    height = ground.inv(x, y - 0.01, x, y + 0.01)[2] * 0.9996
    assert prepare.projected_cell(raster, UTM_32) == pytest.approx((width, height), rel=1e-5)


@pytest.mark.parametrize(("west", "found"), [(179.9, 179.9), (180.0, -180.0), (350.0, -10.0)])
def test_longitudes_from_180_on_are_counted_from_the_other_side(west, found):
    raster = prepare._within_half_turn(degrees(west=west))
    assert raster.transform[2] == found
    assert raster.transform[:2] + raster.transform[3:] == degrees().transform[:2] + degrees().transform[3:]
    assert len(raster.changes) == (found != west)


def test_a_raster_of_more_than_six_degrees_fits_no_zone():
    prepare._require_one_zone(degrees(cell=(1.0, 0.02)))
    with pytest.raises(DemError, match=r"spans 6.6 deg of longitude"):
        prepare._require_one_zone(degrees(cell=(1.1, 0.02)))


def test_cells_outside_the_original_are_cut_off_from_the_worst_side():
    values, outside = np.arange(42.0).reshape(6, 7), np.zeros((6, 7), bool)
    outside[0], outside[:, 0], outside[-1, 3], outside[2, -1] = True, True, True, True
    found, transform = prepare._without_empty_rim(values, outside, (2.0, 0.0, 100.0, 0.0, -2.0, 50.0))
    np.testing.assert_array_equal(found, values[1:5, 1:6])
    assert transform == (2.0, 0.0, 102.0, 0.0, -2.0, 48.0)
    small, _ = prepare._without_empty_rim(values, np.ones((6, 7), bool), (2.0, 0.0, 100.0, 0.0, -2.0, 50.0))
    assert min(small.shape) == 3


def test_new_cells_have_edges_at_multiples_of_their_side_and_cover_the_raster():
    raster = degrees()
    transform, x, y = prepare._cell_centres(raster, UTM_32, 700.0)
    assert (transform[0], transform[4]) == (700.0, -700.0)
    assert transform[2] % 700.0 == transform[5] % 700.0 == 0.0
    west, south, east, north = raster.bounds
    assert x[:, 0].min() < west + 0.01 < east - 0.01 < x[:, -1].max()
    assert y[-1].min() < south + 0.01 < north - 0.01 < y[0].max()
    assert np.diff(y[:, 0]).max() < 0 < np.diff(x[0]).min()
