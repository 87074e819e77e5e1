"""Observations of a site: checked with everything else, inputs of the maps and not of the members, scored and drawn."""

import json
import os
import shutil
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from ramp_site import SITE, WEST, member_file, slab, write_raster, write_site

import runout
from runout import cli
from runout.errors import ExitCode, ObservationError
from runout.io.member_maps import read_maps
from runout.scores.thalweg import Thalweg
from runout.workflow import hazard_map
from runout.workflow.check import inspect
from runout.workflow.study import PLAN, Study

NORTH, UTM = 4_999_880.0, "EPSG:32632"
OBSERVED = """\
observations:
  outline: {polygons: inputs/outline.gpkg}
  deposit: {raster: inputs/deposit.tif, nodata: zero}
  difference: {raster: inputs/dod.tif, detection_limit: 0.2, reaches: [0, 100, 300, 440]}
  gauges: {points: inputs/gauges.gpkg, arrival_time: seconds, speed: v}
  thalweg: {line: inputs/thalweg.gpkg}
"""


def deposit():
    thickness = np.zeros((24, 50))
    thickness[6:18, 30:36] = 4.0
    return thickness


def write_vector(path, geometry, **columns):
    geopandas.GeoDataFrame(columns, geometry=geometry, crs=UTM).to_file(path)


def write_observations(folder):
    """Input files of the observations."""
    inputs = folder / "inputs"
    write_vector(inputs / "outline.gpkg", [shapely.box(WEST + 50, NORTH - 40, WEST + 380, NORTH + 35)])
    write_vector(inputs / "thalweg.gpkg", [shapely.LineString([(WEST + 50, NORTH), (WEST + 490, NORTH)])])
    places = [shapely.Point(WEST + x, NORTH) for x in (150, 250, 400)]
    write_vector(inputs / "gauges.gpkg", places, seconds=[3.0, 6.0, None], v=[10.0, None, 3.0])
    write_raster(inputs / "deposit.tif", np.where(deposit() > 0, deposit(), -9999.0))
    change = np.where(slab() > 0, -8.0, np.where(deposit() > 0, 4.0, 0.0))
    change[:, 45:] = -9999.0
    write_raster(inputs / "dod.tif", change)
    return folder


@pytest.fixture(scope="module")
def observed_site(finished_site, tmp_path_factory):
    """The finished site with observations, run anew: its members are those of the site without."""
    folder = write_observations(write_site(tmp_path_factory.mktemp("observed") / "ramp", SITE + OBSERVED))
    shutil.copytree(finished_site[0] / "results" / "members", folder / "results" / "members")
    return folder, hazard_map.run(folder, workers=1)


@pytest.fixture(scope="module")
def record(observed_site):
    return json.loads((observed_site[0] / "results" / "run.json").read_text())


def value(scores, of, name):
    (found,) = [score["value"] for score in scores if (score["of"], score["name"]) == (of, name)]
    return found


def test_members_do_not_depend_on_observations(observed_site, finished_site):
    names = {path.name for path in (observed_site[0] / "results" / "members").glob("*.nc")}
    assert names == {path.name for path in (finished_site[0] / "results" / "members").glob("*.nc")}
    assert Study.open(observed_site[0]).left == []


def test_scores_of_a_member_are_those_of_its_maps(observed_site, record):
    maps = read_maps(member_file(observed_site[0], 0))
    one = record["observations"]["members"]["0"]
    thickness, laid = maps["max_flow_thickness"].values, maps["deposit_thickness"].values.astype(float)
    shares = np.zeros((24, 50))
    shares[9:16, 5:38] = 1.0
    shares[8, 5:38] = 0.5
    wet = (thickness >= np.float32(0.1)).astype(float)
    csi = np.minimum(wet, shares).sum() / np.maximum(wet, shares).sum()
    assert value(one, "outline, flow of 0.1 m", "csi") == pytest.approx(csi, abs=1e-3)
    assert value(one, "deposit, whole map", "volume_bias") == pytest.approx(laid.sum() / deposit().sum(), rel=1e-5)
    column = np.flatnonzero((wet == 1).any(axis=0)).max()
    assert value(one, "outline, flow of 0.1 m", "front_error") == pytest.approx(10.0 * column + 5.0 - 375.0)
    change = (laid - slab())[:, :45]
    assert value(one, "DEM of difference", "erosion_volume_bias") == pytest.approx(1.0)
    risen = np.where(change >= 0.2, change, 0.0).sum()
    assert value(one, "DEM of difference", "deposition_volume_bias") == pytest.approx(risen / deposit().sum(), rel=1e-4)
    arrival = maps["arrival_time"].values
    assert value(one, "gauges, arrival time", "arrival_bias") == pytest.approx(
        np.mean([arrival[12, 15] - 3.0, arrival[12, 25] - 6.0]), abs=1e-4
    )


def test_the_ensemble_is_scored_by_mean_deposit_and_medians(record):
    ensemble, members = record["observations"]["ensemble"], record["observations"]["members"]
    volumes = [value(one, "deposit, whole map", "volume_bias") for one in members.values()]
    assert value(ensemble["scores"], "deposit, whole map", "volume_bias") == pytest.approx(np.mean(volumes))
    fronts = sorted(value(one, "outline, flow of 1 m", "front_error") for one in members.values())
    assert value(ensemble["scores"], "outline, flow of 1 m", "front_error") == fronts[len(fronts) // 2]  # reached by half of them
    counts = ensemble["counts"]["DEM of difference"]
    assert counts["unknown_cells"] == 24 * 5
    assert ensemble["counts"]["gauges, speed"] == {"points": 2, "unknown_points": 1}
    assert record["observations"]["energy_line_from"] == "top of the release"


def test_volumes_by_reach_of_every_member_are_in_the_products_and_the_report(observed_site, record):
    """Reaches of columns 5 to 14, 15 to 34 and 35 to 49 of 10 m; those west of the line belong to the first."""
    import xarray as xr

    columns = slice(0, 15), slice(15, 35), slice(35, 45)  # 45 to 49 are unknown
    volumes = lambda change: [100.0 * np.where(np.abs(change) < 0.2, 0.0, change)[:, part].sum() for part in columns]  # noqa: E731
    observed = volumes(np.where(slab() > 0, -8.0, np.where(deposit() > 0, 4.0, 0.0)))
    with xr.open_dataset(observed_site[0] / "results" / "hazard.nc") as hazard:
        assert hazard["reach_volume"].units == hazard["observed_reach_volume"].units == "m3"
        assert hazard["reach_start"].values.tolist() == [0.0, 100.0, 300.0]
        assert hazard["reach_end"].values.tolist() == [100.0, 300.0, 440.0]
        np.testing.assert_allclose(hazard["observed_reach_volume"], observed)
        for member, scores in record["observations"]["members"].items():
            laid = read_maps(member_file(observed_site[0], int(member)))["deposit_thickness"].values.astype(float)
            own = hazard["reach_volume"].sel(realization=int(member)).values
            np.testing.assert_allclose(own, volumes(laid - slab()), rtol=1e-4, atol=5.0)
            assert value(scores, "DEM of difference", "reach_error") == pytest.approx(np.abs(own - observed).sum())
    assert record["observations"]["ensemble"]["reaches"]["observed_m3"] == pytest.approx(observed)
    page = (observed_site[0] / "results" / "report.html").read_text()
    assert "Volumes by reach" in page
    assert "100 to 300\u202fm" in page


def test_files_are_recorded_and_make_the_maps_stale_and_not_the_members(observed_site, record):
    named = {entry["name"] for entry in record["inputs"]}
    assert {"inputs/outline.gpkg", "inputs/deposit.tif", "inputs/gauges.gpkg", "inputs/thalweg.gpkg"} <= named
    folder = observed_site[0]
    before = (folder / "inputs" / "deposit.tif").read_bytes()
    write_raster(folder / "inputs" / "deposit.tif", 2 * deposit())
    try:
        study = Study.open(folder)
        stale = {stage.name: study.why_stale(stage) for stage in PLAN}
    finally:
        (folder / "inputs" / "deposit.tif").write_bytes(before)
    assert stale["terrain"] is stale["release"] is stale["ensemble"] is None
    assert stale["hazard"] == stale["report"] == "inputs, configuration or sources of runout changed"


def test_maps_and_layers_open_in_a_gis(observed_site):
    import pyogrio
    import rasterio

    results = observed_site[0] / "results"
    layers = {str(name): str(kind) for name, kind in pyogrio.list_layers(results / "outlines.gpkg")}
    assert (layers["observed_outline"], layers["thalweg"], layers["gauges"]) == ("MultiPolygon", "LineString", "Point")
    gauges = geopandas.read_file(results / "outlines.gpkg", layer="gauges")
    assert gauges.crs.to_epsg() == 32632
    assert gauges["arrival_time"].tolist()[:2] == [3.0, 6.0]
    with rasterio.open(results / "maps" / "observed" / "elevation_change_difference.tif") as file:
        assert (file.read(1, masked=True).mask[:, 45:]).all()
        assert file.read(1)[12, 7] == 0.0  # the release, lowered by as much
    assert (results / "maps" / "observed" / "observed_deposit_thickness.qml").is_file()


def test_the_report_shows_scores_members_and_maps(observed_site, finished_site):
    page = (observed_site[0] / "results" / "report.html").read_text()
    for words in ("outline of the flow", "energy line error", "DEM of difference", "Observed deposit", "Scores of every member"):
        assert words in page
    assert "<dd>sampled parameter</dd>" in page.split("Scores of every member")[1].split('id="members"')[0]
    assert "blue is what was observed" in page
    assert "Observed deposit" not in (finished_site[0] / "results" / "report.html").read_text()


def test_error_bars_come_with_the_convergence_of_the_site(observed_site):
    from runout.io.atomic import write_json

    folder = observed_site[0]
    bars = folder / "results" / "convergence.json"
    quantity = {"title": "front", "unit": "m", "fine": 300.0, "error": 7.0}
    write_json({"quantities": {"f99": quantity}, "fields": [], "levels": [{"cell_size": [10.0]}]}, bars)
    try:
        outcome = hazard_map.run(folder, workers=1)
        stored = json.loads((folder / "results" / "run.json").read_text())["observations"]["ensemble"]["scores"]
        page = (folder / "results" / "report.html").read_text()
    finally:
        bars.unlink()
    assert outcome.done == ("hazard", "report")
    (front,) = [s for s in stored if (s["of"], s["name"]) == ("outline, flow of 1 m", "front_error")]
    assert front["numerical_error"] == 7.0
    assert "±\u202f7" in page


def test_check_lists_all_problems_of_observations_at_once(tmp_path, capsys):
    folder = write_observations(write_site(tmp_path / "ramp", SITE + OBSERVED.replace("speed: v", "speed: velocity")))
    inputs = folder / "inputs"
    write_vector(inputs / "outline.gpkg", [shapely.box(WEST - 900, NORTH, WEST - 800, NORTH + 10)])
    write_vector(inputs / "thalweg.gpkg", [shapely.LineString([(WEST + a, NORTH), (WEST + a + 30, NORTH)]) for a in (50, 200)])
    write_raster(inputs / "deposit.tif", np.where(deposit() > 0, deposit(), -1.0))
    write_raster(inputs / "dod.tif", np.full((24, 50), -9999.0))
    code = cli.main(["check", str(folder)])
    told = " ".join(capsys.readouterr().out.split())
    assert code == ExitCode.CONFIGURATION
    assert "outline.gpkg: no outline lies on" in told
    assert "thalweg.gpkg: holds 2 features (LineString); a thalweg is one line without branches or gaps" in told
    assert "1128 cells are negative, the least -1; values of thickness are 0 or more" in told
    assert "dod.tif: no known cell lies on" in told
    assert "no attribute 'velocity' for the speed" in told
    assert "5 problems" in told
    assert not (folder / "results").exists()


def test_keys_of_observations_are_checked_with_the_others(tmp_path):
    text = OBSERVED.replace("polygons:", "polygon:").replace("zero", "nul").replace("detection_limit: 0.2", "detection_limit: -1")
    text = text.replace("inputs/thalweg.gpkg", "inputs/thalwg.gpkg").replace("arrival_time: seconds, speed: v", "layer: gauges")
    folder = write_observations(write_site(tmp_path / "ramp", SITE.replace("end_time", "end_tiem") + text))
    problems = "\n".join(inspect(folder).problems)
    for words in (
        "observations.outline.polygon: unknown key; did you mean 'polygons'?",
        "observations.deposit.nodata: 'nul' is not known",
        "observations.difference.detection_limit: -1 m is out of range; it must be at least 0 and at most 100 m",
        "observations.gauges: no attribute is named; name that of arrival_time, thickness or speed",
        "observations.thalweg.line: there is no file 'inputs/thalwg.gpkg'; did you mean 'inputs/thalweg.gpkg'?",
        "did you mean 'end_time'?",
    ):
        assert words in problems, words
    assert all("site.yaml:" in line for line in problems.splitlines())


def test_a_site_without_observations_has_none(finished_site):
    site = runout.read_site(finished_site[0])
    assert site.files.observations().require() is None
    assert site.files.paths("observations") == []
    assert "observations" not in json.loads((finished_site[0] / "results" / "run.json").read_text())


def test_a_deposit_normal_to_the_slope_becomes_vertical(tmp_path):
    text = SITE + "observations: {deposit: {raster: inputs/deposit.tif, thickness: slope_normal}}\n"
    folder = write_site(tmp_path / "ramp", text)
    write_raster(folder / "inputs" / "deposit.tif", np.ones((24, 50)))
    site = runout.read_site(folder)
    observed = site.files.observations().require()
    assert observed.deposit[12, 10] == pytest.approx(1 / np.cos(np.radians(30)))
    assert observed.deposit[12, 40] == pytest.approx(1.0)


def test_polygons_that_cross_themselves_are_no_thalweg(tmp_path):
    folder = write_site(tmp_path / "ramp", SITE + "observations: {thalweg: {line: inputs/thalweg.gpkg}}\n")
    corners = [(WEST + x, NORTH - y) for x, y in ((0, 0), (90, 90), (90, 0), (0, 90))]
    write_vector(folder / "inputs" / "thalweg.gpkg", [shapely.Polygon(corners), shapely.Polygon(corners[::-1])])
    site = runout.read_site(folder)
    with pytest.raises(ObservationError, match=r"holds 2 features \(Polygon\); a thalweg is one line"):
        site.files.observations().require()


def test_a_thalweg_drawn_uphill_is_turned_and_said_so(tmp_path):
    folder = write_site(tmp_path / "ramp", SITE + "observations: {thalweg: {line: inputs/thalweg.gpkg}}\n")
    write_vector(folder / "inputs" / "thalweg.gpkg", [shapely.LineString([(WEST + 490, NORTH), (WEST + 50, NORTH)])])
    site = runout.read_site(folder)
    observed = site.files.observations().require()
    assert isinstance(observed.thalweg, Thalweg)
    assert observed.thalweg.points[0, 0] < observed.thalweg.points[-1, 0]
    assert "the line runs uphill, from 3.0" in " ".join(observed.changes) or "it is read from its other end" in observed.changes[0]


CASCADES = Path(os.environ.get("RUNOUT_DATA", "none")) / "cascades_2021_landlab"


@pytest.mark.skipif(not CASCADES.is_dir(), reason="the folder of RUNOUT_DATA does not hold cascades_2021_landlab")
def test_the_dem_of_difference_of_cascades_is_that_of_its_source():
    site = runout.read_site(Path(__file__).parents[2] / "sites" / "cascades_2021")
    terrain = site.terrain()
    observed = site.files.observations().require()
    lowered = -np.minimum(observed.change, 0).sum() * terrain.cell_area
    raised = np.maximum(observed.change, 0).sum() * terrain.cell_area
    assert (lowered, raised) == (pytest.approx(26_407, abs=1), pytest.approx(22_543, abs=1))
    assert (observed.change != 0).sum() <= 224
