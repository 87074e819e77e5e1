"""The closed forms against independent routes: differences, an ODE, Newton's law in the weak form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from runout.materials.elastic import Elastic
from runout.physics import elastic
from runout.studies.verification_cases.closed_forms import (
    GRAVITY,
    AxisAlignedWave,
    Vortex,
    ZonesDownSlope,
    standing_column,
    symplectic_free_fall,
)

MATERIAL = Elastic(density=3072.0, youngs_modulus=1.024e7, poisson_ratio=0.3)


def hencky(F):
    """First Piola stress P = tau F^-T of a deformation gradient (d, d), plane strain when d = 2."""
    full = np.eye(3)
    full[: len(F), : len(F)] = F
    B = full @ full.T - np.eye(3)
    h = elastic.log_strain((B[0, 0], B[1, 1], B[2, 2], B[0, 1], B[1, 2], B[2, 0]))
    t = elastic.kirchhoff_stress(h, MATERIAL)
    tau = np.array([[t[0], t[3], t[5]], [t[3], t[1], t[4]], [t[5], t[4], t[2]]])
    return (tau @ np.linalg.inv(full).T)[: len(F), : len(F)]


def needed(place, X, t, step=1e-4):
    """Body force at X (d,) by differences of the motion ``place(X, t)``: acceleration less Div P over rho."""
    d, e = len(X), step * np.eye(len(X))

    def gradient(Y):
        return np.column_stack([(place(Y + a, t) - place(Y - a, t)) / (2 * step) for a in e])

    divergence = sum((hencky(gradient(X + e[k])) - hencky(gradient(X - e[k])))[:, k] / (2 * step) for k in range(d))
    dt = 1e-5
    acceleration = (place(X, t + dt) - 2 * place(X, t) + place(X, t - dt)) / dt**2
    return acceleration - divergence / MATERIAL.density


@pytest.mark.parametrize("amplitude", [(0.05, 0.0, 0.0), (0.05, 0.04, 0.0), (0.05, 0.04, 0.03)])
def test_force_of_the_waves_satisfies_the_equation_of_motion(amplitude):
    waves, X, t = AxisAlignedWave(MATERIAL, amplitude), np.array([0.31, 0.77, 1.12]), 0.0123
    found = needed(lambda Y, s: Y + waves.displacement(Y[None], s)[0], X, t)
    np.testing.assert_allclose(waves.body_force(X[None], t)[0], found, atol=2e-4 * np.abs(found).max())


@pytest.mark.parametrize("X", [(0.85, 0.1), (-0.5, 0.99), (0.2, -1.1)])
def test_force_of_the_vortex_satisfies_the_equation_of_motion(X):
    vortex, X, t = Vortex(MATERIAL, 0.3), np.array(X), 0.0037
    found = needed(lambda Y, s: vortex.place(Y[None], s)[0], X, t)
    np.testing.assert_allclose(vortex.body_force(X[None], t)[0], found, atol=2e-4 * np.abs(found).max())


def test_vortex_leaves_what_lies_outside_the_ring_alone():
    vortex, X = Vortex(MATERIAL, 1.0), np.array([[0.7, 0.0], [0.0, -1.3]])
    np.testing.assert_array_equal(vortex.velocity(X, 0.1), 0.0)
    np.testing.assert_allclose(vortex.place(X, 0.1), X, atol=1e-15)
    np.testing.assert_array_equal(vortex.body_force(X, 0.1), 0.0)


def test_velocities_and_their_gradients_are_those_of_the_motion():
    t, d = 0.0037, 1e-6
    waves, X = AxisAlignedWave(MATERIAL, (0.05, 0.04, 0.03)), np.array([[0.31, 0.77, 1.12]])
    np.testing.assert_allclose(
        waves.velocity(X, t), (waves.displacement(X, t + d) - waves.displacement(X, t - d)) / (2 * d), rtol=1e-7
    )
    stretching = (waves.stretch(X, t + d) - waves.stretch(X, t - d)) / (2 * d) / waves.stretch(X, t)
    np.testing.assert_allclose(waves.velocity_gradient(X, t), stretching, rtol=1e-6)
    vortex, Y = Vortex(MATERIAL, 0.3), np.array([[0.85, 0.1]])
    np.testing.assert_allclose(vortex.velocity(Y, t), (vortex.place(Y, t + d) - vortex.place(Y, t - d)) / (2 * d), rtol=1e-6)
    e = d * np.eye(2)
    F, rate = (np.column_stack([(f(Y + a, t) - f(Y - a, t))[0] / (2 * d) for a in e]) for f in (vortex.place, vortex.velocity))
    np.testing.assert_allclose(vortex.velocity_gradient(Y, t)[0], rate @ np.linalg.inv(F), rtol=1e-5, atol=1e-3)


def test_column_stands_as_an_ode_says_and_its_stress_carries_its_weight():
    length, weight, modulus = 50.0, 800.0, 1e6
    Y = np.array([0.0, 10.0, 50.0])
    stretch, stress, height = standing_column(Y, length, weight, modulus)
    np.testing.assert_allclose(modulus * np.log(stretch) / stretch, stress, atol=1e-6)
    assert stress[0] == pytest.approx(-40000.0)
    found = solve_ivp(
        lambda y, _: [np.exp(-np.real(lambertw(weight * (length - y) / modulus)))], (0, length), [0.0], rtol=1e-11, atol=1e-12
    )
    assert height[2] == pytest.approx(found.y[0, -1], abs=1e-7)


def test_free_fall_is_what_symplectic_euler_does():
    z = v = 0.0
    for _ in range(137):
        v -= 9.81e-3
        z += v * 1e-3
    np.testing.assert_allclose(symplectic_free_fall(137, 1e-3), (z, v), atol=1e-12)


def test_speed_over_coulomb_zones_is_that_of_the_energy_with_the_share_of_length_beyond_each_border():
    """Integral of the share: (X - X_1)^2 / (2 length) while the body lies on both sides, then its half length more than the way."""
    zones, places = ZonesDownSlope((20.0, 26.0), (0.1, 0.35, 0.6)), np.linspace(10.0, 40.0, 13)
    slope, work = np.radians(25.0), 0.1 * (places - 10.0)
    for border in zones.borders:  # both steps of friction are 0.25
        front = np.clip(places + 6.0 - border, 0.0, None)
        work += 0.25 * np.where(front < 12.0, front**2 / 24.0, front - 6.0)
    square = 16.0 + 2 * GRAVITY * (np.sin(slope) * (places - 10.0) - np.cos(slope) * work)
    np.testing.assert_allclose(zones.speeds(places, 12.0, 25.0, 4.0), np.sqrt(square), rtol=1e-6)


def test_speed_within_a_voellmy_zone_goes_to_its_terminal_speed():
    zones, places = ZonesDownSlope((1e3,), (0.1, 0.3), (0.05, 0.2)), np.linspace(0.0, 60.0, 7)
    terminal = GRAVITY * (np.sin(np.radians(25.0)) - 0.1 * np.cos(np.radians(25.0))) / 0.05
    square = terminal + (16.0 - terminal) * np.exp(-2 * 0.05 * places)
    np.testing.assert_allclose(zones.speeds(places, 2.0, 25.0, 4.0), np.sqrt(square), rtol=1e-6)


def test_pressure_on_a_lever_moves_the_mean_friction_of_a_border_by_the_offset_of_the_centre_of_pressure():
    """Sum of mu p over the length, with the linear pressure whose moment is that of the friction, against the closed form."""
    zones, length, lever = ZonesDownSlope((0.0,), (0.2, 0.6)), 10.0, 1.5
    x = (np.arange(200_000) + 0.5) / 200_000 * length - length / 2
    for place in (-2.0, 1.0):
        mean = 0.4
        for _ in range(60):
            pressure = 1.0 + 12.0 * lever * mean * x / length**2
            mean = np.where(x + place > 0.0, 0.6, 0.2) @ pressure / len(x)
        near = place + np.array([0.0, 1e-4])
        square = zones.speeds(near, length, 25.0, 4.0, lever) ** 2
        slope = np.radians(25.0)
        assert np.diff(square)[0] / 1e-4 == pytest.approx(2 * GRAVITY * (np.sin(slope) - mean * np.cos(slope)), rel=1e-3)
