"""Formulas of a transfer of several substeps: the deformation, what it does to gradients and stresses, and its length."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from runout.physics import moments, substeps

GRADIENTS = arrays(np.float64, 9, elements=st.floats(-0.2, 0.2))
STRESS = (1.0, 2.0, 3.0, 0.4, 0.5, 0.6)


def matrix(tensor):
    return np.array(tensor).reshape(3, 3)


@given(GRADIENTS)
def test_inverse_deformation_is_that_of_the_matrix(G):
    np.testing.assert_allclose(matrix(substeps.inverse_deformation(G)), np.linalg.inv(np.eye(3) + matrix(G)), atol=1e-12)


@pytest.mark.parametrize("stretch", [-0.6, -1.0, -3.0, 1.2, np.inf, np.nan])
def test_a_particle_that_deforms_too_much_is_taken_as_if_its_grid_stood_still(stretch):
    G = np.array([stretch, 0, 0, 0, 0, 0, 0, 0, 0])
    inverse = matrix(substeps.inverse_deformation(G))
    assert np.isfinite(stretch) or not np.isfinite(inverse).all() or (inverse == np.eye(3)).all()
    if np.isfinite(stretch):
        np.testing.assert_array_equal(inverse, np.eye(3))


@given(GRADIENTS, GRADIENTS)
def test_gradients_and_stresses_change_places_by_the_inverse(L, G):
    inverse = substeps.inverse_deformation(G)
    np.testing.assert_allclose(matrix(substeps.present_gradient(L, inverse)), matrix(L) @ matrix(inverse), atol=1e-12)
    tau = np.array([[1.0, 0.4, 0.6], [0.4, 2.0, 0.5], [0.6, 0.5, 3.0]])
    np.testing.assert_allclose(matrix(substeps.stress_at_start(STRESS, inverse)), tau @ matrix(inverse).T, atol=1e-12)


@given(GRADIENTS)
def test_stress_at_the_start_does_the_same_power(G):
    """tau : L F^-1 = tau F^-T : L, for any velocity gradient: nodes lose what the particles take up."""
    inverse, L = substeps.inverse_deformation(G), np.arange(9.0) - 4.0
    tau = np.array([[1.0, 0.4, 0.6], [0.4, 2.0, 0.5], [0.6, 0.5, 3.0]])
    inside = (tau * matrix(substeps.present_gradient(L, inverse))).sum()
    np.testing.assert_allclose(
        (matrix(substeps.stress_at_start(STRESS, inverse)) * matrix(L)).sum(), inside, rtol=1e-10, atol=1e-12
    )


def test_force_without_deformation_is_that_of_a_step():
    still = substeps.inverse_deformation((0.0,) * 9)
    P = substeps.stress_at_start(STRESS, still)
    slopes = (0.1, 0.2, 0.4)
    assert substeps.force_columns(P, 0.125, slopes) == pytest.approx(moments.stress_columns(STRESS, 0.125, slopes), abs=1e-15)


@given(st.floats(0.0, 100.0), st.floats(0.1, 50.0))
def test_fastest_particle_stays_within_the_longest_way(speed, h):
    lasting = substeps.longest_transfer(speed, 9.81, h)
    assert speed * lasting + 0.5 * 9.81 * lasting**2 <= substeps.LONGEST_WAY * h * (1 + 1e-12)


def test_gap_follows_the_normal_part_of_the_way():
    assert substeps.moved_gap(0.5, (0.0, 0.6, 0.8), (9.0, 1.0, -0.5)) == pytest.approx(0.7)
