"""Speed below the energy line and slopes of the free surface on planes; units of elevations; parts of rasters."""

import math

import numpy as np
import pytest

from runout.io.elevation_raster import ElevationRaster, moved
from runout.model.release import Placement, Release
from runout.model.terrain import Terrain
from runout.terrain import open_edge, prepare
from runout.terrain.energy_line import _aside, largest_speed
from runout.terrain.free_surface import free_surface
from runout.terrain.source import ELEVATION, north_up_in_unit_of

CELL = (5.0, 4.0)
FALL, THICK, FRICTION = 0.5, 6.0, 0.2


@pytest.fixture
def plane():
    """30 rows and 40 columns that fall to the east."""
    return Terrain(np.tile(500.0 - FALL * CELL[0] * np.arange(40.0), (30, 1)), CELL)


def pile(terrain, placement, rows=slice(14, 16), columns=slice(9, 12), thickness=THICK):
    values = np.zeros(terrain.shape)
    values[rows, columns] = thickness
    return Release(values, terrain, placement=placement)


@pytest.mark.parametrize(("placement", "centre"), [(Placement.ON_SURFACE, THICK / 2), (Placement.EXCAVATED, -THICK / 2)])
def test_speed_is_that_of_the_fall_below_the_energy_line_at_the_foot_of_a_plane(plane, placement, centre):
    """The centre lies in column 10, half a row off the cells beside it; the foot in column 39."""
    along = (39 - 10) * CELL[0]
    line = centre + FALL * along - FRICTION * math.hypot(along, CELL[1] / 2)
    speed = largest_speed([pile(plane, placement)], [math.atan(FRICTION)])
    assert speed == pytest.approx(math.sqrt(2 * 9.80665 * line), rel=1e-3)


def test_speed_of_several_masses_is_that_of_the_fastest_and_none_moves_on_level_ground(plane):
    high, low = pile(plane, Placement.ON_SURFACE), pile(plane, Placement.ON_SURFACE, columns=slice(30, 33))
    together, alone = largest_speed([low, high], [math.atan(FRICTION)] * 2), largest_speed([high], [math.atan(FRICTION)])
    assert together == pytest.approx(alone, rel=1e-9)
    assert largest_speed([low], [math.atan(FRICTION)]) < 0.7 * alone


def test_free_surface_of_an_excavated_mass_is_the_ground(plane):
    surface = free_surface(pile(plane, Placement.EXCAVATED), (10.0, 10.0))
    x, y = np.array([45.0, 52.0, 59.0]), np.array([57.0, 60.0, 63.0])
    east, north = surface.slopes(x, y)
    np.testing.assert_allclose(east, -FALL, atol=1e-9)
    np.testing.assert_allclose(north, 0.0, atol=1e-9)


def test_free_surface_of_a_heap_is_the_ground_and_the_slope_of_the_heap_up_to_its_rim(plane):
    rows, columns = np.indices(plane.shape)
    x, y = (columns + 0.5) * CELL[0], (plane.shape[0] - rows - 0.5) * CELL[1]
    heap = np.where((abs(x - 100) < 50) & (abs(y - 60) < 30), 20.0 + 0.1 * (x - 100) - 0.2 * (y - 60), 0.0)
    surface = free_surface(Release(heap, plane, placement=Placement.ON_SURFACE), (10.0, 8.0))
    place = np.meshgrid([60.0, 101.0, 140.0], [40.0, 61.0, 85.0])
    east, north = surface.slopes(*(axis.ravel() for axis in place))
    np.testing.assert_allclose(east, 0.1 - FALL, atol=1e-6)
    np.testing.assert_allclose(north, -0.2, atol=1e-6)


def test_a_part_of_a_raster_begins_at_its_first_cell():
    assert moved((5.0, 0.0, 100.0, 0.0, -4.0, 900.0), 3, 7) == (5.0, 0.0, 135.0, 0.0, -4.0, 888.0)


def test_slope_is_continued_into_unknown_cells_up_to_the_reach_and_is_level_beyond(plane):
    z = plane.elevation.copy()
    z[:, 20:] = np.nan
    found = open_edge.continued(z, CELL, 4 * CELL[0])
    np.testing.assert_allclose(found[:, :24], plane.elevation[:, :24])
    np.testing.assert_allclose(found[:, 24:], plane.elevation[:, 23:24] + np.zeros((1, 16)))
    np.testing.assert_array_equal(open_edge.filled(z, CELL)[:, 20:], np.repeat(z[:, 19:20], 20, axis=1))


def test_the_nearest_known_cell_is_the_nearest_in_metres():
    z = np.array([[np.nan, 7.0], [3.0, np.nan]])
    assert open_edge.filled(z, (2.0, 3.0))[0, 0] == 7.0
    assert open_edge.filled(z, (3.0, 2.0))[0, 0] == 3.0


def test_steepness_counts_both_axes_in_metres():
    rows, columns = np.indices((5, 6))
    np.testing.assert_allclose(prepare.steepness(3.0 * CELL[0] * columns + 4.0 * CELL[1] * rows, CELL), 5.0)


@pytest.mark.parametrize("known", [0, 3])
def test_continuation_beyond_the_far_rim_of_the_known_cells_is_level(known):
    z = np.full((3, 4), np.nan)
    z[:, known] = 7.0
    np.testing.assert_array_equal(open_edge.continued(z, CELL, 100.0), 7.0)


def test_a_raster_knows_its_middle_and_its_edges_also_when_it_is_turned():
    turned = ElevationRaster(np.zeros((4, 6)), (3.0, 1.0, 100.0, -1.0, -2.0, 50.0), None, "m", "dem.tif")
    assert turned.centre == (100.0 + 9.0 + 2.0, 50.0 - 3.0 - 4.0)
    assert turned.cell == (3.0, 2.0)
    straight = ElevationRaster(np.zeros((4, 6)), (3.0, 0.0, 100.0, 0.0, -2.0, 50.0), None, "m", "dem.tif")
    assert straight.bounds == (100.0, 42.0, 118.0, 50.0)


def test_slopes_of_a_curved_free_surface_are_those_at_the_place():
    rows, columns = np.indices((60, 70))
    x, y = (columns + 0.5) * CELL[0], (60 - rows - 0.5) * CELL[1]
    bowl = Terrain(0.001 * (x - 50.0) ** 2 + 0.002 * (y - 20.0) ** 2, CELL)
    surface = free_surface(pile(bowl, Placement.EXCAVATED, slice(20, 30), slice(35, 45)), CELL)
    at_x, at_y = np.array([180.0, 200.0, 221.0]), np.array([125.0, 140.0, 151.0])
    east, north = surface.slopes(at_x, at_y)
    np.testing.assert_allclose(east, 0.002 * (at_x - 50.0), atol=1e-6)
    np.testing.assert_allclose(north, 0.004 * (at_y - 20.0), atol=1e-6)


def test_the_energy_line_begins_at_the_highest_point_of_the_mass():
    thickness = np.zeros((41, 41))
    thickness[20, 20:22] = 10.0, 1.0
    reach = prepare.reachable(Terrain.from_array(np.zeros((41, 41)), 1.0), thickness, np.radians(45.0))
    columns = np.flatnonzero(reach[20])
    assert 20 - columns[0] == columns[-1] - 21 == 11  # 10 m high at 45 degrees, and one cell more


def test_cells_beside_a_mass_are_as_far_from_it_as_from_its_box():
    thickness = np.array([0.0, 0.0, 2.0, 0.0, 3.0, 0.0, 0.0])
    np.testing.assert_array_equal(_aside(thickness, 5.0), [10.0, 5.0, 0.0, 0.0, 0.0, 5.0, 10.0])
    np.testing.assert_array_equal(_aside(np.array([1.0, 0.0, 0.0]), 4.0), [0.0, 4.0, 8.0])


def test_a_raster_comes_north_up_and_in_metres_and_its_reader_logs_the_changes(caplog):
    feet = ElevationRaster(np.arange(6.0).reshape(2, 3), (10.0, 0.0, 100.0, 0.0, 10.0, 200.0), None, "ft", "feet.tif")
    metres = north_up_in_unit_of(feet, ELEVATION)
    np.testing.assert_allclose(metres.values, 0.3048 * np.array([[3.0, 4.0, 5.0], [0.0, 1.0, 2.0]]))
    assert metres.transform[4] < 0 < metres.transform[0]
    assert any("were in ft; multiplied by 0.3048" in change for change in metres.changes)
    assert caplog.records == []
