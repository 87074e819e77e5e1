"""Probes of a site from site.yaml to the report, and profiles: files, percentiles, what is run again, and what is refused."""

import logging
import shutil

import geopandas as gpd
import netCDF4
import numpy as np
import pandas as pd
import pytest
import shapely
import xarray as xr
from compliance_checker.runner import CheckSuite, ComplianceChecker
from ramp_site import NORTH, SITE, WEST, member_file, ramp, write_raster, write_site

from runout.cli import main
from runout.config.site import read_site
from runout.errors import ConfigError
from runout.hazard.order import weighted_percentiles
from runout.io.member_maps import read_maps
from runout.workflow import hazard_map
from runout.workflow.probes import write_of_site
from runout.workflow.study import Study

SECONDS = "seconds since 1970-01-01 00:00:00"
LISTED = (
    f"probes:\n  points: [{{name: road, x: {WEST + 203}, y: {NORTH - 119}}}, {{name: dry, x: {WEST + 495}, y: {NORTH - 5}}}]\n"
    "  cross_sections: inputs/x.gpkg\n  interval: 0.5\n"
)
FAN = shapely.LineString([(WEST + 300, NORTH - 1), (WEST + 300, NORTH - 239)])


def write_vector(path, geometries, names=None, crs="EPSG:32632"):
    names = names or [None] * len(geometries)
    gpd.GeoDataFrame({"name": names}, geometry=geometries, crs=crs).to_file(path)
    return path


@pytest.fixture(scope="module")
def probed_site(tmp_path_factory):
    """The site with probes after one whole run; only to be read."""
    folder = write_site(tmp_path_factory.mktemp("probed") / "ramp", SITE.replace("members: 4", "members: 2") + LISTED)
    write_vector(folder / "inputs" / "x.gpkg", [FAN], ["fan"])
    hazard_map.run(folder, workers=1)
    return folder


def member_group(folder, group):
    """Series of all members in their order, and the table of members."""
    study = Study.open(folder)
    files = [standing.member.file(study.results) for standing in study.standings]
    return [xr.load_dataset(file, group=group, decode_times=False) for file in files], study.members


def test_a_run_writes_percentiles_tables_and_figures_of_the_probes_of_site_yaml(probed_site):
    results = probed_site / "results"
    found = xr.load_dataset(results / "probes" / "site_ensemble_points.nc", decode_times=False)
    members, table = member_group(probed_site, "probe_points")
    weights = table["weight"].to_numpy() / table["weight"].sum()
    assert found["percentile"].values.tolist() == [5.0, 50.0, 95.0]
    assert found["time"].values.tolist() == np.arange(0.0, 20.01, 0.5).tolist()
    for name in ("flow_thickness", "max_speed"):
        stacked = np.stack([member[name].values for member in members])
        expected = weighted_percentiles(stacked.reshape(2, -1), weights, (5.0, 50.0, 95.0)).reshape(3, *stacked.shape[1:])
        np.testing.assert_array_equal(found[name], expected)
    assert found["arrival_probability"].values.tolist() == [1.0, 0.0]
    lines = xr.load_dataset(results / "probes" / "site_ensemble_cross_sections.nc", decode_times=False)
    assert float(lines["passed_volume"].isel(time=-1, percentile=-1)[0]) == pytest.approx(28_800.0, rel=0.005)
    series = pd.read_csv(results / "probes" / "site_ensemble_points_series.csv")
    assert len(series) == 2 * 41
    at = series[(series["name"] == "road") & (series["time [s]"] == 10.0)]
    assert float(at["flow_thickness p50 [m]"].iloc[0]) == pytest.approx(float(found["flow_thickness"][1, 0, 20]), rel=1e-6)
    names = {path.name for path in (results / "probes").iterdir()}
    assert {"site_ensemble_point_road.png", "site_ensemble_cross_section_fan.png", "site_ensemble_points_peaks.csv"} <= names
    report = (results / "report.html").read_text(encoding="utf-8")
    assert report.count('<section id="probes">') == 1
    assert "it arrives at road" in report
    assert set(gpd.list_layers(results / "outlines.gpkg")["name"]) >= {"probes", "cross_sections"}
    assert main(["probe", str(probed_site)]) == 0
    assert not any(Study.open(probed_site).why_stale(stage) for stage in hazard_map.PLAN)


def test_series_of_a_file_are_stations_of_cf_with_units_places_and_system(probed_site):
    with netCDF4.Dataset(probed_site / "results" / "probes" / "site_ensemble_points.nc") as file:
        assert file.featureType == "timeSeries"
        assert file["station_name"].cf_role == "timeseries_id"
        assert file["station_name"][:].tolist() == ["road", "dry"]
        assert file["x"][:].tolist() == [WEST + 203, WEST + 495]
        assert file["x"].standard_name == "projection_x_coordinate"
        assert "WGS 84 / UTM zone 32N" in file["crs"].crs_wkt
        for name in ("flow_thickness", "speed", "pressure", "momentum_flux", "max_flow_thickness", "arrival_time"):
            assert {file[name].grid_mapping, *file[name].coordinates.split()} >= {"crs", "x", "y", "station_name"}, name
        assert [file[name].units for name in ("flow_thickness", "speed", "pressure", "time")] == ["m", "m s-1", "Pa", SECONDS]
        assert {"inputs", "versions", "command", "configuration_sha256", "ensemble"} <= set(file.ncattrs())


@pytest.mark.parametrize("name", ["points", "cross_sections"])
def test_series_pass_the_strict_checker_of_cf(probed_site, tmp_path, name):
    path, report = probed_site / "results" / "probes" / f"site_ensemble_{name}.nc", tmp_path / "report.txt"
    CheckSuite.load_all_available_checkers()
    passed, errors = ComplianceChecker.run_checker(str(path), ["cf:1.11"], 0, "strict", output_filename=str(report))
    assert passed, report.read_text()
    assert not errors
    clock = xr.load_dataset(path)["time"].values
    assert (clock[[0, -1]] - np.datetime64("1970-01-01")) / np.timedelta64(1, "ms") == pytest.approx([0.0, 20_000.0])


def test_peaks_of_a_member_are_those_of_its_maps(probed_site):
    study = Study.open(probed_site)
    member = study.standings[0].member.file(study.results)
    points, maps = xr.load_dataset(member, group="probe_points"), xr.load_dataset(member)
    cell = maps.sel(x=WEST + 203, y=NORTH - 119, method="nearest")
    for name in ("max_flow_thickness", "max_speed", "arrival_time", "deposit_thickness"):
        assert float(points[name][0]) == float(cell[name]), name
    assert float(points["flow_thickness"][0].max()) <= float(cell["max_flow_thickness"])


def test_another_probe_makes_other_members_and_says_so(probed_site, tmp_path, caplog, capsys):
    folder = shutil.copytree(probed_site, tmp_path / "ramp")
    text = (folder / "site.yaml").read_text()
    (folder / "site.yaml").write_text(text.replace("interval: 0.5", "interval: 0.25"))
    assert len(Study.open(folder).left) == 2
    (folder / "site.yaml").write_text(text.replace(LISTED, ""))
    assert len(Study.open(folder).left) == 2
    hazard_map.run(folder, stages=("ensemble",), workers=1)
    assert not write_of_site(Study.open(folder))
    assert not list((folder / "results" / "probes").iterdir())  # the files of probes that the site has no more are gone
    (folder / "site.yaml").write_text(text.replace("interval: 0.5", "interval: 0.25"))
    capsys.readouterr()
    assert main(["check", str(folder)]) == 0
    assert "2 members are done without these probes" in " ".join(capsys.readouterr().out.split())
    with caplog.at_level(logging.INFO):
        assert main(["probe", str(folder), "--member", "1"]) == 0
    assert "member 1 has no series at these probes and will be run" in caplog.text
    assert (folder / "results" / "probes" / "site_member_0001_points.nc").is_file()


def test_points_of_the_command_line_run_one_member_or_all(finished_site, tmp_path, caplog):
    folder = shutil.copytree(finished_site[0], tmp_path / "ramp")
    points = write_vector(folder / "inputs" / "p.gpkg", [shapely.Point(WEST + 203, NORTH - 119)], ["a/b"])
    before = {s.member.name for s in Study.open(folder).standings}
    with caplog.at_level(logging.INFO):
        assert main(["probe", str(folder), "--points", str(points), "--interval", "1"]) == 0
    assert "member 0 has no series" in caplog.text
    written = {path.name for path in (folder / "results" / "probes").iterdir()}
    assert written == {f"p_member_0000_{end}" for end in ("points.nc", "points_series.csv", "points_peaks.csv", "point_a_b.png")}
    every = ["--members", "all", "--workers", "1", "--picture", "svg"]
    assert main(["probe", str(folder), "--points", str(points), "--interval", "1", *every]) == 0
    assert (folder / "results" / "probes" / "p_ensemble_point_a_b.svg").read_text().startswith("<?xml")
    assert {s.member.name for s in Study.open(folder).standings if s.state == "done"} == before  # the ensemble stays as it is


def test_profiles_of_the_ensemble_are_the_maps_along_the_line(finished_site, tmp_path):
    folder = shutil.copytree(finished_site[0], tmp_path / "ramp")
    line = write_vector(folder / "inputs" / "l.gpkg", [shapely.LineString([(WEST + 21, NORTH - 115), (WEST + 489, NORTH - 115)])])
    assert main(["profile", str(folder), "--line", str(line)]) == 0
    assert main(["profile", str(folder), "--line", str(line), "--member", "2", "--picture", "svg"]) == 0
    found = xr.load_dataset(folder / "results" / "profiles" / "l_ensemble_x1.nc", decode_times=False)
    hazard = xr.load_dataset(folder / "results" / "hazard.nc", decode_times=False)
    at = {"x": found["x"], "y": found["y"], "method": "nearest"}
    mapped = {"max_flow_thickness": "flow_thickness", "max_speed": "speed", "arrival_time": "arrival_time"}
    for name, stem in mapped.items():
        expected = hazard[f"{stem}_percentile"].sel(percentile=50).sel(**at)
        np.testing.assert_array_equal(found[name].sel(percentile=50), expected, err_msg=name)
    assert float(found["distance"][-1]) == pytest.approx(468.0)
    np.testing.assert_allclose(found["ground_elevation"][0], ramp()[0, 2] + 0.4 * (ramp()[0, 1] - ramp()[0, 2]), rtol=1e-6)
    np.testing.assert_array_equal(found["bed_elevation"], found["ground_elevation"])  # the release lies on the ground
    shown = found.attrs["median_front"]  # a member, whose lines the figure shows: no member has the profile of a percentile
    reach = {k: np.flatnonzero(read_maps(member_file(folder, k))["arrival_time"].values[11] >= 0).max() for k in range(4)}
    assert reach[shown] in sorted(reach.values())[1:3]
    table = pd.read_csv(folder / "results" / "profiles" / "l_member_0002_x1.csv")
    assert {"distance [m]", "ground_elevation [m]", "max_speed [m s-1]", "deposit_thickness [m]"} <= set(table)


BAD_POINTS = [
    shapely.Point(WEST + 9000, NORTH - 100), shapely.Point(WEST + 5, NORTH - 5), shapely.Point(WEST + 10, NORTH - 100),
    shapely.Point(WEST + 30, NORTH - 100), shapely.box(WEST, NORTH - 50, WEST + 9, NORTH - 20), None,
]  # fmt: skip
SAID = (
    "p.gpkg: feature 1: point 'far' at easting 509000",
    "p.gpkg: feature 2: point 'hole' lies on cells without elevation; move it",
    "p.gpkg: feature 4: name: 'a' is the name of",
    "p.gpkg: feature 5: 'poly' is a Polygon, not a single point; draw a point",
    "p.gpkg: feature 6: 'none' has no geometry; delete it or draw it",
    "x.gpkg: feature 1: one: the line has 1 different vertex; draw two or more",
    "x.gpkg: feature 2: 53% of the length of line 'out' lies outside of",
)


def test_check_names_all_problems_of_points_and_lines_at_once(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp", SITE + "probes: {points: inputs/p.gpkg, cross_sections: inputs/x.gpkg}\n")
    hole = ramp()
    hole[0, 0] = -9999.0
    write_raster(folder / "inputs" / "dem.tif", hole)
    write_vector(folder / "inputs" / "p.gpkg", BAD_POINTS, ["far", "hole", "a", "a", "poly", "none"])
    out = [(WEST + 300, NORTH - 100), (WEST + 300, NORTH - 400)]
    lines = [shapely.LineString(vertices) for vertices in ([out[0]] * 2, out)]
    write_vector(folder / "inputs" / "x.gpkg", lines, ["one", "out"])
    assert main(["check", str(folder)]) == 2
    text = " ".join(capsys.readouterr().out.split())
    for said in SAID:
        assert said in text
    assert "7 problems" in text
    line = len(SITE.splitlines()) + 1
    assert f"site.yaml:{line}: probes.points: {folder / 'inputs' / 'p.gpkg'}: feature" in text


def test_a_listed_point_off_the_terrain_has_its_line(tmp_path, capsys):
    listed = f"probes:\n  points:\n    - {{name: a, x: {WEST + 10}, y: {NORTH - 10}}}\n    - {{name: b, x: 1.0, y: 2.0}}\n"
    folder = write_site(tmp_path / "ramp", SITE + listed)
    assert main(["check", str(folder)]) == 2
    line = len(SITE.splitlines()) + 4
    said = " ".join(capsys.readouterr().out.split())
    assert f"site.yaml:{line}: probes.points[1]: point 'b' at easting 1, northing 2 lies outside of" in said


@pytest.mark.parametrize(
    ("block", "said"),
    [
        ("{}", "neither points nor cross_sections are given"),
        ("{points: [{name: a, x: 1, y: high}], interval: 0}", "probes.points[0].y: 'high' is text; a number is needed"),
        ("{points: inputs/q.gpkg}", "there is no file 'inputs/q.gpkg'"),
        ("{cross_sections: inputs/x.gpkg, points_layer: p}", "probes.points_layer: 'p' without a file of points"),
    ],
)
def test_wrong_settings_of_probes_are_refused_with_their_line(block, said, tmp_path):
    folder = write_site(tmp_path / "ramp", f"{SITE}probes: {block}\n")
    with pytest.raises(ConfigError, match=r"site\.yaml:18") as error:
        read_site(folder)
    assert said in str(error.value)


def test_a_command_without_probes_or_members_says_what_to_do(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp")
    line = write_vector(folder / "inputs" / "l.gpkg", [FAN], crs=None)
    for tokens, said in (
        (["probe", str(folder)], "states no probes; add probes: to it, or give --points or --cross-sections"),
        (["probe", str(folder), "--points", str(folder / "q.gpkg")], "there is no such file"),
        (["probe", str(folder), "--line", str(line), "--member", "1", "--members", "all"], "are both given"),
        (["probe", str(folder), "--line", str(line), "--member", "9"], "the site has members 0 to 3"),
        (["profile", str(folder), "--line", str(line)], "states no coordinate system; taken to be in the terrain's"),
        (["profile", str(folder), "--line", str(line)], "no member is done"),
    ):
        assert main(tokens) != 0
        assert said in " ".join(capsys.readouterr().err.split()), tokens
