"""Each release of a site as a site of its own, run in one command, and merged."""

import geopandas as gpd
import numpy as np
import pytest
import ramp_site
import shapely
import xarray as xr

from runout import cli, read_site
from runout.errors import ConfigError, ExitCode
from runout.io.places import RESULT_RECORD
from runout.workflow import regional
from runout.workflow.regional import moved, sources_of, write_sources

WEST, NORTH = ramp_site.WEST, ramp_site.NORTH
TEXT = (
    ramp_site.SITE.replace("members: 4", "members: 2")
    .replace("end_time: 20", "end_time: 3")
    .replace("    raster: inputs/thickness.tif\n", "    polygons: inputs/releases.gpkg\n    thickness: depth\n")
)


@pytest.fixture
def site(tmp_path):
    """Two polygons, 4 m and 2 m thick, 150 m apart across the slope."""
    folder = ramp_site.write_site(tmp_path / "valley", TEXT)
    boxes = [shapely.box(WEST + 50, NORTH - y - 40, WEST + 90, NORTH - y) for y in (20, 170)]
    columns = {"name": ["north", "south"], "depth": [4.0, 2.0], "rate": [0.1, 0.01]}
    gpd.GeoDataFrame(columns, geometry=boxes, crs="EPSG:32632").to_file(folder / "inputs" / "releases.gpkg")
    return folder


def changed(site, old, new):
    text = (site / "site.yaml").read_text()
    assert old in text
    (site / "site.yaml").write_text(text.replace(old, new))
    return read_site(site)


def test_each_polygon_runs_as_a_site_of_its_own_and_the_maps_are_merged(site):
    command = ["regional", str(site), "--annual-rate", "rate", "--workers", "2", "--threads", "1", "--device", "cpu"]
    command += ["--set", "ensemble.seed=2"]
    assert cli.main(command) == ExitCode.OK
    folder = site / "regional"
    volumes = {}
    for name, rate in (("north", 0.1), ("south", 0.01)):
        own = read_site(folder / "sources" / name)
        volumes[name] = sum(release.volume for release in own.releases())
        assert own.settings.ensemble.scenarios[0].annual_rate == rate
        assert own.settings.ensemble.seed == 2
        results = folder / "sources" / name / "results"
        assert {path.name for path in results.glob("*.nc")} == {"hazard.nc", "members.nc", "terrain.nc", "release.nc"}
        assert not [*results.glob("maps/**/*.tif"), *results.glob("*.gpkg"), *results.glob("*.qgz"), *results.glob("*.kmz")]
    assert volumes["north"] == pytest.approx(40 * 40 * 4.0)
    assert volumes["south"] == pytest.approx(40 * 40 * 2.0)
    with xr.open_dataset(folder / "merged.nc") as merged:
        assert list(merged["source_name"].values) == ["north", "south"]
        assert set(np.unique(merged["main_source"])) == {0, 1, 2}
        assert float(merged["thickness_annual_exceedance"].max()) == pytest.approx(0.1)
        in_south = merged["thickness_annual_exceedance"].sel(x=WEST + 70, y=NORTH - 190, method="nearest")
        assert float(in_south[0]) == pytest.approx(0.01)
    made = {path: path.stat().st_mtime_ns for path in folder.glob("sources/*/results/**/*.nc")}
    assert cli.main(command) == ExitCode.OK
    assert {path: path.stat().st_mtime_ns for path in made} == made


def test_a_second_call_writes_no_file_of_a_site_again(site):
    places = write_sources(read_site(site), site / "regional")
    files = [path for place in places for path in place.rglob("*") if path.is_file()]
    times = [path.stat().st_mtime_ns for path in files]
    write_sources(read_site(site), site / "regional")
    assert [path.stat().st_mtime_ns for path in files] == times
    assert len(files) == 4


def test_extents_are_derived_again_only_where_an_input_changed(site, monkeypatch):
    derived, own = [], regional._derived
    monkeypatch.setattr(regional, "_derived", lambda content, place: derived.append(place.name) or own(content, place))
    for _ in range(2):
        write_sources(read_site(site), site / "regional")
    assert derived == ["north", "south"]
    ramp_site.write_raster(site / "inputs" / "dem.tif", ramp_site.ramp() + 1.0)
    write_sources(read_site(site), site / "regional")
    assert derived == ["north", "south"] * 2


def test_a_source_with_all_formats_is_asked_for_by_the_site(site):
    own = changed(site, "hazard: {", "hazard: {formats: all, ")
    place = write_sources(own, site / "regional")[0]
    assert read_site(place).settings.hazard.formats == "all"


def test_a_site_of_netcdf_alone_runs_without_a_report_which_is_refused(site, capsys):
    changed(site, "hazard: {", "hazard: {formats: netcdf, ")
    assert cli.main(["run", str(site), "--workers", "1"]) == ExitCode.OK
    assert (site / "results" / "hazard.nc").is_file()
    assert not (site / "results" / "report.html").exists()
    assert cli.main(["report", str(site)]) == ExitCode.CONFIGURATION
    assert "netcdf leaves out the outlines and rasters that the report shows; write `formats: all`" in capsys.readouterr().err


def test_sites_only_runs_nothing(site):
    assert cli.main(["regional", str(site), "--sites-only", "--out", str(site / "elsewhere")]) == ExitCode.OK
    assert not list((site / "elsewhere").rglob(RESULT_RECORD))
    assert len(list((site / "elsewhere").rglob("site.yaml"))) == 2


def test_a_source_reads_the_part_that_it_can_reach(site):
    changed(site, "basal_friction_angle_deg: 20", "basal_friction_angle_deg: 40")
    own = changed(site, "low: 12, high: 22", "low: 38, high: 42")
    ramp_site.write_raster(site / "inputs" / "dem.tif", np.tile(ramp_site.ramp(), (8, 1)))
    whole, north = own.terrain(), read_site(write_sources(own, site / "regional")[0]).terrain()
    assert np.prod(north.shape) < 0.8 * np.prod(whole.shape)
    row, column = (round((a - b) / 10) for a, b in ((whole.extent[3], north.extent[3]), (north.extent[0], whole.extent[0])))
    part = whole.elevation[row : row + north.shape[0], column : column + north.shape[1]]
    np.testing.assert_array_equal(part, north.elevation)


def test_a_source_with_probes_keeps_the_extent_of_the_site(site):
    points = gpd.GeoDataFrame({"name": ["far"]}, geometry=[shapely.Point(WEST + 480, NORTH - 120)], crs="EPSG:32632")
    points.to_file(site / "inputs" / "points.gpkg")
    own = changed(site, "hazard:", "probes: {points: inputs/points.gpkg}\nhazard:")
    place = write_sources(own, site / "regional")[0]
    assert read_site(place).settings.terrain.extent is None
    assert read_site(place).files.probes().points[0].name == "far"


def test_scenarios_go_to_their_release(site):
    text = TEXT.replace("  - name: slab\n", "  - name: slab\n", 1)
    second = "  - {name: other, polygons: inputs/other.gpkg, thickness: 1, placement: on_surface}\nmaterial:"
    (site / "site.yaml").write_text(text)
    gpd.GeoDataFrame(geometry=[shapely.box(WEST + 100, NORTH - 130, WEST + 130, NORTH - 100)], crs="EPSG:32632").to_file(
        site / "inputs" / "other.gpkg"
    )
    scenarios = "  scenarios: [{name: often, return_period: 30, releases: [other]}, {name: rare, return_period: 300}]\nhazard:"
    changed(site, "material:", second)
    sources = sources_of(changed(site, "hazard:", scenarios))
    names = {one.name: [s["name"] for s in one.settings["ensemble"]["scenarios"]] for one in sources}
    assert names == {"north": ["rare"], "south": ["rare"], "other": ["often", "rare"]}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("thickness: depth", "volume: 5000", "one volume for 2 polygons"),
        ("hazard:", "  scenarios: [{name: a, annual_rate: 1, releases: [slab, b]}]\nhazard:", "2 releases fail together"),
    ],
)
def test_releases_that_cannot_stand_alone_are_refused(site, old, new, message):
    second = "  - {name: b, raster: inputs/thickness.tif, placement: on_surface}\nmaterial:"
    changed(site, "material:", second)
    with pytest.raises(ConfigError, match=message):
        sources_of(changed(site, old, new))


@pytest.mark.parametrize(("rate", "message"), [("none", "has no such attribute"), ("bad", "value 0")])
def test_a_missing_or_impossible_rate_is_refused(site, rate, message):
    frame = gpd.read_file(site / "inputs" / "releases.gpkg").assign(bad=[0.0, 1.0])
    frame.to_file(site / "inputs" / "releases.gpkg")
    with pytest.raises(ConfigError, match=message):
        sources_of(read_site(site), rate)


def test_a_faulty_polygon_is_refused_before_any_run_and_named(site, capsys):
    frame = gpd.read_file(site / "inputs" / "releases.gpkg").assign(depth=[4.0, -1.0])
    frame.to_file(site / "inputs" / "releases.gpkg")
    assert cli.main(["regional", str(site), "--workers", "1"]) == ExitCode.CONFIGURATION
    assert "source south: " in capsys.readouterr().err
    assert not list((site / "regional").rglob(RESULT_RECORD))


def test_paths_of_inputs_follow_the_folder(tmp_path):
    content = {"terrain": {"dem": "inputs/dem.tif"}, "release": [{"polygons": "/data/a.gpkg"}, {"raster": "../b.tif"}]}
    new = moved(content, tmp_path / "site", tmp_path / "site" / "regional" / "sources" / "x")
    assert new["terrain"]["dem"] == "../../../inputs/dem.tif"
    assert [one.get("polygons", one.get("raster")) for one in new["release"]] == ["/data/a.gpkg", "../../../../b.tif"]
    assert moved({"terrain": {"dem": "matplotlib:jacksboro_fault_dem"}}, tmp_path, tmp_path / "x")["terrain"]["dem"].startswith(
        "mat"
    )
