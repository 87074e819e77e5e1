"""An erodible bed in site.yaml: what a run gets of it, sampled parameters, products and refusals."""

import json
import re

import numpy as np
import pytest
import xarray as xr
from ramp_site import CELL, COLUMNS, NORTH, ROWS, SITE, WEST, slab, write_raster, write_site

import runout
from runout import RammsErosion, cli
from runout.errors import ConfigError, ExitCode, InputError
from runout.hazard.figures import VOLUMES
from runout.report import sheets, tables
from runout.report.study import read_study
from runout.report.wording import number, quantity
from runout.variables import VARIABLES
from runout.workflow.check import inspect

BED = "bed:\n  depth: 1.2\n  erosion: {law: ramms, rate: 0.05, critical_stress: 1.0e3, depth_per_stress: 1.0e-4}\n"
SAMPLED = "    erosion_rate: {distribution: uniform, low: 0.02, high: 0.08}\n"
WITH_BED = SITE.replace("simulation:", f"{BED}bulking: 0.9\nsimulation:")
ENSEMBLE = WITH_BED.replace("hazard:", f"{SAMPLED}hazard:").replace("members: 4", "members: 2")
PERCENTILES = "percentiles: [50]"
MAPPED = ENSEMBLE.replace(
    PERCENTILES, "percentiles: [5, 50, 95], net_erosion_thresholds: [0.1, 0.25], net_deposition_thresholds: [0.5, 1]"
)


def write_zone(folder):
    """A square of 100 m in the plain, with an attribute."""
    x, y = WEST + 30 * CELL, NORTH - 15 * CELL
    ring = [[x, y], [x + 100, y], [x + 100, y + 100], [x, y + 100], [x, y]]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    feature = {"type": "Feature", "properties": {"dynamic": 0.4}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    text = json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]})
    (folder / "inputs" / "zone.geojson").write_text(text)


def test_member_has_the_bed_with_its_sampled_parameters(tmp_path):
    text = ENSEMBLE.replace("hazard:", "    bed_depth_factor: {distribution: uniform, low: 0.5, high: 2}\nhazard:")
    site = runout.read_site(write_site(tmp_path / "site", text))
    arguments = site.member_arguments({"erosion_rate": 0.03, "bed_depth_factor": 0.5, "bed_density": 1500.0})
    bed = arguments["bed"]
    assert bed.pore_pressure_ratio is None
    assert (bed.depth, bed.density, arguments["bulking"]) == (0.6, 1500.0, 0.9)
    assert bed.erosion == RammsErosion(rate=0.03, critical_stress=1e3, depth_per_stress=1e-4)
    assert site.member_arguments({"bulking": 1.1})["bulking"] == 1.1
    wet = runout.read_site(
        write_site(tmp_path / "wet", text.replace("depth: 1.2\n", "depth: 1.2\n  pore_pressure: {ratio: 0.5}\n"))
    )
    assert wet.member_arguments()["bed"].pore_pressure_ratio == 0.5
    assert wet.member_arguments({"bed_pore_pressure_ratio": 0.7})["bed"].pore_pressure_ratio == 0.7


def test_bed_is_read_from_a_raster_and_from_polygons(tmp_path):
    folder = write_site(tmp_path / "site", WITH_BED.replace("depth: 1.2", "depth: inputs/bed.tif"))
    depth = np.zeros((ROWS, COLUMNS))
    depth[3:8, 20:25] = 0.7
    write_raster(folder / "inputs" / "bed.tif", depth)
    np.testing.assert_allclose(runout.read_site(folder).member_arguments()["bed"].depth, depth, rtol=1e-6)
    write_zone(folder)
    polygons = "polygons: inputs/zone.geojson\n  depth: dynamic"
    (folder / "site.yaml").write_text(WITH_BED.replace("depth: 1.2", polygons))
    bed = runout.read_site(folder).member_arguments()["bed"]
    assert bed.depth.sum() * CELL**2 == pytest.approx(0.4 * 100.0**2)
    (folder / "site.yaml").write_text(WITH_BED.replace("depth: 1.2", "polygons: inputs/zone.geojson\n  layer: zone\n  depth: gone"))
    with pytest.raises(InputError, match=r"site.yaml:\d+: bed.polygons: .*gone"):
        runout.read_site(folder).member_arguments()


@pytest.mark.parametrize(
    ("bed", "words"),
    [
        ("bed: {depth: 1.2}", r"bed.erosion: required key is missing: a depth without erosion; add erosion"),
        ("bed: {erosion: {law: ramms}}", r"bed.depth: required key is missing: erosion without a depth; add depth"),
        ("bed: {depth: 1.2, erosion: {law: jump}}", r"bed.erosion.most: required key is missing; add it: largest erosion rate"),
        ("bed: {depth: 1.2, erosion: {law: rams}}", r"bed.erosion.law: 'rams' is not known; did you mean 'ramms'"),
        ("bed: {depth: 1.2, erosion: {rate: -1}}", r"bed.erosion.rate: -1 m/s is out of range"),
        ("bed: {depth: -1, erosion: {}}", r"bed.depth: -1 m is out of range"),
        ("bed: {depth: 1, layer: x, erosion: {}}", r"bed.layer: has no meaning without polygons"),
        ("bed: {depth: 1, erosion: {growth_rate: 1}}", r"bed.erosion.growth_rate: unknown key; it belongs to law: growth"),
        ("bed: {depth: gone.tif, erosion: {}}", r"bed.depth: there is no file 'gone.tif'"),
        ("bed: {depth: 1, erosion: {}, pore_pressure: {ratio: 0.98}}", r"bed.pore_pressure.ratio: 0.98 is out of range"),
        ("bed: {depth: 1, erosion: {}, pore_pressure: {}}", r"bed.pore_pressure.ratio: required key is missing"),
        ("bed: {density: 1900}", r"bed: states neither depth nor erosion"),
        ("bulking: 0", r"bulking: 0 is out of range"),
    ],
)
def test_bad_beds_are_refused_in_one_line(tmp_path, bed, words):
    with pytest.raises(ConfigError, match=words) as error:
        runout.read_site(write_site(tmp_path / "site", SITE.replace("simulation:", f"{bed}\nsimulation:")))
    assert len(error.value.problems) == 1, error.value


def test_samples_of_a_bed_that_is_not_there_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"erosion_rate: the site has no bed"):
        runout.read_site(write_site(tmp_path / "a", SITE.replace("hazard:", f"{SAMPLED}hazard:")))
    other = ENSEMBLE.replace("erosion_rate:", "erosion_specific_energy:")
    with pytest.raises(ConfigError, match=r"the erosion law ramms has no such parameter; remove it, or use law: energy"):
        runout.read_site(write_site(tmp_path / "b", other))


def test_thresholds_of_a_bed_that_is_not_there_are_refused(tmp_path):
    conditions = f"{PERCENTILES}, eroded_depth_thresholds: [0.5], joint: [{{thickness: 1.0, eroded_depth: 0.5}}]"
    with pytest.raises(ConfigError) as error:
        runout.read_site(write_site(tmp_path / "a", SITE.replace(PERCENTILES, conditions)))
    said = str(error.value)
    assert re.search(r"site.yaml:\d+: hazard.eroded_depth_thresholds: the site has no bed; remove it, or add bed", said)
    assert re.search(r"site.yaml:\d+: hazard.joint: condition 1 has a threshold of eroded_depth, but the site has no bed", said)
    assert len(error.value.problems) == 2
    with pytest.raises(ConfigError, match=r"hazard.net_erosion_thresholds: \[0.5, 0.25\] does not rise"):
        runout.read_site(write_site(tmp_path / "b", MAPPED.replace("[0.1, 0.25]", "[0.5, 0.25]")))


def test_check_names_what_a_bed_loses_and_does_not_resolve(tmp_path):
    excavated = WITH_BED.replace("placement: on_surface", "placement: excavated").replace("depth: 1.2", "depth: 0.3")
    findings = inspect(write_site(tmp_path / "site", excavated))
    assert not findings.problems
    said = [w for w in findings.warnings if "bed.depth" in w]
    assert len(said) == 2
    lost = 0.3 * (slab() > 0).sum() * CELL**2
    assert f"{lost:.4g}".rstrip("0") in said[0].replace(" ", "")
    assert "thinner than one particle (1.25 m)" in said[1]


def test_check_doubts_a_bed_deeper_than_any_and_than_the_relief(tmp_path):
    def said(depth):
        findings = inspect(write_site(tmp_path / f"{depth:g}", WITH_BED.replace("depth: 1.2", f"depth: {depth:g}")))
        return [w for w in findings.warnings if "that can be eroded, in metres" in w]

    (both,) = said(900.0)
    assert re.match(
        r"site.yaml:\d+: bed.depth: depth is 900 m at most, more than 100 m, .* and than the relief of .*dem.tif, 141", both
    )
    (one,) = said(120.0)
    assert "relief" not in one
    assert not said(80.0)


@pytest.mark.parametrize(
    ("bed", "words"),
    [
        ("ramms, critical_stress: 1", r"erosion: critical_stress is 1 Pa, 1000 is typical; check the unit"),
        (
            "ramms, depth_per_stress: 0.1",
            r"depth_per_stress is 0.1 m/Pa, 0.0001 is typical; check the unit: 0.1 m per kPa",
        ),
        ("ramms, depth_per_stress: 1.0e-12", r"depth_per_stress is 1e-12 m/Pa"),
        ("energy, specific_energy: 1.0e-3", r"specific_energy is 0.001 J/kg, 5000 is typical; check the unit"),
    ],
)
def test_check_doubts_the_unit_of_a_parameter_of_erosion(tmp_path, bed, words):
    text = SITE.replace("simulation:", f"bed: {{depth: 1.2, erosion: {{law: {bed}}}}}\nsimulation:")
    assert any(re.search(words, warning) for warning in inspect(write_site(tmp_path / "site", text)).warnings)


def test_check_names_a_bed_that_the_mass_cannot_reach(tmp_path):
    """Behind the release, where no energy line leads; below it the same bed is not named."""
    depth, said = np.zeros((ROWS, COLUMNS)), "none of the bed lies where the mass can come"
    for name, columns, doubted in (("behind", slice(0, 2), True), ("below", slice(20, 22), False)):
        depth[:] = 0.0
        depth[:3, columns] = 2.0
        folder = write_site(tmp_path / name, WITH_BED.replace("depth: 1.2", "depth: inputs/bed.tif"))
        write_raster(folder / "inputs" / "bed.tif", depth)
        assert any(said in warning for warning in inspect(folder).warnings) == doubted


def test_check_counts_cells_without_a_depth_and_names_a_wide_range_of_the_ratio(tmp_path):
    sampled = "    bed_pore_pressure_ratio: {distribution: uniform, low: 0.3, high: HIGH}\nhazard:"
    text = WITH_BED.replace("depth: 1.2", "depth: inputs/bed.tif").replace("hazard:", sampled)
    text = text.replace("depth: inputs/bed.tif\n", "depth: inputs/bed.tif\n  pore_pressure: {ratio: 0.5}\n")
    depth = np.full((ROWS, COLUMNS), 3.0)
    depth[:, :4] = np.nan
    folder = write_site(tmp_path / "site", text.replace("HIGH", "0.7"))
    write_raster(folder / "inputs" / "bed.tif", depth)
    said = inspect(folder).warnings
    assert f"inputs/bed.tif: {4 * ROWS} of {ROWS * COLUMNS} cells of the terrain have no value; they have no bed" in said
    (wide,) = [warning for warning in said if "bed_pore_pressure_ratio: it spans 0.3 to 0.7" in warning]
    assert re.match(r"site.yaml:\d+: ensemble.parameters.bed_pore_pressure_ratio: ", wide)
    assert wide.endswith("narrow it, or read the volumes as their range over the members")
    (folder / "site.yaml").write_text(text.replace("HIGH", "0.6"))
    write_raster(folder / "inputs" / "bed.tif", np.nan_to_num(depth, nan=3.0))
    assert not [warning for warning in inspect(folder).warnings if "it spans" in warning or "have no bed" in warning]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of an ensemble with a bed, two members."""
    folder = write_site(tmp_path_factory.mktemp("bed") / "site", MAPPED + "observations: {difference: {raster: inputs/dod.tif}}\n")
    write_raster(folder / "inputs" / "dod.tif", -slab())
    assert cli.main(["run", str(folder), "--workers", "1"]) == ExitCode.OK
    return folder / "results"


def test_changes_of_elevation_balance_and_maps_are_those_of_the_members(results):
    """The change of elevation of a member is bulking times deposit, minus release and eroded depth; its volume balances."""
    members = xr.open_dataset(results / "members.nc")
    eroded, change, deposit = (members[name].values for name in ("eroded_depth", "elevation_change", "deposit_thickness"))
    assert eroded.max() > 0.1
    np.testing.assert_allclose(change, deposit - slab() - eroded, atol=1e-5)
    grown = slab().sum() + eroded.sum(axis=(1, 2))
    np.testing.assert_allclose(deposit.sum(axis=(1, 2)), 0.9 * grown, rtol=1e-4)
    hazard = xr.open_dataset(results / "hazard.nc")
    np.testing.assert_allclose(hazard["mean_eroded_depth"], eroded.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(hazard["mean_elevation_change"], change.mean(axis=0), atol=1e-5)
    for name, values in (("eroded_depth", eroded), ("net_erosion", -change), ("net_deposition", change)):
        for limit in (0.1, 0.25) if name == "net_erosion" else (0.5, 1.0):
            p = hazard[f"{name}_exceedance_probability"].sel({f"{name}_threshold": limit})
            np.testing.assert_allclose(p, (values >= np.float32(limit)).mean(axis=0), atol=1e-6, err_msg=f"{name} {limit}")
        np.testing.assert_allclose(hazard[f"peak_{name}"], np.maximum(values, 0.0).max(axis=0), atol=1e-6)
    assert float(hazard["net_erosion_exceedance_probability"].max()) == 1.0
    for name, values in (("eroded_depth", eroded), ("elevation_change", change)):
        low, middle, high = (hazard[f"{name}_percentile"].sel(percentile=level).values for level in (5.0, 50.0, 95.0))
        np.testing.assert_array_equal(low, values.min(axis=0))
        np.testing.assert_array_equal(middle, values.min(axis=0), err_msg="two members: the smaller one")
        np.testing.assert_array_equal(high, values.max(axis=0))


def test_the_share_of_the_bed_integrates_to_what_the_flow_took_up(results):
    members, hazard = (xr.open_dataset(results / name) for name in ("members.nc", "hazard.nc"))
    eroded, deposit, share = (members[name].values for name in ("eroded_depth", "deposit_thickness", "bed_share"))
    np.testing.assert_array_equal(np.isnan(share), deposit == 0.0)
    of_bed, mass = np.nan_to_num(share * deposit).sum(axis=0), deposit.sum(axis=0)
    mean = np.where(mass > 0.0, of_bed / np.maximum(mass, 1e-30), np.nan)
    np.testing.assert_allclose(hazard["mean_bed_share"], mean, atol=1e-5)
    np.testing.assert_allclose(np.nan_to_num(share * deposit).sum(axis=(1, 2)), 0.9 * eroded.sum(axis=(1, 2)), rtol=1e-3)


def test_rasters_and_report_of_an_ensemble_with_a_bed_show_its_changes(results):
    maps = results / "maps"
    layers = ("mean_eroded_depth", "mean_elevation_change", "mean_bed_share", "net_erosion_exceedance_probability_over_0.1")
    for name in (*layers, "elevation_change_percentile_5", "eroded_depth_percentile_95", "peak_net_deposition"):
        assert list(maps.rglob(f"{name}.tif")), name
    names = ("mean_elevation_change", *(f"elevation_change_percentile_{level}" for level in (5, 50, 95)))
    scales = {path.read_text() for name in names for path in maps.rglob(f"{name}.qml")}
    assert len(scales) == 1, "one scale for all maps of the change of elevation"
    edges = re.findall(r'<item value="([-.e0-9]+)"', *scales)
    assert float(edges[0]) == -float(edges[-1]) < 0.0
    page = (results / "report.html").read_text()
    assert "volume of the bed that the flow took up" in page
    assert "The bed is eroded at the rate of an empirical law" in page
    assert "takes up no bed" not in page
    (change,) = [sheet for sheet in sheets.printed_sheets(read_study(results)) if sheet.title.startswith("Change of elevation")]
    assert change.top > 0.0
    assert change.style == "difference"


def test_volumes_of_an_ensemble_with_a_bed_balance_in_members_and_key_figures(results):
    study, members = read_study(results), xr.open_dataset(results / "members.nc")
    eroded, page = members["eroded_depth"].values, (results / "report.html").read_text()
    figures = {name: study.valid[name].to_numpy() for name in VOLUMES}
    np.testing.assert_allclose(figures["released_volume"], slab().sum() * CELL**2, rtol=1e-5)
    np.testing.assert_allclose(figures["eroded_volume"], eroded.sum(axis=(1, 2)) * CELL**2, rtol=1e-5)
    grown = figures["released_volume"] + figures["eroded_volume"]
    np.testing.assert_allclose(figures["whole_deposit_volume"], 0.9 * (grown - figures["left_volume"]), rtol=1e-4)
    net = figures["raised_volume"] - figures["lowered_volume"]
    np.testing.assert_allclose(net, figures["whole_deposit_volume"] - grown, rtol=1e-4)
    cards = {label: (value, remark) for label, value, remark in tables.key_figures(study)}
    assert cards["Eroded, median"][0] == quantity(figures["eroded_volume"].min(), "m³"), "two members: the smaller one"
    low, high = number(figures["eroded_volume"].min()), quantity(figures["eroded_volume"].max(), "m³")
    assert cards["Eroded, median"][1].endswith(f"{low} to {high} in 90 % of the members")
    assert cards["Left the site, median"][1].endswith("; the same in 90 % of the members")
    assert {label: remark for label, _, remark in tables.volumes(study.valid[:1])}["Eroded"] == VARIABLES["eroded_volume"].long_name
    assert {"Released, median", "Deposited, median", "Left the site, median"} <= cards.keys()
    assert "Eroded, median" in page
    assert tables.balance(study)["mass"].startswith(("exactly", "to 1e-1", "to 2e-1", "to 3e-1")), "mass of the bed is no error"
    assert max(map(tables.energy_residual, study.ledgers.values())) < 0.2


def test_site_without_a_bed_has_no_maps_of_one(tmp_path):
    folder = write_site(tmp_path / "site", SITE.replace("members: 4", "members: 1"))
    assert cli.main(["run", str(folder), "--workers", "1"]) == ExitCode.OK
    assert "eroded_depth" not in xr.open_dataset(folder / "results" / "members.nc")
    assert "mean_elevation_change" not in xr.open_dataset(folder / "results" / "hazard.nc")
    assert "The mass takes up no bed material" in (folder / "results" / "report.html").read_text()
