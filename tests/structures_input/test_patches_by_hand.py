"""Patches of pieces by hand: which pieces join, where the middle lies, which patch is the nearest, and what a small one joins."""

import numpy as np
import pytest
from structure_bodies import body, box

from runout.model.structures import Patches
from runout.model.terrain import Terrain
from runout.structures import build as made_of
from runout.structures.pieces import Pieces, cut_pieces
from runout.structures.solid import normals_and_areas

UP = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])  # 0.5 m2
DOWN, BESIDE = UP[::-1], UP + np.array([2.0, 0.0, 0.0])
FRICTION = np.array([0.3, 0.6])


def pieces_of(*rows):
    """Pieces by (corners, body, facade, whether it is visible)."""
    corners, solid, facade, visible = zip(*rows, strict=True)
    return Pieces(np.array(corners), np.array(solid), np.array(facade), np.array(visible))


def test_pieces_of_one_facade_in_one_cell_that_face_the_same_way_are_one_patch():
    wide = UP * [1.0, 3.0, 1.0] + [0.5, 0.2, 0.0]  # 1.5 m2
    pieces = pieces_of(
        (UP, 0, 0, True), (wide, 0, 0, True), (DOWN, 0, 0, True), (UP, 1, 2, True), (BESIDE, 0, 0, True), (UP, 0, 1, False)
    )  # fmt: skip
    found = made_of.joined_patches(pieces, (2.0, 2.0, 2.0), FRICTION)
    np.testing.assert_allclose(found.area, [0.5, 2.0, 0.5, 0.5])
    np.testing.assert_allclose(found.normal[:, 2], [-1.0, 1.0, 1.0, 1.0])
    middle = (0.5 * UP.mean(0) + 1.5 * wide.mean(0)) / 2.0
    np.testing.assert_allclose(found.centre, [UP.mean(0), middle, BESIDE.mean(0), UP.mean(0)])
    assert (found.facade.tolist(), found.friction.tolist()) == ([0, 0, 0, 2], [0.3, 0.3, 0.3, 0.6])


def test_a_patch_has_the_mean_direction_of_its_pieces_weighted_by_area():
    turned = np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 1.6, 1.2)])  # 2 m2, its normal is (0, -0.6, 0.8)
    found = made_of.joined_patches(pieces_of((UP, 0, 0, True), (turned, 0, 0, True)), (4.0, 4.0, 4.0), FRICTION)
    mean = np.array([0.0, -1.2, 0.5 + 1.6])
    np.testing.assert_allclose(found.normal, [mean / np.linalg.norm(mean)])
    vectors = made_of._unit(np.array([(3.0, 0.0, 4.0), (0.0, 0.0, 0.0)]), np.array([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]))
    np.testing.assert_allclose(vectors, [(0.6, 0.0, 0.8), (0.0, 1.0, 0.0)])


def patches_of(centre, normal, area, facade):
    return Patches(
        np.array(centre, float), np.array(normal, float), np.array(area, float), np.array(facade), np.full(len(area), 0.4)
    )


@pytest.mark.parametrize(("length", "nearest"), [(0.1, [0, 1]), (4.0, [1, 1])])
def test_a_turn_counts_as_much_as_a_length(length, nearest):
    """A point beside patch 0, which faces up, and one in the middle; both face as patch 1 does."""
    patches = patches_of([(0, 0, 0), (3, 0, 0)], [(0, 0, 1), (1, 0, 0)], [1, 1], [0, 0])
    foot, normal = np.array([[(1.0, 0.0, 0.0)], [(1.6, 0.0, 0.0)]]), np.array([[(1.0, 0.0, 0.0)], [(1.0, 0.0, 0.0)]])
    found = made_of.nearest_patches(foot, normal, patches, length)
    assert found.dtype == np.int32
    np.testing.assert_array_equal(found, np.array(nearest)[:, None])


def test_a_small_patch_joins_the_nearest_of_its_facade_that_is_not_small():
    up = [(0, 0, 1)] * 6
    centre = [(0, 0, 0), (4, 0, 0), (3, 0, 0), (3.2, 0, 0), (9, 0, 0), (2.6, 0, 0)]
    patches = patches_of(centre, up, [4.0, 4.0, 1.9, 4.0, 0.1, 2.0], [0, 0, 0, 1, 2, 0])
    assert made_of._neighbours(patches, 1.0).tolist() == [0, 1, 5, 3, 4, 5], "half of 4 m2 is not small"
    turned = patches_of(centre[:3], [(0, 0, 1), (1, 0, 0), (0, 0, 1)], [4.0, 4.0, 1.9], [0, 0, 0])
    assert made_of._neighbours(turned, 1.0).tolist() == [0, 1, 1]
    assert made_of._neighbours(turned, 9.0).tolist() == [0, 1, 0]


def test_faces_between_bodies_that_touch_are_left_out_and_others_stay_whole(level):
    west, east = body(box((100, 100, 105), (20, 10, 18)), "west"), body(box((120, 100, 105), (20, 10, 18)), "east")
    pieces, surface = cut_pieces([west, east], level, 2.0)
    areas = normals_and_areas(pieces.corners)[1]
    assert areas.sum() == pytest.approx(2 * (40 * 10 + 40 * 18 + 10 * 18))
    assert np.bincount(pieces.solid, areas) == pytest.approx([20 * 10 * 2 + 20 * 18 * 2 + 10 * 18] * 2)
    assert areas[pieces.visible].sum() == pytest.approx(40 * 10 + 2 * (40 + 10) * 14)
    assert len(surface) == 2 * (12 - 2)
    assert set(pieces.facade[pieces.solid == 1]) == {1}
    inner, _ = cut_pieces([west, body(box((100, 100, 105), (4, 4, 4)), "inner")], level, 2.0)
    assert set(inner.solid) == {0}, "a body within another one has no surface"


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_hut_at_a_tall_house_covers_its_wall_in_any_order(level, order):
    """The western wall of the hut is gone, and of the eastern wall of the house the pieces that lie wholly behind it."""
    house, hut = body(box((100, 100, 110), (20, 10, 28)), "house"), body(box((113, 100, 101), (6, 6, 10)), "hut")
    pieces, surface = cut_pieces([[house, hut][k] for k in order], level, 1.0)
    areas = normals_and_areas(pieces.corners)[1]
    own = np.bincount(pieces.solid, areas)[list(order)]
    assert own[1] == pytest.approx(2 * (36 + 60 + 60) - 60)
    assert 2 * (200 + 560 + 280) - 60 <= own[0] < 2 * (200 + 560 + 280) - 30
    assert normals_and_areas(surface)[1].sum() == pytest.approx(areas.sum())


def test_pieces_above_unknown_ground_are_not_visible():
    elevation = np.full((40, 40), 100.0)
    elevation[:, 20:] = np.nan
    pieces, _ = cut_pieces([body(box((100, 100, 105), (20, 10, 18)))], Terrain(elevation, (5.0, 5.0), 0.0, 0.0), 2.0)
    assert pieces.visible.any()
    assert pieces.centre[pieces.visible, 0].max() < 97.5
