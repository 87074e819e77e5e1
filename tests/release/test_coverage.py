"""Exact covered areas and conservative regridding against shapely and closed forms."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from runout.io.polygon_coverage import common_intervals, covered_area, covered_centroid, regrid, regrid_within


def by_shapely(outline, edges_x, edges_y):
    """Parts of the outline in each cell, by polygon clipping."""
    west, south = np.meshgrid(edges_x[:-1], edges_y[:-1], indexing="ij")
    east, north = np.meshgrid(edges_x[1:], edges_y[1:], indexing="ij")
    return shapely.intersection(shapely.box(west, south, east, north), outline)


def uneven(n, length, seed):
    inner = np.random.default_rng(seed).uniform(0.0, length, n - 1)
    return np.concatenate(([0.0], np.sort(inner), [length]))


@st.composite
def outlines(draw):
    """Star-shaped polygons with a hole, some with corners and sides on lattice lines, and a second part."""
    n = draw(st.integers(3, 12))
    radius = np.array(draw(st.lists(st.floats(0.5, 4.5), min_size=n, max_size=n)))
    angle = np.sort(np.array(draw(st.lists(st.floats(0.0, 6.28), min_size=n, max_size=n, unique=True))))
    star = np.column_stack((5.0 + radius * np.cos(angle), 5.0 + radius * np.sin(angle)))
    if draw(st.booleans()):
        star = np.round(star)
    outline = shapely.make_valid(shapely.Polygon(star))
    outline = shapely.difference(outline, shapely.box(4.6, 4.0, 5.3, 5.5))
    outline = shapely.union(outline, shapely.box(11.0, 2.0, 13.0, draw(st.floats(2.5, 9.0))))
    return shapely.MultiPolygon([g for g in shapely.get_parts(outline) if g.geom_type == "Polygon"])


@given(outlines(), st.integers(0, 1000))
@settings(max_examples=80, deadline=None)
def test_covered_areas_equal_polygon_clipping_with_holes_and_on_lattice_lines(outline, seed):
    for edges_x, edges_y in ((np.arange(15.0), np.arange(11.0)), (uneven(9, 14.0, seed), uneven(7, 10.0, seed + 1))):
        area = covered_area(outline, edges_x, edges_y)
        np.testing.assert_allclose(area, shapely.area(by_shapely(outline, edges_x, edges_y)), atol=1e-9)
        assert area.sum() == pytest.approx(outline.area, rel=1e-11, abs=1e-9)


@given(outlines())
@settings(max_examples=40, deadline=None)
def test_centroids_of_cut_cells_equal_polygon_clipping(outline):
    edges_x, edges_y = np.arange(15.0), np.arange(11.0)
    east, north = covered_centroid(outline, edges_x, edges_y)
    parts = by_shapely(outline, edges_x, edges_y)
    cut = (shapely.area(parts) > 1e-3) & (shapely.area(parts) < 1 - 1e-3)
    exact = shapely.centroid(parts[cut])
    west, south = np.meshgrid(edges_x[:-1] + 0.5, edges_y[:-1] + 0.5, indexing="ij")
    np.testing.assert_allclose(west[cut] + east[cut], shapely.get_x(exact), atol=1e-8)
    np.testing.assert_allclose(south[cut] + north[cut], shapely.get_y(exact), atol=1e-8)


def test_triangle_of_5000_m2_on_5_m_cells_has_its_exact_area():
    triangle = shapely.Polygon([(3.1, 2.2), (103.1, 2.2), (41.7, 102.2)])
    area = covered_area(triangle, np.arange(0.0, 130.0, 5.0), np.arange(0.0, 130.0, 5.0))
    assert triangle.area == pytest.approx(5000.0, rel=1e-12)
    assert area.sum() == pytest.approx(5000.0, rel=1e-12)


def test_half_a_cell_is_half_covered_and_a_hole_is_not():
    outline = shapely.Polygon([(0, 0), (3, 0), (3, 3), (0, 3)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    np.testing.assert_array_equal(covered_area(outline, np.arange(4.0), np.arange(4.0)), [[1, 1, 1], [1, 0, 1], [1, 1, 1]])
    diagonal = shapely.Polygon([(0, 0), (1, 0), (1, 1)])
    assert covered_area(diagonal, np.array([0.0, 1.0]), np.array([0.0, 1.0]))[0, 0] == 0.5


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 1000))
@settings(max_examples=60, deadline=None)
def test_regridding_keeps_the_volume_and_stays_within_the_old_range(n, m, seed):
    edges = uneven(n, 10.0, seed), uneven(m, 7.0, seed + 1)
    to_edges = uneven(m + 2, 10.0, seed + 2), uneven(n + 1, 7.0, seed + 3)
    thickness = np.random.default_rng(seed).uniform(0.0, 3.0, (n, m))
    moved = regrid(thickness, edges, to_edges)
    before = np.diff(edges[0]) @ thickness @ np.diff(edges[1])
    assert np.diff(to_edges[0]) @ moved @ np.diff(to_edges[1]) == pytest.approx(before, rel=1e-4)
    assert moved.min() >= thickness.min() * (1 - 1e-3)
    assert moved.max() <= thickness.max() * (1 + 1e-3)


def test_regridding_to_half_the_cells_repeats_and_to_double_averages():
    thickness, fine, coarse = np.array([[1.0, 3.0], [5.0, 7.0]]), np.arange(0.0, 2.1, 0.5), np.array([0.0, 2.0])
    unit = np.arange(3.0)
    np.testing.assert_allclose(regrid(thickness, (unit, unit), (fine, fine)), np.kron(thickness, np.ones((2, 2))))
    np.testing.assert_allclose(regrid(thickness, (unit, unit), (coarse, coarse)), [[4.0]])


def test_edges_that_a_header_rounded_are_one_edge():
    bounds, _, source, target = common_intervals(np.array([0.0, 1.0000001, 2.0]), np.array([0.0, 1.0, 2.0]))
    assert len(bounds) == 3
    np.testing.assert_array_equal(source, target)


def test_volume_of_a_cut_cell_lies_only_inside_the_outline():
    outline = shapely.box(0.0, 0.0, 1.5, 1.0)
    thickness = np.array([[4.0], [2.0]])  # 4 m inside, half of the second cell covered
    fine = regrid_within(outline, thickness, (np.arange(3.0), np.arange(2.0)), (np.arange(0.0, 2.1, 0.5), np.arange(2.0)))
    np.testing.assert_allclose(fine[:, 0], [4.0, 4.0, 4.0, 0.0], atol=1e-12)
