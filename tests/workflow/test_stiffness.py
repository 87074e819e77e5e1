"""Young's modulus that a run chooses: the rule against closed forms, who is counted, what is recorded, YAML and Python alike."""

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from ramp_site import SITE, write_site

import runout
from runout.errors import ConfigError, MaterialError
from runout.forecast.stiffness import chosen_moduli, extremes, sentence_of, stiffness
from runout.io.netcdf import read_attributes
from runout.model.numerics import Numerics
from runout.model.parameters import parameter
from runout.simulation.checkpoint import run_key
from runout.simulation.scenario import build_scene, scene_arguments
from runout.workflow.check import inspect
from runout.workflow.check_stiffness import lines, member_stiffness

G, CELL, SLOPE, FOOT = 9.81, 10.0, 0.5, 40  # a plane that falls to the east up to its column FOOT, level from there
SAND = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
AUTO = SITE.replace("youngs_modulus: 2.0e+6, ", "")


def plane(slope=SLOPE, rows=9, columns=60):
    """Elevation (rows, columns) [m]."""
    return np.tile(slope * CELL * np.maximum(0.0, FOOT - np.arange(float(columns))), (rows, 1))


def block(terrain, thickness, column, row=4, **choices):
    """A block on one cell; its centre of mass is that of the cell."""
    values = np.zeros(terrain.shape)
    values[row, column] = thickness
    return runout.Release(values, terrain, placement=choices.pop("placement", "on_surface"), **choices)


def speed(releases, angles, material=SAND, zones=None):
    """Speed [m/s] of the flow that the stiffness of a run is chosen by, friction angles in degrees."""
    strength = [material.shear_strength(material.density * G * CELL)] * len(releases)
    return stiffness([material] * len(releases), releases, [math.radians(a) for a in angles], strength, zones).flow_speed


def fall(column, thickness, friction, slope=SLOPE):
    """Speed [m/s] of a point at the centre of a block when it has slid down the plane to its foot."""
    along = (FOOT - column) * CELL
    return math.sqrt(2 * G * (0.5 * thickness + slope * along - friction * along))


def modulus(c, density=2000.0, nu=0.3):
    """Young's modulus [Pa] for waves of ``c`` [m/s]."""
    return density * c**2 * (1 + nu) * (1 - 2 * nu) / (1 - nu)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_block_on_a_plane_has_waves_four_times_as_fast_as_it_slides_at_the_foot(nu):
    terrain = runout.Terrain(plane(), (CELL, CELL))
    releases, material = [block(terrain, 6.0, 10)], replace(SAND, poisson_ratio=nu)
    v = fall(10, 6.0, math.tan(math.radians(15.0)))
    (found,) = stiffness([material], releases, [math.radians(15.0)], [math.inf]).materials
    assert found.wave_speed == pytest.approx(4.0 * v, rel=5e-3)  # three digits of the modulus, rounded up
    assert found.youngs_modulus == pytest.approx(modulus(4.0 * v, nu=nu), rel=1e-2)
    assert found.youngs_modulus >= modulus(4.0 * v, nu=nu)
    (faster,) = stiffness([replace(material, wave_ratio=5.0)], releases, [math.radians(15.0)], [math.inf]).materials
    assert faster.wave_speed == pytest.approx(5.0 * v, rel=5e-3)


@pytest.mark.parametrize("strain", [0.02, 0.01])
def test_release_on_level_ground_is_strained_by_its_weight_as_much_as_is_allowed(strain):
    """It falls by half its height: v^2 = g H, so that 4 v gives c^2 = 16 g H, and 2 % of strain 50 g H."""
    terrain = runout.Terrain(np.zeros((9, 60)), (CELL, CELL))
    found = stiffness([replace(SAND, weight_strain=strain)], [block(terrain, 6.0, 10)], [math.radians(30.0)], [math.inf])
    assert found.flow_speed == pytest.approx(math.sqrt(G * 6.0))
    assert found.wave_speed == pytest.approx(math.sqrt(G * 6.0 / strain), rel=5e-3)
    assert found.weight_strain == pytest.approx(strain, rel=1e-2)
    assert found.weight_strain <= strain


def test_the_fastest_of_several_releases_counts_each_from_its_own_centre_with_its_own_friction():
    terrain = runout.Terrain(plane(), (CELL, CELL))
    high, low = block(terrain, 6.0, 5), block(terrain, 4.0, 30)
    assert speed([high, low], [20.0, 20.0]) == pytest.approx(fall(5, 6.0, math.tan(math.radians(20.0))), rel=1e-9)
    assert speed([high, low], [26.0, 10.0]) == pytest.approx(fall(30, 4.0, math.tan(math.radians(10.0))), rel=1e-9)
    one = runout.Release(high.thickness + low.thickness, terrain, placement="on_surface")  # one mass in two parts: one centre
    assert speed([one], [20.0]) < speed([high, low], [20.0, 20.0])
    found = stiffness([SAND, replace(SAND, density=1000.0)], [high, low], [0.3, 0.3], [math.inf, math.inf])
    assert found.thickness == 6.0
    assert found.materials[0].wave_speed == pytest.approx(found.materials[1].wave_speed, rel=1e-2)  # one speed, two moduli


def test_an_excavated_mass_falls_from_the_middle_of_its_scar():
    terrain = runout.Terrain(plane(), (CELL, CELL))
    friction, along = math.tan(math.radians(15.0)), 300.0
    found = speed([block(terrain, 6.0, 10, placement="excavated")], [15.0])
    assert found == pytest.approx(math.sqrt(2 * G * (-3.0 + (SLOPE - friction) * along)), rel=1e-9)


def test_the_least_friction_that_acts_counts():
    terrain = runout.Terrain(plane(), (CELL, CELL))
    releases, kinds = [block(terrain, 6.0, 10)], np.ones((60, 9))
    kinds[20:30] = 0.5
    zones = runout.FrictionZones(kinds, np.zeros((60, 9)), (CELL, CELL))
    assert speed(releases, [20.0], zones=zones) == pytest.approx(fall(10, 6.0, 0.5 * math.tan(math.radians(20.0))), rel=1e-9)
    weak = replace(SAND, friction_angle=15.0)  # it passes sin(15 deg) on to stronger ground
    assert speed(releases, [30.0], weak) == pytest.approx(fall(10, 6.0, math.sin(math.radians(15.0))), rel=1e-3)
    grains = runout.GranularFlow(static_friction=0.2, dynamic_friction=0.3, grain_size=0.01)
    assert speed(releases, [30.0], grains) == pytest.approx(fall(10, 6.0, 0.3), rel=1e-9)
    assert speed(releases, [0.0]) == pytest.approx(fall(10, 6.0, 0.0), rel=1e-9)


def test_neither_unknown_ground_nor_what_lies_behind_it_is_fallen_to():
    known = plane()
    known[:, 50:] = -500.0  # an abyss
    open_edge = known.copy()
    open_edge[:, 48:52] = np.nan
    terrains = [runout.Terrain(values, (CELL, CELL)) for values in (plane(), open_edge, known)]
    level, hidden, abyss = (speed([block(terrain, 6.0, 10)], [15.0]) for terrain in terrains)
    assert hidden == pytest.approx(level, rel=1e-9)
    assert abyss > 2.5 * level


def test_a_law_of_another_package_says_with_its_parameters_whether_a_run_chooses_its_modulus():
    """The declaration is the default of youngs_modulus; how the number is chosen may be the law's own."""

    @dataclass(frozen=True, kw_only=True)
    class Measured(runout.Material):
        youngs_modulus: float = parameter("of the laboratory", unit="Pa", low=1e3, high=1e12, typical=1e7)

    @dataclass(frozen=True, kw_only=True)
    class Stiff(runout.Material):
        def chosen(self, speed, thickness, gravity):
            return replace(self, youngs_modulus=1e9) if self.youngs_modulus == "auto" else self

    with pytest.raises(TypeError, match="youngs_modulus"):
        Measured()
    with pytest.raises(MaterialError, match="youngs_modulus is 'auto'; it must be a number in Pa"):
        Measured(youngs_modulus="auto")
    terrain = runout.Terrain(plane(), (CELL, CELL))
    arguments = [block(terrain, 6.0, 10)], [0.3], [math.inf]
    assert chosen_moduli([Measured(youngs_modulus=3e6)], *arguments)[0].youngs_modulus == 3e6
    assert chosen_moduli([Stiff()], *arguments)[0].youngs_modulus == 1e9


@pytest.mark.parametrize(
    ("name", "wrong"), [("wave_ratio", 2.9), ("weight_strain", 0.05), ("youngs_modulus", "soft"), ("youngs_modulus", None)]
)
def test_wrong_words_and_values_out_of_range_are_refused(name, wrong):
    with pytest.raises(MaterialError, match=f"{name} is '?{wrong}'?; it must be"):
        runout.DruckerPrager(friction_angle=34.0, **{name: wrong})


def test_a_rule_beside_a_stated_modulus_is_refused_and_moduli_of_no_run_are_none():
    with pytest.raises(MaterialError, match="wave_ratio is 5 and youngs_modulus 1e\\+07 Pa, so that wave_ratio sets nothing"):
        replace(SAND, youngs_modulus=1e7, wave_ratio=5.0)
    with pytest.raises(MaterialError, match="youngs_modulus is auto, which a run chooses"):
        _ = SAND.shear_modulus


def arguments_of(tmp_path, text=AUTO, sample=None):
    return runout.read_site(write_site(tmp_path / "site", text)).member_arguments(sample)


def test_yaml_and_python_choose_alike_and_the_recorded_number_gives_the_same_bits(tmp_path, caplog):
    arguments = arguments_of(tmp_path) | {"end_time": 3.0}
    with caplog.at_level("INFO", "runout"):
        by_yaml = runout.simulate(**arguments)
    assert f"youngs_modulus {by_yaml.start['youngs_modulus'][0]:.3g} Pa: pressure waves of" in caplog.text
    python = replace(arguments["material"], youngs_modulus="auto")
    by_python = runout.simulate(**arguments | {"material": python})
    stated = replace(arguments["material"], youngs_modulus=by_yaml.maps.attrs["youngs_modulus"][0])
    recorded = runout.simulate(**arguments | {"material": stated, "threads": 1})
    for found in (by_python, recorded):
        assert found.start == by_yaml.start
        np.testing.assert_array_equal(found.fields["max_flow_thickness"], by_yaml.fields["max_flow_thickness"])


def test_waves_are_three_to_six_times_as_fast_as_a_real_flow(tmp_path):
    """The lower bound is k = 4 over the share of v_E by which a flow may be faster than its centre; steps follow the modulus."""
    arguments = arguments_of(tmp_path, AUTO.replace("end_time: 20", "end_time: 12")) | {"basal_friction_angle": 15.0}
    chosen = runout.simulate(**arguments)
    stiff = runout.simulate(**arguments | {"material": replace(arguments["material"], youngs_modulus=1e8)})
    ratio = chosen.start["wave_speed"][0] / float(chosen.fields["max_speed"].max())
    assert 3.0 < ratio < 6.0
    assert stiff.steps > 1.5 * chosen.steps


def test_a_run_goes_on_only_with_the_modulus_that_it_began_with(tmp_path):
    arguments = arguments_of(tmp_path)

    def key(**changed):
        return run_key(*build_scene(**scene_arguments(arguments | changed)))

    modulus_now = build_scene(**scene_arguments(arguments))[0].materials[0].youngs_modulus
    assert key() == key() == key(material=replace(arguments["material"], youngs_modulus=modulus_now))
    assert key() != key(material=replace(arguments["material"], wave_ratio=5.0))


def test_members_choose_by_their_own_friction_and_files_and_run_json_tell_the_number(tmp_path):
    from runout.workflow import hazard_map

    folder = write_site(tmp_path / "ramp", AUTO.replace("end_time: 20", "end_time: 2").replace("members: 4", "members: 2"))
    hazard_map.run(folder, workers=1)
    site, found = runout.read_site(folder), []
    for path in sorted(folder.glob("results/members/*.nc")):
        attributes = read_attributes(path)
        sample = json.loads(attributes["parameters"])
        own = site.member_arguments(sample)
        scene = build_scene(**scene_arguments(own | {"particles_per_cell": 8}))[0]
        assert attributes["youngs_modulus"] == scene.materials[0].youngs_modulus
        assert attributes["wave_speed"] == pytest.approx(scene.wave_speed)
        (expected,) = member_stiffness(site, own["release"], None, [sample])
        assert attributes["youngs_modulus"] == expected.materials[0].youngs_modulus
        found.append(float(attributes["youngs_modulus"]))
    assert found[0] != found[1]
    run = json.loads((folder / "results" / "run.json").read_text())
    assert run["stiffness"]["youngs_modulus"] == [min(found), max(found)]
    report = (folder / "results" / "report.html").read_text()
    assert sentence_of(run["stiffness"]).split(" Pa")[0].replace("'", "&#39;") in report
    assert site.computed()["material"]["youngs_modulus"] == "auto"  # in each member's key, with all that decides the number


def test_a_sampled_modulus_counts_as_it_is(tmp_path):
    moduli = "  parameters:\n    youngs_modulus: {distribution: uniform, low: 2.0e+6, high: 9.0e+6}\n"
    site = runout.read_site(write_site(tmp_path / "site", AUTO.replace("  parameters:\n", moduli)))
    own = site.member_arguments({"youngs_modulus": 3e6, "basal_friction_angle_deg": 12.0})
    assert own["material"].youngs_modulus == 3e6
    scene = build_scene(own["terrain"], own["release"], own["material"], 12.0, Numerics(cell_size=10.0, particles_per_cell=8))[0]
    assert scene.materials[0].youngs_modulus == 3e6


def test_check_prints_the_stiffness_and_warns_of_stated_moduli_that_show_in_the_runout(tmp_path):
    def checked(name, text):
        found = inspect(write_site(tmp_path / name, text))
        assert found.problems == []
        said = lines([found.site.material()], found.stiffness, ["scar"])
        return said, [w for w in found.warnings if "the stiffness affects the run-out; youngs_modulus: auto avoids it" in w]

    (own, members), none = checked("auto", AUTO)
    assert none == []
    assert "(auto, set by wave_ratio 4): pressure waves of" in own
    assert "4 times the flow of" in own
    low, high = (float(part.split()[0]) for part in members.split("members: ")[1].split(" to "))
    assert low < high  # of the largest and the smallest friction
    said, warned = checked("soft", SITE.replace("2.0e+6", "1.0e+6"))
    assert "youngs_modulus 1e+06 Pa (stated)" in said[0]
    assert len([w for w in warned if "pressure waves of" in w]) == 1
    assert checked("enough", SITE.replace("2.0e+6", f"{1.01 * high:.3e}"))[1] == []
    said, warned = checked("stiff", SITE.replace("2.0e+6", "1.0e+8"))
    assert warned == []
    assert "fewer steps" in said[-1]
    strained = AUTO.replace("density: 2000", "density: 2000, weight_strain: 0.005")
    assert "set by weight_strain 0.005): pressure waves" in checked("slow", strained)[0][0]


def test_many_members_are_forecast_from_few_energy_lines(tmp_path, monkeypatch):
    from runout.workflow import check_stiffness

    site = runout.read_site(write_site(tmp_path / "site", AUTO))
    releases, angles, drawn = site.releases(site.terrain()), np.linspace(12.0, 22.0, 40), []
    exact = [stiffness([site.material()], releases, [math.radians(a)], [0.5]).flow_speed for a in angles]
    draw = check_stiffness.largest_speed
    monkeypatch.setattr(check_stiffness, "largest_speed", lambda *given: drawn.append(given) or draw(*given))
    found = member_stiffness(site, releases, None, [{"basal_friction_angle_deg": a} for a in angles.tolist()])
    assert len(drawn) == check_stiffness.EXACT
    np.testing.assert_allclose([s.flow_speed for s in found], exact, rtol=0.02)


def test_many_members_with_drag_are_forecast_from_few_slides(tmp_path, monkeypatch):
    from runout.terrain import energy_line
    from runout.workflow import check_stiffness

    text = AUTO.split("  parameters:")[0] + AUTO[AUTO.index("hazard:") :]
    text = text.replace("basal_friction_angle_deg: 20\n", "basal_friction: {law: voellmy, mu: 0.2, xi: 200}\n")
    site = runout.read_site(write_site(tmp_path / "site", text))
    releases, slid, slide = site.releases(site.terrain()), [], energy_line.slide
    samples = [{"basal_xi": xi, "basal_mu": mu} for xi in (50.0, 100.0, 200.0, 400.0, 800.0) for mu in (0.1, 0.2, 0.3, 0.4)]
    exact = [member_stiffness(site, releases, None, [one])[0].flow_speed for one in samples]
    monkeypatch.setattr(energy_line, "slide", lambda *a, points: slid.append(a[2] * points) or slide(*a, points=points))
    found = member_stiffness(site, releases, None, samples)
    few, all_points = check_stiffness.FEW_POINTS, energy_line.POINTS
    assert sum(slid) == 2 * (len(samples) * few + check_stiffness.SLID * all_points)
    np.testing.assert_allclose([s.flow_speed for s in found], exact, rtol=0.06)
    assert "(energy line, less drag)" in found[0].statement()


def test_extremes_are_those_of_all_runs_and_releases():
    runs = [{"youngs_modulus": [3e6, 5e6], "wave_speed": [40.0, 50.0]}, {"youngs_modulus": 2e6, "wave_speed": 35.0}, {}]
    found = extremes(runs)
    assert found == {"youngs_modulus": [2e6, 5e6], "wave_speed": [35.0, 50.0]}
    assert sentence_of(found) == "Young's modulus 2e+06 to 5e+06 Pa, pressure waves of 35 to 50 m/s"
    assert extremes([{}]) == {}


def test_site_yaml_refuses_what_python_refuses(tmp_path):
    text = AUTO.replace("density: 2000", "density: 2000, wave_ratio: 2")
    with pytest.raises(ConfigError, match="wave_ratio: 2 is out of range; it must be at least 3 and at most 20; 4 is usual"):
        runout.read_site(write_site(tmp_path / "site", text))
