"""`runout check` on the physics: which friction acts at the base, and how fast a mass may become."""

import json
import math

import numpy as np
import pytest
from ramp_site import SITE, ramp, write_site

import runout
from runout.io.netcdf import read_attributes
from runout.terrain.energy_line import largest_speed
from runout.workflow.check import inspect
from runout.workflow.check_physics import least_friction

SAMPLED = "basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}"


def warned(folder, text, words):
    """The warnings of a site that hold some words."""
    return [warning for warning in inspect(write_site(folder, text)).warnings if words in warning]


def test_check_says_which_friction_acts_on_ground_stronger_than_the_mass(tmp_path):
    assert warned(tmp_path / "weaker", SITE, "stronger than the material") == []
    alone = SITE.replace("basal_friction_angle_deg: 20", "basal_friction_angle_deg: 35").replace(f"    {SAMPLED}\n", "")
    (said,) = warned(tmp_path / "alone", alone.replace("members: 4", "members: 1").replace("  parameters:\n", ""), "stronger")
    assert said.startswith("slab: the ground (friction 0.700, 35.0 deg) is stronger than the material")
    assert "friction 0.500, 26.6 deg acts" in said


def test_check_counts_the_members_whose_ground_is_stronger_whatever_is_sampled(tmp_path):
    """Ground of 12 to 22 degrees on material of 5 to 30: sin(phi) is less than tan(delta) in some of 16 members."""
    more = SITE.replace("members: 4", "members: 16").replace(
        SAMPLED, f"{SAMPLED}\n    friction_angle_deg: {{distribution: uniform, low: 5, high: 30}}"
    )
    site = runout.read_site(write_site(tmp_path / "site", more))
    from runout.ensemble.design import member_table

    table = member_table(site.settings.ensemble)
    ground = np.tan(np.radians(table["basal_friction_angle_deg"]))
    strength = np.sin(np.radians(table["friction_angle_deg"]))
    count = int((ground > strength).sum())
    assert 0 < count < 16
    (said,) = [warning for warning in inspect(tmp_path / "site").warnings if "stronger" in warning]
    assert f"so in {count} of 16 members" in said
    least = math.atan(min(np.minimum(ground, strength)))
    assert least_friction(site, site.releases(site.terrain())) == pytest.approx(least)


def test_cohesion_counts_with_the_weight_of_one_cell(tmp_path):
    text = SITE.replace(SAMPLED, "basal_friction_angle_deg: {distribution: uniform, low: 27.9, high: 28}")
    assert len(warned(tmp_path / "without", text, "stronger")) == 1
    stiff = text.replace("friction_angle_deg: 30}", "friction_angle_deg: 30, cohesion: 1.0e+4}")
    assert warned(tmp_path / "with", stiff, "stronger") == []  # 1e4 cos(30 deg) over 2000 g 10 m is 0.044; 0.532 - 0.5 is less


def test_the_energy_line_gives_the_speed_of_a_point_mass():
    """From 144 m down a slope of 30 degrees over 250 m, against friction of 20 degrees."""
    terrain = runout.Terrain.from_array(ramp(), 10.0)
    thickness = np.zeros(terrain.shape)
    thickness[12, 0] = 0.01
    drop = (245.0 - 0.5 * 10.0) * (math.tan(math.radians(30)) - math.tan(math.radians(20)))  # centres of cells, 5 to 245 m east
    found = largest_speed([runout.Release(thickness, terrain)], [math.radians(20.0)])
    assert found == pytest.approx(math.sqrt(2 * 9.81 * drop), rel=0.01)
    assert largest_speed([runout.Release(thickness, terrain)], [math.radians(40.0)]) < 0.1 * found


def test_run_json_and_members_record_the_start_and_the_friction_that_acts(finished_site):
    results = finished_site[0] / "results"
    configuration = json.loads((results / "run.json").read_text())["configuration"]
    assert configuration["simulation"]["initial_stress"] == "at_rest"
    for path in sorted(results.glob("members/*.nc")):
        attributes = read_attributes(path)
        angle = json.loads(attributes["parameters"])["basal_friction_angle_deg"]
        assert attributes["initial_stress"] == "at_rest"
        assert attributes["basal_friction"] == pytest.approx(math.tan(math.radians(angle)))
        assert attributes["acting_basal_friction"] == pytest.approx(min(math.tan(math.radians(angle)), 0.5))


def test_run_json_records_what_relief_costs_and_products_the_filter_of_the_grid(finished_site):
    import xarray as xr

    results = finished_site[0] / "results"
    relief = json.loads((results / "run.json").read_text(encoding="utf-8"))["relief"]
    assert relief.keys() == {"carried", "removed", "friction", "wave"}
    assert 0.0 < relief["friction"] < 0.1
    assert relief["wave"] == 0.0
    with xr.open_dataset(results / "hazard.nc") as hazard:
        assert hazard.attrs["ground_filter_half_width"].tolist() == [7.0, 7.0]
        assert "terrain_smoothing" not in hazard.attrs
    (member, *_) = sorted((results / "members").glob("*.nc"))
    with xr.open_dataset(member) as maps:
        assert maps.attrs["ground_filter_half_width"].tolist() == [7.0, 7.0]
