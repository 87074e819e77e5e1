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
