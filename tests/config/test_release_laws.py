"""Material and friction of each release in site.yaml: laws, parameters in the place of those of the site, samples for one."""

import pytest
from conftest import SQUARE
from refused_site import problems

import runout
from runout import Coulomb, DruckerPrager, GranularFlow, HerschelBulkley, Voellmy
from runout.config.parameter_variables import parameter_variable
from runout.config.release_laws import several_laws
from runout.config.scaffold import commented_yaml

MUD = """\
  - name: mud
    polygons: inputs/mud.geojson
    thickness: 2.0
    material: {law: herschel_bulkley, density: 1800, yield_stress: 1500, consistency: 200}
    basal_friction: {law: voellmy, mu: 0.05, xi: 500}
"""
OWN = "    material: {friction_angle_deg: 40}\n"


@pytest.fixture
def two(edited, site_folder):
    """A function that adds the release mud, with some text replaced, to the site, and returns the folder."""

    def add(*changes, of_scar="", sampled=""):
        (site_folder / "inputs" / "mud.geojson").write_text(SQUARE.replace("[5000", "[5001"))
        text = MUD
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        edited("material:\n  density", text + "material:\n  density")
        edited("    thickness: 4.0\n", f"    thickness: 4.0\n{of_scar}")
        return edited("low: 12, high: 22}\n", f"low: 12, high: 22}}\n{sampled}")

    return add


GRAINS = "    material: {law: granular_flow, static_friction: 0.4, dynamic_friction: 0.7, grain_size: 0.1}\n"
FOREIGN = "release[0].material.yield_stress: unknown key; it belongs to law: herschel_bulkley"


def uniform(key, low, high):
    return f"    {key}: {{distribution: uniform, low: {low}, high: {high}}}\n"


def test_a_release_states_laws_of_its_own(two):
    site = runout.read_site(two())
    scar, mud = site.member_arguments({"basal_friction_angle_deg": 15.0})["release"]
    assert (scar.material, scar.basal_friction) == (None, None)
    assert mud.material == HerschelBulkley(density=1800.0, yield_stress=1500.0, consistency=200.0)
    assert mud.basal_friction == Voellmy(mu=0.05, xi=500.0)
    assert several_laws(site.settings)
    assert [law.name for law in site.friction.laws] == ["coulomb", "voellmy"]


def test_a_block_without_a_law_replaces_parameters_of_the_site(two):
    site = runout.read_site(two(of_scar=OWN, sampled=uniform("density", 1900, 2100)))
    scar, mud = site.member_arguments({"density": 1950.0})["release"]
    assert scar.material == DruckerPrager(density=1950.0, youngs_modulus=5e6, friction_angle=40.0)
    assert mud.material.density == 1800.0  # a whole block does not follow the site


def test_an_ensemble_samples_parameters_of_one_release(two):
    keys = "mud.yield_stress", "mud.basal_mu", "scar.friction_angle_deg", "scar.basal_friction_angle_deg"
    bounds = (1000, 2000), (0.02, 0.1), (30, 35), (10, 12)
    site = runout.read_site(two(sampled="".join(uniform(k, *ends) for k, ends in zip(keys, bounds, strict=True))))
    assert list(site.settings.ensemble.parameters) == ["basal_friction_angle_deg", *keys]
    sample = dict(zip(keys, (1100.0, 0.03, 31.0, 11.0), strict=True)) | {"basal_friction_angle_deg": 20.0}
    arguments = site.member_arguments(sample)
    scar, mud = arguments["release"]
    assert (mud.material.yield_stress, mud.material.consistency) == (1100.0, 200.0)
    assert mud.basal_friction == Voellmy(mu=0.03, xi=500.0)
    assert scar.material == DruckerPrager(density=2000.0, youngs_modulus=5e6, friction_angle=31.0)
    assert scar.basal_friction == Coulomb(friction_angle=11.0)
    assert arguments["material"].friction_angle == 30.0
    assert parameter_variable("mud.yield_stress").units == "Pa"
    assert "release mud" in parameter_variable("mud.basal_mu").long_name


def test_settings_survive_a_round_trip(two):
    folder = two(of_scar=OWN, sampled=uniform("mud.basal_mu", 0.02, 0.1) + uniform("scar.density", 1900, 2100))
    site = runout.read_site(folder)
    (folder / "site.yaml").write_text(commented_yaml(site.settings))
    again = runout.read_site(folder)
    assert again.settings == site.settings
    assert again.computed() == site.computed()
    assert again.computed()["release"][1]["material"]["law"] == "herschel_bulkley"


def test_the_whole_law_may_be_that_of_the_site(two):
    site = runout.read_site(
        two(("herschel_bulkley, density: 1800, yield_stress: 1500, consistency: 200", "drucker_prager, friction_angle_deg: 25"))
    )
    assert site.releases()[1].material == DruckerPrager(friction_angle=25.0)  # not the modulus of the site


@pytest.mark.parametrize(
    ("changes", "of_scar", "sampled", "said"),
    [
        ([("herschel_bulkley", "herschel_bulkly")], "", "", "release[1].material.law: 'herschel_bulkly' is not known"),
        ([(", yield_stress: 1500", "")], "", "", "release[1].material.yield_stress: required key is missing"),
        ([("yield_stress: 1500", "yield_stress: 0.1")], "", "", "release[1].material.yield_stress: 0.1 Pa is out of range"),
        ([("mu: 0.05", "mue: 0.05")], "", "", "release[1].basal_friction.mue: unknown key; did you mean 'mu'?"),
        ([], "    material: {yield_stress: 100}\n", "", FOREIGN),
        ([], "    material: {}\n", "", "release[0].material: states no parameter"),
        ([], "    material: 5\n", "", "release[0].material: 5 is a number; a block is needed"),
        ([], "    material: {friction_angle_deg: 0}\n", "", "release[0].material: friction_angle_deg and cohesion are both 0"),
        ([], "", uniform("sludge.density", 1900, 2100), "parameters.sludge.density: no release or inflow is called 'sludge'"),
        ([], "", uniform("mud.friction_angle_deg", 20, 30), "the laws of mud, herschel_bulkley and voellmy, have no such"),
        ([], "", uniform("mud.basal_mu", 1.0, 3.0), "it can give 3; the parameter must be"),
        ([], "", uniform("mud.nothing", 1.0, 3.0), "ensemble.parameters.mud.nothing"),
        ([], "    material: {density: 1900}\n", uniform("density", 1900, 2100), "release[0].material.density: the ensemble"),
    ],
)
def test_what_a_release_cannot_state_is_refused_with_its_place(two, changes, of_scar, sampled, said):
    found = problems(two(*changes, of_scar=of_scar, sampled=sampled))
    assert any(said in line for line in found), found
    assert all("site.yaml:" in line for line in found)


def test_a_sampled_parameter_that_no_release_follows_is_refused(two):
    (line,) = problems(two(of_scar=GRAINS, sampled=uniform("density", 1900, 2100)))
    assert "every release and inflow has a material of its own" in line
    assert "NAME.density" in line


def test_a_release_may_follow_a_law_that_depends_on_the_rate(two):
    assert isinstance(runout.read_site(two(of_scar=GRAINS)).releases()[0].material, GranularFlow)
