"""Ground contact of one particle: unilateral, Coulomb on the whole tangential vector, no energy gain."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from symmetric import rotation

from runout.model.friction_laws import FRICTIONS
from runout.physics import contact

UP = (0.0, 0.0, 1.0)
velocity = st.tuples(*[st.floats(-10, 10)] * 3)
friction = st.floats(0.0, 1.5)
compliance = st.floats(1e-3, 10.0)


NONE = (0.0, 0.0, 0.0)


def impulse(u, n, gap, A, mu, dt, given):
    """Impulse with Coulomb friction ``mu``."""
    return FRICTIONS.find("coulomb").impulse(u, n, gap, A, SimpleNamespace(friction=mu), dt, given, 0.0)


def after(u, n, gap, A, mu, dt=0.01, given=NONE):
    """Velocity after the impulse and the impulse; ``u`` contains the ``given`` part of it."""
    one = np.array(impulse(u, n, gap, A, mu, dt, given))
    return np.array(u) + A * (one - given), one


def test_oblique_impact_slides_along_its_own_direction():
    """Velocity (1, 1, -1) and friction 0.5: 0.914 m/s at 45 degrees; axis by axis it would be 1.004 m/s at 49.9."""
    v, _ = after((1.0, 1.0, -1.0), UP, 0.0, 1.0, 0.5)
    np.testing.assert_allclose(v, (1 - 0.5 / np.sqrt(2), 1 - 0.5 / np.sqrt(2), 0.0), atol=1e-14)
    assert np.hypot(v[0], v[1]) == pytest.approx(np.sqrt(2) - 0.5, abs=1e-14)


def test_contact_within_the_friction_cone_sticks():
    v, one = after((0.3, -0.4, -1.0), UP, 0.0, 0.25, 0.6)
    np.testing.assert_allclose(v, 0.0, atol=1e-15)
    np.testing.assert_allclose(one, (-1.2, 1.6, 4.0), atol=1e-14)


def test_frictionless_contact_keeps_the_tangential_velocity():
    v, _ = after((2.0, 3.0, -1.0), UP, 0.0, 0.5, 0.0)
    np.testing.assert_allclose(v, (2.0, 3.0, 0.0), atol=1e-15)


def test_departing_particle_feels_nothing():
    assert impulse((1.0, 0.0, 0.1), UP, 0.0, 1.0, 0.5, 0.01, NONE) == NONE


def test_approach_is_slowed_just_enough_to_close_the_gap():
    v, _ = after((0.0, 0.0, -5.0), UP, 0.02, 1.0, 0.5, dt=0.01)
    assert v[2] == pytest.approx(-2.0)  # 0.02 m in 0.01 s
    assert impulse((0.0, 0.0, -1.5), UP, 0.02, 1.0, 0.5, 0.01, NONE) == NONE


def test_particle_below_the_ground_rises_by_a_twentieth_of_its_depth_in_a_step():
    v, _ = after((0.0, 0.0, -1.0), UP, -0.03, 1.0, 0.5, dt=0.01)
    assert v[2] * 0.01 == pytest.approx(0.03 / 20)


def test_particle_deep_below_the_ground_gets_back_half_its_speed_and_no_more():
    v, _ = after((0.0, 0.0, -1.0), UP, -30.0, 1.0, 0.5)
    assert v[2] == pytest.approx(0.5)


def test_departing_particle_below_the_ground_feels_nothing():
    assert impulse((1.0, 0.0, 0.1), UP, -0.3, 1.0, 0.5, 0.01, NONE) == NONE


def test_load_presses_in_every_step_while_a_particle_rises_out_of_the_ground():
    """Under its weight, 3 s: the impulse never vanishes, so that friction holds all the while, and the depth goes to zero."""
    depth, speed, dt = 1e-3, 0.0, 1e-3
    for _ in range(3000):
        (_, _, speed), push = after((0.0, 0.0, speed - 9.81 * dt), UP, -depth, 1.0, 0.5, dt)
        assert push[2] > 0.0
        depth -= speed * dt
    assert 0 <= depth < 1e-6


@given(velocity, friction, compliance, st.floats(-0.1, 0.1), st.integers(0, 10_000))
def test_impulse_never_pulls_stays_in_the_friction_cone_and_takes_energy(u, mu, A, gap, seed):
    n = rotation(np.random.default_rng(seed))[:, 0]
    v, one = after(u, tuple(n), gap, A, mu)
    normal = one @ n
    tangential = np.linalg.norm(one - normal * n)
    size = np.abs(one).max() + 1e-300
    assert normal >= -1e-12 * size
    assert tangential <= mu * normal + 1e-9 * size
    assert v @ v <= np.dot(u, u) * (1 + 1e-12) + 1e-12
    if normal > 0:
        assert v @ n == pytest.approx(contact.normal_target(np.dot(u, n), gap, 0.01), abs=1e-9)


@given(velocity, friction, compliance, st.integers(0, 10_000))
def test_impulse_turns_with_the_ground(u, mu, A, seed):
    q = rotation(np.random.default_rng(seed))
    still = np.array(impulse(u, UP, 0.0, A, mu, 0.01, NONE))
    turned = np.array(impulse(tuple(q @ np.array(u)), tuple(q[:, 2]), 0.0, A, mu, 0.01, NONE))
    np.testing.assert_allclose(turned, q @ still, atol=1e-9 * (1 + np.abs(still).max()))


impulses = st.tuples(*[st.floats(-10, 10)] * 3)


@given(velocity, impulses, friction, compliance, st.floats(-0.1, 0.1), st.integers(0, 10_000))
def test_impulse_depends_on_the_start_only_through_neighbours(u, begun, mu, A, gap, seed):
    """With the particle's own compliance the result is that of a cold start: the start matters where neighbours differ."""
    n = tuple(rotation(np.random.default_rng(seed))[:, 0])
    felt = np.array(u) + A * np.array(begun)
    warm = np.array(impulse(tuple(felt), n, gap, A, mu, 0.01, begun))
    cold = np.array(impulse(u, n, gap, A, mu, 0.01, NONE))
    np.testing.assert_allclose(warm, cold, atol=1e-9 * (1 + np.abs(begun).max() + np.abs(cold).max()))


def test_impulse_begun_too_large_is_taken_back():
    v, one = after((0.0, 0.0, 2.0), UP, 0.0, 1.0, 0.5, given=(0.3, 0.0, 3.0))
    np.testing.assert_allclose(one, (0.3, 0.0, 1.0), atol=1e-14)
    assert v[2] == 0.0
    assert impulse((0.0, 0.0, 2.0), UP, 0.0, 1.0, 0.5, 0.01, (0.0, 0.0, 1.0)) == NONE


def test_work_of_a_held_load_is_none_whatever_it_starts_from():
    """Gravity brings 0.1 m/s in the step and the ground takes it: velocities before and after are zero."""
    for begun in (0.0, 0.05, 0.1):
        u, given = (0.0, 0.0, begun - 0.1), (0.0, 0.0, begun)
        push = impulse(u, UP, 0.0, 1.0, 0.5, 0.01, given)
        assert push[2] == pytest.approx(0.1)
        assert contact.work(push, given, NONE, u, 1.0) == pytest.approx(0.0, abs=1e-15)


def test_contact_begins_when_the_gap_would_close_within_the_step():
    dt, band = 0.01, 0.002
    assert contact.in_contact(0.0, 0.0, dt, band)
    assert contact.in_contact(-0.5, 3.0, dt, band)
    assert contact.in_contact(0.05, -6.0, dt, band)
    assert not contact.in_contact(0.05, -4.0, dt, band)
    assert not contact.in_contact(0.003, 5.0, dt, band)
