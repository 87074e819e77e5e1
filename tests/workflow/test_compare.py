"""`runout compare`: two members, two products, and a product against rasters, outlines and points."""

import json
import re
import shutil
from xml.etree import ElementTree

import geopandas
import numpy as np
import pandas
import pytest
import rasterio
import shapely
from ramp_site import CELL, NORTH, WEST, member_file, ramp, write_raster
from rasterio.transform import from_origin
from rasterio.warp import calculate_default_transform, reproject

import runout
from runout import cli
from runout.errors import ExitCode
from runout.io import netcdf
from runout.io.geotiff import write_cog
from runout.io.member_maps import read_maps
from runout.quantities import QUANTITIES

UTM = "EPSG:32632"


@pytest.fixture(scope="module")
def members(finished_site):
    """Files of two members: steep friction and low friction."""
    folder, _ = finished_site
    return member_file(folder, 0), member_file(folder, 1)


def compare(capsys, *arguments):
    """Exit code, lines by what is scored, and the errors."""
    code = cli.main(["-q", "compare", *map(str, arguments)])
    told = capsys.readouterr()
    return code, dict(line.split(": ", 1) for line in told.out.splitlines()), told.err


def scores(line):
    """Values of a line by the name of the score."""
    return {name: float(value) for name, value in re.findall(r"([A-Za-z][A-Za-z1 ]*?) (-?[\d.e+-]+)(?=[ ,]|$)", line)}


def thickness_of(path):
    return read_maps(path)["max_flow_thickness"].values.astype(float)


def outline_of(mask):
    from rasterio.features import shapes

    parts = shapes(mask.astype(np.uint8), mask=mask, transform=from_origin(WEST, NORTH, CELL, CELL))
    return geopandas.GeoDataFrame(geometry=[shapely.union_all([shapely.geometry.shape(p) for p, _ in parts])], crs=UTM)


def test_two_members_are_scored_and_written_as_page_record_and_maps(members, tmp_path, capsys):
    out = tmp_path / "comparison"
    code = cli.main(["-q", "--out", str(out), "compare", *map(str, members), "--threshold", "0.5", "0.1"])
    told = capsys.readouterr().out
    assert code == ExitCode.OK
    assert told.index("flow of 0.1 m: CSI") < told.index("flow of 0.5 m: CSI")
    record = json.loads((out / "comparison.json").read_text())
    assert record["thresholds"] == [0.1, 0.5]
    assert {score["name"] for score in record["scores"]} >= {"csi", "pod", "far", "area_bias", "rmse", "arrival_bias"}
    one, other = map(thickness_of, members)
    both, either = ((one >= 0.5) & (other >= 0.5)).sum(), ((one >= 0.5) | (other >= 0.5)).sum()
    (csi,) = [s["value"] for s in record["scores"] if (s["of"], s["name"]) == ("flow of 0.5 m", "csi")]
    assert csi == pytest.approx(both / either)
    assert record["counts"]["flow of 0.5 m"]["hits_m2"] == both * CELL**2
    with rasterio.open(out / "flow_thickness_difference.tif") as file:
        assert file.crs.to_epsg() == 32632
        assert file.read(1) == pytest.approx(one - other, abs=1e-5)
    for name in record["maps"]:
        assert (out / name).is_file()
    style = ElementTree.parse(out / "flow_thickness_difference.qml").getroot()
    stops = [float(item.get("value")) for item in style.iter("item")]
    assert stops == sorted(stops)
    assert stops[0] == -stops[-1]
    page = (out / "comparison.html").read_text()
    assert "Maximum flow thickness: difference" in page
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", page)
    assert page.count("data:image/png;base64") == 3 * len(QUANTITIES) + 3  # each quantity and arrival: of both and as difference


def test_a_product_against_itself_is_perfect_and_its_reverse_has_the_other_sign(members, finished_site, capsys):
    folder, _ = finished_site
    code, same, _ = compare(capsys, folder, folder / "results")
    assert code == ExitCode.OK
    assert scores(same["flow of 1 m"]) == {"CSI": 1.0, "POD": 1.0, "FAR": 0.0, "area bias": 1.0, "agreement within a cell": 1.0}
    assert "volume" not in same["deposit, whole map"]  # a percentile over the members has none
    _, there, _ = compare(capsys, *members)
    _, back, _ = compare(capsys, *members[::-1])
    assert scores(there["flow, whole map"])["bias"] == -scores(back["flow, whole map"])["bias"]
    assert scores(there["flow of 0.5 m"])["POD"] == pytest.approx(1 - scores(back["flow of 0.5 m"])["FAR"], abs=2e-3)


def test_an_ensemble_is_scored_by_its_members_and_its_probability_not_by_a_percentile_map(members, finished_site, tmp_path, capsys):
    folder, _ = finished_site
    out = tmp_path / "comparison"
    code = cli.main(["-q", "--out", str(out), "compare", str(members[1]), str(folder), "--threshold", "0.5"])
    printed = capsys.readouterr().out
    assert code == ExitCode.OK
    assert "flow, whole map" not in printed.split("best of")[0]  # no values of percentiles
    assert re.search(r"flow of 0.5 m with P >= 0.5: CSI .* Brier 0\.\d+", printed)
    assert "best of 4 members by mean CSI: member 1; basal_friction_angle_deg" in printed
    assert "member 1, flow, whole map: bias 0 m, RMSE 0 m" in printed
    record = json.loads((out / "comparison.json").read_text())
    assert record["members"][0]["member"] == 1
    csi = [np.mean([s["value"] for s in one["scores"] if s["name"] == "csi"]) for one in record["members"]]
    assert csi == sorted(csi, reverse=True)
    assert csi[0] == 1.0
    table = pandas.read_csv(out / "members.csv")
    assert list(table["member"]) == [one["member"] for one in record["members"]]
    assert table["basal_friction_angle_deg"].between(12, 22).all()
    shares = np.mean([thickness_of(member_file(folder, k)) >= 0.5 for k in range(4)], axis=0)
    other = (thickness_of(members[1]) >= 0.5).astype(float)
    counts = (shares > 0) | (other > 0)
    (brier,) = [s["value"] for s in record["scores"] if (s["of"], s["name"]) == ("flow of 0.5 m with P >= 0.5", "brier")]
    assert brier == pytest.approx(np.mean((shares - other)[counts] ** 2))
    page = (out / "comparison.html").read_text()
    assert "Member 1 is the best of 4 by mean CSI" in page
    assert f"{folder.name}, member 1" in page
    with rasterio.open(out / "flow_thickness_difference.tif") as file:  # of the best member, which is the other
        assert not np.nan_to_num(file.read(1)).any()


def test_members_against_an_outline_and_points_are_ranked_with_their_parameters(members, finished_site, tmp_path, capsys):
    outline_of(thickness_of(members[0]) >= 0.5).to_file(tmp_path / "outline.gpkg")
    _, found, _ = compare(capsys, finished_site[0], tmp_path / "outline.gpkg", "--threshold", "0.5")
    assert found["best of 4 members by mean CSI"].startswith("member 0; basal_friction_angle_deg")
    assert scores(found["member 0, outline, flow of 0.5 m"])["CSI"] > 0.99
    place = shapely.Point(WEST + 155.0, NORTH - 125.0)
    speed = float(read_maps(members[0])["max_speed"].values[12, 15])
    geopandas.GeoDataFrame({"speed": [speed]}, geometry=[place], crs=UTM).to_file(tmp_path / "gauges.gpkg")
    _, found, _ = compare(capsys, finished_site[0], tmp_path / "gauges.gpkg")
    assert found["best of 4 members by mean RMSE"].startswith("member 0; basal_friction_angle_deg")


def test_an_ensemble_without_its_members_scores_areas_of_its_probability_and_says_so(members, finished_site, tmp_path, capsys):
    shutil.copy(finished_site[0] / "results" / "hazard.nc", tmp_path)
    code, found, error = compare(capsys, members[0], tmp_path / "hazard.nc")
    assert code == ExitCode.OK
    assert set(found) == {f"{what} of {t} m with P >= 0.5" for what in ("flow", "deposit") for t in ("0.1", "1")}
    assert "the members of the ensemble are not there, so that only areas of its probability are scored" in " ".join(error.split())
    code, found, error = compare(capsys, members[0], tmp_path / "hazard.nc", "--quantity", "speed")
    assert code == ExitCode.CONFIGURATION
    assert "values of percentiles are those of no member: name a member, or state --threshold" in " ".join(error.split())


def test_two_ensembles_are_compared_by_percentiles_with_a_warning(finished_site, capsys):
    _, _, error = compare(capsys, finished_site[0], finished_site[0])
    assert "compared are the percentiles of each cell, maps that no member has" in " ".join(error.split())


def test_a_raster_of_other_cells_in_another_system_finds_its_place(members, tmp_path, capsys):
    values = thickness_of(members[0])
    write_raster(tmp_path / "same.tif", values)
    with rasterio.open(tmp_path / "same.tif") as file:
        place, width, height = calculate_default_transform(UTM, "EPSG:3035", file.width, file.height, *file.bounds, resolution=4.0)
        moved = np.full((height, width), -9999.0, np.float32)
        reproject(rasterio.band(file, 1), moved, dst_transform=place, dst_crs="EPSG:3035", dst_nodata=-9999.0)
    profile = {"driver": "GTiff", "height": height, "width": width, "count": 1, "dtype": "float32", "nodata": -9999.0}
    with rasterio.open(tmp_path / "moved.tif", "w", crs="EPSG:3035", transform=place, **profile) as file:
        file.write(moved, 1)
    _, exact, _ = compare(capsys, members[0], tmp_path / "same.tif")
    assert scores(exact["flow of 0.5 m"])["CSI"] == 1.0
    _, near, _ = compare(capsys, members[0], tmp_path / "moved.tif")
    assert scores(near["flow of 0.5 m"])["CSI"] > 0.85
    assert abs(scores(near["flow of 0.5 m"])["area bias"] - 1) < 0.05


def test_cells_without_a_value_are_unknown_unless_they_are_declared_dry(members, tmp_path, capsys):
    values = thickness_of(members[0])
    write_raster(tmp_path / "observed.tif", np.where(values > 2.0, values, -9999.0))
    _, unknown, _ = compare(capsys, members[0], tmp_path / "observed.tif", "--threshold", "0.5")
    assert scores(unknown["flow of 0.5 m"])["FAR"] == 0.0
    assert f"{(values <= 2.0).sum() * CELL**2:.4g} m2 unknown" in unknown["flow of 0.5 m"]
    _, dry, _ = compare(capsys, members[0], tmp_path / "observed.tif", "--threshold", "0.5", "--nodata", "zero")
    assert scores(dry["flow of 0.5 m"])["FAR"] > 0.1
    assert "unknown" not in dry["flow of 0.5 m"]


def test_a_raster_normal_to_the_slope_is_compared_normal_to_it(members, tmp_path, capsys):
    slope = np.arctan(np.hypot(*np.gradient(ramp(), CELL)))
    write_raster(tmp_path / "normal.tif", thickness_of(members[0]) * np.cos(slope))
    _, found, _ = compare(capsys, members[0], tmp_path / "normal.tif", "--slope-normal", "--threshold", "0.5")
    assert scores(found["flow of 0.5 m"])["CSI"] == 1.0
    assert scores(found["flow, whole map"])["RMSE"] < 1e-6
    _, wrong, _ = compare(capsys, members[0], tmp_path / "normal.tif", "--threshold", "0.5")
    assert scores(wrong["flow, whole map"])["bias"] > 0.1
    code, _, error = compare(capsys, tmp_path / "normal.tif", tmp_path / "normal.tif", "--slope-normal")
    assert code == ExitCode.OK  # both are normal already
    assert error.count("warning:") == 1
    assert "taken as maximum flow thickness" in " ".join(error.split())


def test_an_outline_in_degrees_and_a_thalweg_give_areas_front_and_energy_line(members, tmp_path, capsys):
    outline_of(thickness_of(members[0]) >= 0.5).to_crs("EPSG:4326").to_file(tmp_path / "outline.geojson")
    line = [(WEST + 60.0, NORTH - 120.0), (WEST + 490.0, NORTH - 120.0)]
    geopandas.GeoDataFrame(geometry=[shapely.LineString(line[::-1])], crs=UTM).to_file(tmp_path / "thalweg.gpkg")
    options = ("--threshold", "0.5", "--thalweg", tmp_path / "thalweg.gpkg")
    code, found, error = compare(capsys, members[0], tmp_path / "outline.geojson", *options)
    assert code == ExitCode.OK
    values = scores(found["outline, flow of 0.5 m"])
    assert values["CSI"] > 0.99
    assert values["front error"] == 0.0
    assert values["energy line error"] == 0.0
    assert "the line runs uphill" in error
    _, other, _ = compare(capsys, members[1], tmp_path / "outline.geojson", *options)
    reach = [np.flatnonzero((thickness_of(m) >= 0.5).any(axis=0)).max() for m in members]
    assert scores(other["outline, flow of 0.5 m"])["front error"] == pytest.approx(CELL * (reach[1] - reach[0]), abs=0.1)
    assert np.sign(scores(other["outline, flow of 0.5 m"])["energy line error"]) == -np.sign(reach[1] - reach[0])


def test_points_are_scored_by_the_attributes_that_they_have(members, tmp_path, capsys):
    arrival = read_maps(members[0])["arrival_time"].values
    row, column = 12, [15, 20, 49]
    places = [shapely.Point(WEST + (c + 0.5) * CELL, NORTH - (row + 0.5) * CELL) for c in column]
    observed = [float(arrival[row, 15]) + 1.0, float(arrival[row, 20]) + 1.0, 30.0]
    frame = geopandas.GeoDataFrame({"arrival_time": observed, "speed": [None, 5.0, None]}, geometry=places, crs=UTM)
    frame.to_file(tmp_path / "gauges.gpkg")
    _, found, _ = compare(capsys, members[0], tmp_path / "gauges.gpkg")
    values = scores(found["gauges, arrival time"])
    assert values["arrival bias"] == pytest.approx(-1.0, abs=1e-3)
    assert values["missed arrivals"] == 1
    assert "2 points unknown" in found["gauges, speed"]


BAD = {
    "missing.tif": "missing.tif: no such file or folder",
    "lines.gpkg": "lines.gpkg: holds LineString; an outline is polygons, gauges are points, a thalweg goes to --thalweg",
    "nameless.gpkg": r"its points have none of the attributes arrival_time, thickness, speed; they have: height",
    "far.tif": "do not overlap",
    "negative.tif": r"negative.tif: 1 cells are negative, the least -3",
    "two.gpkg": r"two.gpkg: holds 2 layers \(a, b\); name the one with the observation",
    "note.nc": "cannot be read as NetCDF",
    "empty": "holds no hazard.nc; run `runout run",
    "unknown.tif": "thickness: no cell is known in both of the two",
    "degrees.tif": r"degrees.tif: is in WGS 84, which is not in metres",
}


def make_bad(folder):
    point, line = shapely.Point(WEST + 50, NORTH - 50), shapely.LineString([(WEST, NORTH - 50), (WEST + 50, NORTH - 50)])
    geopandas.GeoDataFrame(geometry=[line], crs=UTM).to_file(folder / "lines.gpkg")
    geopandas.GeoDataFrame({"height": [1.0]}, geometry=[point], crs=UTM).to_file(folder / "nameless.gpkg")
    for layer in "ab":
        geopandas.GeoDataFrame(geometry=[point.buffer(9)], crs=UTM).to_file(folder / "two.gpkg", layer=layer)
    write_raster(folder / "far.tif", np.ones((5, 5)), crs="EPSG:32610")
    values = np.ones((24, 50))
    profile = {"driver": "GTiff", "height": 24, "width": 50, "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    with rasterio.open(folder / "degrees.tif", "w", transform=from_origin(9.0, 45.1, 1e-4, 1e-4), **profile) as file:
        file.write(values.astype("f4"), 1)
    values[3, 3] = -3.0
    write_raster(folder / "negative.tif", values)
    write_raster(folder / "unknown.tif", np.full((24, 50), np.nan))
    (folder / "note.nc").write_text("no numbers")
    (folder / "empty").mkdir()


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_compared_gets_one_line(name, members, tmp_path, capsys):
    make_bad(tmp_path)
    first = tmp_path / name if name == "degrees.tif" else members[0]
    code, found, error = compare(capsys, first, tmp_path / name)
    assert code == ExitCode.CONFIGURATION
    assert found == {}
    assert re.search(BAD[name], " ".join(error.split()))
    assert error.count("error:") == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--quantity", "sped"), "choose one of thickness, deposit, change"),
        (("--quantity", "change"), "do not share the quantity change"),
        (("--threshold", "-1"), "--threshold is -1; it must be above 0"),
        (("--probability", "50"), "--probability is 50; it must be above 0 and below 1"),
        (("--half-width", "0"), "--half-width is 0 m"),
        (("--thalweg", "nowhere.gpkg"), "nowhere.gpkg: no such file"),
        (("--nodata", "dry"), "nodata"),
        (("--layer", "flow"), "has maps, not layers; leave the option out"),
    ],
)
def test_wrong_options_get_one_line(options, message, members, capsys):
    code, _, error = compare(capsys, *members, *options)
    assert code == ExitCode.CONFIGURATION
    assert message in " ".join(error.split())


def test_a_probability_whose_percentile_is_not_there_names_those_that_are(finished_site, capsys):
    code, _, error = compare(capsys, finished_site[0], finished_site[0], "--probability", "0.05")
    assert code == ExitCode.CONFIGURATION
    assert "holds no percentile 95, which the probability 0.05 needs; choose one of 0.5" in " ".join(error.split())


def test_what_is_changed_in_both_is_stated_once(members, tmp_path, capsys):
    write_raster(tmp_path / "flow.tif", thickness_of(members[0]))
    with rasterio.open(tmp_path / "flow.tif", "r+") as file:
        file.scales = (0.5,)
    code, _, error = compare(capsys, tmp_path / "flow.tif", tmp_path / "flow.tif")
    assert code == ExitCode.OK
    assert error.count("warning:") == 1


def test_differences_below_rounding_are_printed_as_none(members, tmp_path, capsys):
    values = thickness_of(members[0])
    write_raster(tmp_path / "flow.tif", values)
    write_raster(tmp_path / "near.tif", values * (1.0 + 1e-7))
    _, found, _ = compare(capsys, tmp_path / "near.tif", tmp_path / "flow.tif")
    line = found["flow, whole map"]
    assert "e-" not in line
    assert scores(line)["bias"] == scores(line)["RMSE"] == 0.0


def test_the_file_of_a_run_and_a_raster_in_kilopascals_are_read(members, finished_site, tmp_path, capsys):
    run = tmp_path / "run.nc"
    maps = read_maps(members[0])
    netcdf.write(maps, run)
    code, found, _ = compare(capsys, run, members[0])
    assert code == ExitCode.OK
    assert scores(found["pressure, whole map"])["RMSE"] == 0.0
    raster = write_cog(maps, "max_pressure", tmp_path / "pressure.tif")
    _, found, _ = compare(capsys, members[0], raster, "--quantity", "pressure", "--threshold", "30000")
    assert scores(found["pressure of 30000 Pa"])["CSI"] == 1.0
    assert scores(found["pressure, whole map"])["RMSE"] < 0.1


def test_maps_must_come_first(members, tmp_path, capsys):
    outline_of(thickness_of(members[0]) >= 0.5).to_file(tmp_path / "outline.gpkg")
    code, _, error = compare(capsys, tmp_path / "outline.gpkg", members[0])
    assert code == ExitCode.CONFIGURATION
    assert "the first of the two is the one that is scored; exchange the two" in " ".join(error.split())


def test_error_bars_of_the_site_stand_beside_the_scores(finished_site, members, tmp_path, capsys):
    from runout.io.atomic import write_json

    bars = finished_site[0] / "results" / "convergence.json"
    quantity = {"title": "t", "unit": "m", "fine": 1.0, "error": 7.0}
    index = [{"map": "flow_thickness", "critical_success_index": {"0.1": 0.9}, "relative_l1": 0.1}]
    write_json({"quantities": {"f99": quantity, "area_above_0.1_m": quantity}, "fields": index, "levels": []}, bars)
    try:
        _, found, _ = compare(capsys, *members, "--threshold", "0.1")
    finally:
        bars.unlink()
    assert re.search(r"CSI [\d.]+ \+- 0\.\d+, POD", found["flow of 0.1 m"])


def bed_run(path, depth):
    """File of a run over an erodible bed of a depth [m]."""
    z = np.broadcast_to(-0.5 * CELL * np.minimum(np.arange(30), 20), (12, 30)).copy()
    terrain = runout.Terrain.from_array(z, CELL, crs=UTM, origin=(WEST, NORTH))
    thickness = np.zeros(z.shape)
    thickness[4:8, 3:8] = 3.0
    result = runout.simulate(
        terrain,
        runout.Release.from_array(thickness, terrain),
        runout.DruckerPrager(density=2000.0, youngs_modulus=2e6, friction_angle=32.0),
        basal_friction_angle=15.0,
        bed=runout.Bed(depth, runout.RammsErosion(rate=0.1, depth_per_stress=2e-4)),
        cell_size=CELL,
        end_time=15.0,
    )
    result.to_netcdf(path)
    return result.maps


def test_runs_over_a_bed_are_compared_by_eroded_depth_change_and_share_of_the_bed(tmp_path, capsys):
    one, other = (bed_run(tmp_path / f"bed_{depth}.nc", depth) for depth in (2.0, 0.5))
    out = tmp_path / "out"
    code = cli.main(["-q", "--out", str(out), "compare", str(tmp_path / "bed_2.0.nc"), str(tmp_path / "bed_0.5.nc")])
    assert code == ExitCode.OK
    lines = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines())
    eroded = [maps["eroded_depth"].values.astype(float) for maps in (one, other)]
    assert eroded[0].sum() > 1.2 * eroded[1].sum() > 0.0
    record = json.loads((out / "comparison.json").read_text())
    values = {(score["of"], score["name"]): score["value"] for score in record["scores"]}
    bias = eroded[0].sum() / eroded[1].sum()
    assert values["eroded_depth, whole map", "volume_bias"] == pytest.approx(bias, rel=1e-5)
    counts = record["counts"]["eroded_depth, whole map"]
    assert counts["modelled_volume_m3"] == pytest.approx(eroded[0].sum() * CELL**2, rel=1e-5)
    masks = [depth >= np.float32(0.1) for depth in eroded]
    assert values["eroded_depth of 0.1 m", "csi"] == pytest.approx((masks[0] & masks[1]).sum() / (masks[0] | masks[1]).sum())
    assert {"change of elevation", "bed_share, whole map"} <= lines.keys()
    for name, map_name in (("eroded_depth", "eroded_depth"), ("elevation_change", "elevation_change"), ("bed_share", "bed_share")):
        with rasterio.open(out / f"{name}_difference.tif") as file:
            difference = one[map_name].values - other[map_name].values
            np.testing.assert_allclose(file.read(1, masked=True).filled(np.nan), difference, atol=1e-5)
    page = (out / "comparison.html").read_text()
    assert "Eroded depth: difference" in page
    assert "Share of the bed in the deposit: difference" in page


def test_a_raster_named_after_the_bed_is_not_taken_as_thickness_of_the_flow(tmp_path, capsys):
    maps = bed_run(tmp_path / "run.nc", 1.0)
    write_cog(maps, "eroded_depth", tmp_path / "eroded_depth.tif")
    code, lines, _ = compare(capsys, tmp_path / "run.nc", tmp_path / "eroded_depth.tif")
    assert code == ExitCode.OK
    assert {line.split(",")[0].split(" of ")[0] for line in lines} == {"eroded_depth"}
    assert scores(lines["eroded_depth, whole map"])["RMSE"] == pytest.approx(0.0, abs=1e-6)
