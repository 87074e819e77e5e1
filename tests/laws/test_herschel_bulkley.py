"""Herschel-Bulkley and Bingham mud: its flow curve at any step, what it admits, and a heap. `runout verify mud` has layers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_point import pressed, record, shear_stress, sheared

import runout
from runout.materials import herschel_bulkley
from runout.materials.herschel_bulkley import HerschelBulkley
from runout.physics import elastic
from runout.studies.verification_cases import mud_slope

MUD = HerschelBulkley(density=1800.0, youngs_modulus=5e6, yield_stress=2e3, consistency=500.0, flow_index=0.5)
BINGHAM = replace(MUD, flow_index=1.0)


@pytest.mark.parametrize("material", [MUD, BINGHAM], ids=["n = 0.5", "Bingham"])
@pytest.mark.parametrize("rate", [0.01, 1.0, 30.0])
def test_steady_shear_has_the_stress_of_the_flow_curve(material, rate):
    dt = min(1e-3, 1e-3 / rate)
    mat = record(material, time_step=dt)
    states = sheared(material, mat, pressed(mat, 25e3), 0.05, int(0.05 / (rate * dt)))  # the elastic strain is 1e-3
    expected = 2e3 + 500.0 * rate**material.flow_index
    h, _, lost = states[-1]
    assert shear_stress(h, mat) == pytest.approx(expected, rel=5e-3)
    assert lost == pytest.approx(expected * rate * dt, rel=0.02)


@pytest.mark.parametrize("dt", [1e-6, 1e-3, 1.0])
def test_the_flow_curve_holds_at_steps_far_above_and_below_the_viscous_time(dt):
    """The viscous time K/G of this mud is 2.6e-4 s; an explicit viscosity is unstable above a share of it."""
    mat = record(BINGHAM, time_step=dt)
    excess = 500.0 * 2.0 + mat.shear_modulus * 2.0 * dt  # trial stress of a rate of 2/s from the flow curve
    assert herschel_bulkley.viscous_stress(excess, mat) == pytest.approx(1000.0, rel=1e-9)


@pytest.mark.parametrize("excess", [1e-2, 1.0, 1e3, 1e6])
@pytest.mark.parametrize(("index", "dt"), [(0.2, 1e-5), (0.5, 1e-3), (1.0, 1e-1)])
def test_the_viscous_stress_is_exact_to_rounding(excess, index, dt):
    mat = record(replace(MUD, flow_index=index), time_step=dt)
    w = herschel_bulkley.viscous_stress(excess, mat)
    assert w + mat.shear_modulus * dt * (w / 500.0) ** (1 / index) == pytest.approx(excess, rel=1e-13)


@settings(max_examples=200)
@given(
    st.tuples(*[st.floats(-0.02, 0.02)] * 6), st.floats(0.0, 0.02), st.floats(1.0, 1e5), st.floats(1e-3, 1e6), st.floats(0.2, 1.0),
    st.floats(1e-6, 1e-1),
)  # fmt: skip
def test_what_is_left_lies_between_yield_and_trial_stress(h, history, yield_stress, consistency, index, dt):
    mat = record(replace(MUD, yield_stress=yield_stress, consistency=consistency, flow_index=index), time_step=dt)
    new, left, lost = herschel_bulkley.update(h, history, mat, 1.0)
    s, trial = shear_stress(new, mat), shear_stress(h, mat)
    assert s <= trial * (1 + 1e-9)
    assert elastic.pressure(new, mat) >= -1e-9
    if elastic.pressure(new, mat) > 1e-6:
        assert s >= min(trial, yield_stress) * (1 - 1e-9)
    assert left >= 0.0
    assert lost >= -1e-9 * elastic.energy_density(h, mat)


def test_mud_limits_friction_of_the_ground_by_no_strength_and_holds_its_yield_stress_at_rest():
    assert MUD.shear_strength(1e4) == math.inf
    assert MUD.yield_cone == (0.0, pytest.approx(math.sqrt(3.0) * 2e3))


def test_closed_form_of_the_layer_balances_momentum_and_its_mean_is_the_mean():
    """Its stress tau_y + K rate^n is the weight above, where it is sheared."""
    height = (np.arange(20_000) + 0.5) / 20_000
    for layer in (mud_slope.BINGHAM, mud_slope.THINNING):
        speed, rate = layer.profile(height)
        below = height < layer.yielding
        stress = layer.mud.yield_stress + layer.consistency * rate**layer.exponent
        np.testing.assert_allclose(stress[below], mud_slope.WEIGHT * (1.0 - height[below]), rtol=1e-9)
        np.testing.assert_allclose(np.gradient(speed, height)[1:-1], rate[1:-1], atol=1e-3 * rate.max())
        assert speed.mean() == pytest.approx(layer.mean_speed, rel=1e-6)


def test_a_heap_of_mud_stops_on_a_slope_no_thicker_than_it_yields():
    """On 12 degrees mud of 1800 kg/m3 and 5 kPa stands 1.4 m thick, across the slope; it starts with 4 m."""
    slope = math.radians(12.0)
    x, y = np.meshgrid(np.arange(0.25, 60.0, 0.5), np.arange(0.25, 16.0, 0.5))
    terrain = runout.Terrain.from_array(50.0 - math.tan(slope) * x, 0.5)
    heap = np.where((abs(x - 15.0) < 4.0) & (abs(y - 8.0) < 4.0), 4.0, 0.0)
    mud = HerschelBulkley(density=1800.0, youngs_modulus=2e6, yield_stress=5e3, consistency=300.0)
    release = runout.Release.from_array(heap, terrain, placement="on_surface")
    result = runout.simulate(terrain, release, mud, basal_friction_angle=60.0, cell_size=0.5, end_time=15.0, threads=1)
    yields = 5e3 / (1800.0 * 9.81 * math.sin(slope)) / math.cos(slope)  # vertical thickness
    assert 0.5 * yields < float(result.maps.deposit_thickness.max()) < 1.1 * yields
    assert result.stop_reason == "at rest"
