"""Moments of particles against matrices: gradients, stress, affine momentum and the energies of a particle."""

from types import SimpleNamespace

import numpy as np
import pytest

from runout.physics import moments, plastic

RNG = np.random.default_rng(8)
BX, BY, BZ, F, V, D = RNG.normal(size=(6, 3))
S = np.array([0.2, 0.3, 0.5])  # slopes of three unequal spacings
GRADIENT = np.column_stack((BX, BY, BZ)) * S


def test_slopes_of_a_step_are_those_of_the_second_moment():
    assert moments.moment_slope(0.01, 2.0) == pytest.approx(0.01 * 2.0 / (2.0**2 / 4))


def test_moments_about_a_point_lose_the_part_of_the_mean_velocity():
    for axis in range(3):
        np.testing.assert_allclose(moments.moment_about(BX, F[axis], V), BX - F[axis] * V, rtol=1e-14)


def test_velocity_gradient_has_the_moments_as_columns():
    np.testing.assert_allclose(np.reshape(moments.velocity_gradient(BX, BY, BZ, S), (3, 3)), GRADIENT, rtol=1e-14)


def test_impulse_of_the_stress_is_the_negative_stress_times_volume_and_slope_by_axis():
    tau = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    matrix = np.array([[1.0, 4.0, 6.0], [4.0, 2.0, 5.0], [6.0, 5.0, 3.0]])
    columns = np.reshape(moments.stress_columns(tau, 7.0, S), (3, 3))
    np.testing.assert_allclose(columns, -7.0 * S[:, None] * matrix, rtol=1e-14)


def test_affine_momentum_is_linear_in_the_offset_and_carries_the_gradient():
    m, h, p = 3.0, 2.0, np.array([1.0, -2.0, 0.5])
    columns = np.reshape(moments.affine_columns(m, BX, BY, BZ), (3, 3))
    np.testing.assert_allclose(columns, 4.0 * m * np.array([BX, BY, BZ]), rtol=1e-14)
    np.testing.assert_allclose(moments.momentum_at(p, *columns, D), p + columns.T @ D, rtol=1e-13)
    assert moments.gradient_column(columns[0, 1], m, h) == pytest.approx(4.0 * BX[1] / h)
    assert moments.node_velocity(6.0, 3.0, -0.5) == 1.5
    assert moments.velocity_after(1.0, 6.0, 0.5) == 4.0


def test_kinetic_energy_is_that_of_the_mass_and_of_its_weights():
    """27 nodes of unit spacing around a particle on a node hold the energy of the velocities that it gives them."""
    m, v = 2.0, np.array([0.3, -0.4, 0.5])
    C = np.column_stack((BX, BY, BZ)) * 4.0
    weights = np.array([1 / 8, 3 / 4, 1 / 8])
    nodes = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), -1).reshape(-1, 3)
    share = weights[nodes + 1].prod(axis=1)
    exact = 0.5 * m * (share * ((v + nodes @ C.T) ** 2).sum(axis=1)).sum()
    assert moments.kinetic_energy(m, m * v, *(m * C.T)) == pytest.approx(exact)
    assert moments.potential_energy(m, (0.0, 1.0, -9.81), (5.0, 2.0, 3.0)) == pytest.approx(2.0 * (9.81 * 3.0 - 2.0))


@pytest.mark.parametrize("component", range(6))
def test_a_strain_that_a_return_changes_in_one_component_has_flowed(component):
    h = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3)
    new = tuple(value + (k == component) * 1e-6 for k, value in enumerate(h))
    assert plastic.same(h, h)
    assert not plastic.same(h, new)


def test_a_return_gains_the_volume_that_it_takes_and_never_less_than_none():
    big, small = (3e-3, 2e-3, 1e-3, 0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3, 9.0, 9.0, 9.0)
    assert plastic.gained_volume(big, small) == pytest.approx(3e-3)
    assert plastic.gained_volume(small, big) == 0.0


def test_dissipation_is_the_stress_after_the_return_times_the_plastic_strain():
    mat = SimpleNamespace(lame_lambda=2.0, shear_modulus=3.0)
    new, trial = (1.0, 0.0, 0.0, 0.5, 0.0, 0.0), (1.0, 0.0, 0.0, 0.7, 0.0, 0.0)
    assert plastic.dissipated_energy(trial, new, mat) == pytest.approx(2 * (2 * 3.0 * 0.5) * 0.2)


def test_end_of_a_step_without_flow_keeps_the_trial_strain_and_dissipates_nothing():
    trial, h, new = (2e-3, 0.0, 0.0, 0.0, 0.0, 0.0), (1e-3, 0.0, 0.0, 0.0, 0.0, 0.0), (5e-4, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert plastic.end_of_step(trial, h, h, 0.1, 9.0) == (trial, h, 0.1, 0.0)
    B, given, left, lost = plastic.end_of_step(trial, h, new, 0.1, 9.0)
    assert (given, left, lost) == (new, 0.1, 9.0)
    assert B[0] == pytest.approx(np.expm1(1e-3), rel=1e-12)
    assert plastic.end_of_small_step(trial, h, h, 0.1, 9.0) == (trial, h, 0.1, 0.0, pytest.approx(4e-6))
    small = plastic.end_of_small_step(trial, h, new, 0.1, 9.0)
    np.testing.assert_allclose(small[0], B, rtol=1e-12)
    assert small[1:] == (new, 0.1, 9.0, pytest.approx(4e-6))
    grown = plastic.end_of_small_step(new, h, trial, 0.1, 9.0)
    assert grown[4] == pytest.approx(1.6e-5)  # 2 h is the larger one
