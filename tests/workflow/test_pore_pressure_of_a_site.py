"""Pore pressure in site.yaml and Python: settings, samples, rasters and blocks, checks and refusals, forecasts, a run."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from ramp_site import CELL, NORTH, SITE, WEST, slab, write_raster, write_site

import runout
from runout import PorePressure, RatioZones
from runout.config.parameter_variables import parameter_variable
from runout.errors import ConfigError, InputError, ReleaseError
from runout.forecast.memory import expected_extent, pore_bytes
from runout.forecast.stiffness import chosen_moduli
from runout.model.numerics import Numerics
from runout.simulation.scenario import build_scene
from runout.workflow.check import inspect
from runout.workflow.check_physics import least_friction

PLACED = "    placement: on_surface\n"
SAMPLED = "    basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}\n"


def with_pores(stated, sampled=""):
    return SITE.replace(PLACED, f"{PLACED}    pore_pressure: {stated}\n").replace(SAMPLED, SAMPLED + sampled)


NUMBER = with_pores(
    "{ratio: 0.7, saturation: 1.0, diffusivity: 1.0e-3}",
    "    pore_pressure_ratio: {distribution: uniform, low: 0.6, high: 0.9}\n"
    "    pore_pressure_diffusivity: {distribution: uniform, low: 1.0e-4, high: 1.0e-2}\n",
)
BLOCKS = with_pores("{ratio: {low: 0.4, high: 0.8, block: 20}, saturation: 0.5, decay_time: 5}")
RASTER = with_pores("{ratio: inputs/ratio.tif, decay_time: 5.0}")


def pores_of(site, sample=None):
    (release,) = site.member_arguments(sample)["release"]
    return release.pore_pressure


def particles_of(site, sample=None):
    """Pore pressure ratio of each particle at the start, and local positions (n, 3) [m]."""
    arguments = site.member_arguments(sample)
    chosen = {name: arguments[name] for name in ("terrain", "release", "material", "basal_friction_angle")}
    scene, p = build_scene(**chosen, numerics=Numerics.of(arguments))
    return p.pore_excess + scene.pore_table()["equilibrium"][0], p.position(np.array(scene.spacing))


def test_numbers_of_a_site_are_those_of_its_members(tmp_path):
    site = runout.read_site(write_site(tmp_path / "site", NUMBER))
    stated = pores_of(site)
    assert (stated.ratio, stated.saturation, stated.diffusivity, stated.decay_time) == (0.7, 1.0, 1e-3, None)
    drawn = pores_of(site, {"pore_pressure_ratio": 0.8, "pore_pressure_diffusivity": 5e-3})
    assert (drawn.ratio, drawn.saturation, drawn.diffusivity) == (0.8, 1.0, 5e-3)
    assert parameter_variable("pore_pressure_diffusivity").units == "m2 s-1"
    ratios, _ = particles_of(site, {"pore_pressure_ratio": 0.8})
    assert ratios == pytest.approx(0.8)


def test_blocks_are_drawn_by_the_seed_of_a_member(tmp_path):
    site = runout.read_site(write_site(tmp_path / "site", BLOCKS))
    (first, x), (again, _), (other, _) = (particles_of(site, {"seed": seed}) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert 0.4 <= first.min() < first.max() - 0.1 <= 0.7
    blocks = np.unique(np.floor(x[:, :2] / 20.0), axis=0, return_inverse=True)[1].ravel()
    assert all(np.ptp(first[blocks == b]) == 0.0 for b in range(blocks.max() + 1))


def test_a_raster_of_ratios_reaches_the_particles_of_its_cells(tmp_path):
    folder, ratio = write_site(tmp_path / "site", RASTER), np.full(slab().shape, 0.3)
    ratio[:, 8:] = 0.6
    write_raster(folder / "inputs" / "ratio.tif", ratio)
    site = runout.read_site(folder)
    found, x = particles_of(site)
    inside = np.abs(x[:, 0] - 80.0) > 1.0
    np.testing.assert_allclose(found[inside], np.where(x[inside, 0] > 80.0, 0.6, 0.3), rtol=1e-6)
    assert any(path.name == "ratio.tif" for path in site.inputs())
    write_raster(folder / "inputs" / "ratio.tif", np.where(slab() > 0, 1.3, 0.0))
    with pytest.raises(InputError, match=r"site.yaml.*pore_pressure.ratio.*1.3"):
        runout.read_site(folder).releases()


def write_zones(folder, *, second=(0.5, 1.0)):
    """Two zones of the slab, its western and eastern part, with an attribute; the second from a share of its width on."""
    rows, columns = np.nonzero(slab() > 0)
    west, east = WEST + columns.min() * CELL, WEST + (columns.max() + 1) * CELL
    north, south = NORTH - rows.min() * CELL, NORTH - (rows.max() + 1) * CELL
    features = []
    for (low, high), ratio in (((0.0, 0.5), 0.3), (second, 0.8)):
        a, b = west + low * (east - west), west + high * (east - west)
        ring = [[a, south], [b, south], [b, north], [a, north], [a, south]]
        geometry = {"type": "Polygon", "coordinates": [ring]}
        features.append({"type": "Feature", "properties": {"water": ratio}, "geometry": geometry})
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    text = json.dumps({"type": "FeatureCollection", "crs": crs, "features": features})
    (folder / "inputs" / "wet.geojson").write_text(text)
    return 0.5 * (west + east) - WEST  # local easting of the line between them


def zoned(stated, sampled=""):
    return with_pores(f"{{ratio: {{polygons: inputs/wet.geojson, {stated}}}, decay_time: 5}}", sampled)


def write_zoned(folder, text, **choices):
    return write_site(folder, text), write_zones(folder, **choices)


def test_zones_give_their_ratio_to_the_particles_of_their_cells(tmp_path):
    folder, line = write_zoned(tmp_path / "site", zoned("ratio: water"))
    site = runout.read_site(folder)
    ratios, x = particles_of(site)
    inside = np.abs(x[:, 0] - line) > 1.0
    np.testing.assert_allclose(ratios[inside], np.where(x[inside, 0] > line, 0.8, 0.3), rtol=1e-12)
    assert any(path.name == "wet.geojson" for path in site.inputs())
    again = particles_of(site, {"pore_pressure_ratio": 0.6})[0]
    np.testing.assert_array_equal(again, ratios, err_msg="an attribute is not sampled")


def test_ratios_of_zones_are_sampled_and_drawn_by_the_seed(tmp_path):
    sampled = "    pore_pressure_ratio: {distribution: uniform, low: 0.6, high: 0.9}\n"
    sampled += "    pore_pressure_ratio_elsewhere: {distribution: uniform, low: 0.1, high: 0.2}\n"
    text = zoned("ratio: 0.7, elsewhere: 0.1", sampled)
    folder, line = write_zoned(tmp_path / "site", text, second=(0.5, 0.75))
    ratios, x = particles_of(runout.read_site(folder), {"pore_pressure_ratio": 0.65, "pore_pressure_ratio_elsewhere": 0.15})
    assert set(np.round(np.unique(ratios), 12)) == {0.15, 0.65}
    assert ratios[x[:, 0] < line].min() == pytest.approx(0.65)
    assert inspect(folder).problems == []

    folder, line = write_zoned(tmp_path / "drawn", zoned("low: 0.2, high: 0.9"))
    site = runout.read_site(folder)
    (first, x), (again, _), (other, _) = (particles_of(site, {"seed": seed}) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    west, east = first[x[:, 0] < line - 1.0], first[x[:, 0] > line + 1.0]
    assert np.ptp(west) < 1e-15 > np.ptp(east), "one ratio for each zone"
    assert 0.2 <= first.min() < first.max() <= 0.9
    assert set(np.unique(other)).isdisjoint(np.unique(first)), "another member draws other ratios"
    assert (pores_of(site).lowest, pores_of(site).highest) == (0.2, 0.9)
    drawn = particles_of(site, {"seed": 1, "pore_pressure_ratio_low": 0.9})[0]
    assert drawn == pytest.approx(0.9)


def test_zones_are_read_in_python_as_in_a_site(tmp_path):
    folder, _ = write_zoned(tmp_path / "site", zoned("ratio: water, elsewhere: 0.1"))
    terrain = runout.read_site(folder).terrain()
    zones = RatioZones.from_vector(folder / "inputs" / "wet.geojson", terrain, "water", elsewhere=0.1)
    np.testing.assert_array_equal(zones.on_cells((0,)), pores_of(runout.read_site(folder)).ratio.on_cells((0,)))
    assert set(np.unique(zones.on_cells((0,)))) == {0.1, 0.3, 0.8}
    with pytest.raises(InputError, match=r"wet.geojson: no attribute 'lambda' for the ratio"):
        RatioZones.from_vector(folder / "inputs" / "wet.geojson", terrain, "lambda")


def test_check_says_what_readers_of_ratios_assumed(tmp_path):
    folder = write_site(tmp_path / "raster", with_pores("{ratio: inputs/ratio.tif, decay_time: 5}"))
    write_raster(folder / "inputs" / "ratio.tif", np.where(slab() > 0, 0.5, 0.4), crs=None)
    (said,) = [warning for warning in inspect(folder).warnings if "ratio.tif" in warning]
    assert said.startswith(
        "site.yaml:9: release[0].pore_pressure: inputs/ratio.tif states no coordinate system; taken to be in the terrain's"
    )
    folder, _ = write_zoned(tmp_path / "zones", zoned("ratio: 0.5"))
    text = json.loads((folder / "inputs" / "wet.geojson").read_text())
    far = [[[x + 1e4, y] for x, y in text["features"][0]["geometry"]["coordinates"][0]]]
    text["features"].append({"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": far}})
    (folder / "inputs" / "wet.geojson").write_text(json.dumps(text))
    (said,) = [warning for warning in inspect(folder).warnings if "wet.geojson" in warning]
    assert said.startswith(
        "site.yaml:9: release[0].pore_pressure: inputs/wet.geojson: zones 3 cover no cell of the terrain to a half"
    )


def test_mass_beyond_all_zones_and_zones_beside_the_mass_are_told(tmp_path):
    folder, _ = write_zoned(tmp_path / "site", zoned("ratio: 0.7"), second=(0.5, 0.75))
    said = " ".join(map(str, inspect(folder).problems))
    assert re.search(r"site.yaml:\d+: .*pore_pressure.ratio: .*cells of the release in all; give elsewhere", said)
    folder, _ = write_zoned(tmp_path / "overlap", zoned("ratio: water"), second=(0.4, 1.0))
    said = " ".join(map(str, inspect(folder).problems))
    assert re.search(r"polygons 1 \(0.3\) and 2 \(0.8\) overlap .* so that every place has one ratio", said)
    folder, _ = write_zoned(tmp_path / "unknown", zoned("ratio: wet"))
    said = " ".join(map(str, inspect(folder).problems))
    assert re.search(r"no attribute 'wet' for the ratio", said)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("polygons: inputs/wet.geojson", "neither ratio nor low and high are given; give ratio, or low and high"),
        ("polygons: inputs/wet.geojson, low: 0.2", "low is given alone; give ratio, or low and high"),
        ("polygons: inputs/wet.geojson, ratio: 0.5, low: 0.2, high: 0.4", "ratio.low: ratio is given too; give ratio, or low"),
        ("polygons: inputs/wet.geojson, low: 0.5, high: 0.4", r"low: low \(0.5\) is above high \(0.4\); exchange them"),
        ("polygons: inputs/wet.geojson, ratio: 0.99", "ratio.ratio: 0.99 is out of range"),
        ("polygons: inputs/none.geojson, ratio: 0.5", "ratio.polygons: there is no file"),
        ("polygons: inputs/wet.geojson, ratio: 0.5, block: 10", "block and polygons are both given; give block, or polygons"),
        ("ratio: 0.5", "neither block nor polygons is given"),
        ("low: 0.2, high: 0.4, block: 10, elsewhere: 0.1", "ratio.elsewhere: has no meaning without polygons"),
        ("low: 0.2, block: 10", "ratio.high: required key is missing; give low and high"),
        ("low: 0.2, hihg: 0.4, polygons: inputs/wet.geojson, ratio: 0.3", "ratio.hihg: unknown key; did you mean 'high'"),
    ],
)
def test_wrong_zones_are_refused_with_key_and_remedy(tmp_path, stated, said):
    text = with_pores(f"{{ratio: {{{stated}}}, decay_time: 5}}")
    with pytest.raises(ConfigError, match=said) as error:
        runout.read_site(write_zoned(tmp_path / "site", text)[0])
    assert re.search(r"site.yaml:\d+: release\[0\].pore_pressure.ratio", str(error.value))


def test_zones_in_python_are_checked():
    zone = np.full((12, 60), -1)
    zone[4:8, 4:7], zone[4:8, 7:10] = 0, 1
    stated = RatioZones(zone=zone, ratio=np.array([0.2, 0.6]))
    _, release = ramp(pore_pressure=PorePressure(ratio=stated, decay_time=1.0))
    assert release.least_effective == pytest.approx(0.4)
    with pytest.raises(ReleaseError, match="1 ratios for 2 zones"):
        RatioZones(zone=zone, ratio=np.array([0.2]))
    with pytest.raises(ReleaseError, match=r"ratio: ratio is 1\.2"):
        RatioZones(zone=zone, ratio=np.array([0.2, 1.2]))
    with pytest.raises(ReleaseError, match="neither ratio nor low and high"):
        RatioZones(zone=zone)
    with pytest.raises(ReleaseError, match="-1 where there is none"):
        RatioZones(zone=np.full((12, 60), -1), ratio=0.2)
    zone[4:8, 9] = -1
    with pytest.raises(ReleaseError, match="4 cells of the release in all; give elsewhere"):
        ramp(pore_pressure=PorePressure(ratio=RatioZones(zone=zone, ratio=0.2), decay_time=1.0))[1].pore_pressure.require_fits(
            release.thickness, 2000.0, "release"
        )
    one, other = (PorePressure(ratio=RatioZones(zone=zone, ratio=r), decay_time=1.0).content() for r in (0.2, 0.3))
    assert any(not np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(
    ("stated", "sampled", "said"),
    [
        ("{ratio: 0.99, decay_time: 5}", "", "ratio: .*0.97"),
        ("{ratio: -0.1, decay_time: 5}", "", "ratio"),
        ("{ratio: 0.7}", "", "neither diffusivity nor decay_time"),
        ("{ratio: 0.7, decay_time: 5, diffusivity: 0.001}", "", "both given; give one"),
        ("{ratio: 0.7, decay_time: 5, saturation: 1.5}", "", "saturation"),
        ("{ratio: 0.7, decay_time: 0}", "", "decay_time"),
        ("{ratio: {low: 0.8, high: 0.4, block: 10}, decay_time: 5}", "", "exchange them"),
        ("{ratio: inputs/none.tif, decay_time: 5}", "", "there is no file"),
        (
            "{ratio: 0.7, decay_time: 5}",
            "    pore_pressure_diffusivity: {distribution: uniform, low: 1.0e-4, high: 1.0e-2}\n",
            "the pore pressure of no release states it",
        ),
    ],
)
def test_wrong_numbers_are_refused_with_key_and_remedy(tmp_path, stated, sampled, said):
    with pytest.raises(ConfigError, match=said):
        runout.read_site(write_site(tmp_path / "site", with_pores(stated, sampled)))


def test_check_says_what_a_wet_mass_stands_on_and_warns_of_rising_pressure(tmp_path):
    folder = write_site(tmp_path / "site", NUMBER)
    found = inspect(folder)
    assert found.problems == []
    (said,) = [note for note in found.notes if "water carries" in note]
    acting = math.degrees(math.atan(0.3 * math.tan(math.radians(20.0))))
    assert f"water carries 0.7 of its weight at the start; the ground, of 20.0 deg, acts like {acting:.1f} deg" in said
    least = least_friction(found.site, found.releases)  # of the member with the highest ratio and the lowest angle
    assert math.tan(least) < 0.3 * math.tan(math.radians(22.0))
    low = inspect(write_site(tmp_path / "low", with_pores("{ratio: 0.2, saturation: 1.0, decay_time: 5}")))
    assert any("below the hydrostatic 0.5" in warning for warning in low.warnings)
    fluid = SITE.replace("density: 2000", "density: 1020")
    fluid = fluid.replace(PLACED, f"{PLACED}    pore_pressure: {{ratio: 0.9, saturation: 1.0, decay_time: 5}}\n")
    assert any(
        "water carries 0.98 of the weight" in problem for problem in map(str, inspect(write_site(tmp_path / "f", fluid)).problems)
    )


def ramp(**choices):
    """Terrain and release of the ramp in Python."""
    x = 5.0 * np.arange(60)
    terrain = runout.Terrain.from_array(np.tile(np.maximum(0.0, 80.0 - 0.5 * x), (12, 1)), 5.0)
    thickness = np.zeros(terrain.shape)
    thickness[4:8, 4:10] = 4.0
    return terrain, runout.Release.from_array(thickness, terrain, placement="on_surface", **choices)


def test_python_refuses_what_no_mass_stands_on():
    with pytest.raises(ReleaseError, match=r"pore_pressure: ratio is 0\.98"):
        PorePressure(ratio=0.98, decay_time=1.0)
    with pytest.raises(ReleaseError, match="give one of them"):
        PorePressure(ratio=0.5)
    with pytest.raises(ReleaseError, match="give low, high, block"):
        PorePressure(ratio={"low": 0.1, "high": 0.2}, decay_time=1.0)
    with pytest.raises(ReleaseError, match=r"give runout.PorePressure"):
        ramp(pore_pressure=0.7)
    cells = np.full((12, 60), np.nan)
    cells[0, 0] = 0.5
    terrain, release = ramp(pore_pressure=PorePressure(ratio=cells, decay_time=1.0))
    with pytest.raises(ReleaseError, match="24 cells of the release"):
        runout.simulate(terrain, release, runout.DruckerPrager(density=2000.0, friction_angle=30.0), cell_size=5.0, end_time=1.0)


def test_forecasts_take_the_friction_that_acts_and_the_memory_of_the_pressure():
    terrain, dry = ramp()
    wet, material = (
        replace(dry, pore_pressure=PorePressure(ratio=0.6, decay_time=5.0)),
        runout.DruckerPrager(density=2000.0, friction_angle=35.0),
    )
    stiff = [chosen_moduli([material], [r], [math.radians(20.0)], [0.6])[0].modulus for r in (dry, wet)]
    assert stiff[1] > 1.1 * stiff[0]
    surface = build_scene(terrain, wet, material, 20.0, Numerics(cell_size=5.0))[0].surface
    extents = [expected_extent([r], surface, (5.0, 5.0, 5.0), (2, 2, 4)) for r in (dry, wet)]
    assert pore_bytes(extents[0], "float32") == 0
    assert pore_bytes(extents[1], "float32") >= 4 * extents[1].particles
    more = pore_bytes(extents[1], "float32", on_cpu=True) - pore_bytes(extents[1], "float32")
    assert more == 4 * (16 * extents[1].owners + 64 * extents[1].nodes)


def test_a_wet_mass_runs_farther_and_a_drained_one_hardly():
    terrain, dry = ramp()
    reached = []
    for pore in (None, PorePressure(ratio=0.8, decay_time=0.05), PorePressure(ratio=0.8, diffusivity=1e-3)):
        release, material = replace(dry, pore_pressure=pore), runout.DruckerPrager(density=2000.0, friction_angle=35.0)
        result = runout.simulate(terrain, release, material, basal_friction_angle=22.0, cell_size=2.5, end_time=12.0)
        reached.append(float(result.particles.easting.mean()))
    assert reached[2] > reached[1] + 10.0
    assert reached[1] - reached[0] < 0.25 * (reached[2] - reached[0])


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ("{ratio: 0.9, decay_time: 1.0e-6}", r"decay_time drains the mass within 1e-06 s, before it moves .* 8 m takes 1.3 s"),
        ("{ratio: {low: 0.1, high: 0.4, block: 900}, decay_time: 20}", r"block is 900 m, the mass 60 m: one or few ratios"),
        (
            "{ratio: {polygons: inputs/p.geojson, ratio: 0.8, elsewhere: 0.3}, decay_time: 20}",
            r"no zone of the ratio lies on this mass; all of it has elsewhere, 0.3",
        ),
    ],
)
def test_check_names_pore_pressure_that_cannot_act(tmp_path, stated, words):
    folder = write_site(tmp_path / "site", with_pores(stated))
    x, y = WEST + 40 * CELL, NORTH - 3 * CELL
    ring = [[x, y], [x + 40, y], [x + 40, y - 40], [x, y - 40], [x, y]]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    (folder / "inputs" / "p.geojson").write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]}))
    assert any(re.match(rf"site.yaml:\d+: release\[0\].pore_pressure: .*{words}", warning) for warning in inspect(folder).warnings)


def test_check_is_silent_on_blocks_within_the_mass(tmp_path):
    assert not any("drains the mass" in w or "one or few" in w for w in inspect(write_site(tmp_path / "site", BLOCKS)).warnings)
