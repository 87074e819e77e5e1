"""An inflow in site.yaml: what a run gets of it, sampled parameters, check, products and refusals."""

import json
import re

import geopandas as gpd
import numpy as np
import pytest
import shapely
import xarray as xr
from ramp_site import NORTH, SITE, WEST, write_site

import runout
from runout import cli
from runout.ensemble.member import plan_members
from runout.errors import ConfigError, ExitCode, InputError
from runout.workflow.check import inspect
from runout.workflow.plan import particle_count

X, Y = WEST + 90.0, NORTH - 120.0  # middle of the line, on the slope
LINE = [[X, Y - 30.0], [X, Y + 30.0]]
SQUARE = [[X - 10, Y - 10], [X + 10, Y - 10], [X + 10, Y + 10], [X - 10, Y + 10], [X - 10, Y - 10]]
SERIES = "time [s],discharge [m3/s]\n0,0\n2,2000\n6,2000\n8,0\n"
VOLUME = 12_000.0
INFLOW = "inflow:\n  - name: gauge\n    line: inputs/gauge.geojson\n    hydrograph: inputs/q.csv\n    thickness: 6\n"
RELEASE = SITE[SITE.index("release:") : SITE.index("material:")]
WITH_RELEASE = SITE.replace("simulation:", f"{INFLOW}simulation:")
ALONE = WITH_RELEASE.replace(RELEASE, "")
BED = "bed: {depth: 1, erosion: {}, pore_pressure: {ratio: 0.5}}\n"
CLAY = "    material: {law: von_mises, density: 1800, undrained_strength: 2000}\n"
SAMPLED = """\
    discharge_factor: {distribution: uniform, low: 0.5, high: 2}
    inflow_delay: {distribution: uniform, low: 0, high: 4}
"""
ENSEMBLE = ALONE.replace("hazard:", f"{SAMPLED}hazard:").replace("members: 4", "members: 2")


def write_inputs(folder, line=LINE, series=SERIES, kind="LineString"):
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": kind, "coordinates": line}}
    text = json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]})
    (folder / "inputs" / "gauge.geojson").write_text(text)
    (folder / "inputs" / "q.csv").write_text(series)
    return folder


def site_of(folder, text=ALONE, **inputs):
    return write_inputs(write_site(folder, text), **inputs)


def test_member_has_the_inflow_with_its_sampled_parameters(tmp_path):
    site = runout.read_site(site_of(tmp_path / "site", ENSEMBLE))
    (one,) = site.member_arguments()["inflow"]
    assert (one.name, one.thickness, one.hydrograph.volume) == ("gauge", 6.0, VOLUME)
    np.testing.assert_allclose(one.direction, [1.0, 0.0], atol=1e-9)
    assert site.member_arguments()["release"] == []
    (other,) = site.member_arguments({"discharge_factor": 0.5, "inflow_delay": 3.0})["inflow"]
    assert (other.hydrograph.volume, other.hydrograph.begin) == (0.5 * VOLUME, 3.0)
    assert set(site.resolved()) >= {"inflow"}
    assert [p.name for p in site.inputs()][-2:] == ["gauge.geojson", "q.csv"]


def test_own_friction_and_pore_pressure_count(tmp_path):
    own = "    basal_friction_angle_deg: 15\n    pore_pressure: {ratio: 0.5, decay_time: 20}\n"
    text = ALONE.replace("    thickness: 6\n", "    thickness: 6\n" + own).replace("low: 12, high: 22", "low: 1900, high: 2100")
    text = text.replace("    basal_friction_angle_deg: {dist", "    density: {dist")
    site = runout.read_site(site_of(tmp_path / "site", text))
    (one,) = site.member_arguments()["inflow"]
    assert one.basal_friction_angle == pytest.approx(np.radians(15.0))
    assert one.pore_pressure.ratio == 0.5
    (mass,) = site.masses()
    assert mass.pore_pressure.ratio == 0.5


def test_own_material_is_that_of_the_entered_mass(tmp_path):
    """Some parameters of the law of the site, or a law of its own; the ensemble samples one of it alone."""
    own = "    thickness: 6\n    material: {density: 1500}\n"
    site = runout.read_site(site_of(tmp_path / "some", ALONE.replace("    thickness: 6\n", own)))
    (one,) = site.member_arguments({"gauge.density": 1600.0})["inflow"]
    assert (site.inflows()[0].material.density, one.material.density) == (1500.0, 1600.0)
    assert one.material.friction_angle == site.material().friction_angle
    own = own.replace("{density: 1500}", "{law: herschel_bulkley, density: 1800, yield_stress: 500, consistency: 100}")
    folder = site_of(tmp_path / "law", WITH_RELEASE.replace("    thickness: 6\n", own))
    site = runout.read_site(folder)
    assert [m.density for m in site.materials(site.masses())] == [site.material().density, 1800.0]
    assert inspect(folder).problems == []
    result = runout.simulate(**site.member_arguments() | {"end_time": 9.0})
    assert result.ledger["entered_mass"].values[-1] == pytest.approx(1800.0 * VOLUME, rel=1e-7)  # masses of particles are float32


def test_a_polygon_and_velocities_are_read(tmp_path):
    text = ALONE.replace("line: inputs", "polygon: inputs").replace("    thickness: 6\n", "")
    site = runout.read_site(site_of(tmp_path / "polygon", text, line=[SQUARE], kind="Polygon"))
    (one,) = site.inflows()
    assert one.polygon.area == pytest.approx(400.0)
    series = "time,discharge,velocity\n0,100,4\n9,100,5\n"
    site = runout.read_site(site_of(tmp_path / "line", ALONE.replace("    thickness: 6\n", ""), series=series))
    (one,) = site.inflows()
    assert one.hydrograph.velocity.tolist() == [4.0, 5.0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("    line: inputs/gauge.geojson\n", "", r"inflow\[0\]: neither line nor polygon is given; give one of them"),
        ("    thickness", "    polygon: inputs/gauge.geojson\n    thickness", r"inflow\[0\]: line and polygon are both given"),
        ("line: inputs", "polygon: inputs", r"inflow\[0\].thickness: has no meaning with a polygon"),
        ("    hydrograph: inputs/q.csv\n", "", r"inflow\[0\].hydrograph: required key is missing"),
        ("inputs/q.csv", "inputs/p.csv", r"inflow\[0\].hydrograph: there is no file 'inputs/p.csv'; did you mean 'inputs/q.csv'"),
        ("thickness: 6", "thickness: 0", r"inflow\[0\].thickness: 0 m is out of range"),
        ("thickness: 6", "basal_friction_angle_deg: 0.3", r"inflow\[0\].basal_friction_angle_deg: .*suspiciously small"),
        (INFLOW, "", r"release: required key is missing; add it: .* or inflow"),
        (INFLOW, "inflow: []\n", r"inflow: .*"),
    ],
)
def test_settings_that_cannot_be_used_are_refused(tmp_path, old, new, words):
    with pytest.raises(ConfigError, match=words):
        runout.read_site(site_of(tmp_path / "site", ALONE.replace(old, new)))


def test_names_are_unique_and_samples_need_an_inflow(tmp_path):
    with pytest.raises(ConfigError, match=r"inflow\[0\].name: two masses are called 'slab'"):
        runout.read_site(site_of(tmp_path / "name", WITH_RELEASE.replace("name: gauge", "name: slab")))
    text = SITE.replace("hazard:", f"{SAMPLED}hazard:")
    with pytest.raises(ConfigError, match=r"parameters.discharge_factor: the site has no inflow; remove it, or add inflow"):
        runout.read_site(site_of(tmp_path / "sample", text))


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ({"series": "time,discharge\n0,1\n1,-2\n"}, r"inflow\[0\].hydrograph: inputs/q.csv:3: discharge: is -2 m3/s"),
        ({"series": "time,q\n0,1\n"}, r"inflow\[0\].hydrograph: inputs/q.csv:1: there is no column discharge"),
        (
            {"series": "time,discharge,velocity\n0,1,1\n1,1,1\n"},
            r"inflow\[0\].thickness: inputs/q.csv: thickness and the velocities .* both given",
        ),
        ({"line": [[X, Y], [X, NORTH + 90.0]]}, r"inflow\[0\].line: inputs/gauge.geojson.*lies outside"),
        ({"line": [SQUARE], "kind": "Polygon"}, r"inflow\[0\].line: .*is a Polygon, not a single line"),
        ({"line": [[X, Y], [X, Y]]}, r"inflow\[0\].line: .*1 different vertex"),
    ],
)
def test_files_that_cannot_be_used_are_refused_with_their_setting(tmp_path, inputs, words):
    folder = site_of(tmp_path / "site", **inputs)
    with pytest.raises(InputError, match=rf"site.yaml:\d+: {words}"):
        runout.read_site(folder).member_arguments()
    found = inspect(folder)
    assert any(text for text in found.problems if "inflow[0]" in text), found.problems
    assert len(found.problems) == 1


def test_a_line_without_thickness_and_velocity_is_refused_at_the_hydrograph(tmp_path):
    (said,) = inspect(site_of(tmp_path / "site", ALONE.replace("    thickness: 6\n", ""))).problems
    assert re.match(r"site.yaml:\d+: inflow\[0\].hydrograph: inputs/q.csv: neither thickness nor velocity is given; add", said)


def test_faults_of_inflow_and_bed_are_told_beside_those_of_settings(tmp_path):
    text = ALONE.replace("simulation:", "bed: {depth: inputs/gauge.geojson, erosion: {}}\nsimulation:")
    text = text.replace("hazard:", "hazzard:")
    found = inspect(site_of(tmp_path / "site", text, series="time,discharge\n0,1\nx,2\n1,-2\n"))
    for said in ("hazzard: unknown key", "q.csv:3: time: 'x' is no number", "q.csv:4: discharge: is -2 m3/s", "bed.depth"):
        assert [said in problem for problem in found.problems].count(True) == 1, said
    assert len(found.problems) == 4


def uniform(*keys):
    return "".join(f"    {key}: {{distribution: uniform, low: 20, high: 30}}\n" for key in keys)


def test_samples_that_no_inflow_has_a_use_of_are_refused_where_there_is_no_release(tmp_path):
    text = ALONE.replace(INFLOW, f"{INFLOW}{CLAY}    basal_friction: {{law: voellmy, mu: 0.1, xi: 300}}\n")
    text = text.replace("hazard:", uniform("friction_angle_deg", "release_volume_factor", "gauge.start_time") + "hazard:")
    found = inspect(site_of(tmp_path / "site", text))
    said = {problem.partition("parameters.")[2].partition(": ")[0]: problem for problem in found.problems}
    assert set(said) == {"basal_friction_angle_deg", "friction_angle_deg", "release_volume_factor", "gauge.start_time"}
    assert "every release and inflow has a material of its own, so that this changes nothing" in said["friction_angle_deg"]
    assert "the site has no release; remove it, or sample discharge_factor" in said["release_volume_factor"]
    assert "gauge is an inflow, which starts as its hydrograph states" in said["gauge.start_time"]


def test_a_sample_that_an_inflow_has_a_use_of_is_not_refused(tmp_path):
    text = WITH_RELEASE.replace("  - name: slab\n", f"  - name: slab\n{CLAY}")
    text = text.replace("hazard:", uniform("friction_angle_deg") + "hazard:")
    assert not inspect(site_of(tmp_path / "site", text), forecast=False).problems


def test_a_mass_that_cannot_be_read_hides_no_fault_of_others_above_a_bed(tmp_path):
    second = "  - name: second\n    line: inputs/gauge.geojson\n    hydrograph: inputs/gauge.geojson\n    thickness: 6\n"
    text = WITH_RELEASE.replace(INFLOW, f"{INFLOW}{second}").replace("simulation:", f"{BED}simulation:")
    text = text.replace("particles_per_cell: 8, ", "")
    found = inspect(site_of(tmp_path / "site", text, line=[[X, Y - 1.0], [X, Y + 1.0]]), forecast=False)
    assert ["inflow[0].line" in problem for problem in found.problems].count(True) == 1, found.problems
    assert ["inflow[1].hydrograph" in problem for problem in found.problems].count(True) == 1, found.problems


def test_check_refuses_a_hydrograph_of_which_nothing_enters(tmp_path):
    late = "time,discharge\n30,0\n40,5\n"
    (said,) = inspect(site_of(tmp_path / "site", WITH_RELEASE, series=late)).problems
    words = "nothing of inflow gauge enters: its discharge lasts from 30 to 40 s, the run from 0 to 20 s; shift its times"
    assert re.match(r"site.yaml:\d+: inflow\[0\].hydrograph: inputs/q.csv: " + words, said)


@pytest.mark.parametrize(("high", "refused"), [(90, True), (18, False)])
def test_check_knows_the_largest_sampled_delay(tmp_path, high, refused):
    folder = site_of(tmp_path / "site", ENSEMBLE.replace("low: 0, high: 4", f"low: {high - 10}, high: {high}"))
    latest = max(member.parameters["inflow_delay"] for member in plan_members(runout.read_site(folder)))
    found = inspect(folder, forecast=False)
    if refused:
        (said,) = found.problems
        assert f"nothing of inflow gauge enters with inflow_delay {latest:.4g}, the largest: its discharge lasts from" in said
    else:
        (said,) = [warning for warning in found.warnings if "do not enter" in warning]
        assert said.endswith(f"or cut the hydrograph; with inflow_delay {latest:.4g}, the largest")


def test_doubts_of_the_water_in_an_inflow_name_its_line(tmp_path):
    wet = "    pore_pressure: {ratio: {low: 0.1, high: 0.6, block: 900}, decay_time: 20}\n"
    folder = site_of(tmp_path / "site", ALONE.replace(INFLOW, INFLOW + wet))
    line = (folder / "site.yaml").read_text().splitlines().index(wet.rstrip("\n")) + 1
    said = f"site.yaml:{line}: inflow[0].pore_pressure: ratio: block is 900 m, the mass 60 m: one or few ratios"
    assert [warning.startswith(said) for warning in inspect(folder, forecast=False).warnings].count(True) == 1


def test_a_dry_inflow_over_a_wet_bed_is_named(tmp_path):
    folder = site_of(tmp_path / "site", ALONE.replace("simulation:", f"{BED}simulation:"))
    warnings = inspect(folder, forecast=False).warnings
    assert ["pore_pressure is 0.5, but gauge is dry, and so is what joins dry mass" in text for text in warnings].count(True) == 1


def test_check_warns_of_a_line_down_the_fall_and_not_of_one_across_a_channel(tmp_path):
    down = site_of(tmp_path / "down", line=[[X, Y], [X + 60.0, Y + 5.0]])
    (said,) = [warning for warning in inspect(down).warnings if "along the line" in warning]
    assert re.search(
        r"inputs/gauge.geojson: the ground falls by 0.5[78] along the line of inflow gauge.* draw it across the fall", said
    )
    oblique = site_of(tmp_path / "oblique", line=[[X, Y], [X + 30.0, Y + 40.0]])  # nearer to the contour than to the fall
    assert not [warning for warning in inspect(oblique).warnings if "along the line" in warning]


def test_a_discharge_too_fast_for_its_line_is_refused_with_its_remedy(tmp_path):
    folder = site_of(tmp_path / "site", series="time,discharge\n0,0\n5,9e5\n8,0\n")
    said = r"site.yaml:\d+: inflow\[0\].line: inputs/gauge.geojson: 900000 m3/s over a line of 60 m, 6 m thick, flow at 2500 m/s, "
    with pytest.raises(ConfigError, match=said + r"at most 200 can be computed; check the unit of the discharge, or give a larger"):
        runout.read_site(folder).member_arguments()


def test_a_line_narrower_than_a_cell_is_named_by_its_key(tmp_path):
    (said,) = inspect(site_of(tmp_path / "site", line=[[X, Y - 1.0], [X, Y + 1.0]])).problems
    assert re.match(r"site.yaml:\d+: inflow\[0\].line: inputs/gauge.geojson: the line of inflow gauge is 2 m wide", said)


def test_check_says_volume_peak_and_resolution(tmp_path, capsys):
    assert cli.main(["check", str(site_of(tmp_path / "site"))]) == ExitCode.OK
    said = " ".join(capsys.readouterr().out.split())
    assert "gauge: 1.2e+04 m3 from 0 to 8 s, at most 2000 m3/s; line of 60 m (6 cells), 6 m thick at most (0.6 cells)" in said
    assert "particles" in said
    found = inspect(site_of(tmp_path / "short", ALONE.replace("end_time: 20", "end_time: 5")))
    assert any("goes on until 8 s, the run ends at 5 s: 4000 m3 of 1.2e+04 m3 do not enter" in text for text in found.warnings)
    found = inspect(site_of(tmp_path / "narrow", line=[[X, Y], [X, Y + 5.0]]))
    assert any("is 5 m wide, less than a cell of 10 m; draw it wider" in text for text in found.problems)


def test_a_site_with_an_inflow_alone_has_all_products(tmp_path):
    """Two members with half and twice the discharge: maps, balances, record and report."""
    folder = site_of(tmp_path / "site", ENSEMBLE.replace("end_time: 20", "end_time: 20, backend: reference"))
    assert cli.main(["run", str(folder), "--quiet", "--workers", "1"]) == ExitCode.OK
    results = folder / "results"
    with xr.open_dataset(results / "hazard.nc") as hazard, xr.open_dataset(results / "members.nc") as members:
        assert float(np.nanmax(hazard["peak_flow_thickness"])) > 1.0
        assert float(np.nansum(hazard["release_thickness"])) == 0.0
        assert float(np.nanmax(hazard["inflow_thickness"])) == pytest.approx(6.0)
        assert set(members) >= {"discharge_factor", "inflow_delay"}
        factors = members["discharge_factor"].values
    volumes = []
    for path in sorted((results / "members").glob("*.nc")):
        with xr.open_datatree(path) as member:
            volumes.append(float(member["ledger"]["entered_mass"][-1]) / 2000.0)
            assert member.attrs["inflow_volume"] == pytest.approx(volumes[-1], rel=1e-6)
    np.testing.assert_allclose(sorted(volumes), sorted(VOLUME * factors), rtol=1e-6)
    record = json.loads((results / "run.json").read_text())
    assert record["inflows"][0]["volume"] == VOLUME
    report = (results / "report.html").read_text()
    assert re.search(r"Inflow gauge: 12\W000\W*m³ from 0 to 8\W*s, at most 2\W000", report)
    assert "Inflow volume" in report
    assert "Released volume" not in report
    lines = gpd.read_file(results / "outlines.gpkg", layer="inflow_lines")
    assert (lines["name"].tolist(), lines["volume_m3"].tolist()) == (["gauge"], [VOLUME])


def test_release_and_inflow_run_together(tmp_path):
    text = WITH_RELEASE.replace("members: 4", "members: 1").replace("end_time: 20", "end_time: 9, backend: reference")
    folder = site_of(tmp_path / "site", text)
    assert cli.main(["run", str(folder), "--quiet", "--workers", "1"]) == ExitCode.OK
    record = json.loads((folder / "results" / "run.json").read_text())
    assert [mass["name"] for mass in record["releases"]["masses"]] == ["slab"]
    assert [one["name"] for one in record["inflows"]] == ["gauge"]


def test_the_member_with_the_largest_discharge_is_forecast(tmp_path):
    """Particles of an inflow are counted with those of its largest factor on the discharge."""
    stated = particle_count(runout.read_site(site_of(tmp_path / "stated", ALONE)))
    sampled = runout.read_site(site_of(tmp_path / "sampled", ENSEMBLE))
    factor = max(member.parameters["discharge_factor"] for member in plan_members(sampled))
    assert stated == pytest.approx(VOLUME / 10.0**3 * 8, abs=1)
    assert particle_count(sampled) == pytest.approx(factor * stated, abs=1)


def test_check_refuses_a_structure_where_mass_enters_and_doubts_a_flow_that_creeps(tmp_path):
    house = "structures:\n  - {file: inputs/house.gpkg, height: 5}\nsimulation:"
    folder = site_of(tmp_path / "house", ALONE.replace("simulation:", house))
    walls = shapely.box(X - 30, Y - 40, X + 30, Y + 40)
    gpd.GeoDataFrame({"name": ["house"]}, geometry=[walls], crs="EPSG:32632").to_file(folder / "inputs" / "house.gpkg")
    (said,) = [problem for problem in inspect(folder).problems if "overlaps" in problem]
    assert re.search(
        r"the structure 'house' overlaps inflow gauge on \d+ cells, .*; move one of them, or cut the inflow back", said
    )
    creeping = inspect(site_of(tmp_path / "slow", series="time,discharge\n0,5\n9,5\n")).warnings
    assert any("inflow gauge enters at 0.01389 m/s at most; debris flows are faster than 0.05 m/s" in one for one in creeping)


def test_the_baseline_says_that_it_needs_a_release(tmp_path, capsys):
    pytest.importorskip("landlab")
    folder = site_of(tmp_path / "site")
    assert cli.main(["screen", str(folder)]) == ExitCode.CONFIGURATION
    said = " ".join(capsys.readouterr().err.split())
    assert "the baseline starts from releases, and the site has an inflow alone; state a release" in said
