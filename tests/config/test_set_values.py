"""`--set KEY=VALUE`: settings of the command line are checked and used as those of site.yaml."""

import pytest

from runout.config.read import load
from runout.config.site import read_site
from runout.ensemble.member import plan_members
from runout.errors import ConfigError


def refused(folder, *changes):
    with pytest.raises(ConfigError) as caught:
        load(folder, changes)
    return str(caught.value).splitlines()


def test_settings_take_the_place_of_those_of_the_file_by_key_name_and_number(site_folder):
    changes = ["simulation.cell_size=20", "release.scar.thickness=3", "ensemble.parameters.basal_friction_angle_deg.low=15"]
    settings = load(site_folder, [*changes, "hazard.thickness_thresholds=[0.5, 2]", "budget.hours=1"])
    assert settings.simulation.cell_size == 20
    assert settings.release[0].thickness == 3
    sampled = settings.ensemble.parameters["basal_friction_angle_deg"]
    assert (sampled.low, sampled.high) == (15, 22)
    assert settings.hazard.thickness_thresholds == [0.5, 2]
    assert settings.budget.hours == 1
    assert load(site_folder, ["release[0].thickness=5"]).release[0].thickness == 5
    assert load(site_folder).simulation.cell_size == 10


def test_an_empty_value_removes_a_key(site_folder):
    changes = ["basal_friction_angle_deg=18", "ensemble.parameters.basal_friction_angle_deg="]
    settings = load(site_folder, changes)
    assert settings.basal_friction_angle_deg == 18
    assert settings.ensemble.parameters == {}


def test_a_parameter_of_one_release_may_be_sampled(site_folder):
    changes = ["ensemble.parameters.scar.start_time={distribution: uniform, low: 0, high: 5}"]
    assert load(site_folder, changes).ensemble.parameters["scar.start_time"].high == 5


def test_members_have_the_keys_of_a_file_that_says_the_same(edited, site_folder):
    changed = [member.key for member in plan_members(read_site(site_folder, ["simulation.cell_size=8"]))]
    usual = [member.key for member in plan_members(read_site(site_folder))]
    assert changed == [member.key for member in plan_members(read_site(edited("cell_size: 10", "cell_size: 8")))] != usual


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("simulation.cell_size=ten", "--set: simulation.cell_size: 'ten' is text; a number or a list is needed"),
        ("simulation.cell_sise=20", "--set: simulation.cell_sise: unknown key; did you mean 'cell_size'?"),
        ("simulatoin.cell_size=20", "--set: simulatoin: unknown key; did you mean 'simulation'?"),
        ("release.skar.thickness=4", "--set: release.skar.thickness: release has no entry 'skar'; did you mean 'scar'?"),
        ("release[3].thickness=4", "--set: release[3].thickness: release has no entry '3'; choose one of scar, 0"),
        ("release.scar.thickness=-4", "--set: release[0].thickness: -4 m is out of range; it must be at least 1e-05 m"),
        ("simulation.cell_size.x=4", "--set: simulation.cell_size.x: simulation.cell_size is 10, which holds no keys; "
                                     "set simulation.cell_size as a whole"),
        ("simulation.cell_size", "--set: 'simulation.cell_size' is no setting; write KEY=VALUE"),
        ("simulation.cfl=", "--set: simulation.cfl: site.yaml does not state this key, so that it cannot be removed"),
        ("hazard.percentiles=[5", "--set: hazard.percentiles: not valid YAML"),
        ("terrain.dem=inputs/dme.asc", "--set: terrain.dem: there is no file 'inputs/dme.asc'; did you mean 'inputs/dem.asc'?"),
        ("basal_friction_angle_deg=18", "--set: basal_friction_angle_deg: the ensemble samples it, so that this value changes no "
                                        "member; add --set ensemble.parameters.basal_friction_angle_deg= to give"),
        ("material=", "--set: material: required key is missing"),
    ],
)  # fmt: skip
def test_what_cannot_be_set_is_refused_with_option_key_and_remedy(site_folder, change, message):
    (line,) = refused(site_folder, change)
    assert line.startswith(message)


def test_a_key_that_is_set_twice_is_refused(site_folder):
    (line,) = refused(site_folder, "simulation.cell_size=20", "simulation.cell_size=25")
    assert line == "--set: simulation.cell_size: is set twice; keep one of the two"


def test_problems_of_file_and_options_are_listed_together(edited):
    lines = refused(edited("members: 4", "members: four"), "simulation.cell_size=ten")
    assert [line.split(": ")[0] for line in lines] == ["--set", "site.yaml:19"]


@pytest.mark.parametrize("releases", ["5", "{a: 1}", "", "[5, {}]"])
def test_releases_that_are_no_list_are_refused_beside_settings(edited, releases):
    folder = edited("release:\n", f"release: {releases}\nother:\n")
    assert any(line.startswith("site.yaml") for line in refused(folder, "simulation.cell_size=20"))
