"""Height field: exact for planes and parabolas, continuous slopes, unit normals, distances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runout.model.surface import Surface
from runout.physics import heightfield

SPACING, ORIGIN = (2.0, 3.0), (-5.0, 7.0)
NX, NY = 16, 12


def lattice():
    x = ORIGIN[0] + SPACING[0] * np.arange(NX)
    y = ORIGIN[1] + SPACING[1] * np.arange(NY)
    return np.meshgrid(x, y, indexing="ij")


def points(margin, n=500):
    rng = np.random.default_rng(5)
    x = rng.uniform(ORIGIN[0] + margin * SPACING[0], ORIGIN[0] + (NX - 1 - margin) * SPACING[0], n)
    y = rng.uniform(ORIGIN[1] + margin * SPACING[1], ORIGIN[1] + (NY - 1 - margin) * SPACING[1], n)
    return x, y


def test_plane_is_exact_up_to_the_rim_and_beyond():
    X, Y = lattice()
    surface = Surface.through(100 + 0.4 * X - 0.7 * Y, SPACING, ORIGIN)
    x, y = points(-2.0)
    z, east, north = surface.evaluate(x, y)
    np.testing.assert_allclose(z, 100 + 0.4 * x - 0.7 * y, atol=1e-12)
    np.testing.assert_allclose(east, 0.4, atol=1e-12)
    np.testing.assert_allclose(north, -0.7, atol=1e-12)


def test_parabola_and_saddle_are_exact_inside():
    def f(x, y):
        return 3 + 0.2 * x - 0.1 * y + 0.03 * x * x - 0.02 * y * y + 0.05 * x * y

    surface = Surface.through(f(*lattice()), SPACING, ORIGIN)
    x, y = points(2.0)
    z, east, north = surface.evaluate(x, y)
    np.testing.assert_allclose(z, f(x, y), atol=1e-11)
    np.testing.assert_allclose(east, 0.2 + 0.06 * x + 0.05 * y, atol=1e-11)
    np.testing.assert_allclose(north, -0.1 - 0.04 * y + 0.05 * x, atol=1e-11)


def test_slopes_are_continuous_where_patches_meet():
    rng = np.random.default_rng(6)
    surface = Surface.through(rng.normal(size=(NX, NY)), SPACING, ORIGIN)
    seams = ORIGIN[0] + SPACING[0] * (np.arange(3, NX - 3) + 0.5)
    y = np.full_like(seams, ORIGIN[1] + 10.1)
    for before, behind in zip(surface.evaluate(seams - 1e-9, y), surface.evaluate(seams + 1e-9, y), strict=True):
        np.testing.assert_allclose(before, behind, atol=1e-7)


def test_smooth_hill_converges_at_third_order():
    errors = []
    for n in (20, 40, 80):
        h = 200.0 / n
        x = h * np.arange(n + 1)
        surface = Surface.through(30 * np.sin(2 * np.pi * x / 100)[:, None] * np.cos(2 * np.pi * x / 100)[None, :], (h, h))
        q = np.random.default_rng(7).uniform(40, 160, (2, 2000))
        exact = 30 * np.sin(2 * np.pi * q[0] / 100) * np.cos(2 * np.pi * q[1] / 100)
        errors.append(np.sqrt(np.mean((surface.elevation(*q) - exact) ** 2)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 2.8


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-10, 10))
def test_distance_to_a_plane_is_exact(slope_x, slope_y, height):
    n_z = heightfield.normal_z(slope_x, slope_y)
    normal = np.array([-slope_x * n_z, -slope_y * n_z, n_z])
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
    assert heightfield.distance(height, n_z) == pytest.approx(normal @ (0.0, 0.0, height), abs=1e-12)


def test_weighted_sum_of_three_values():
    assert heightfield.interpolate((0.25, 0.5, 0.25), 1.0, 2.0, 7.0) == 3.0
