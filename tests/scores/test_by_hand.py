"""Scores against numbers that are worked out by hand or by plain numpy and shapely, from rasters on the disk on."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from rasterio.transform import from_origin

from runout import scores
from runout.errors import ObservationError
from runout.io import netcdf
from runout.model.terrain import Terrain
from runout.scores.assessment import Setting, against_observations
from runout.scores.definitions import Score
from runout.scores.flow import Flow
from runout.scores.grid import Grid
from runout.scores.members import Member, Probabilities, brier, ranked
from runout.scores.observations import Observations
from runout.scores.points import Gauges

WEST, NORTH, UTM = 500_000.0, 5_000_300.0, "EPSG:32632"


def write(path, values, size=(10.0, 10.0), *, west=WEST, north=NORTH, crs=UTM, units=None):
    """A raster of the disk, NaN as -9999."""
    rows, columns = values.shape
    profile = {"driver": "GTiff", "height": rows, "width": columns, "count": 1, "dtype": "float32", "nodata": -9999.0}
    with rasterio.open(path, "w", crs=crs, transform=from_origin(west, north, *size), **profile) as file:
        file.write(np.where(np.isnan(values), -9999.0, values).astype("f4"), 1)
        if units:
            file.units = (units,)
    return path


def write_run(path, elevation, **maps):
    """File of a run with maps (rows, columns) of float."""
    terrain = Terrain(elevation, (10.0, 10.0), WEST, NORTH - 10.0 * len(elevation), rasterio.CRS.from_string(UTM).to_wkt(), "run")
    netcdf.write(netcdf.map_dataset(terrain, {name: values.astype("f4") for name, values in maps.items()}, title="run"), path)
    return path


def scored(first, second, **options):
    """Scores of one file against another by what is scored and the name, and the counts behind them."""
    found = scores.compare(first, second, scores.Choices(**options)).assessment
    return {(score.of, score.name): score.value for score in found.scores}, found.counts


def cells(rows, columns, **values):
    """Zeros with some cells set by ``r{row}c{column}``."""
    found = np.zeros((rows, columns))
    for place, value in values.items():
        row, column = place[1:].split("c")
        found[int(row), int(column)] = value
    return found


# --- energy line -----------------------------------------------------------------------------------------------------------

GRID = scores.Grid(0.0, 0.0, (10.0, 10.0), (15, 30))


def energy_line(line, elevation, modelled, observed, release):
    """Error of the angle [degree] of an outline of 0.5 m; places are (easting, northing) of cells."""
    x, y = np.meshgrid(GRID.easting, GRID.northing)
    wet = np.zeros(GRID.shape)
    for east, north in modelled:
        wet[(x == east) & (y == north)] = 1.0
    start = scores.release_point(GRID.easting, GRID.northing, elevation(x, y), sum((x == e) & (y == n) for e, n in release) * 3.0)
    setting = Setting([0.5], thalweg=scores.Thalweg(np.array(line)), start=start, elevation=elevation(x, y))
    outline = shapely.union_all([shapely.box(e - 5, n - 5, e + 5, n + 5) for e, n in observed])
    found = against_observations(Flow(GRID, {"thickness": wet}), Observations(GRID, outline=outline), setting)
    (angle,) = [score.value for score in found.scores if score.name == "energy_line_error_deg"]
    return angle


def test_energy_line_of_a_slope_that_ends_on_a_plain():
    """Top of the release at s = 25 m and 987.5 m. Fronts: at 205 m and 925 m on the plain, at 125 m and 937.5 m on the slope."""
    line, places = [(0.0, 75.0), (300.0, 75.0)], np.arange(25.0, 206.0, 10.0)
    angle = energy_line(
        line,
        lambda x, y: np.where(x < 150.0, 1000.0 - 0.5 * x, 925.0),
        [(x, 75.0) for x in places],
        [(x, 75.0) for x in places[places <= 125.0]],
        [(25.0, 75.0), (35.0, 75.0)],
    )
    assert angle == pytest.approx(math.degrees(math.atan(62.5 / 180.0) - math.atan(50.0 / 100.0)), abs=1e-9)
    assert angle == pytest.approx(19.1485 - 26.5651, abs=1e-3)


def test_energy_line_has_the_length_of_the_bent_path_and_not_the_straight_distance():
    """100 m east, then 80 m north, 64 m down: 19.57 degrees; straight it would be atan(64 / 128.06) = 26.55 degrees."""
    path = [(float(x), 25.0) for x in range(25, 126, 10)] + [(125.0, float(y)) for y in range(35, 106, 10)]
    angle = energy_line(
        [(25.0, 25.0), (125.0, 25.0), (125.0, 145.0)],
        lambda x, y: 1000.0 - 0.4 * x - 0.3 * (y - 25.0),
        path,
        [(x, y) for x, y in path if y == 25.0],  # 100 m, 40 m down: 21.80 degrees
        [(25.0, 25.0)],
    )
    assert angle == pytest.approx(19.5730 - 21.8014, abs=1e-3)


def test_energy_line_of_a_flow_that_reaches_nothing_is_not_defined():
    angle = energy_line([(0.0, 75.0), (300.0, 75.0)], lambda x, y: 100.0 - 0.1 * x, [], [(45.0, 75.0)], [(25.0, 75.0)])
    assert math.isnan(angle)


# --- arrival ---------------------------------------------------------------------------------------------------------------


def test_arrival_at_gauges_late_early_missed_and_unknown():
    """2 s late and 3 s early: bias -0.5 s, RMSE sqrt(13 / 2) s; one is never reached, two are not known on one side."""
    found = scores.arrival_errors([np.inf, 12.0, 30.0, np.nan, 7.0], [5.0, 10.0, 33.0, 4.0, np.nan])
    assert (found.points, found.missed, found.unknown) == (2, 1, 2)
    assert (found.bias, found.rmse, found.mean_absolute_error) == (-0.5, pytest.approx(2.549510), 2.5)


def test_gauges_take_the_arrival_of_the_cell_that_holds_them():
    arrival = np.where(np.arange(30) < 20, 2.0 * np.arange(30), np.inf) * np.ones((15, 1))
    gauges = Gauges(np.array([14.9, 105.0, 251.0]), np.full(3, 75.0), {"arrival_time": np.array([1.0, 25.0, 9.0])})
    found = against_observations(Flow(GRID, {"arrival": arrival}), Observations(GRID, gauges=gauges), Setting([0.5]))
    values = {score.name: score.value for score in found.scores}
    assert values == {"arrival_bias": (1.0 - 5.0) / 2, "arrival_rmse": pytest.approx(math.sqrt(13.0)), "missed_arrivals": 1.0}


@pytest.mark.parametrize("coarse", [False, True])
def test_cells_of_an_arrival_raster_that_are_declared_dry_are_never_reached(tmp_path, coarse):
    """`--nodata zero` says that nothing happened there: no arrival, which is not an arrival at 0 s."""
    modelled, observed = np.full((4, 4), 20.0), np.full((4, 4), 15.0)
    modelled[:, 2:], observed[:2] = np.nan, np.nan
    if coarse:
        observed = np.kron(observed, np.ones((2, 2)))
    pair = write(tmp_path / "a.tif", modelled), write(tmp_path / "b.tif", observed, (5.0, 5.0) if coarse else (10.0, 10.0))
    values, counts = scored(*pair, quantity="arrival", nodata="zero")
    assert values["arrival, whole map", "arrival_bias"] == 5.0
    assert values["arrival, whole map", "arrival_rmse"] == 5.0
    assert counts["arrival, whole map"] == {"cells": 4, "missed_cells": 4}
    values, counts = scored(*pair, quantity="arrival")
    assert counts["arrival, whole map"] == {"cells": 4, "missed_cells": 0}


# --- DEM of difference -----------------------------------------------------------------------------------------------------

BEFORE = 800.0 - 3.0 * np.arange(6.0) + np.zeros((5, 1))
OBSERVED_AFTER = BEFORE + cells(5, 6, r0c0=-4.0, r0c1=-2.0, r1c0=-0.25, r3c3=3.0, r3c4=1.5, r4c4=0.25)
MODELLED_AFTER = BEFORE + cells(5, 6, r0c0=-5.0, r2c1=-1.0, r3c3=2.0, r3c4=2.5, r3c5=1.0)


def test_elevation_change_of_two_surveys_by_volume_area_and_sign(tmp_path):
    """Cells of 2 x 3 m: observed -36 and +27 m3 beyond 0.5 m, modelled -36 and +33 m3; 1 of 3 eroded cells is in both."""
    a = write(tmp_path / "a.tif", MODELLED_AFTER - BEFORE, (2.0, 3.0))
    b = write(tmp_path / "b.tif", OBSERVED_AFTER - BEFORE, (2.0, 3.0))
    values, _ = scored(a, b, quantity="change", thresholds=(0.5,))
    values = {name: value for (_, name), value in values.items()}
    assert values["erosion_volume_bias"] == pytest.approx((5.0 + 1.0) / (4.0 + 2.0))
    assert values["deposition_volume_bias"] == pytest.approx((2.0 + 2.5 + 1.0) / (3.0 + 1.5))
    assert values["erosion_csi"] == pytest.approx(1.0 / 3.0)
    assert values["deposition_csi"] == pytest.approx(2.0 / 3.0)
    assert values["bias"] == pytest.approx((-1.0 + 2.0 - 1.0 - 1.0 + 1.0 + 1.0) / 6.0)
    assert values["rmse"] == pytest.approx(math.sqrt((1.0 + 4.0 + 1.0 + 1.0 + 1.0 + 1.0) / 6.0))


def test_volumes_of_a_change_are_in_cubic_metres_and_leave_out_unknown_cells():
    modelled, observed = MODELLED_AFTER - BEFORE, OBSERVED_AFTER - BEFORE
    observed[3, 3] = np.nan
    grid = scores.Grid(0.0, 0.0, (2.0, 3.0), (5, 6))
    observations = Observations(grid, change=observed, detection_limit=0.5)
    found = against_observations(Flow(grid, {}), observations, Setting([0.5]), modelled)
    assert found.counts["DEM of difference"] == {
        "modelled_net_m3": 6.0 * (2.5 + 1.0 - 5.0 - 1.0),
        "observed_net_m3": 6.0 * (1.5 - 4.0 - 2.0),
        "modelled_erosion_m3": 36.0,
        "observed_erosion_m3": 36.0,
        "modelled_deposition_m3": 21.0,
        "observed_deposition_m3": 9.0,
        "unknown_cells": 1,
    }


def test_the_statement_of_observations_has_their_areas_and_volumes():
    grid = scores.Grid(0.0, 0.0, (2.0, 3.0), (3, 3))
    deposit, change = np.zeros((2, 3, 3))
    deposit[:2, :2], change[:2, :2] = [[1.5, 0.0], [np.nan, 2.5]], [[-4.0, 1.0], [0.5, -1.0]]
    gauges = Gauges(np.array([1.0, 3.0]), np.array([1.0, 1.0]), {"arrival_time": np.array([5.0, np.nan])})
    line = scores.Thalweg(np.array([[0.0, 0.0], [3.0, 4.0]]))
    outline = shapely.box(0.0, 0.0, 4.0, 3.0)
    said = Observations(grid, outline, deposit=deposit, change=change, gauges=gauges, thalweg=line).statement()
    for part in (
        "12 m2",
        "deposit, 24 m3 (1 of 9 cells unknown)",
        "-30 and +9 m3",
        "2 gauges (1 of arrival time)",
        "thalweg of 5 m",
    ):
        assert part in said


def test_a_deposit_on_its_own_scar_changes_the_ground_by_both():
    """8 m are taken and 3 m stay in one cell, 5 m lie beside it: -5 and +5 m."""
    change = scores.elevation_change(deposit=np.array([[3.0, 5.0]]), release=np.array([[8.0, 0.0]]))
    assert change.tolist() == [[-5.0, 5.0]]


def test_a_change_in_feet_is_scored_in_metres(tmp_path):
    change = OBSERVED_AFTER - BEFORE
    a, b = write(tmp_path / "a.tif", change), write(tmp_path / "b.tif", change / 0.3048, units="ft")
    values, _ = scored(a, b, quantity="change")
    assert values["change of elevation", "erosion_volume_bias"] == pytest.approx(1.0, rel=1e-6)
    assert values["change of elevation", "rmse"] == pytest.approx(0.0, abs=1e-6)


def test_a_survey_of_finer_shifted_cells_keeps_its_volume(tmp_path):
    """Cells of 4 m, 3 m west and 2 m north of those of 10 m: the volume beside the map's rim is that of numpy."""
    fine = np.zeros((40, 50))
    fine[10:21, 12:30], fine[5:8, 5:9] = 1.5, -2.0
    coarse = cells(14, 18, r5c5=1.0, r2c2=-1.0)
    a = write(tmp_path / "a.tif", coarse)
    b = write(tmp_path / "b.tif", fine, (4.0, 4.0), west=WEST - 3.0, north=NORTH + 2.0)
    values, _ = scored(a, b, quantity="change")
    assert values["change of elevation", "deposition_volume_bias"] == pytest.approx(100.0 / (11 * 18 * 16 * 1.5), rel=1e-6)
    assert values["change of elevation", "erosion_volume_bias"] == pytest.approx(100.0 / (12 * 16 * 2.0), rel=1e-6)


# --- areas -----------------------------------------------------------------------------------------------------------------


def test_areas_of_an_outline_are_those_of_polygons(tmp_path):
    import geopandas

    outline = shapely.Polygon([(WEST + 3, NORTH - 7), (WEST + 171, NORTH - 31), (WEST + 88, NORTH - 143)])
    geopandas.GeoDataFrame(geometry=[outline], crs=UTM).to_file(tmp_path / "outline.gpkg")
    wet = np.zeros((15, 20))
    wet[2:9, 4:19] = 1.0
    flow = shapely.box(WEST + 40, NORTH - 90, WEST + 190, NORTH - 20)
    values, counts = scored(write(tmp_path / "a.tif", wet), tmp_path / "outline.gpkg", thresholds=(0.5,))
    of = "outline, flow of 0.5 m"
    both, either = flow.intersection(outline).area, flow.union(outline).area
    assert counts[of]["hits_m2"] == pytest.approx(both)
    assert values[of, "csi"] == pytest.approx(both / either)
    assert values[of, "pod"] == pytest.approx(both / outline.area)
    assert values[of, "far"] == pytest.approx(1.0 - both / flow.area)
    assert values[of, "area_bias"] == pytest.approx(flow.area / outline.area)


def test_maps_that_share_no_wet_cell_score_nothing_right(tmp_path):
    a, b = write(tmp_path / "a.tif", cells(4, 4, r0c0=2.0)), write(tmp_path / "b.tif", cells(4, 4, r3c3=1.0, r3c2=1.0))
    values, _ = scored(a, b, quantity="deposit", thresholds=(0.5,))
    of = "deposit of 0.5 m"
    assert [values[of, name] for name in ("csi", "pod", "far", "area_bias")] == [0.0, 0.0, 1.0, 0.5]
    assert values["deposit, whole map", "volume_bias"] == 1.0
    assert values["deposit, whole map", "relative_l1"] == 2.0


def test_a_raster_in_feet_of_a_state_plane_comes_to_its_place_and_is_refused_as_the_first(tmp_path):
    """New York Long Island in US survey feet: 30 m of the other system are about 98.4 of its units."""
    from pyproj import Transformer

    x, y = Transformer.from_crs("EPSG:32618", "EPSG:2263", always_xy=True).transform(585_000.0, 4_511_000.0)
    wet = np.zeros((40, 40))
    wet[10:30, 10:30] = 2.0
    b = write(tmp_path / "feet.tif", wet, (32.8084, 32.8084), west=x, north=y, crs="EPSG:2263")
    model = np.full((60, 60), 1.0)
    a = write(tmp_path / "metres.tif", model, west=584_900.0, north=4_511_100.0, crs="EPSG:32618")
    _, counts = scored(a, b, quantity="deposit", thresholds=(0.5,), nodata="zero")
    assert counts["deposit, whole map"]["observed_volume_m3"] == pytest.approx(200.0 * 200.0 * 2.0, rel=0.005)
    with pytest.raises(ObservationError, match="not in metres"):
        scored(b, a, quantity="deposit")


# --- thickness normal to the slope -----------------------------------------------------------------------------------------

SLOPE = 900.0 - 0.75 * 10.0 * np.arange(20.0) + np.zeros((12, 1))  # tan 3/4, cos 4/5


def test_runout_is_scored_normal_to_the_slope_with_the_volume_that_it_has(tmp_path):
    """2.5 m vertical are 2 m normal to a slope of 3 in 4; 6 cells of 100 m2 hold 1500 m3 in both ways."""
    laid = np.zeros((12, 20))
    laid[4:6, 5:8] = 2.5
    run = write_run(tmp_path / "run.nc", SLOPE, max_flow_thickness=laid, deposit_thickness=laid)
    peer, dem = write(tmp_path / "peer.tif", 0.8 * laid), write(tmp_path / "dem.tif", SLOPE)
    values, counts = scored(run, peer, quantity="deposit", slope_normal=True, dem=dem, thresholds=(2.0, 2.1))
    assert values["deposit, whole map", "rmse"] == pytest.approx(0.0, abs=1e-6)
    assert (values["deposit of 2 m", "csi"], counts["deposit of 2.1 m"]["hits_m2"]) == (1.0, 0.0)
    volumes = counts["deposit, whole map"]
    assert volumes["modelled_volume_m3"] == volumes["observed_volume_m3"] == pytest.approx(1500.0, rel=1e-6)
    values, _ = scored(run, peer, quantity="deposit", dem=dem)
    assert values["deposit, whole map", "bias"] == pytest.approx(0.5, rel=1e-6)
    assert values["deposit, whole map", "volume_bias"] == pytest.approx(1.25, rel=1e-6)


def test_rasters_normal_to_the_slope_hold_no_volume_where_the_ground_is_not_known(tmp_path):
    laid = cells(4, 4, r1c1=2.0)
    a, b = write(tmp_path / "a.tif", laid), write(tmp_path / "b.tif", 2.0 * laid)
    values, counts = scored(a, b, quantity="deposit", slope_normal=True)
    assert ("deposit, whole map", "volume_bias") not in values
    assert "modelled_volume_m3" not in counts["deposit, whole map"]
    assert values["deposit, whole map", "bias"] == -2.0


# --- what has no value, and what a raster shows --------------------------------------------------------------------------------


def test_scores_without_a_value_say_why_and_no_line_holds_nan(tmp_path):
    from runout.report.scores import score_tables
    from runout.workflow.comparison import lines

    a, b = write(tmp_path / "deposit.tif", cells(4, 4, r0c0=2.0)), write(tmp_path / "deposit_observed.tif", np.zeros((4, 4)))
    found = scores.compare(a, b, scores.Choices(thresholds=(0.5,))).assessment
    told = list(lines(found))
    assert told[0] == "deposit of 0.5 m: CSI 0, FAR 1, agreement within a cell 0; undefined: POD, area bias (no observed area)"
    assert "; undefined: volume bias (no observed volume); relative L1 (all observed values are 0 or unknown)" in told[1]
    table = score_tables(found.stored()["scores"])[0]
    assert table.undefined == ["Undefined for deposit of 0.5 m: POD, area bias (no observed area)."]
    assert not any("nan" in line for line in told)


@pytest.mark.parametrize(
    ("name", "units", "shown"),
    [
        ("deposit.tif", None, "deposit"), ("deposit_thickness_p50.tif", None, "deposit"), ("Mean-Deposit.tif", "ft", "deposit"),
        ("max_flow_thickness.tif", None, "thickness"), ("flow_speed.tif", None, "speed"), ("arrival_time.tif", None, "arrival"),
        ("dod.tif", None, "change"), ("peer.tif", "m/s", "speed"), ("peer.tif", "kPa", "pressure"), ("peer.tif", "min", "arrival"),
    ],
)  # fmt: skip
def test_a_raster_shows_what_its_name_or_unit_says(tmp_path, name, units, shown):
    path = write(tmp_path / name, np.ones((4, 4)), units=units)
    found = scores.compare(path, path, scores.Choices())
    assert found.quantities == [shown]
    assert not any("taken as" in sentence for sentence in found.changes)


def test_a_raster_that_says_nothing_is_taken_as_flow_and_contradictions_are_refused(tmp_path):
    plain = write(tmp_path / "peer.tif", np.ones((4, 4)))
    (said,) = scores.compare(plain, plain, scores.Choices()).changes
    assert "taken as maximum flow thickness, since neither name nor unit says what it shows; --quantity" in said
    assert scores.compare(plain, plain, scores.Choices("deposit")).changes == ()
    odd = {"deposit_speed.tif": "deposit and speed", "speed_exceedance_probability.tif": "exceedance and probability"}
    for name, words in odd.items():
        path = write(tmp_path / name, np.ones((4, 4)))
        with pytest.raises(ObservationError, match=f"its name says {words}; state what it shows with --quantity"):
            scores.compare(path, path, scores.Choices())
    speed, laid = write(tmp_path / "speed.tif", np.ones((4, 4))), write(tmp_path / "deposit.tif", np.ones((4, 4)))
    with pytest.raises(ObservationError, match=r"they have \[speed\] and \[deposit\]"):
        scores.compare(speed, laid, scores.Choices())


def test_a_threshold_counts_for_the_quantity_that_a_name_says(tmp_path):
    a, b = write(tmp_path / "speed.tif", cells(4, 4, r0c0=9.0)), write(tmp_path / "velocity.tif", cells(4, 4, r0c0=9.0, r0c1=7.0))
    values, _ = scored(a, b, thresholds=(6.0,))
    assert values["speed of 6 m s-1", "csi"] == 0.5


def flows(*masks):
    """Flows of 1 m on the cells of masks (rows, columns) of 2 by 2 m."""
    grid = Grid(0.0, 0.0, (2.0, 2.0), (3, 4))
    return [Flow(grid, {"thickness": np.asarray(mask, float)}) for mask in masks]


def test_the_area_of_a_probability_that_is_smaller_than_that_of_every_member_is_named():
    """Three members reach places of their own: the cellwise median is dry, and no member is."""
    members = flows([[1, 1, 0, 0], [0] * 4, [0] * 4], [[0, 0, 1, 1], [0] * 4, [0] * 4], [[0] * 4, [1, 1, 1, 0], [0] * 4])
    probabilities = Probabilities()
    for member in members:
        probabilities.add(member, 1 / 3, [("thickness", 0.5)])
    whole = Flow(members[0].grid, {}, probabilities.shares, 0.5, is_percentile=True)
    (said,) = probabilities.unlike_members(whole)
    assert "thickness of 0.5: the area with P >= 0.5, 0 m2, is smaller than that of every member (8 to 12 m2)" in said
    (said,) = probabilities.unlike_members(replace(whole, probability=0.3))  # all that any member reaches
    assert "28 m2, is larger than that of every member" in said
    assert not list(probabilities.unlike_members(replace(whole, probabilities={("thickness", 0.5): members[0].maps["thickness"]})))


def test_brier_score_by_hand_leaves_out_what_is_dry_in_all():
    probability, share = np.array([1.0, 0.5, 0.25, 0.0, 0.0, np.nan]), np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0])
    assert brier(probability, share) == pytest.approx((0.0 + 0.25 + 0.0625 + 1.0) / 4)
    assert np.isnan(brier(np.zeros(3), np.zeros(3)))


def test_members_are_ranked_by_their_mean_csi_and_one_without_it_is_last():
    def member(number, *values):
        return Member(number, 0.25, {}, Path("x"), tuple(Score("flow", "csi", value) for value in values))

    order, by = ranked([member(0, 0.2, 0.4), member(1, np.nan, np.nan), member(2, 0.9, 0.1)])
    assert [one.number for one in order] == [2, 0, 1]
    assert by == "mean CSI"
    speeds = [Score("gauges, speed", "rmse", value, "m s-1") for value in (3.0, 1.0)]
    errors = [Member(k, 0.5, {}, Path("x"), (speed,)) for k, speed in enumerate(speeds)]
    assert [one.number for one in ranked(errors)[0]] == [1, 0]
