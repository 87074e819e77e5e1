"""Tensor algebra against NumPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from symmetric import components, matrix, rotation

from runout.physics import tensors

finite = st.floats(-100, 100)
symmetric = st.tuples(*[finite] * 6)


@given(symmetric, symmetric)
def test_sums_norms_and_contractions_are_those_of_matrices(a, b):
    A, B = matrix(a), matrix(b)
    np.testing.assert_allclose(matrix(tensors.added(a, b)), A + B, atol=1e-12)
    np.testing.assert_allclose(tensors.contracted(a, b), np.tensordot(A, B), atol=1e-9)
    np.testing.assert_allclose(tensors.norm(a), np.linalg.norm(A), rtol=1e-14)
    np.testing.assert_allclose(tensors.trace(tensors.deviator(a)), 0.0, atol=1e-12)
    np.testing.assert_allclose(matrix(tensors.shifted(tensors.scaled(a, 2.0), 3.0)), 2 * A + 3 * np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(matrix(tensors.isotropic(a[0])), a[0] * np.eye(3))


@pytest.mark.parametrize("seed", range(20))
def test_product_and_inverse_of_commuting_tensors_are_those_of_matrices(seed):
    rng = np.random.default_rng(seed)
    q = rotation(rng)
    A, B = (q @ np.diag(rng.uniform(0.3, 3.0, 3)) @ q.T for _ in range(2))
    np.testing.assert_allclose(matrix(tensors.product(components(A), components(B))), A @ B, atol=1e-13)
    np.testing.assert_allclose(matrix(tensors.inverse(components(A))), np.linalg.inv(A), atol=1e-13)


def test_scalar_product_of_vectors():
    assert tensors.dot((1.0, -2.0, 3.0), (4.0, 5.0, 0.5)) == -4.5


@given(symmetric)
def test_invariants_are_those_of_the_characteristic_polynomial(a):
    exact = np.poly(matrix(a))[1:] * (-1.0, 1.0, -1.0)
    np.testing.assert_allclose(tensors.invariants(a), exact, rtol=1e-9, atol=1e-6)


def test_a_cubic_in_a_tensor_comes_from_horner_steps():
    a, P = (1.0, 2.0, -1.0, 0.3, 0.4, 0.5), (0.7, -0.2, 0.9)
    A, eye = matrix(a), np.eye(3)
    quadratic = P[0] * A @ A + P[1] * A + P[2] * eye
    np.testing.assert_allclose(matrix(tensors.polynomial(a, P)), quadratic, atol=1e-14)
    cubic = tensors.polynomial(a, tensors.horner(P, tensors.invariants(a), 0.6))
    np.testing.assert_allclose(matrix(cubic), A @ quadratic + 0.6 * eye, atol=1e-13)
