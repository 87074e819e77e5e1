"""Steps of a run are forecast from points that slide in place of its mass, within a factor of 1.5."""

import numpy as np
import pytest
from ramp_site import SITE, write_site

import runout
from runout.ensemble.member import plan_members
from runout.forecast.step_cost import StepCost, measured_step_cost
from runout.workflow import flow_forecast, plan
from runout.workflow.check_stiffness import member_stiffness

AUTO = SITE.replace("youngs_modulus: 2.0e+6, ", "")
CASES = {  # of basal friction [deg] and the end time [s]: the flow rests, is cut off by the end time, leaves the DEM, never starts
    "at rest": (AUTO, 12, 22, 60),
    "end time": (SITE, 12, 22, 12),
    "leaves": (SITE, 5, 8, 40),
    "held": (SITE, 31, 35, 12),
}


def site_of(tmp_path, text, low, high, end, members=3):
    text = text.replace("low: 12, high: 22", f"low: {low}, high: {high}").replace("end_time: 20", f"end_time: {end}")
    return runout.read_site(write_site(tmp_path / "ramp", text.replace("members: 4", f"members: {members}")))


@pytest.mark.parametrize("case", CASES)
def test_steps_and_particle_steps_are_forecast_within_a_factor_of_one_and_a_half(tmp_path, case):
    site = site_of(tmp_path, *CASES[case])
    members = plan_members(site)
    assert len(members) == 3
    for member, expected in zip(members, flow_forecast.member_steps(site, members), strict=True):
        result = runout.simulate(**{**site.member_arguments(member.parameters), "seed": member.seed, "threads": 1})
        assert 1 / 1.5 < expected.steps / result.steps < 1.5
        held = np.interp(np.linspace(0, result.series["time"][-1], 200), result.series["time"], result.series["mass"])
        depth = flow_forecast.depth_of_flow(site.member_arguments(member.parameters), 0.0)
        assert 1 / 1.5 < depth / result.depth_resolution.depth < 1.5
        done = result.steps * held.mean() / held[0]
        assert 1 / 1.5 < expected.per_particle / done < 1.5


def test_the_member_that_is_resolved_least_is_forecast_from_the_fastest_and_the_smallest(tmp_path):
    volumes = "release_volume_factor: {distribution: uniform, low: 0.6, high: 1.4}"
    text = SITE.replace("low: 12, high: 22}", f"low: 12, high: 22}}\n    {volumes}")
    site = runout.read_site(write_site(tmp_path / "ramp", text))
    members = plan_members(site)
    stiffness = member_stiffness(site, site.data().releases, None, [m.parameters for m in members])
    found = flow_forecast.least_resolved(site, stiffness)
    runs = [runout.simulate(**{**site.member_arguments(m.parameters), "seed": m.seed, "threads": 1}) for m in members]
    cells = [run.depth_resolution.cells_through_depth for run in runs]
    assert 0.7 < min(cells) / found.cells_through_depth < 1.4
    assert found.cells_through_depth == pytest.approx(found.depth / 10.0)


def test_the_viscosity_of_transfers_is_forecast_with_their_substeps(tmp_path):
    found = []
    for substeps in (1, 4):
        text = SITE.replace("2.0e+6", "8.0e+7").replace("end_time: 20", f"end_time: 20, substeps: {substeps}")
        site = runout.read_site(write_site(tmp_path / f"of_{substeps}", text))
        members = member_stiffness(site, site.data().releases, None, [m.parameters for m in plan_members(site)])
        found.append(flow_forecast.least_resolved(site, members).numerical_viscosity)
    assert found[1] == pytest.approx(found[0] / 4)


def test_a_slab_that_goes_twelve_times_its_length_down_a_smooth_slope_comes_to_rest_at_once(tmp_path):
    """A long way alone makes no tail: all of the mass moves alike, thin as it is."""
    easting = 10.0 * np.arange(150) + 5.0
    elevation = np.broadcast_to(np.maximum(0.0, (500.0 - easting) * np.tan(np.radians(25.0))), (24, 150)).copy()
    thickness = np.zeros(elevation.shape)
    thickness[9:15, 3:9] = 3.0
    text = AUTO.replace("low: 12, high: 22", "low: 12, high: 12.1").replace("members: 4", "members: 1")
    text = text.replace("end_time: 20", "end_time: 150")
    site = runout.read_site(write_site(tmp_path / "slope", text, elevation, thickness))
    (member,), cell = plan_members(site), 10.0
    (expected,) = flow_forecast.member_steps(site, [member])
    result = runout.simulate(**{**site.member_arguments(member.parameters), "seed": member.seed, "threads": 1})
    rms = np.sqrt(2.0 * result.series["kinetic_energy"] / result.series["mass"])
    assert result.stop_reason == "at rest"
    assert rms @ np.diff(result.series["time"], prepend=0.0) > 12 * 6 * cell
    assert 0.95 < expected.steps / result.steps < 1.35


LAWS = {  # settings of the law, the parameter that members vary, and its range
    "weakening": ("law: velocity_weakening, static_friction: 0.84, dynamic_friction: 0.11", "dynamic_friction", 0.11, 0.3),
    "drag": ("law: voellmy, mu: 0.1, xi: 300", "mu", 0.1, 0.2),
}


@pytest.mark.parametrize("law", LAWS)
def test_steps_against_friction_that_depends_on_the_speed_are_forecast_within_a_factor_of_one_and_a_half(tmp_path, law):
    """In float64, for which the tests of the laws compile them."""
    settings, name, *ends = LAWS[law]
    text = AUTO.replace("basal_friction_angle_deg: 20", f"basal_friction: {{{settings}}}")
    text = text.replace("basal_friction_angle_deg: {", f"basal_{name}: {{").replace("end_time: 20", "end_time: 200")
    text = text.replace("low: 12, high: 22", "low: {}, high: {}".format(*ends)).replace("members: 4", "members: 2")
    site = runout.read_site(write_site(tmp_path / "ramp", text))
    members = plan_members(site)
    assert len(members) == 2
    for member, expected in zip(members, flow_forecast.member_steps(site, members), strict=True):
        arguments = {**site.member_arguments(member.parameters), "seed": member.seed, "threads": 1, "precision": "float64"}
        result = runout.simulate(**arguments)
        assert result.stop_reason == "at rest"
        assert 1 / 1.5 < expected.steps / result.steps < 1.5


def test_a_thin_flow_with_drag_in_a_channel_is_forecast_within_a_factor_of_one_and_a_half(tmp_path):
    """The mass gathers in the channel and stretches: it is faster than its mean thickness says, and its tail stops sooner."""
    easting, northing = 10.0 * np.arange(170) + 5.0, 10.0 * np.arange(24)[:, None] - 115.0
    along = np.interp(easting, [0.0, 400.0, 1500.0, 1700.0], [400.0, 190.0, 15.0, 75.0])
    elevation = along + northing**2 / 200.0
    thickness = np.zeros(elevation.shape)
    thickness[8:16, 3:13] = 2.0
    text = AUTO.replace("basal_friction_angle_deg: 20", "basal_friction: {law: voellmy, mu: 0.12, xi: 800}")
    text = text.replace("basal_friction_angle_deg: {", "basal_mu: {").replace("low: 12, high: 22", "low: 0.12, high: 0.121")
    text = text.replace("members: 4", "members: 1").replace("end_time: 20", "end_time: 600")
    site = runout.read_site(write_site(tmp_path / "channel", text, elevation, thickness))
    (member,) = plan_members(site)
    (expected,) = flow_forecast.member_steps(site, [member])
    result = runout.simulate(**{**site.member_arguments(member.parameters), "seed": member.seed, "threads": 1})
    assert result.stop_reason == "at rest"
    assert 1 / 1.5 < expected.steps / result.steps < 1.5
    depth = flow_forecast.depth_of_flow(site.member_arguments(member.parameters), 30.0)
    assert 1 / 1.5 < depth / result.depth_resolution.depth < 1.5


def test_forecast_counts_particles_exactly_and_adds_up_its_members(tmp_path, monkeypatch):
    monkeypatch.setattr(plan, "step_cost", lambda arguments: StepCost(1e-3, 1e-6))
    site = site_of(tmp_path, SITE, 12, 22, 12, members=4)
    expected = plan.forecast(site, [0, 1, 3], workers=1)
    found = flow_forecast.member_steps(site, [plan_members(site)[k] for k in (0, 1, 3)])
    made = runout.simulate(**{**site.member_arguments(plan_members(site)[0].parameters), "end_time": 0.01})
    assert expected.particles == plan.particle_count(site) == made.n_particles == 288
    assert expected.particle_steps == pytest.approx(288 * sum(one.per_particle for one in found))
    steps = [one.steps for one in found]
    assert expected.range_of_steps == (int(np.ceil(min(steps))), int(np.ceil(max(steps))))
    work = sum(1e-3 * one.steps + 1e-6 * 288 * one.per_particle for one in found)
    assert expected.seconds == pytest.approx(work + 3 * plan.SETUP_SECONDS)
    assert (expected.members, expected.workers) == (3, 1)


def test_softer_members_take_fewer_steps_and_many_members_slide_few_times(tmp_path, monkeypatch):
    site, slid = site_of(tmp_path, AUTO, 12, 22, 60, members=64), []
    slide = flow_forecast.slide
    monkeypatch.setattr(flow_forecast, "slide", lambda *given, **more: slid.append(given[2]) or slide(*given, **more))
    members = plan_members(site)
    found = flow_forecast.member_steps(site, members)
    assert sum(slid) == flow_forecast.EXACT
    order = np.argsort([m.parameters["basal_friction_angle_deg"] for m in members])
    steps = np.array([one.steps for one in found])[order]
    assert steps[0] > 1.2 * steps[-1]
    monkeypatch.setattr(flow_forecast, "EXACT", 64)
    exact = np.array([one.steps for one in flow_forecast.member_steps(site, members)])[order]
    np.testing.assert_allclose(steps, exact, rtol=0.1)


def test_time_of_a_step_grows_with_its_particles(tmp_path):
    cost, _ = measured_step_cost(site_of(tmp_path, SITE, 12, 22, 12).member_arguments())
    assert cost.step >= 0
    assert cost.particle > 0
    assert cost.seconds(10, 1000) == pytest.approx(10 * cost.step + 1000 * cost.particle)
