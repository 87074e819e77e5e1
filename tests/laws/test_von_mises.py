"""Undrained clay: simple shear, tension, and the thickness that stands on a slope."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_point import pressed, record, shear_stress, sheared

from runout.backends.protocol import get_backend
from runout.materials import von_mises
from runout.materials.von_mises import VonMises
from runout.physics import elastic
from runout.physics.tensors import trace
from runout.studies.verification_cases import flow
from runout.studies.verification_cases.closed_forms import GRAVITY

CLAY = VonMises(density=1700.0, youngs_modulus=5e6, undrained_strength=20e3)


@pytest.mark.parametrize("pressure", [10e3, 200e3])
def test_simple_shear_ends_at_the_strength_at_any_pressure(pressure):
    mat = record(CLAY)
    states = sheared(CLAY, mat, pressed(mat, pressure), 0.2, 2000)
    yields = 20e3 / mat.shear_modulus  # plastic from this shear on
    half = round(0.5 * yields / 1e-4)
    assert shear_stress(states[half - 1][0], mat) == pytest.approx(half * 1e-4 * mat.shear_modulus, rel=1e-3)
    assert shear_stress(states[-1][0], mat) == pytest.approx(20e3, rel=1e-12)
    assert elastic.pressure(states[-1][0], mat) == pytest.approx(pressure, rel=1e-9)
    assert sum(lost for _, _, lost in states) == pytest.approx(20e3 * (0.2 - yields), rel=5e-3)


@given(st.tuples(*[st.floats(-0.02, 0.02)] * 6), st.floats(0.0, 0.02))
def test_what_is_left_is_admissible_keeps_the_volume_and_carries_no_tension(h, history):
    mat = record(CLAY)
    new, left, lost = von_mises.update(h, history, mat, 1.0)
    assert shear_stress(new, mat) <= 20e3 * (1 + 1e-12)
    assert elastic.pressure(new, mat) >= -1e-9
    assert trace(new) + left == pytest.approx(trace(h) + history, abs=1e-14)
    assert lost >= -1e-9


def test_what_comes_apart_carries_nothing_until_it_has_closed_up():
    mat = record(CLAY)
    h, gained, lost = von_mises.update((1e-3, 1e-3, 1e-3, 2e-4, 0.0, 0.0), 0.0, mat, 1.0)
    assert (h, lost) == ((0.0,) * 6, 0.0)
    h, left, _ = von_mises.update((-5e-4, -5e-4, -5e-4, 0.0, 0.0, 0.0), gained, mat, 1.0)
    assert h == (0.0,) * 6
    assert left == pytest.approx(1.5e-3)


def test_friction_of_the_ground_is_at_most_the_strength_over_the_weight():
    assert CLAY.shear_strength(40e3) == pytest.approx(0.5)


def speed_after(strength, slope_deg=20.0, cells=10, time=0.25):
    """Speed [m/s] of the upper half of a layer of 1 m that starts at rest, on a floor that holds; strength [Pa]."""
    soft = replace(CLAY, youngs_modulus=2e6, undrained_strength=strength)
    scene, particles, height = flow.endless_slope(soft, 1.0, cells, slope_deg, lambda z: (0.0 * z, 0.0 * z))
    engine = get_backend("reference")
    engine.period[:2] = flow.PERIOD, flow.ACROSS
    engine.load(scene, particles)
    steps = math.ceil(time / engine.stable_step())
    for _ in range(steps):
        engine.step(time / steps)
    return float(engine.particles().velocity[height > 0.5, 0].mean())


def test_a_layer_stands_below_its_yield_thickness_and_slides_above_it():
    """It stands if s_u > rho g H sin(slope); else it gains at most g sin(slope) - s_u/(rho H), less until the base has yielded."""
    pull = 1700.0 * GRAVITY * math.sin(math.radians(20.0))
    assert abs(speed_after(1.1 * pull)) < 5e-3
    expected = 0.25 * 0.4 * GRAVITY * math.sin(math.radians(20.0))
    assert 0.5 * expected < speed_after(0.6 * pull) < expected
