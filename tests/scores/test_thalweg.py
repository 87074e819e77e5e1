"""Coordinates along a thalweg, and errors of front, sides and energy line."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runout import scores
from runout.errors import ObservationError

EAST = scores.Thalweg(np.array([[0.0, 0.0], [100.0, 0.0]]))
BENT = scores.Thalweg(np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0]]))  # turns left
GRID = scores.Grid(-200.0, -200.0, (5.0, 5.0), (80, 120))
PLACE = st.tuples(st.floats(-300, 300), st.floats(-300, 300))


def tongue(front, left, right, start=0.0):
    """Reached cells of the grid along the line to the east."""
    x, y = np.meshgrid(GRID.easting, GRID.northing)
    return ((x >= start) & (x <= front) & (y <= left) & (y >= right)).astype(float)


def errors(modelled, observed, thalweg=EAST, **options):
    return scores.thalweg_errors(thalweg, GRID.easting, GRID.northing, modelled, observed, **options)


@given(PLACE)
def test_coordinates_of_a_straight_line_are_a_rotation_also_beyond_its_ends(place):
    turned = scores.Thalweg(np.array([[10.0, 20.0], [10.0 + 30.0, 20.0 + 40.0]]))
    s, across = turned.coordinates(*place)
    east, north = place[0] - 10.0, place[1] - 20.0
    assert s == pytest.approx(0.6 * east + 0.8 * north, abs=1e-9)
    assert across == pytest.approx(0.6 * north - 0.8 * east, abs=1e-9)


def test_a_line_of_many_vertices_goes_on_straight_beyond_its_end():
    """The length that is found for the nearest place may differ from the sum of the segments by rounding."""
    for seed in range(40):
        steps = np.random.default_rng(seed).uniform((1.0, -0.5), (90.0, 0.5), (30, 2))
        line = scores.Thalweg(np.cumsum(steps, axis=0) + np.array([5e5, 5.2e6]))
        beyond = line.points[-1] + 250.0 * line.directions[-1]
        s, across = line.coordinates(*beyond)
        assert s == pytest.approx(line.length + 250.0, abs=1e-6)
        assert across == pytest.approx(0.0, abs=1e-6)


@given(PLACE)
def test_distance_from_the_line_is_the_nearest_and_the_left_is_positive(place):
    s, across = BENT.coordinates(*place)
    foot = BENT.at(s)
    assert math.dist(foot, place) == pytest.approx(abs(float(across)), abs=1e-6)
    s_right, l_right = scores.Thalweg(BENT.points * (1.0, -1.0)).coordinates(place[0], -place[1])
    assert (s_right, -l_right) == (pytest.approx(s, abs=1e-9), pytest.approx(across, abs=1e-9))


def test_bends_and_ends_have_the_coordinates_that_they_should():
    x, y = [50.0, 120.0, 90.0, 100.0, -10.0, 130.0], [10.0, -20.0, 30.0, 95.0, -7.0, 90.0]
    s, across = BENT.coordinates(x, y)
    assert s == pytest.approx([50.0, 100.0, 130.0, 195.0, -10.0, 190.0])
    assert across == pytest.approx([10.0, -math.hypot(20, 20), 10.0, 0.0, -7.0, -30.0])


def test_map_coordinates_far_from_the_origin_lose_nothing():
    far = np.array([2_600_000.0, 1_200_000.0])
    there = scores.Thalweg(BENT.points + far)
    near, moved = BENT.coordinates([33.3], [12.1]), there.coordinates([33.3 + far[0]], [12.1 + far[1]])
    assert np.allclose(near, moved, atol=1e-8)


@given(st.floats(1.0, 60.0), PLACE)
def test_more_vertices_change_no_coordinate(spacing, place):
    fine = BENT.resampled(spacing)
    assert np.diff(fine.vertex_s).max() <= spacing + 1e-9
    assert fine.length == pytest.approx(BENT.length)
    assert np.allclose(fine.coordinates(*place), BENT.coordinates(*place), atol=1e-6)


def test_lines_of_one_place_and_spacings_of_nothing_are_refused():
    with pytest.raises(ObservationError, match="fewer than two different points"):
        scores.Thalweg(np.array([[1.0, 1.0], [1.0, 1.0]]))
    with pytest.raises(ObservationError, match="finite points"):
        scores.Thalweg(np.array([[1.0, np.nan], [1.0, 1.0]]))
    with pytest.raises(ObservationError, match="spacing is 0 m"):
        EAST.resampled(0.0)


def test_widths_are_those_of_cells_not_of_their_centres():
    """Three cells beside five have 0.6 of the width, along the grid and across it."""
    three, five = tongue(102, 8, -3), tongue(102, 13, -8)
    assert (three.sum(axis=0).max(), five.sum(axis=0).max()) == (3, 5)
    assert errors(three, five).width_bias == pytest.approx(0.6)


@pytest.mark.parametrize("loop", [[[0, 0], [100, 0], [100, 50], [40, -30]], [[0, 0], [50, 50], [100, 0], [50, 50], [50, 100]]])
def test_a_line_that_crosses_itself_is_refused_with_the_place(loop):
    with pytest.raises(ObservationError, match=r"crosses itself at [0-9.]+ east, [0-9.]+ north; draw it without a loop"):
        scores.Thalweg(np.array(loop, float))


def test_front_and_sides_of_a_tongue_that_is_longer_wider_and_aside():
    found = errors(tongue(152, 42, -16), tongue(102, 22, -22))
    assert found.modelled_front == 147.5
    assert found.front_error == pytest.approx(50.0)
    assert found.lateral_error == pytest.approx((20.0 + 5.0) / 2)
    assert found.lateral_shift == pytest.approx((20.0 + 5.0) / 2)
    assert found.width_bias == pytest.approx(55.0 / 40.0)
    assert found.observed_width == pytest.approx(40.0, rel=0.1)
    assert found.outside == 0


def test_a_perfect_forecast_has_no_errors_and_mirrored_flows_mirrored_ones():
    one, other = tongue(152, 42, -18), tongue(102, 22, -22)
    same = errors(one, one)
    assert (same.front_error, same.lateral_error, same.lateral_shift, same.width_bias) == (0.0, 0.0, 0.0, 1.0)
    found, turned = errors(one, other), errors(other, one)
    assert turned.front_error == -found.front_error
    assert turned.lateral_shift == -found.lateral_shift
    assert turned.lateral_error == found.lateral_error
    mirrored = errors(one[::-1], other[::-1])
    assert mirrored.lateral_shift == pytest.approx(-found.lateral_shift)


@pytest.mark.parametrize("steps", [1, 4, 9])
def test_an_outline_shifted_downstream_has_the_shift_as_front_error(steps):
    shifted = np.roll(tongue(102, 22, -22), steps, axis=1)
    assert errors(shifted, tongue(102, 22, -22)).front_error == pytest.approx(5.0 * steps)


def test_cells_beyond_the_half_width_and_unknown_cells_do_not_count():
    modelled, observed = tongue(152, 42, -18), tongue(102, 22, -22)
    narrow = errors(modelled, observed, half_width=25.0)
    assert narrow.outside > 0
    assert narrow.lateral_shift < 5.0
    modelled[:, GRID.easting > 110] = np.nan
    assert errors(modelled, observed).front_error < 15.0


def test_a_flow_that_reaches_nothing_has_no_front():
    found = errors(np.zeros(GRID.shape), tongue(102, 22, -22))
    assert math.isnan(found.front_error)
    assert math.isnan(found.lateral_error)
    assert found.stretch == 0.0


def test_energy_line_of_a_slope_of_30_degrees():
    x, y = np.meshgrid(GRID.easting, GRID.northing)
    elevation = 1000.0 - x * math.tan(math.radians(30))
    released = np.where((np.abs(x - 2.5) < 11) & (np.abs(y - 2.5) < 6), 3.0, 0.0)
    top = scores.release_point(GRID.easting, GRID.northing, elevation, released)
    centre = scores.release_point(GRID.easting, GRID.northing, elevation, released, "centre_of_mass")
    assert top.easting == -7.5
    assert (centre.easting, centre.northing) == (pytest.approx(2.5), pytest.approx(2.5))
    front = scores.ReleasePoint(102.5, 2.5, 1000.0 - 102.5 * math.tan(math.radians(30)))
    assert scores.energy_line_angle(centre, front) == pytest.approx(math.radians(30))
    assert scores.energy_line_angle(centre, front, EAST) == pytest.approx(math.radians(30))
    assert math.isnan(scores.energy_line_angle(front, front))


def test_energy_line_along_a_bent_path_is_flatter_than_straight():
    start, front = scores.ReleasePoint(0.0, 0.0, 100.0), scores.ReleasePoint(100.0, 80.0, 0.0)
    assert scores.energy_line_angle(start, front, BENT) == pytest.approx(math.atan(100 / 180))
    assert scores.energy_line_angle(start, front) == pytest.approx(math.atan(100 / math.hypot(100, 80)))


def test_no_release_and_unknown_starts_are_refused():
    flat = np.zeros(GRID.shape)
    with pytest.raises(ObservationError, match="no cell with an elevation is released"):
        scores.release_point(GRID.easting, GRID.northing, flat, flat)
    with pytest.raises(ObservationError, match="choose one of top, centre_of_mass"):
        scores.release_point(GRID.easting, GRID.northing, flat, flat + 1, "middle")


def test_fronts_of_the_iseesnow_tools_along_the_published_thalweg(iseesnow, public_data):
    import geopandas

    tools, grid = iseesnow("IdealizedTopo")
    line = geopandas.read_file(public_data("iseesnow") / "IdealizedTopo" / "LINES" / "path_aimec.shp").geometry.iloc[0]
    thalweg = scores.Thalweg(np.array(line.coords)[:, :2])
    reached = {name: scores.reached(values, 0.1) for name, values in tools.items()}
    found = scores.thalweg_errors(thalweg, grid.easting, grid.northing, reached["RAMMS"], reached["AvaFrame-com1DFA"])
    assert abs(found.front_error) < 50.0
    assert found.lateral_error < 20.0
    assert found.width_bias == pytest.approx(1.0, abs=0.2)
    east = grid.easting[(reached["RAMMS"] == 1).any(axis=0)].max()  # the line runs east from 1020 m, with a bend of 0.4 degrees
    assert found.modelled_front == pytest.approx(east - 1020.0, abs=1.0)


def test_places_beside_a_surveyed_thalweg_with_bends_come_back_as_s_and_l(public_data):
    import geopandas

    path = public_data("avaframe") / "avaKot" / "Inputs" / "LINES" / "path_aimec.shp"
    line = scores.Thalweg(np.array(geopandas.read_file(path).geometry.iloc[0].coords)[:, :2])
    s = 0.5 * (line.vertex_s[1:] + line.vertex_s[:-1])  # the middle of every segment
    normal = np.column_stack([-line.directions[:, 1], line.directions[:, 0]])
    for offset in (-8.0, 0.0, 5.0):
        place = line.at(s) + offset * normal
        along, across = line.coordinates(place[:, 0], place[:, 1])
        assert along == pytest.approx(s, abs=1e-6)
        assert across == pytest.approx(np.full(len(s), offset), abs=1e-6)
    assert line.resampled(10.0).length == pytest.approx(line.length)
