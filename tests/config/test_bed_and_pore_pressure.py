"""Erodible bed and pore pressure of a site.yaml: settings, limits, files, sampled numbers, and what of a law they belong to."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from refused_site import problems

from runout import EnergyErosion, JumpErosion, PorePressure, RammsErosion, read_site
from runout.config import bed
from runout.config.bed import BedSettings
from runout.config.parameter_variables import parameter_variable, udunits
from runout.config.pore_pressure import PorePressureSettings, RatioSettings, sampled_pores, unused_samples
from runout.errors import InputError
from runout.model.erosion_laws import EROSIONS
from runout.model.pore_pressure import RatioBlocks

LAW = {"law": "ramms"}
OF_EVERY_BED = {"bed_density", "bed_depth_factor", "bed_pore_pressure_ratio"}
SIMULATION = "basal_friction_angle_deg: 20\nsimulation:"
PLACE = "    thickness: 4.0\n"
CELLS = 0.1 * (1 + np.arange(20))[:, None] + 0.01 * np.arange(30)  # [m], another value in every cell
UNIFORM = "{distribution: uniform, low: 0.1, high: 0.2}"


def with_bed(edited, text):
    return edited(SIMULATION, f"basal_friction_angle_deg: 20\nbed:\n{text}simulation:")


def write_cells(path, values):
    """An ESRI grid on the cells of the site."""
    head = "ncols 30\nnrows 20\nxllcorner 500000\nyllcorner 5000000\ncellsize 10\nNODATA_value -9999\n"
    path.write_text(head + "\n".join(" ".join(map(str, row)) for row in values.tolist()) + "\n", encoding="utf-8")
    path.with_suffix(".prj").write_text("EPSG:32632", encoding="utf-8")


@pytest.mark.parametrize(
    ("key", "valid", "refused"),
    [
        ("depth", [1e-6, 1000.0, "inputs/bed.tif"], [0.0, -1.0, 1000.1, "", None, [1.0], True]),
        ("density", [None, 1.0, 20_000.0], [0.9, 20_001.0, "dense"]),
        ("polygons", [None, "a.gpkg"], ["", 3]),
        ("layer", [None], ["channel"]),
        ("erosion", [LAW, {"rate": 0.1}, {"law": "growth", "growth_rate": 0.5}], [None, {"law": "none"}, 3, {"rate": -0.1}]),
    ],
)
def test_settings_of_a_bed_have_their_limits(key, valid, refused):
    others = {"depth": 1.2, "erosion": LAW}
    for value in valid:
        assert getattr(BedSettings(**{**others, key: value}), key) is not None or value is None
    for value in refused:
        with pytest.raises(ValidationError):
            BedSettings(**{**others, key: value})


def test_a_bed_states_depth_and_law_and_leaves_out_the_rest():
    settings = BedSettings(depth=1.2, erosion={})
    assert (settings.polygons, settings.layer, settings.density, settings.erosion.law) == (None, None, None, "ramms")
    assert settings.erosion.with_values({"rate": 0.5}) == RammsErosion(rate=0.5)
    assert BedSettings(depth="d", polygons="a.gpkg", layer="channel", erosion=LAW).layer == "channel"
    with pytest.raises(ValidationError, match="states neither depth nor erosion; add both, or remove the bed"):
        BedSettings(density=1900.0)


def test_conflicts_of_a_bed_name_the_key_that_is_missing():
    assert [key for key, _, _ in bed.bed_conflicts({"erosion": LAW, "layer": "a"})] == ["depth", "layer"]
    assert [key for key, _, _ in bed.bed_conflicts({"depth": 1.0, "polygons": "a", "layer": "b"})] == ["erosion"]
    assert list(bed.bed_conflicts({"depth": 1.0, "erosion": LAW})) == list(bed.bed_conflicts({})) == []


@pytest.mark.parametrize(
    ("site", "law"),
    [
        ({"bed": {"depth": 1.0}}, "ramms"),
        ({"bed": {"depth": 1.0, "erosion": {"law": "jump"}}}, "jump"),
        ({"bed": {"erosion": {"law": "unknown"}}}, None),
        ({"bed": {"erosion": 3}}, None),
        ({"bed": 3}, None),
        ({}, None),
        ([], None),
    ],
)
def test_the_law_of_a_file_is_the_one_that_its_bed_names(site, law):
    assert bed.stated_law(site) is (EROSIONS.find(law) if law else None)


def test_each_law_of_erosion_has_its_own_sampled_parameters():
    ramms = OF_EVERY_BED | {"erosion_rate", "erosion_critical_stress", "erosion_depth_per_stress"}
    assert bed.sampled_ranges(EROSIONS.find("ramms")).keys() == ramms
    assert bed.sampled_ranges(EROSIONS.find("growth")).keys() == OF_EVERY_BED | {"erosion_growth_rate"}
    assert ramms | {"erosion_growth_rate", "erosion_specific_energy", "erosion_most"} < bed.sampled_ranges().keys()
    assert bed.sampled_ranges()["erosion_rate"].high == 10
    for name, unit in (("erosion_rate", "m s-1"), ("erosion_specific_energy", "J kg-1"), ("erosion_friction_angle_deg", "degree")):
        assert parameter_variable(name).units == unit
    assert parameter_variable("erosion_rate").long_name == "erosion rate, normal to the ground (erosion)"
    assert [udunits(unit) for unit in ("", "deg", "m/Pa", "1/m", "m/s2")] == ["1", "degree", "m Pa-1", "m-1", "m s-2"]


def test_sampled_parameters_that_the_bed_of_a_file_does_not_have_are_named():
    sampled = {"bulking": 1, "friction_angle_deg": 1, "erosion_rate": 1, "erosion_most": 1, "bed_density": 1}
    without = list(bed.foreign_parameters({}, sampled))
    assert [key for key, _, _ in without] == ["erosion_rate", "erosion_most", "bed_density"]
    assert {message for _, message, _ in without} == {"the site has no bed"}
    said = ("erosion_most", "the erosion law ramms has no such parameter", "remove it, or use law: jump")
    assert list(bed.foreign_parameters({"bed": {"depth": 1.0, "erosion": LAW}}, sampled)) == [said]
    assert list(bed.foreign_parameters({"bed": {"erosion": {"law": "unknown"}}}, sampled)) == []


def test_a_number_as_depth_of_a_bed_is_placed_in_site_yaml(edited):
    folder = with_bed(edited, "  depth: 1.5\n  density: 1700\n  erosion: {law: energy, specific_energy: 900}\n")
    found = read_site(folder).data().bed
    assert (found.depth, found.density, found.erosion) == (1.5, 1700.0, EnergyErosion(specific_energy=900.0))
    line = (folder / "site.yaml").read_text().splitlines().index("  depth: 1.5") + 1
    assert found.source == f"site.yaml:{line}: bed.depth"


def test_a_raster_of_depths_has_the_north_west_corner_first(edited, site_folder):
    write_cells(site_folder / "inputs" / "bed.asc", CELLS)
    folder = with_bed(edited, "  depth: inputs/bed.asc\n  density: 1700\n  erosion: {law: jump, most: 0.2}\n")
    found = read_site(folder).data().bed
    np.testing.assert_allclose(found.depth, CELLS, rtol=1e-6)
    assert (found.density, found.erosion) == (1700.0, JumpErosion(most=0.2))
    write_cells(site_folder / "inputs" / "bed.asc", 0.0 * CELLS)
    with pytest.raises(InputError, match=r"site.yaml:\d+: bed.depth: inputs/bed.asc: depth of the bed is 0 on all cells"):
        read_site(folder).data()


def test_polygons_of_a_bed_have_the_depth_of_their_attribute_and_lie_in_the_layer_that_is_named(edited):
    text = "  depth: depth\n  polygons: inputs/release.geojson\n  layer: release\n  density: 1700\n  erosion: {rate: 0.1}\n"
    folder = with_bed(edited, text)
    found = read_site(folder).data().bed
    depth = np.zeros((20, 30))
    depth[12:16, 4:8] = 4.0  # 40 m to 80 m east and north
    np.testing.assert_allclose(found.depth, depth)
    assert (found.density, found.erosion) == (1700.0, RammsErosion(rate=0.1))
    edited("layer: release", "layer: nowhere")
    with pytest.raises(InputError, match=r"site.yaml:\d+: bed.polygons: inputs/release.geojson: .*'?nowhere'?"):
        read_site(folder).data()


def test_a_member_has_the_bed_with_the_sampled_numbers_of_its_law(edited):
    folder = with_bed(edited, "  depth: 1.5\n  density: 1700\n  erosion: {rate: 0.1, critical_stress: 500}\n")
    site = read_site(folder)
    stated, data = site.settings, site.data().bed
    assert bed.law_of(stated).name == "ramms"
    plain = bed.of_member(stated, data, {})
    assert plain.keys() == {"bed"}
    assert (plain["bed"].depth, plain["bed"].density) == (1.5, 1700.0)
    drawn = bed.of_member(stated, data, {"bed_depth_factor": 2.0, "bed_density": 1500.0, "erosion_rate": 0.3, "bulking": 1.25})
    assert (drawn["bed"].depth, drawn["bed"].density, drawn["bulking"]) == (3.0, 1500.0, 1.25)
    assert drawn["bed"].erosion == RammsErosion(rate=0.3, critical_stress=500.0)
    assert bed.of_member(stated.model_copy(update={"bulking": 1.5}), None, {}) == {"bulking": 1.5}
    assert bed.of_member(stated.model_copy(update={"bed": None}), None, {"erosion_rate": 0.3}) == {}
    assert bed.law_of(stated.model_copy(update={"bed": None})) is None


# --- pore pressure -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "valid", "refused"),
    [
        ("ratio", [0.0, 0.97, "inputs/ratio.tif", {"low": 0.1, "high": 0.1, "block": 5.0}], [-0.01, 0.98, "", None, [0.5], {}]),
        ("saturation", [0.0, 1.0], [-0.01, 1.01, None]),
        ("decay_time", [1e-6, 1e6], [0.0, -1.0, 1.1e6, None]),
    ],
)
def test_settings_of_pore_pressure_have_their_limits(key, valid, refused):
    others = {"ratio": 0.5, "decay_time": 5.0}
    for value in valid:
        PorePressureSettings(**{**others, key: value})
    for value in refused:
        with pytest.raises(ValidationError):
            PorePressureSettings(**{**others, key: value})


def test_pressure_drains_by_diffusion_or_by_a_time():
    assert PorePressureSettings(ratio=0.5, diffusivity=100.0).saturation == 0.0
    for stated, said in (
        ({}, "neither diffusivity nor decay_time is given; give one of them"),
        ({"diffusivity": 1e-3, "decay_time": 5.0}, "diffusivity and decay_time are both given; give one of them"),
        ({"diffusivity": 0.0}, "greater than 0"),
        ({"diffusivity": 101.0}, "less than or equal to 100"),
    ):
        with pytest.raises(ValidationError, match=said):
            PorePressureSettings(ratio=0.5, **stated)


@pytest.mark.parametrize("block", [{"low": -0.1}, {"high": 0.98}, {"low": 0.7}, {"block": 0.009}, {"block": 1.1e5}, {"low": None}])
def test_blocks_of_ratios_have_their_limits(block):
    assert RatioSettings(low=0.2, high=0.6, block=0.01).block == 0.01
    with pytest.raises(ValidationError):
        RatioSettings(**{"low": 0.2, "high": 0.6, "block": 20.0, **block})


def pressure_of(edited, stated):
    (release,) = read_site(edited(PLACE, f"{PLACE}    pore_pressure: {stated}\n")).releases()
    return release.pore_pressure


def test_pore_pressure_of_a_release_is_what_its_block_states(edited):
    found = pressure_of(edited, "{ratio: {low: 0.2, high: 0.6, block: 20}, saturation: 0.5, diffusivity: 0.01}")
    assert found.ratio == RatioBlocks(low=0.2, high=0.6, block=20.0)
    assert (found.saturation, found.diffusivity, found.decay_time) == (0.5, 0.01, None)


def test_a_raster_of_ratios_has_the_north_west_corner_first(edited, site_folder):
    write_cells(site_folder / "inputs" / "ratio.asc", CELLS / 4.0)
    found = pressure_of(edited, "{ratio: inputs/ratio.asc, decay_time: 5}")
    np.testing.assert_allclose(found.ratio, CELLS / 4.0, rtol=1e-6)
    assert (found.saturation, found.diffusivity, found.decay_time) == (0.0, None, 5.0)


def release_with(site_folder, pore):
    (release,) = read_site(site_folder).releases()
    return replace(release, pore_pressure=pore)


def test_sampled_numbers_replace_those_that_a_release_states_and_no_others(site_folder):
    dry, wet = release_with(site_folder, None), release_with(site_folder, PorePressure(ratio=0.5, decay_time=5.0))
    assert sampled_pores([dry, wet], {"erosion_rate": 0.1, "friction_angle_deg": 30.0}) == [dry, wet]
    sample = {"pore_pressure_ratio": 0.7, "pore_pressure_saturation": 0.4, "pore_pressure_decay_time": 9.0}
    first, second = sampled_pores([dry, wet], sample | {"pore_pressure_diffusivity": 0.1, "pore_pressure_ratio_low": 0.1})
    assert first.pore_pressure is None
    found = second.pore_pressure
    assert (found.ratio, found.saturation, found.decay_time, found.diffusivity) == (0.7, 0.4, 9.0, None)
    (same,) = sampled_pores([wet], {"pore_pressure_saturation": 0.25})
    assert (same.pore_pressure.ratio, same.pore_pressure.saturation) == (0.5, 0.25)


def test_sampled_ends_are_those_of_blocks_and_a_sampled_ratio_is_not(site_folder):
    blocks = release_with(site_folder, PorePressure(ratio=RatioBlocks(low=0.2, high=0.6, block=20.0), diffusivity=0.01))
    (low,) = sampled_pores([blocks], {"pore_pressure_ratio_low": 0.3, "pore_pressure_ratio": 0.9})
    assert low.pore_pressure.ratio == RatioBlocks(low=0.3, high=0.6, block=20.0)
    (high,) = sampled_pores([blocks], {"pore_pressure_ratio_high": 0.9, "pore_pressure_diffusivity": 0.02})
    assert high.pore_pressure.ratio == RatioBlocks(low=0.2, high=0.9, block=20.0)
    assert high.pore_pressure.diffusivity == 0.02
    cells = release_with(site_folder, PorePressure(ratio=CELLS / 4.0, decay_time=5.0))
    (same,) = sampled_pores([cells], {"pore_pressure_ratio": 0.9, "pore_pressure_ratio_low": 0.1})
    np.testing.assert_array_equal(same.pore_pressure.ratio, CELLS / 4.0)


def unused(pore, *names):
    """Names of the sampled numbers of pore pressure that no release states."""
    releases = [{"name": "dry"}, {"name": "wet", "pore_pressure": pore}]
    said = list(unused_samples(releases, dict.fromkeys((*(f"pore_pressure_{name}" for name in names), "friction_angle_deg"))))
    assert {message for _, message, _ in said} <= {"the pore pressure of no release states it"}
    return [key.removeprefix("pore_pressure_") for key, _, _ in said]


def test_a_sampled_number_that_no_release_states_is_named():
    every = ("ratio", "ratio_low", "ratio_high", "saturation", "diffusivity", "decay_time")
    assert unused({"ratio": 0.5, "decay_time": 5}, *every) == ["ratio_low", "ratio_high", "diffusivity"]
    assert unused({"ratio": 1, "diffusivity": 0.1}, *every) == ["ratio_low", "ratio_high", "decay_time"]
    assert unused({"ratio": {"low": 0.1, "high": 0.2, "block": 3}, "diffusivity": 0.1}, *every) == ["ratio", "decay_time"]
    zones = {"ratio": {"polygons": "a.gpkg", "ratio": 0.4, "elsewhere": 0.1}, "diffusivity": 0.1}
    assert unused(zones, *every, "ratio_elsewhere") == ["ratio_low", "ratio_high", "decay_time"]
    assert unused({"ratio": "a.tif"}, *every) == ["ratio", "ratio_low", "ratio_high", "diffusivity", "decay_time"]
    assert unused("text", *every) == list(every)
    fixes = {key: fix for key, _, fix in unused_samples([], {"pore_pressure_ratio_low": 1, "pore_pressure_saturation": 1})}
    assert fixes["pore_pressure_ratio_low"] == "remove it, or give a release pore_pressure: {ratio: {low: ...}, ...}"
    assert fixes["pore_pressure_saturation"] == "remove it, or give a release pore_pressure: {saturation: a number, ...}"


def test_samples_without_bed_or_pressure_are_refused_with_their_lines(edited):
    more = f"    erosion_rate: {UNIFORM}\n    pore_pressure_ratio: {UNIFORM}\n"
    said = problems(edited("  parameters:\n", f"  parameters:\n{more}"))
    assert len(said) == 2
    assert "ensemble.parameters.erosion_rate: the site has no bed; remove it, or add bed: {depth: ..., erosion: {...}}" in said[0]
    assert "ensemble.parameters.pore_pressure_ratio: the pore pressure of no release states it" in said[1]


def test_a_sampled_ratio_out_of_its_range_is_refused(edited):
    edited(PLACE, f"{PLACE}    pore_pressure: {{ratio: 0.5, decay_time: 5}}\n")
    high = UNIFORM.replace("0.2", "0.98")
    (said,) = problems(edited("  parameters:\n", f"  parameters:\n    pore_pressure_ratio: {high}\n"))
    assert "ensemble.parameters.pore_pressure_ratio: it can give 0.98; the parameter must be" in said
