"""Quadratic B-splines: partition of unity, linear reproduction and inertia at 10 000 points, on nodes and half-way too."""

import numpy as np
import pytest

from runout.physics import bspline

RNG = np.random.default_rng(4)
POINTS = np.concatenate([RNG.uniform(-1e3, 1e3, 10_000), np.arange(-20.0, 20.0), np.arange(-20.0, 20.0) + 0.5])


@pytest.fixture(scope="module")
def stencil():
    first = np.array([bspline.first_node(q) for q in POINTS])
    f = POINTS - first
    return f, np.array(bspline.weights(f)), np.array(bspline.weight_slopes(f))


def test_point_lies_between_half_and_one_and_a_half_cells_from_its_first_node(stencil):
    f, w, _ = stencil
    assert f.min() >= 0.5
    assert f.max() < 1.5
    assert w.min() >= 0.0


def test_weights_sum_to_one_and_slopes_to_zero(stencil):
    _, w, dw = stencil
    np.testing.assert_allclose(w.sum(axis=0), 1.0, atol=1e-14)
    np.testing.assert_allclose(dw.sum(axis=0), 0.0, atol=1e-14)


def test_weights_reproduce_the_position_and_slopes_its_gradient(stencil):
    f, w, dw = stencil
    nodes = np.arange(3.0)[:, None]
    np.testing.assert_allclose((w * nodes).sum(axis=0), f, atol=1e-14)
    np.testing.assert_allclose((dw * nodes).sum(axis=0), 1.0, atol=1e-14)


def test_inverse_inertia_is_that_of_the_weights_for_any_spacing(stencil):
    f, w, _ = stencil
    for h in (0.1, 1.0, 7.0):
        second_moment = (w * (h * (np.arange(3.0)[:, None] - f)) ** 2).sum(axis=0)
        np.testing.assert_allclose(second_moment * bspline.inverse_inertia(h), 1.0, atol=1e-13)


def test_slopes_are_the_derivatives_of_the_weights():
    f = np.linspace(0.51, 1.49, 200)
    numeric = (np.array(bspline.weights(f + 1e-6)) - np.array(bspline.weights(f - 1e-6))) / 2e-6
    np.testing.assert_allclose(np.array(bspline.weight_slopes(f)), numeric, atol=1e-9)


def test_negative_positions_are_floored_not_truncated():
    assert [bspline.first_node(q) for q in (-0.4, -0.5, -0.6, -3.7, 0.4, 0.5)] == [-1, -1, -2, -5, -1, 0]
