"""Stress of a mass under its own weight: balanced, inside the yield cone, and left alone by every law."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from symmetric import matrix

from runout import DruckerPrager, Elastic, GranularFlow
from runout.backends.initial_stress import strain_at_rest
from runout.materials.drucker_prager import Cone
from runout.model.laws import LAWS, law_of
from runout.physics import elastic, geostatic
from runout.physics.tensors import deviator, norm, tens, trace

REST = {"density": 2000.0, "youngs_modulus": 5e6, "poisson_ratio": 0.3}
SLOPES = st.floats(-1.5, 1.5)
MATERIALS = st.one_of(
    st.builds(
        DruckerPrager, **{k: st.just(v) for k, v in REST.items()}, friction_angle=st.floats(1.6, 60), cone=st.sampled_from(Cone),
        cohesion=st.sampled_from([0.0, 500.0, 5e4]),
    ),
    st.builds(DruckerPrager, **{k: st.just(v) for k, v in REST.items()}, friction_angle=st.just(0.0), cohesion=st.just(3e3)),
    st.builds(
        GranularFlow, **{k: st.just(v) for k, v in REST.items()}, static_friction=st.floats(0.01, 1.0),
        dynamic_friction=st.just(1.2), grain_size=st.just(0.01),
    ),
    st.just(Elastic(**REST)),
    st.sampled_from([law.example for law in LAWS.of_runout()]),
)  # fmt: skip


def record(material):
    return SimpleNamespace(**material.record() | {"time_step": 1e-3})


def stress_of(material, depth, east, north, friction):
    """Stress (3, 3) [Pa] and elastic strain B of a particle of a release."""
    (strain,) = strain_at_rest(material, np.array([depth]), (np.array([east]), np.array([north])), np.array([friction]))
    return matrix(elastic.kirchhoff_stress(elastic.log_strain(tuple(strain.tolist())), record(material))), tuple(strain.tolist())


@given(SLOPES, SLOPES, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_normal_traction_is_that_of_the_weight_and_the_shear_its_share(east, north, share, ratio):
    stress = matrix(geostatic.slope_stress(3.0, east, north, share, ratio))
    n = np.array([-east, -north, 1.0]) / math.hypot(east, north, 1.0)
    weight = np.array([0.0, 0.0, -3.0]) * n[2]  # over the area of the plane
    traction, pressed = stress @ n, (weight @ n) * n
    np.testing.assert_allclose(traction, pressed + share * (weight - pressed), atol=1e-12)
    across = np.array([-north, east, 0.0])
    assert across @ stress @ across == pytest.approx(ratio * (weight @ n) * (across @ across), abs=1e-12)


def test_a_rough_slope_is_in_equilibrium_whatever_the_stress_along_it():
    """div(sigma) + rho g = 0, with a stress that grows with the vertical depth below the plane."""
    east, north = 0.3, -0.5
    stress = matrix(geostatic.slope_stress(1.0, east, north, 1.0, 0.6))
    np.testing.assert_allclose(stress @ np.array([east, north, -1.0]), [0.0, 0.0, 1.0], atol=1e-14)


def test_level_ground_has_the_ratio_of_jaky_and_no_shear():
    sand = DruckerPrager(**REST, friction_angle=30.0)
    stress, _ = stress_of(sand, 5.0, 0.0, 0.0, 0.4)
    vertical = -2000.0 * 9.81 * 5.0
    np.testing.assert_allclose(stress, vertical * np.diag([0.5, 0.5, 1.0]), rtol=1e-10, atol=1e-6)
    assert stress_of(Elastic(**REST), 5.0, 0.0, 0.0, 0.4)[0][0, 0] == pytest.approx(vertical * 0.3 / 0.7)


@settings(max_examples=300, deadline=None)
@given(MATERIALS, st.floats(0.1, 8.0), SLOPES, SLOPES, st.floats(0.0, 2.0))
def test_every_law_leaves_the_initial_stress_as_it_is(material, depth, east, north, friction):
    """So it lies inside the cone, or on it; what rounding makes of that is below a thousand-millionth."""
    stress, strain = stress_of(material, depth, east, north, friction)
    new, _, history, lost = law_of(material).step(strain, tens(*[0.0] * 9), 0.0, record(material))
    np.testing.assert_allclose(new, strain, atol=1e-9 * max(map(abs, strain)))
    assert history <= 1e-12
    assert abs(lost) <= 1e-9 * abs(np.trace(stress)) * max(map(abs, strain))


@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 60.0), st.floats(0.0, 1.0), st.floats(0.0, 0.5))
def test_the_lateral_stress_is_the_least_that_the_cone_admits(phi, share, cohesion):
    s = math.sin(math.radians(phi))
    slope, rest = math.sqrt(3.0) * s, 1.0 - s
    shear = share * geostatic.shear_strength(slope, cohesion)
    ratio = geostatic.lateral_ratio(rest, shear, slope, cohesion)

    def excess(k):
        return math.hypot(1.0 - k, math.sqrt(3.0) * shear) - slope * (1.0 + 2.0 * k) / 3.0 - cohesion

    assert rest <= ratio <= 1.0
    assert excess(ratio) <= 1e-9
    if ratio > rest:
        assert excess(ratio - 1e-4) > 0.0


@given(st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6))
def test_the_strain_of_a_stress_has_that_stress(tau):
    mat = record(Elastic(**REST))
    found = elastic.kirchhoff_stress(elastic.strain_of_stress(tuple(tau), mat), mat)
    np.testing.assert_allclose(found, tau, rtol=1e-9, atol=1e-6)


def test_simple_shear_of_the_law_ends_at_the_shear_strength():
    """Sheared at constant volume, each law passes on what shear_strength says: sin(phi) with the default cone."""
    fast = GranularFlow(**REST, static_friction=0.4, dynamic_friction=0.6, grain_size=100.0)  # grains so large that I is 100
    for material, rate in ((DruckerPrager(**REST, friction_angle=30.0), 1e-4), (fast, 1e-2)):
        mat, history = record(material), 0.0
        _, strain = stress_of(material, 4.0, 0.0, 0.0, 0.0)
        for _ in range(3000):
            strain, h, history, _ = law_of(material).step(strain, tens(0, 0, rate, 0, 0, 0, 0, 0, 0), history, mat)
        tau = elastic.kirchhoff_stress(h, mat)
        assert -tau[5] / tau[2] == pytest.approx(material.shear_strength(math.inf), rel=1.5e-2)
        assert norm(deviator(tau)) < abs(trace(tau))


def test_strength_counts_cohesion_with_the_pressure_and_names_the_cone():
    def strength(pressure, **choices):
        return DruckerPrager(**REST, friction_angle=30.0, **choices).shear_strength(pressure)

    assert strength(math.inf) == pytest.approx(0.5)
    assert strength(1e4, cohesion=1e3) == pytest.approx(0.5 + 0.1 * math.cos(math.radians(30.0)))
    assert strength(math.inf, cone=Cone.TRIAXIAL_COMPRESSION) == pytest.approx(1.2 / math.sqrt(3.0))
    assert DruckerPrager(**REST, friction_angle=30.0).internal_friction == pytest.approx(0.5)
    assert Elastic(**REST).shear_strength(1e4) == math.inf
