"""Hencky elasticity: logarithm and exponential without eigenvectors, energy, objectivity, small strains in float32."""

from types import SimpleNamespace

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, logm
from symmetric import components, flat, matrix, rotation

from runout.backends.compile import numba_binding
from runout.physics import elastic

MAT = SimpleNamespace(lame_lambda=3.0e6, shear_modulus=2.0e6)
small = st.floats(-0.05, 0.05)


@pytest.mark.parametrize("size", [1e-8, 1e-4, 1e-2, 0.05, 0.099, 0.11, 0.5, 2.0])
def test_logarithm_is_that_of_scipy_for_small_and_large_strain(size):
    rng = np.random.default_rng(1)
    for _ in range(20):
        q, e = rotation(rng), rng.uniform(-1, 1, 3)
        h = q @ np.diag(0.5 * size * e / np.linalg.norm(e)) @ q.T
        found = matrix(elastic.log_strain(components(expm(2 * h) - np.eye(3))))
        # scipy's expm itself rounds B to 1e-16 of the identity
        np.testing.assert_allclose(found, h, atol=1e-15 + 2e-11 * size)
        np.testing.assert_allclose(
            matrix(elastic.log_strain(components(expm(2 * h) - np.eye(3)))), 0.5 * logm(expm(2 * h)), atol=5e-13
        )


@pytest.mark.parametrize("size", [1e-8, 1e-3, 0.049, 0.051, 0.5, 2.0])
def test_exponential_is_that_of_scipy_for_small_and_large_strain(size):
    rng = np.random.default_rng(2)
    for _ in range(20):
        q, e = rotation(rng), rng.uniform(-1, 1, 3)
        h = q @ np.diag(size * e / np.linalg.norm(e)) @ q.T
        expected = expm(2 * h) - np.eye(3)
        np.testing.assert_allclose(
            matrix(elastic.strain_of_log(components(h))), expected, atol=1e-15 + 1e-12 * np.abs(expected).max()
        )


@given(st.tuples(*[st.floats(-0.4, 0.4)] * 6))
def test_logarithm_undoes_the_exponential(h):
    np.testing.assert_allclose(elastic.log_strain(elastic.strain_of_log(h)), h, atol=2e-11)


@given(st.tuples(*[small] * 6), st.tuples(*[small] * 9))
def test_trial_strain_is_that_of_the_deformation_gradient(B, L):
    F = np.eye(3) + np.reshape(L, (3, 3))
    expected = F @ (np.eye(3) + matrix(B)) @ F.T - np.eye(3)
    np.testing.assert_allclose(matrix(elastic.trial_strain(B, L)), expected, atol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_superposed_rotation_turns_strain_and_keeps_energy(seed):
    rng = np.random.default_rng(seed)
    q, B, L = rotation(rng), components(0.02 * matrix(rng.normal(size=6))), 0.02 * rng.normal(size=(3, 3))
    still = elastic.step(B, flat(L), 0.0, MAT)
    turned = elastic.step(B, flat(q @ (np.eye(3) + L) - np.eye(3)), 0.0, MAT)
    np.testing.assert_allclose(matrix(turned[0]), q @ matrix(still[0]) @ q.T, atol=1e-14)
    np.testing.assert_allclose(matrix(turned[1]), q @ matrix(still[1]) @ q.T, atol=1e-14)
    np.testing.assert_allclose(elastic.energy_density(turned[1], MAT), elastic.energy_density(still[1], MAT), rtol=1e-10)


@given(st.tuples(*[small] * 6), st.tuples(*[st.floats(-1, 1)] * 6))
def test_stress_is_the_slope_of_the_stored_energy(h, direction):
    e = 1e-5
    up, down = ([a + s * e * b for a, b in zip(h, direction, strict=True)] for s in (1, -1))
    slope = (elastic.energy_density(up, MAT) - elastic.energy_density(down, MAT)) / (2 * e)
    tau = matrix(elastic.kirchhoff_stress(h, MAT))
    np.testing.assert_allclose(slope, np.tensordot(tau, matrix(direction)), atol=1e-3, rtol=1e-7)


def test_moduli_of_youngs_modulus_and_poisson_ratio():
    E, nu, rho = 10e6, 0.3, 2000.0
    lam, mu = elastic.lame_lambda(E, nu), elastic.shear_modulus(E, nu)
    assert mu * (3 * lam + 2 * mu) / (lam + mu) == pytest.approx(E)
    assert lam / (2 * (lam + mu)) == pytest.approx(nu)
    assert elastic.wave_speed(lam, mu, rho) == pytest.approx(np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / rho))


def test_uniaxial_tension_gives_youngs_modulus():
    E, nu, stretch = 10e6, 0.3, 0.01
    mat = SimpleNamespace(lame_lambda=elastic.lame_lambda(E, nu), shear_modulus=elastic.shear_modulus(E, nu))
    tau = elastic.kirchhoff_stress((stretch, -nu * stretch, -nu * stretch, 0.0, 0.0, 0.0), mat)
    np.testing.assert_allclose(tau, (E * stretch, 0, 0, 0, 0, 0), atol=1e-6)


@pytest.mark.parametrize("motion", ["stretching to and fro", "turning"])
def test_float32_keeps_small_strain_over_1e5_steps(motion):
    """A strain of 1e-4 under 1e5 small steps: relative error 7e-5 and 2e-5, where (I + L) B (I + L)^T leaves 2e-3."""
    result = {real: np.array(_move(real, motion == "turning")(100_000)) for real in (np.float32, np.float64)}
    error = np.abs(result[np.float32] - result[np.float64]).max()
    assert error < 1e-4 * np.abs(result[np.float64]).max()


def _move(real, turning):
    trial = numba_binding(real, False).elastic.trial_strain

    @numba.njit
    def run(steps):
        zero = real(0.0)
        B = (real(2e-4), zero, zero, zero, zero, zero)
        for k in range(steps):
            if turning:
                t = real(1e-5)
                B = trial(B, (-real(5e-11), -t, zero, t, -real(5e-11), zero, zero, zero, zero))
            else:
                s = real(2e-6) if (k // 100) & 1 else real(-2e-6)
                B = trial(B, (zero, s, zero, s, zero, zero, zero, zero, s))
        return B

    return run
