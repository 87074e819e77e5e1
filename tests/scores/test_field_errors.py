"""Errors of thickness, its two definitions, changes of elevation, and values at points."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from runout import scores
from runout.errors import ObservationError

THICKNESS = arrays(np.float64, (5, 6), elements=st.floats(0.0, 50.0))
CHANGE = arrays(np.float64, (5, 6), elements=st.floats(-20.0, 20.0))


def test_errors_of_a_slab_that_is_one_metre_too_thick():
    observed = np.zeros((10, 10))
    observed[2:6, 2:6] = 4.0
    modelled = np.where(observed > 0, 5.0, 0.0)
    found = scores.field_errors(modelled, observed, cell_area=100.0)
    assert (found.cells, found.unknown) == (16, 0)
    assert found.bias == found.rmse == found.mean_absolute_error == 1.0
    assert (found.modelled_sum, found.observed_sum) == (8000.0, 6400.0)
    assert found.volume_bias == 1.25
    assert found.relative_l1 == 0.25


def test_dry_ground_around_the_flow_does_not_change_the_errors():
    rng = np.random.default_rng(3)
    modelled, observed = rng.uniform(1, 2, (2, 4, 4))
    small = scores.field_errors(modelled, observed)
    large = scores.field_errors(np.pad(modelled, 9), np.pad(observed, 9))
    assert (large.bias, large.rmse, large.cells) == (small.bias, small.rmse, small.cells)


def test_unknown_cells_are_counted_and_in_no_sum():
    modelled, observed = np.ones((2, 3)), np.ones((2, 3))
    modelled[0, 0] = observed[1, 1] = np.nan
    found = scores.field_errors(modelled, observed)
    assert (found.cells, found.unknown, found.observed_sum, found.modelled_sum) == (4, 2, 4.0, 4.0)
    assert math.isnan(scores.field_errors(np.full((2, 2), np.nan), np.ones((2, 2))).rmse)


@given(THICKNESS, THICKNESS, st.floats(0.0, 5.0))
def test_errors_change_sign_with_the_order_and_are_bounded(one, other, threshold):
    found, turned = scores.field_errors(one, other, 2.0, threshold), scores.field_errors(other, one, 2.0, threshold)
    if found.cells:
        assert turned.bias == pytest.approx(-found.bias)
        assert turned.rmse == pytest.approx(found.rmse)
        assert abs(found.bias) <= found.mean_absolute_error + 1e-9 <= found.rmse + 2e-9
    same = scores.field_errors(one, one)
    assert same.relative_l1 == 0.0 if one.any() else math.isnan(same.relative_l1)


def test_a_layer_on_a_slope_of_60_degrees_is_twice_as_thick_vertically():
    assert scores.vertical_thickness(1.0, math.radians(60)) == pytest.approx(2.0)
    assert scores.slope_normal_thickness(2.0, math.radians(60)) == pytest.approx(1.0)


@given(st.floats(0.0, 100.0), st.floats(0.0, math.radians(85)))
def test_thickness_converted_there_and_back_is_the_same(vertical, slope):
    normal = scores.slope_normal_thickness(vertical, slope)
    assert normal <= vertical
    assert scores.vertical_thickness(normal, slope) == pytest.approx(vertical)


def test_degrees_for_radians_are_refused():
    with pytest.raises(ObservationError, match="slope is 30 rad; it must be 0 or more and below pi/2"):
        scores.vertical_thickness(np.ones(2), np.array([0.1, 30.0]))


def test_slope_of_a_plane_and_of_the_cells_beside_unknown_ones():
    east, north = np.meshgrid(np.arange(8) * 10.0, np.arange(6)[::-1] * 5.0)
    elevation = 0.3 * east - 0.4 * north
    elevation[2, 3] = np.nan
    slope = scores.terrain_slope(elevation, (10.0, 5.0))
    assert np.isnan(slope[2, 3])
    assert np.nanmax(np.abs(slope - math.atan(0.5))) < 1e-12


def test_change_of_elevation_of_a_slide_by_parts():
    observed = np.array([[-3.0, -1.0, 0.2, 4.0, 0.0]])
    modelled = np.array([[-3.0, -2.0, 0.0, 2.0, 1.0]])
    found = scores.change_errors(modelled, observed, cell_area=10.0, detection_limit=0.5)
    assert (found.erosion.observed_sum, found.erosion.modelled_sum) == (40.0, 50.0)
    assert (found.deposition.observed_sum, found.deposition.modelled_sum) == (40.0, 30.0)
    assert found.erosion_area.critical_success_index == 1.0
    assert found.deposition_area.critical_success_index == 0.5
    assert found.change.rmse == pytest.approx(math.sqrt((1 + 4 + 1) / 4))
    assert found.change.modelled_sum == -20.0
    assert scores.change_errors(modelled, observed).change.modelled_sum == -2.0  # heights, where no cell area is given


@given(CHANGE, CHANGE)
def test_parts_of_a_change_add_up_to_it(one, other):
    found = scores.change_errors(one, other, 3.0)
    assert found.deposition.modelled_sum - found.erosion.modelled_sum == pytest.approx(found.change.modelled_sum, abs=1e-9)
    same = scores.change_errors(one, one)
    assert same.erosion.relative_l1 in (0.0, pytest.approx(math.nan, nan_ok=True))
    assert same.erosion_area.misses == same.deposition_area.false_alarms == 0


def test_change_is_deposit_minus_release():
    assert np.array_equal(scores.elevation_change([[0.0, 2.0]], [[5.0, 1.0]]), [[-5.0, 1.0]])


GRID = scores.Grid(100.0, 200.0, (10.0, 5.0), (4, 6))


def test_values_at_points_are_those_of_their_cells():
    values = np.arange(24.0).reshape(4, 6)
    x, y = np.meshgrid(GRID.easting, GRID.northing)
    assert np.array_equal(scores.values_at(GRID, values, x.ravel() + 4.9, y.ravel() - 2.4), values.ravel())
    assert np.isnan(scores.values_at(GRID, values, [99.9, 160.1, 130.0], [210.0, 210.0, 199.9])).all()


def test_arrival_at_points_counts_those_that_the_flow_misses():
    thickness = np.where(np.arange(6) < 4, 1.0, 0.0) * np.ones((4, 1))
    arrival = np.where(thickness > 0, 10.0 * np.arange(6), np.nan)
    thickness[0, 0] = np.nan
    modelled = scores.arrival_or_never(arrival, thickness)
    at = scores.values_at(GRID, modelled, [125.0, 135.0, 155.0, 90.0], [201.0, 201.0, 201.0, 201.0])
    found = scores.arrival_errors(at, [25.0, 20.0, 40.0, 1.0])
    assert (found.points, found.missed, found.unknown) == (2, 1, 1)
    assert found.bias == 2.5
    assert found.rmse == pytest.approx(math.sqrt((25 + 100) / 2))


def test_errors_at_points_leave_out_what_was_not_observed():
    found = scores.point_errors([1.0, 2.0, np.nan], [2.0, np.nan, 3.0])
    assert (found.points, found.unknown, found.bias, found.rmse) == (1, 2, -1.0, 1.0)
    assert math.isnan(scores.point_errors([], []).bias)
