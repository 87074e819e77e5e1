"""Profiles along lines and series at probes: of one member, and as percentiles over weighted members."""

import numpy as np
import pytest
from synthetic_ensemble import CELL, SHAPE, SOUTH, WEST, make_terrain, member_maps, write_member

from runout.errors import StorageError
from runout.hazard.probe_series import ensemble_series, member_series
from runout.hazard.profiles import ProfileLine, ensemble_profiles, member_profiles, profile_table
from runout.io import netcdf
from runout.io.probe_files import POINTS, SECTIONS, add_values, points_frame, sections_frame
from runout.model.probes import CrossSection, Probes

NORTH = SOUTH + SHAPE[0] * CELL[1]
EAST = WEST + 10.5 * CELL[0]  # middle of column 10, within the tongues of all members
LINE = CrossSection("down", ((EAST, NORTH - 1.5 * CELL[1]), (EAST, NORTH - 25.5 * CELL[1]), (EAST + 20.0, NORTH - 25.5 * CELL[1])))
WEIGHTS = [1.0, 1.0, 2.0]
DUG = np.full(SHAPE, 3.0)


def rows_of(profile):
    """Row of the raster of each place of a profile."""
    return np.floor((NORTH - profile["y"].values) / CELL[1]).astype(int)


def test_places_of_a_profile_are_half_a_cell_apart_at_most_and_hold_all_vertices():
    terrain = make_terrain()
    line = ProfileLine.of(LINE, terrain, DUG)
    assert line.name == "down"
    assert (line.distance[0], line.distance[-1]) == pytest.approx((0.0, 24 * CELL[1] + 20.0))
    assert (np.diff(line.distance) > 0).all()
    assert np.diff(line.distance).max() <= min(CELL) / 2
    assert {tuple(place) for place in line.places} >= set(LINE.vertices)
    np.testing.assert_allclose(np.hypot(*np.diff(line.places, axis=0).T), np.diff(line.distance), atol=1e-9)
    row, column = (NORTH - line.places[:, 1]) / CELL[1] - 0.5, (line.places[:, 0] - WEST) / CELL[0] - 0.5
    np.testing.assert_allclose(line.ground, 1000.0 - 3.0 * row - 2.0 * column)
    np.testing.assert_allclose(line.ground - line.bed, 3.0)
    (rows, columns) = line.window
    assert (rows.start, rows.stop, columns.start, columns.stop) == (1, 26, 10, 13)


def test_a_profile_beyond_the_raster_takes_the_cells_of_its_rim():
    line = ProfileLine.of(CrossSection("out", ((WEST - 50.0, NORTH + 50.0), (WEST + 5.0, NORTH - 5.0))), make_terrain(), DUG)
    assert (line.cells[0].min(), line.cells[1].min()) == (0, 0)
    assert line.ground[0] == pytest.approx(1000.0)


def test_a_profile_of_a_member_has_the_values_of_the_cells_below_it(tmp_path):
    terrain = make_terrain()
    (profile,) = member_profiles(write_member(tmp_path, 1, terrain), [LINE], terrain, DUG)
    maps, rows = member_maps(1), rows_of(profile)
    column = np.floor((profile["x"].values - WEST) / CELL[0]).astype(int)
    for name, values in maps.items():
        np.testing.assert_allclose(profile[name].values, values[rows, column].astype("f4"), err_msg=name)
    assert profile.attrs["line"] == "down"
    assert profile["max_flow_thickness"].dims == ("distance",)
    assert profile["max_flow_thickness"].attrs["units"] == "m"
    assert "percentile" not in profile.coords
    assert profile["deposit_thickness"].encoding["grid_mapping"] == "crs"
    assert "members" not in profile.attrs


def test_percentiles_along_a_line_are_those_of_the_weighted_members_place_by_place(tmp_path):
    terrain = make_terrain()
    files = [write_member(tmp_path, number, terrain) for number in range(3)]
    (profile,) = ensemble_profiles(files, WEIGHTS, [LINE], terrain, DUG, [25.0, 50.0, 100.0])
    rows = rows_of(profile)
    wet = np.array([(rows >= 2) & (rows < 6 + 4 * number) for number in range(3)])
    np.testing.assert_allclose(profile["arrival_probability"].values, np.array(WEIGHTS) / 4.0 @ wet)
    heavy = np.repeat(np.where(wet, np.array([[1.0], [2.0], [3.0]]), 0.0), [1, 1, 2], axis=0)
    np.testing.assert_allclose(profile["max_flow_thickness"].values, np.sort(heavy, axis=0)[[0, 1, 3]])
    times = np.repeat(np.where(wet, 2.0 * rows + np.array([[0.0], [1.0], [2.0]]), np.inf), [1, 1, 2], axis=0)
    median = np.sort(times, axis=0)[1]
    np.testing.assert_array_equal(profile["arrival_time"].values[1], np.where(np.isinf(median), np.nan, median))
    assert profile["max_flow_thickness"].attrs["long_name"].startswith("percentile over the members of the ")
    assert (profile.attrs["members"], profile.attrs["median_front"]) == (3, 1)
    assert (profile["bed_elevation"].dims, profile["arrival_probability"].dims) == (("distance",), ("distance",))
    (heavier,) = ensemble_profiles(files, [1.0, 1.0, 3.0], [LINE], terrain, DUG)
    assert heavier.attrs["median_front"] == 2
    assert heavier["percentile"].values.tolist() == [5.0, 50.0, 95.0]


def test_a_profile_is_unknown_on_ground_without_elevation_and_its_table_has_units(tmp_path):
    terrain = make_terrain(None)
    ends = [(WEST + (SHAPE[1] - cells) * CELL[0], SOUTH + 6.0) for cells in (2.5, 0.5)]
    corner = CrossSection("corner", tuple(ends))
    files = [write_member(tmp_path, number, terrain) for number in range(2)]
    (profile,) = ensemble_profiles(files, [1.0, 1.0], [corner], terrain, np.zeros(SHAPE), [50.0])
    unknown = profile["x"].values >= WEST + (SHAPE[1] - 1) * CELL[0]
    assert 0 < unknown.sum() < unknown.size
    np.testing.assert_array_equal(np.isnan(profile["deposit_thickness"].values[0]), unknown)
    assert "grid_mapping" not in profile["deposit_thickness"].encoding
    table = profile_table(profile)
    assert len(table) == unknown.size
    named = {"distance [m]", "x [m]", "y [m]", "bed_elevation [m]", "max_speed p50 [m s-1]", "arrival_time p50 [s]"}
    assert named <= set(table.columns)
    np.testing.assert_array_equal(table["distance [m]"], profile["distance"].values)
    np.testing.assert_array_equal(table["deposit_thickness p50 [m]"], profile["deposit_thickness"].values[0])


def test_members_of_another_raster_have_no_profile(tmp_path):
    terrain = make_terrain()
    other = terrain.part(slice(0, 30), slice(0, 40))
    maps = {name: values[:30, :40] for name, values in member_maps(1).items()}
    path = netcdf.write(netcdf.map_dataset(other, maps, title="other"), tmp_path / "other.nc")
    with pytest.raises(StorageError, match=r"other\.nc: its grid"):
        member_profiles(path, [LINE], terrain, DUG)


# --- series ----------------------------------------------------------------------------------------------------------------

TIMES = np.array([0.0, 1.0, 2.0])


def write_series(path, factor, arrival, shift=0.0):
    """File of a member with two points and a line; the second point is reached at a time of its own."""
    terrain = make_terrain()
    points = {"near": (WEST + 100.0 + shift, NORTH - 100.0), "far": (WEST + 200.0, NORTH - 200.0)}
    probes = Probes(points, {"line": LINE.vertices}, interval=1.0)
    at_points, across = points_frame(probes, terrain, TIMES), sections_frame(probes, terrain, TIMES)
    add_values(at_points, "flow_thickness", factor * np.array([[0.0, 1.0, 2.0], [0.0, 0.0, 1.0]]), ("station", "time"))
    add_values(at_points, "arrival_time", np.array([0.5, arrival]), ("station",))
    add_values(across, "discharge", factor * np.array([[0.0, 10.0, 20.0]]), ("station", "time"))
    maps = netcdf.map_dataset(terrain, {}, title="member")
    return netcdf.write(maps, path, groups={POINTS: at_points, SECTIONS: across})


def test_percentiles_of_series_are_those_of_each_time_over_the_weighted_members(tmp_path):
    files = [write_series(tmp_path / f"{k}.nc", k, arrival) for k, arrival in ((1, 3.0), (2, np.nan), (3, 4.0))]
    series = ensemble_series(files, WEIGHTS, [25.0, 50.0, 75.0])
    assert set(series) == {POINTS, SECTIONS}
    points, across = series[POINTS], series[SECTIONS]
    heavy = np.repeat([1.0, 2.0, 3.0], [1, 1, 2])[:3]  # of four equal members the first, second and third
    np.testing.assert_allclose(points["flow_thickness"].values[:, 0], heavy[:, None] * [0.0, 1.0, 2.0])
    np.testing.assert_allclose(across["discharge"].values[:, 0], heavy[:, None] * [0.0, 10.0, 20.0])
    np.testing.assert_allclose(points["arrival_time"].values, [[0.5, 3.0], [0.5, 4.0], [0.5, 4.0]])
    np.testing.assert_allclose(points["arrival_probability"].values, [1.0, 0.75])
    assert points["flow_thickness"].dims == ("percentile", "station", "time")
    assert points["percentile"].values.tolist() == [25.0, 50.0, 75.0]
    assert points["flow_thickness"].attrs["long_name"].startswith("percentile over the members of the ")
    assert (points.attrs["members"], across.attrs["members"]) == (3, 3)
    assert across["section_length"].values == pytest.approx([24 * CELL[1] + 20.0])
    assert "arrival_probability" not in across
    assert np.isnan(ensemble_series(files[1:2], [1.0])[POINTS]["arrival_time"].values[:, 1]).all()
    assert ensemble_series(files[:1], [1.0])[POINTS]["percentile"].values.tolist() == [5.0, 50.0, 95.0]


def test_series_of_a_member_are_those_of_its_file_and_other_probes_are_refused(tmp_path):
    one = write_series(tmp_path / "1.nc", 1, 3.0)
    series = member_series(one)
    assert list(series) == [POINTS, SECTIONS]
    assert series[POINTS]["arrival_time"].values.tolist() == [0.5, 3.0]
    moved = write_series(tmp_path / "2.nc", 1, 3.0, shift=1.0)
    with pytest.raises(StorageError, match=r"2\.nc: its probes are not those of 1\.nc; run the ensemble again"):
        ensemble_series([one, moved], [1.0, 1.0])
    with pytest.raises(StorageError, match="holds no series of probes; run the member again with probes"):
        member_series(write_member(tmp_path, 0, make_terrain()))
