"""Forecasts of fluids with a yield stress, and of flows over a bed that is wetter than they are."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ramp_site import SITE as STATED_MODULUS
from ramp_site import write_site

import runout
from runout import Bed, DruckerPrager, HerschelBulkley, PorePressure, Release, Terrain
from runout.forecast.stiffness import chosen_moduli, stiffness
from runout.model.basal_strength import forecast_strengths, strengths
from runout.model.numerics import Numerics
from runout.model.scene import STANDARD_GRAVITY
from runout.simulation.scenario import build_scene, scene_arguments
from runout.workflow.check import inspect
from runout.workflow.check_stiffness import site_stiffness
from runout.workflow.flow_forecast import depth_of_flow, flows_of

SLOPE, HOLDING = math.radians(10.0), math.radians(30.0)  # of the ground, and the friction angle that holds the mass
MUD = HerschelBulkley(density=2000.0, yield_stress=6e3, consistency=200.0)
WEIGHT = 2000.0 * STANDARD_GRAVITY  # [N/m3]
SITE = STATED_MODULUS.replace(" youngs_modulus: 2.0e+6,", "")
MUD_SITE = """material: {law: herschel_bulkley, density: 2000, yield_stress: 5.0e4, consistency: 200}
basal_friction_angle_deg: 45
"""


def layer(thickness):
    """Terrain and release of a layer high on an inclined plane."""
    x = 5.0 * np.arange(80)
    terrain = Terrain.from_array(np.tile((400.0 - x) * math.tan(SLOPE), (20, 1)), 5.0)
    released = np.zeros(terrain.shape)
    released[8:12, 4:8] = thickness
    return terrain, Release.from_array(released, terrain, placement="on_surface")


def arguments_of(thickness, **changed):
    terrain, release = layer(thickness)
    arguments = {"terrain": terrain, "release": [release], "material": MUD, "basal_friction_angle": math.degrees(HOLDING)}
    return arguments | {"cell_size": 2.5, "end_time": 30.0, "stop": True, "friction_zones": None} | changed


def test_a_layer_moves_where_its_yield_stress_does_not_hold_it():
    """Thickness tau_y / (rho g tan a) decides on ground that holds the mass; friction of the ground decides on the rest."""
    holds = MUD.yield_stress / (WEIGHT * math.tan(SLOPE))
    speeds = {}
    for share in (0.9, 1.1, 3.0):
        _, release = layer(share * holds)
        (strength,) = forecast_strengths([MUD], [release], 2.5)
        assert strength == pytest.approx(math.tan(SLOPE) / share, rel=1e-6)
        assert strengths([MUD], 2.5) == (math.inf,), "what a flow passes on to the ground has no such limit"
        (flow,) = flows_of([arguments_of(share * holds)], 10.0)
        assert (flow.path > 1.0) == (share > 1.0)
        speeds[share] = stiffness([MUD], [release], [HOLDING], [strength]).flow_speed
        same = stiffness([MUD], [release], [math.atan(strength)], [math.inf]).flow_speed
        assert speeds[share] == pytest.approx(same, rel=1e-12), "as on ground of that friction"
    assert speeds[3.0] > 2.0 * speeds[1.1] > 2.0 * speeds[0.9]
    _, release = layer(0.9 * holds)
    weak = stiffness([MUD], [release], [math.radians(5.0)], forecast_strengths([MUD], [release], 2.5)).flow_speed
    assert weak > 2.0 * speeds[0.9], "it slides on ground that does not hold it, as a whole"
    assert depth_of_flow(arguments_of(3.0 * holds), 10.0) < 3.0 * holds


def test_other_laws_are_forecast_as_before():
    _, release = layer(4.0)
    for material in (
        DruckerPrager(density=2000.0, friction_angle=30.0, cohesion=1e3),
        runout.VonMises(density=1800.0, undrained_strength=2e4),
    ):
        assert forecast_strengths([material], [release], 2.5) == strengths([material], 2.5)


def test_a_wetter_bed_counts_in_the_modulus_of_a_wet_release_only():
    terrain, dry = layer(4.0)
    sand = DruckerPrager(density=2000.0, friction_angle=35.0)
    damp, wet = (replace(dry, pore_pressure=PorePressure(ratio=ratio, decay_time=5.0)) for ratio in (0.3, 0.8))

    def modulus(release, ratio=None):
        return chosen_moduli([sand], [release], [math.radians(12.0)], [0.6], None, ratio)[0].modulus

    assert modulus(damp, 0.8) == modulus(wet) > 1.1 * modulus(damp)
    assert modulus(damp, 0.1) == modulus(damp) == modulus(damp, 0.3)
    assert modulus(dry, 0.8) == modulus(dry), "mass that a dry release takes up is dry"
    bed, numerics = Bed(1.0, pore_pressure_ratio=0.8), Numerics(cell_size=5.0)
    made = [build_scene(terrain, damp, sand, 12.0, numerics, bed=one)[0].materials[0].modulus for one in (None, bed)]
    assert made[1] > 1.1 * made[0]


def modulus_of_member(site, sample):
    """Modulus [Pa] that the run of a member takes."""
    return build_scene(**scene_arguments(site.member_arguments(sample) | {"particles_per_cell": 8}))[0].materials[0].modulus


def test_check_states_the_modulus_of_the_run_over_a_wet_bed(tmp_path):
    pores = "    placement: on_surface\n    pore_pressure: {ratio: 0.3, decay_time: 5}\n"
    bed = "bed: {depth: 1, erosion: {law: ramms}, pore_pressure: {ratio: 0.5}}\n"
    text = SITE.replace("    placement: on_surface\n", pores).replace("simulation:", f"{bed}simulation:")
    text = text.replace("hazard:", "    bed_pore_pressure_ratio: {distribution: uniform, low: 0.4, high: 0.9}\nhazard:")
    site = runout.read_site(write_site(tmp_path / "site", text))
    releases = site.releases()
    own, *members = site_stiffness(site, releases, None)
    assert own.materials[0].modulus == pytest.approx(modulus_of_member(site, {}), rel=1e-6)
    dry_bed = runout.read_site(write_site(tmp_path / "dry", text.replace(", pore_pressure: {ratio: 0.5}", "")))
    assert own.flow_speed > 1.02 * site_stiffness(dry_bed, releases, None)[0].flow_speed
    assert max(m.flow_speed for m in members) > own.flow_speed


def test_check_says_on_which_slopes_a_yield_stress_holds_a_layer(tmp_path):
    left_out = ("material:", "basal_friction_angle_deg:", "  parameters:", "    basal_friction_angle_deg")
    lines = [line for line in SITE.splitlines(keepends=True) if not line.startswith(left_out)]
    text = "".join(lines).replace("simulation:", f"{MUD_SITE}simulation:")
    folder = write_site(tmp_path / "site", text)
    found = inspect(folder)
    assert not found.problems
    held = 5.0e4 / (WEIGHT * 8.0)
    angle = math.degrees(0.5 * math.asin(2.0 * held))
    (said,) = [note for note in found.notes if "yield stress" in note]
    assert f"its yield stress holds a layer of 8 m, its mean thickness, on slopes below {angle:.2g} deg" in said
    assert found.stiffness[0].flow_speed > 5.0, "the ground of 45 deg holds it, its yield stress does not"
    site = runout.read_site(folder)
    assert found.stiffness[0].materials[0].modulus == pytest.approx(modulus_of_member(site, {}), rel=1e-6)
    stiff = inspect(write_site(tmp_path / "stiff", text.replace("5.0e4", "5.0e5")))
    assert stiff.stiffness[0].flow_speed == 0.0
    assert any("on any slope" in note for note in stiff.notes)
