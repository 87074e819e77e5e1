"""What cannot be compared is refused with the remedy; options and members of an ensemble reach the scores."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import geopandas as gpd
import numpy as np
import pyproj
import pytest
import rasterio
import shapely
from rasterio.transform import from_origin

from runout import scores
from runout.errors import ObservationError
from runout.scores.assessment import Setting, against_observations
from runout.scores.comparison import NOTHING_IN_AREAS, _assessed, summary
from runout.scores.definitions import Score
from runout.scores.flow import Flow, percentile_of
from runout.scores.grid import Grid, common_grid
from runout.scores.members import Member, Probabilities, ranked
from runout.scores.observations import Observations
from runout.scores.points import Gauges

sys.path.append(str(Path(__file__).parents[1] / "hazard"))
from synthetic_ensemble import CELL, SHAPE, SOUTH, WEST, member_maps, write_all

UTM = pyproj.CRS("EPSG:32632").to_wkt()
GRID = Grid(500_000.0, 5_000_000.0, (10.0, 10.0), (9, 20), UTM, "flow")
NORTH = SOUTH + SHAPE[0] * CELL[1]


def write(path, values, size=(10.0, 10.0), west=500_000.0, north=5_000_090.0, crs="EPSG:32632"):
    """A raster of the disk."""
    profile = {"driver": "GTiff", "height": values.shape[0], "width": values.shape[1], "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", crs=crs, transform=from_origin(west, north, *size), nodata=-9999.0, **profile) as file:
        file.write(np.where(np.isnan(values), -9999.0, values).astype("f4"), 1)
    return path


def layer(path, *geometries, **attributes):
    gpd.GeoDataFrame(attributes, geometry=list(geometries), crs="EPSG:32632").to_file(path)
    return path


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({"quantity": "depth"}, "--quantity is 'depth'; choose one of thickness, deposit, change, eroded_depth, bed_share, speed"),
        ({"probability": 0.0}, "--probability is 0; it must be above 0 and below 1"),
        ({"probability": 1.0}, "--probability is 1; it must be above 0 and below 1"),
        ({"thresholds": (1.0, 0.0)}, "--threshold is 0; it must be above 0"),
        ({"thresholds": (np.inf,)}, "--threshold is inf; it must be above 0"),
        ({"half_width": 0.0}, "--half-width is 0 m; it must be above 0"),
        ({"half_width": np.nan}, "--half-width is nan m; it must be above 0"),
    ],
)
def test_choices_that_mean_nothing_are_refused(choices, said):
    with pytest.raises(ObservationError, match=said):
        scores.Choices(**choices)


def test_products_that_cannot_be_compared_are_refused(tmp_path):
    flow, deposit = (write(tmp_path / f"{name}.tif", np.ones((9, 20))) for name in ("thickness", "deposit"))
    outline = layer(tmp_path / "outline.gpkg", shapely.box(500_000, 5_000_000, 500_050, 5_000_050))
    line = layer(tmp_path / "line.gpkg", shapely.LineString([(500_000, 5_000_000), (500_050, 5_000_050)]))
    points = layer(tmp_path / "points.gpkg", shapely.Point(500_005, 5_000_005), depth=[1.0])
    far = write(tmp_path / "far_thickness.tif", np.ones((9, 20)), west=900_000.0)
    degrees = write(tmp_path / "thickness_deg.tif", np.ones((9, 20)), (1e-4, 1e-4), 9.0, 45.0, "EPSG:4326")
    unknown = write(tmp_path / "thickness_b.tif", np.full((9, 20), np.nan))
    (tmp_path / "empty").mkdir()
    cases = [
        (outline, flow, "outline.gpkg: holds no maps, and the first of the two is the one that is scored; exchange the two"),
        (outline, outline, "the one that is scored; name a product with maps"),
        (flow, line, "line.gpkg: holds LineString; an outline is polygons, gauges are points, a thalweg goes to --thalweg"),
        (flow, points, "its points have none of the attributes arrival_time, thickness, speed; they have: depth"),
        (flow, far, r"far_thickness.tif do not overlap: \[500000, 5000000, 500200, 5000090\] and \[900000,"),
        (degrees, flow, "thickness_deg.tif: is in WGS 84, which is not in metres"),
        (flow, unknown, "thickness: no cell is known in both of the two; check nodata, or declare it dry: --nodata zero"),
        (flow, deposit, r"they have \[thickness\] and \[deposit\]; choose one that both have"),
        (flow, tmp_path / "no.tif", "no.tif: no such file or folder; name results, hazard.nc, a member, a raster"),
        (flow, tmp_path / "empty", "empty: holds no hazard.nc; run `runout run "),
    ]
    for first, second, said in cases:
        with pytest.raises(ObservationError, match=said):
            scores.compare(first, second, scores.Choices())
    with pytest.raises(ObservationError, match=r"--layer a: .*deposit\.tif has maps, not layers; leave the option out"):
        scores.compare(deposit, deposit, scores.Choices(layer="a"))
    with pytest.raises(ObservationError, match="--quantity arrival: an outline scores one of none of the first"):
        scores.compare(write(tmp_path / "arrival.tif", np.ones((9, 20))), outline, scores.Choices())


def test_maps_of_different_shapes_are_refused_also_where_numpy_would_stretch_them():
    for one, other in (((3, 4), (1, 4)), ((3, 4), (4,)), ((3, 4), (3, 1))):
        for compare in (scores.field_errors, scores.contingency, scores.change_errors):
            with pytest.raises(ObservationError, match=r"bring them to one grid with scores\.resampled"):
                compare(np.ones(one), np.ones(other))


def test_maps_without_a_place_in_the_system_of_the_other_are_refused():
    globe = Grid(-180.0, -90.0, (10.0, 10.0), (18, 36), pyproj.CRS("EPSG:4326").to_wkt(), "globe.tif")
    with pytest.raises(ObservationError, match=r"globe\.tif: part of it has no place in the other system; cut it"):
        common_grid(replace(GRID, crs=pyproj.CRS("+proj=ortho +lat_0=45 +lon_0=9 +datum=WGS84").to_wkt()), globe)  # of a hemisphere


def test_flows_that_share_no_score_are_refused_unless_members_have_some():
    speeds = np.ones(GRID.shape)
    one, percentile = Flow(GRID, {"speed": speeds}), Flow(GRID, {"speed": speeds}, is_percentile=True)
    setting, choices = Setting(()), scores.Choices("speed")
    with pytest.raises(ObservationError, match=NOTHING_IN_AREAS[:40]):
        _assessed((percentile, one), None, setting, choices)
    assert _assessed((percentile, one), None, setting, choices, may_be_empty=True).scores == []
    with pytest.raises(ObservationError, match=r"hazard\.nc: holds no percentile 30, .*; choose one of 0.95, 0.5, 0.05, or add"):
        percentile_of(0.7, np.array([5.0, 50.0, 95.0]), "hazard.nc")
    assert percentile_of(0.05, np.array([5.0, 50.0, 95.0]), "hazard.nc") == 95.0


def test_a_quantity_that_one_of_the_two_does_not_know_does_not_keep_the_others_from_their_scores():
    known, unknown = np.ones(GRID.shape), np.full(GRID.shape, np.nan)
    flows = Flow(GRID, {"thickness": known, "speed": unknown}), Flow(GRID, {"thickness": known, "speed": known})
    assessment = _assessed(flows, None, Setting((0.5,)), scores.Choices())
    values = {(score.of, score.name): score.value for score in assessment.scores}
    assert values["flow of 0.5 m", "csi"] == 1.0
    assert np.isnan(values["speed, whole map", "bias"])
    with pytest.raises(ObservationError, match="speed: no cell is known in both of the two"):
        _assessed(flows, None, Setting((0.5,)), scores.Choices("speed"))


def test_cells_beyond_the_half_width_of_a_setting_count_in_no_score_of_the_thalweg():
    modelled, observed = np.zeros((2, 9, 20))
    modelled[:, 2:15], observed[:, 2:12] = 1.0, 1.0
    line = scores.Thalweg(np.array([[500_000.0, 5_000_045.0], [500_200.0, 5_000_045.0]]))
    for half_width, outside in ((np.inf, 0), (20.0, 52)):
        setting = Setting([0.5], thalweg=line, half_width=half_width)
        outline = shapely.box(500_020, 5_000_000, 500_120, 5_000_090)
        assessment = against_observations(Flow(GRID, {"thickness": modelled}), Observations(GRID, outline=outline), setting)
        (counts,) = assessment.counts.values()
        assert counts["cells_beyond_half_width"] == outside
        assert (counts["modelled_front_m"], counts["observed_front_m"]) == pytest.approx((145.0, 115.0))
        (error,) = [score.value for score in assessment.scores if score.name == "front_error"]
        assert error == pytest.approx(30.0)


def test_members_with_more_scores_are_ranked_by_their_mean_and_not_by_the_sum():
    def member(number, *values):
        return Member(number, 0.5, {}, Path("x"), tuple(Score("flow", "csi", value) for value in values))

    order, _ = ranked([member(0, 0.3, 0.3, 0.3), member(1, 0.5), member(2, 0.4, 0.4)])
    assert [one.number for one in order] == [1, 2, 0]
    named, by = ranked([Member(4, 0.5, {}, Path("x"), (Score("flow", "pod", 0.5),)), Member(3, 0.5, {}, Path("x"))])
    assert ([one.number for one in named], by) == ([4, 3], "number")


def test_gauges_of_a_run_are_scored_at_their_cells_or_with_the_values_that_are_given():
    thickness, speed = np.full(GRID.shape, 2.0), np.full(GRID.shape, 5.0)
    thickness[0, 0] = np.nan
    flow = Flow(GRID, {"thickness": thickness, "speed": speed})
    gauges = Gauges(np.array([500_005.0, 500_055.0]), np.array([5_000_085.0, 5_000_045.0]), {"thickness": np.array([1.0, 1.5])})
    observed = Observations(GRID, gauges=gauges)
    assessment = against_observations(flow, observed, Setting([0.5]))
    assert {score.name: score.value for score in assessment.scores} == {"bias": 0.5, "rmse": 0.5}
    assert assessment.counts == {"gauges, thickness": {"points": 1, "unknown_points": 1}}
    assert {score.units for score in assessment.scores} == {"m"}
    of_values = against_observations(flow, observed, Setting([0.5]), at_gauges={"thickness": np.array([2.0, 1.5])})
    assert {score.name: score.value for score in of_values.scores} == {"bias": 0.5, "rmse": pytest.approx(0.5**0.5)}


# --- ensembles -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def products(tmp_path_factory):
    """Three members of equal weight: tongues of 4, 8 and 12 rows of 1, 2 and 3 m."""
    return write_all(tmp_path_factory.mktemp("products"), "EPSG:32632")


@pytest.fixture(scope="module")
def second_member(products):
    """A raster with the thickness of the second member."""
    path = products.site.folder / "inputs" / "peer_thickness.tif"
    return write(path, member_maps(1)["max_flow_thickness"], CELL, WEST, NORTH)


def test_an_ensemble_is_scored_by_its_members_and_by_what_a_share_of_them_reaches(products, second_member):
    comparison = scores.compare(products.results, second_member, scores.Choices(thresholds=(1.5,)))
    assert [member.number for member in comparison.members] == [1, 2, 0]
    assert comparison.ranked_by == "mean CSI"
    csi = {member.number: next(s.value for s in member.scores if s.name == "csi") for member in comparison.members}
    marker = 1  # a cell of all members
    assert csi == pytest.approx({0: marker / (8 * 15 + marker), 1: 1.0, 2: (8 * 15 + marker) / (12 * 15 + marker)})
    values = {(score.of, score.name): score.value for score in comparison.assessment.scores}
    group = "flow of 1.5 m with P >= 0.5"
    assert values[group, "csi"] == 1.0
    p = np.array([2 / 3] * (8 * 15) + [1 / 3] * (4 * 15) + [1.0])
    reached = np.array([1.0] * (8 * 15) + [0.0] * (4 * 15) + [1.0])
    assert values[group, "brier"] == pytest.approx(np.mean((p - reached) ** 2))
    assert (comparison.of_ensemble, comparison.quantities) == (0, comparison.quantities)
    likely = scores.compare(products.results, second_member, scores.Choices(thresholds=(1.5,), probability=0.05))
    values = {(score.of, score.name): score.value for score in likely.assessment.scores}
    assert values["flow of 1.5 m with P >= 0.05", "csi"] == pytest.approx((8 * 15 + marker) / (12 * 15 + marker))


def test_the_content_of_a_comparison_is_json_and_names_both(products, second_member):
    comparison = scores.compare(second_member, products.results / "hazard.nc", scores.Choices(thresholds=(1.5,)))
    content = json.loads(json.dumps(summary(comparison)))
    assert (content["a"]["kind"], content["b"]["kind"]) == ("raster", "ensemble")
    assert content["thresholds"] == [1.5]
    assert content["probability"] == 0.5
    assert content["thickness"] == "vertical"
    assert content["energy_line_from"] is None
    assert content["grid"]["rows_columns"] == list(SHAPE)
    assert [member["member"] for member in content["members"]] == [1, 2, 0]
    assert content["ranked_by"] == "mean CSI"
    assert comparison.of_ensemble == 1


def test_two_members_are_compared_cell_by_cell_without_members(products):
    first, second = (products.results / "members" / f"{number:04d}.nc" for number in (0, 1))
    comparison = scores.compare(first, second, scores.Choices(thresholds=(0.5,)))
    assert (comparison.members, comparison.of_ensemble, comparison.ranked_by) == ((), None, "")
    assert {"thickness", "deposit", "speed", "arrival"} <= set(comparison.quantities)
    expected = member_maps(0)["max_flow_thickness"] - member_maps(1)["max_flow_thickness"]
    known = np.isfinite(comparison.difference("thickness"))
    np.testing.assert_allclose(comparison.difference("thickness")[known], expected[known], atol=1e-5)
    assert np.isnan(comparison.difference("arrival")[30, 30]), "neither arrives"
    assert "members" not in summary(comparison)


def test_both_ensembles_are_compared_by_percentiles_with_a_sentence(products):
    comparison = scores.compare(products.results, products.results, scores.Choices())
    assert any(sentence.startswith("both are ensembles: compared are the percentiles") for sentence in comparison.changes)
    assert {score.value for score in comparison.assessment.scores if score.name == "csi"} == {1.0}
    assert comparison.members == ()
    assert "volume_bias" not in {score.name for score in comparison.assessment.scores}


def test_a_thalweg_is_turned_downhill_also_on_ground_that_is_known_in_part(tmp_path):
    ground = np.broadcast_to(np.arange(20.0, 0.0, -1.0), GRID.shape).copy()  # falls to the east
    ground[0, 7] = np.nan
    flow = np.zeros(GRID.shape)
    flow[4, 2:15] = 1.0
    maps = [write(tmp_path / f"{name}_thickness.tif", flow) for name in ("one", "other")]
    line = layer(tmp_path / "line.gpkg", shapely.LineString([(500_185.0, 5_000_045.0), (500_015.0, 5_000_045.0)]))
    choices = scores.Choices(thresholds=(0.5,), thalweg=line, dem=write(tmp_path / "dem.tif", ground))
    comparison = scores.compare(*maps, choices)
    assert any("the line runs uphill, from 2 to 19 m; it is read from its other end." in note for note in comparison.changes)
    assert comparison.setting.thalweg.points[0, 0] < comparison.setting.thalweg.points[-1, 0]
    (counts,) = [counts for counts in comparison.assessment.counts.values() if "modelled_front_m" in counts]
    assert counts["modelled_front_m"] == pytest.approx(130.0)


def test_a_probable_area_is_told_from_those_of_members_only_where_it_is_smaller_or_larger_than_all():
    def flow(cells, probability=None):
        thickness = np.zeros(GRID.shape)
        thickness[0, :cells] = 1.0
        if probability is None:
            return Flow(GRID, {"thickness": thickness})
        return Flow(GRID, {}, {("thickness", 0.5): np.where(thickness > 0, 1.0, 0.0)}, probability)

    members = Probabilities()
    for cells in (4, 8):
        members.add(flow(cells), 0.5, [("thickness", 0.5)])
    said = {cells: " ".join(members.unlike_members(flow(cells, 0.5))) for cells in (3, 4, 8, 9)}
    assert said[4] == said[8] == ""
    assert "300 m2, is smaller than that of every member (400 to 800 m2)" in said[3]
    assert "900 m2, is larger than that of every member (400 to 800 m2)" in said[9]
