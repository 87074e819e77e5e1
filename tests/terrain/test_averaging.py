"""Elevations averaged over blocks or a triangle, continued into unknown cells, and polygons on cells."""

import numpy as np
import pytest
import shapely

from runout.errors import ConfigError, DemError
from runout.io.polygon_coverage import covered_part, on_cells
from runout.model.terrain import Terrain
from runout.terrain.averaging import averaged, smoothed
from runout.terrain.open_edge import continued, filled

CELL = (10.0, 5.0)  # east, north
WEST, SOUTH = 600_000.0, 5_200_000.0


def terrain_of(elevation, cell=CELL):
    return Terrain(np.asarray(elevation, float), cell, WEST, SOUTH, None, "dem.tif")


def plane(rows=12, columns=9, cell=CELL, east=0.3, north=-0.2):
    """Elevation of cell centres on a plane."""
    x, y = (np.arange(columns) + 0.5) * cell[0], (np.arange(rows)[::-1] + 0.5) * cell[1]
    return 100.0 + east * x[None, :] + north * y[:, None]


def test_blocks_start_at_the_south_west_corner_and_have_the_mean_of_their_cells():
    z = np.random.default_rng(1).random((13, 8))
    coarse = averaged(terrain_of(z), 20.0)
    assert (coarse.cell_size, coarse.shape) == ((20.0, 20.0), (3, 4))
    assert (coarse.west, coarse.south) == (WEST, SOUTH)
    np.testing.assert_allclose(coarse.elevation, z[1:].reshape(3, 4, 4, 2).mean(axis=(1, 3)))
    assert coarse.changes == ("averaged over blocks of 2 x 4 cells to 20 m x 20 m (resolution)",)


def test_a_plane_stays_a_plane_on_blocks_and_an_unknown_cell_makes_its_block_unknown():
    z = plane(18, 9)
    z[17, 0] = np.nan
    coarse = averaged(terrain_of(z), 30.0)
    assert coarse.cell_size == (30.0, 30.0)
    expected = plane(3, 3, (30.0, 30.0))
    expected[2, 0] = np.nan
    np.testing.assert_allclose(coarse.elevation, expected)
    assert coarse.changes[-1].endswith("(resolution); 1 of 9 blocks hold an unknown cell and are unknown")


@pytest.mark.parametrize(
    ("resolution", "cell"), [(3.76, (10.0, 5.0)), (7.4, (10.0, 5.0)), (7.6, (10.0, 10.0)), (20.0, (20.0, 20.0))]
)
def test_blocks_are_whole_numbers_of_cells_nearest_to_the_resolution(resolution, cell):
    assert averaged(terrain_of(plane()), resolution).cell_size == cell


def test_a_resolution_below_three_quarters_of_a_cell_or_above_a_third_of_the_raster_is_refused():
    terrain = terrain_of(plane())  # 90 m x 60 m
    averaged(terrain, 3.75)
    with pytest.raises(ConfigError, match=r"resolution: 3.74 m is finer than the raster's own cells of 10 m x 5 m; remove it"):
        averaged(terrain, 3.74)
    averaged(terrain, 20.0)
    with pytest.raises(ConfigError, match=r"dem\.tif: resolution: 20.1 m leaves fewer than 3 cells along a side of .* 90 m x 60 m"):
        averaged(terrain, 20.1)
    with pytest.raises(ConfigError, match=r"^site\.yaml: terrain\.resolution: 20.1 m"):
        averaged(terrain, 20.1, "site.yaml")
    with pytest.raises(DemError, match="resolution is -1"):
        averaged(terrain, -1.0)


def test_a_triangle_keeps_planes_takes_out_waves_of_two_cells_and_leaves_unknown_cells_unknown():
    z = plane(30, 40)
    z[4, 7] = np.nan
    flat = smoothed(terrain_of(z), 20.0)
    np.testing.assert_allclose(flat.elevation, z, atol=1e-9)
    assert np.isnan(flat.elevation[4, 7])
    assert flat.changes == ("averaged over a triangle of half-width 20 m along both axes (smoothing)",)
    wavy = plane(30, 40) + np.where(np.arange(40) % 2, 1.0, -1.0) + np.where(np.arange(30) % 2, 1.0, -1.0)[:, None]
    even = smoothed(terrain_of(wavy), 20.0)
    assert np.abs(even.elevation - plane(30, 40))[10:-10, 10:-10].max() < 1e-6


def test_the_mean_over_a_triangle_is_the_same_length_along_both_axes():
    z = np.zeros((61, 41))
    z[30, 20] = 1.0
    spread = smoothed(terrain_of(z), 60.0).elevation
    x, y = (np.arange(41) - 20) * 10.0, (np.arange(61) - 30) * 5.0
    variances = spread.sum(0) @ x**2, spread.sum(1) @ y**2
    assert variances == pytest.approx((60.0**2 / 6,) * 2, rel=0.15)  # and somewhat more, on cells
    assert spread.sum() == pytest.approx(1.0)


def test_a_half_width_below_half_a_cell_or_above_a_third_of_the_raster_is_refused():
    terrain = terrain_of(plane())
    smoothed(terrain, 2.6)
    with pytest.raises(ConfigError, match=r"smoothing: 2.5 m averages nothing on cells of 10 m x 5 m; write 5 or more"):
        smoothed(terrain, 2.5)
    smoothed(terrain, 20.0)
    with pytest.raises(ConfigError, match=r"^site\.yaml: terrain\.smoothing: 20.1 m is more than a third .*; write 20 or less"):
        smoothed(terrain, 20.1, "site.yaml")


def test_unknown_cells_get_the_nearest_elevation_in_metres_or_the_slope_beyond_the_edge():
    z = plane(20, 20)
    gap = z.copy()
    gap[:, 12:] = np.nan
    np.testing.assert_array_equal(filled(gap, CELL)[:, 12:], np.repeat(z[:, 11:12], 8, axis=1))
    np.testing.assert_allclose(continued(gap, CELL, 80.0), z)
    near = continued(gap, CELL, 30.0)
    np.testing.assert_allclose(near[:, :15], z[:, :15])
    np.testing.assert_allclose(near[:, 15:], np.repeat(z[:, 14:15], 5, axis=1))
    hole = np.array([[1.0, np.nan, np.nan], [9.0, np.nan, np.nan], [2.0, 3.0, 4.0]])
    assert filled(hole, (10.0, 5.0))[1, 1] == 3.0, "5 m to the south, 10 m to the west"
    assert filled(hole, (5.0, 10.0))[1, 1] == 9.0


def box(west, south, east, north):
    return shapely.box(WEST + west, SOUTH + south, WEST + east, SOUTH + north)


def test_polygons_cover_their_shares_of_cells_and_weigh_them_by_their_values():
    terrain = terrain_of(np.zeros((4, 6)))
    parts = np.array([box(0, 0, 15, 5), box(15, 0, 20, 5), box(50, 17.5, 70, 30), box(100, 0, 110, 5)])
    covered, weighted, inside = on_cells(parts, np.array([2.0, 6.0, 4.0, 9.0]), terrain)
    expected, values = np.zeros((6, 4)), np.zeros((6, 4))
    expected[0, 0], expected[1, 0], expected[5, 3] = 1.0, 1.0, 0.5
    values[0, 0], values[1, 0], values[5, 3] = 2.0, 0.5 * 2.0 + 0.5 * 6.0, 0.5 * 4.0
    np.testing.assert_allclose(covered, expected, atol=1e-9)
    np.testing.assert_allclose(weighted, values, atol=1e-9)
    assert [value for _, value in inside] == [2.0, 6.0, 4.0]
    assert inside[2][0].area == pytest.approx(25.0), "what lies beyond the terrain is cut off"


def test_the_area_that_a_polygon_covers_is_that_of_rows_from_the_north():
    terrain = terrain_of(np.zeros((4, 6)))
    (rows, columns), area = covered_part(box(12, 3, 30, 10), terrain)
    assert (rows, columns) == (slice(2, 4), slice(1, 3))
    np.testing.assert_allclose(area, [[8 * 5.0, 10 * 5.0], [8 * 2.0, 10 * 2.0]], atol=1e-6)
