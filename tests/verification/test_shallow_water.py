"""The closed forms of depth-averaged flow against its equations: balances of mass and momentum, jump conditions."""

import numpy as np
import pytest

from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.dam_breaks import SpreadingCap, dam_break, earth_pressure, wet_dam_break, wet_middle_state


@pytest.mark.parametrize(("slope", "friction", "pressure"), [(0.0, 0.0, 1.0), (30.0, 20.0, 1.0), (22.0, 21.0, 0.6)])
def test_dam_break_keeps_mass_and_momentum(slope, friction, pressure):
    x, t, d, depth = np.linspace(-30.0, 60.0, 3001), 2.0, 1e-4, 3.0
    (h, u), (h1, u1), (h2, u2) = (dam_break(x, s, depth, slope, friction, pressure) for s in (t, t - d, t + d))
    fan = (h > 0.05) & (h < 0.98 * depth)
    weight = GRAVITY * np.cos(np.radians(slope))
    pull = weight * (np.tan(np.radians(slope)) - np.tan(np.radians(friction)))
    mass = (h2 - h1) / (2 * d) + np.gradient(h * u, x)
    momentum = (u2 - u1) / (2 * d) + u * np.gradient(u, x) + pressure * weight * np.gradient(h, x) - pull
    assert np.abs(mass[fan]).max() < 2e-3
    assert np.abs(momentum[fan]).max() < 2e-3
    assert fan.sum() > 300


def test_shock_of_a_wet_dam_break_keeps_mass_and_momentum():
    middle, speed, shock = wet_middle_state(1.0, 0.1)
    assert middle * (speed - shock) == pytest.approx(-0.1 * shock)
    assert middle * (speed - shock) ** 2 + GRAVITY * middle**2 / 2 == pytest.approx(0.1 * shock**2 + GRAVITY * 0.01 / 2)
    x = np.linspace(-20.0, 30.0, 50001)
    h = wet_dam_break(x, 2.0, 1.0, 0.1)
    assert np.trapezoid(h, x) == pytest.approx(20.0 + 3.0, rel=1e-3)


@pytest.mark.parametrize("across", [0.0, 80.0])
def test_cap_keeps_its_volume_and_follows_its_equation_of_motion(across):
    cap, t, d = SpreadingCap(across=across), 4.0, 1e-4
    x = np.linspace(-150.0, 250.0, 1601)
    y = np.linspace(-150.0, 150.0, 601)
    h = cap.thickness(x[:, None], y[None, :], 5.0)
    volume = np.trapezoid(np.trapezoid(h, y, axis=1), x) if across else np.trapezoid(h[:, 0], x)
    assert volume == pytest.approx(np.pi / 2 * 80 * 80 * 4 if across else 4 / 3 * 80 * 4, rel=1e-3)
    place = cap.reach(t)[0] - 30.0
    rate = (cap.speed(place, t + d) - cap.speed(place, t - d)) / (2 * d)
    slopes = [(f(place + d) - f(place - d)) / (2 * d) for f in (lambda q: cap.speed(q, t), lambda q: cap.thickness(q, 10.0, t))]
    slope, friction = np.radians(35.0), np.radians(25.0)
    pull = GRAVITY * np.cos(slope) * (np.tan(slope) - np.tan(friction) - slopes[1])
    assert rate + cap.speed(place, t) * slopes[0] == pytest.approx(pull, abs=1e-4)


def test_cap_is_that_of_the_literature():
    np.testing.assert_allclose(SpreadingCap().reach(5.0), (113.09, -66.10, 83.16), atol=5e-3)


def test_earth_pressure_is_one_where_all_shear_is_that_of_the_bed():
    friction = 25.0
    internal = np.degrees(np.arcsin(np.tan(np.radians(friction))))
    assert earth_pressure(internal, friction) == pytest.approx(1.0)
    assert earth_pressure(40.0, 0.0) == pytest.approx((1 - np.sin(np.radians(40.0))) / (1 + np.sin(np.radians(40.0))))
