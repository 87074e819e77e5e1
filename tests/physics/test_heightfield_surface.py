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


@given(st.lists(st.floats(-100, 100), min_size=7, max_size=7), st.integers(1, 20))
def test_surface_half_way_between_two_elevations_lies_between_them_where_the_ground_is_not_smooth(z, averaged):
    """No new extremum: the bounds of two neighbours leave their mean between both."""
    w = heightfield.weight_of_means(averaged)
    c = [heightfield.spline_coefficient(z[k], (z[k - 1] - z[k]) / 2, (z[k + 1] - z[k]) / 2, 0.0, w) for k in range(1, 6)]
    for k in range(4):
        low, high = sorted(z[k + 1 : k + 3])
        assert low - 1e-9 <= (c[k] + c[k + 1]) / 2 <= high + 1e-9


@given(st.floats(-100, 100), st.floats(-50, 50), st.integers(1, 20))
def test_surface_passes_through_a_single_crest_or_pit_of_level_ground_that_is_not_smooth(level, height, averaged):
    z = [level] * 3 + [level + height] + [level] * 3
    w = heightfield.weight_of_means(averaged)
    c = [heightfield.spline_coefficient(z[k], (z[k - 1] - z[k]) / 2, (z[k + 1] - z[k]) / 2, 0.0, w) for k in range(1, 6)]
    assert (c[1] + 6 * c[2] + c[3]) / 8 == pytest.approx(level + height, abs=1e-9)
    assert c[0] == c[1] == c[3] == c[4] == level


@given(st.floats(-100, 100), st.floats(1e-3, 1e3), st.floats(-1e3, 1e3), st.floats(-0.05, 0.05))
def test_parabola_is_smooth_and_a_step_is_not_however_it_is_tilted(tilt, bend, drop, noise):
    assert heightfield.smoothness(bend, bend * (1 + noise), bend, bend * (1 - noise), bend) == 1.0
    assert heightfield.smoothness(-bend, -bend, -bend * (1 + noise), -bend, -bend) == 1.0
    for face in ((0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.3, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0)):
        z = [tilt * k + drop * share for k, share in enumerate(face)]
        bends = [heightfield.second_difference(*z[k : k + 3]) for k in range(5)]
        if abs(drop) > 1e-3:
            assert heightfield.smoothness(*bends) < 1e-3


def test_resampled_surface_is_the_surface_where_it_is_smooth_and_on_the_same_lattice():
    x = 5.0 * np.arange(41)
    hills = Surface.through(3 * np.sin(x / 25)[:, None] * np.cos(x / 30)[None, :], (5.0, 5.0))
    same = hills.on_nodes((5.0, 5.0), (0, 0), (41, 41))
    np.testing.assert_allclose(same.coefficients[2:-2, 2:-2], hills.coefficients[2:-2, 2:-2], atol=1e-3)
    q = np.random.default_rng(3).uniform(30, 170, (2, 500))
    np.testing.assert_allclose(hills.on_nodes((2.0, 3.0), (1, 2), (100, 66)).elevation(*q), hills.elevation(*q), atol=0.01)


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


def test_surface_at_a_point_is_that_of_the_nine_coefficients_around_it():
    """Coefficients of 3 + 2 x - 5 y are its values at the nodes."""
    c = [3.0 + 2.0 * x - 5.0 * y for x in range(3) for y in range(3)]
    z, east, north = heightfield.surface_at(c, 0.8, 1.3)
    assert (z, east, north) == pytest.approx((3.0 + 1.6 - 6.5, 2.0, -5.0))
    bent = [float(x * x * (1 + y)) for x in range(3) for y in range(3)]
    step = 1e-6
    numeric = [
        (heightfield.surface_at(bent, 0.8 + dx, 1.3 + dy)[0] - heightfield.surface_at(bent, 0.8 - dx, 1.3 - dy)[0]) / (2 * step)
        for dx, dy in ((step, 0.0), (0.0, step))
    ]
    assert heightfield.surface_at(bent, 0.8, 1.3)[1:] == pytest.approx(numeric, abs=1e-8)


def test_upward_normal_has_unit_length_and_stands_on_both_slopes():
    n = np.array(heightfield.upward_normal(0.3, -0.4))
    assert n[2] > 0
    assert n @ n == pytest.approx(1.0)
    assert n @ (1.0, 0.0, 0.3) == pytest.approx(0.0, abs=1e-15)
    assert n @ (0.0, 1.0, -0.4) == pytest.approx(0.0, abs=1e-15)
    assert heightfield.height_at(heightfield.distance(3.0, 0.8), 0.8) == pytest.approx(3.0)
