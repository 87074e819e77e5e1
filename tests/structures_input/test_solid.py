"""Normals, areas, discs and boxes of bodies, and the nearest points of a triangle: each by hand."""

import numpy as np
import pytest
from structure_bodies import body, box

from runout.errors import StructureError
from runout.structures import inspection, lattice_distance
from runout.structures.facades import walls_of
from runout.structures.inspection import wall_thickness
from runout.structures.pieces import bisected
from runout.structures.read import Bodies
from runout.structures.solid import Solid, as_arrays, discs_around, normals_and_areas, pseudo_normals

RIGHT = np.array([[(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 3.0, 0.0)]])  # its longest edge is 5 m


def test_normals_areas_and_discs_of_triangles_by_hand():
    corners = np.array(
        [[(0, 0, 0), (3, 0, 0), (0, 3, 0)], [(0, 0, 0), (0, 0, 2), (0, 5, 0)], [(1, 1, 1), (2, 2, 2), (3, 3, 3)]], float
    )
    normals, areas = normals_and_areas(corners)
    np.testing.assert_allclose(normals, [(0, 0, 1), (-1, 0, 0), (0, 0, 0)])
    np.testing.assert_allclose(areas, [4.5, 5.0, 0.0])
    np.testing.assert_allclose(discs_around(corners)[0], [1.0, 1.0, 0.0, np.sqrt(5.0), 0.0, 0.0, 1.0])
    np.testing.assert_allclose(discs_around(corners)[2, :4], [2.0, 2.0, 2.0, np.sqrt(3.0)])


def test_pseudo_normals_of_a_box_are_those_of_its_faces_edges_and_corners():
    """Each of three faces has a right angle at a corner, however its diagonals divide it."""
    half = np.array([1.0, 2.0, 5.0])
    solid = body(box((0, 0, 0), 2 * half))
    found = pseudo_normals(solid)
    np.testing.assert_allclose(found[:, 0], normals_and_areas(solid.corners)[0])
    np.testing.assert_allclose(found[:, 1:4], 0.5 * np.pi * np.sign(solid.corners))
    middle = 0.5 * (solid.corners + np.roll(solid.corners, -1, axis=1)) / half
    outer = np.where(np.abs(middle) > 0.99, np.sign(middle), 0.0)
    is_diagonal = (outer != 0).sum(2, keepdims=True) == 1
    np.testing.assert_allclose(found[:, 4:], np.where(is_diagonal, 2.0 * outer, outer), atol=1e-12)


def test_a_body_has_a_box_which_a_gap_widens_on_all_sides():
    solid = body(box((5, 6, 7), (2, 4, 6)))
    np.testing.assert_allclose(solid.box, [[4, 4, 4], [6, 8, 10]])
    corners, discs, normals, wide = as_arrays(solid, 0.5)
    np.testing.assert_allclose(wide, [[3.5, 3.5, 3.5], [6.5, 8.5, 10.5]])
    assert (corners.shape, discs.shape, normals.shape) == ((12, 3, 3), (12, 7), (12, 7, 3))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_bodies_meet_if_their_boxes_are_no_farther_apart_than_the_gap(axis):
    one, other = body(box((0, 0, 0), (2, 2, 2))), body(box(3.0 * np.eye(3)[axis], (2, 2, 2)))
    for a, b in ((one, other), (other, one)):
        assert not a.meets(b)
        assert not a.meets(b, 0.99)
        assert a.meets(b, 1.0)


@pytest.mark.parametrize(
    ("faces", "facade"), [([(0, 1, 3)], [0]), ([(0, 1, -1)], [0]), ([(0, 1, 2)], [0, 0]), ([(0, 1, 2), (0, 2, 1)], [0])]
)
def test_faces_of_vertices_that_are_not_there_make_no_body(faces, facade):
    with pytest.raises(StructureError, match="hut: the faces of the body do not fit to its vertices or facades"):
        Solid("hut", np.eye(3), np.array(faces), np.array(facade), ("surface",), 0.4, "hut")
    assert Solid("hut", np.eye(3), np.array([(0, 1, 2)]), np.array([0]), ("surface",), 0.4, "hut").clearance is None


@pytest.mark.parametrize(
    ("point", "nearest", "part"),
    [
        ((-1.0, -2.0, 1.0), (0.0, 0.0, 0.0), "CORNER_A"),
        ((6.0, -1.0, 2.0), (4.0, 0.0, 0.0), "CORNER_B"),
        ((-1.0, 7.0, 2.0), (0.0, 4.0, 0.0), "CORNER_C"),
        ((1.0, -3.0, 1.0), (1.0, 0.0, 0.0), "EDGE_AB"),
        ((-2.0, 1.0, 5.0), (0.0, 1.0, 0.0), "EDGE_CA"),
        ((5.0, 3.0, -1.0), (3.0, 1.0, 0.0), "EDGE_BC"),
        ((1.0, 2.0, 3.0), (1.0, 2.0, 0.0), "INSIDE"),
    ],
)
def test_the_nearest_point_of_a_triangle_lies_in_each_of_its_parts(point, nearest, part):
    corners = np.array([[(9.0, 9.0, 9.0)] * 3, [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0)]])
    found, region = lattice_distance.nearest_point(point, corners, 1)
    np.testing.assert_allclose(found, nearest, atol=1e-12)
    assert region == getattr(lattice_distance, part)


def test_edges_are_halved_that_are_longer_than_the_longest_allowed():
    whole, parent = bisected(RIGHT, 5.0)
    np.testing.assert_allclose(whole, RIGHT)
    halves, parents = bisected(np.concatenate([whole - 9.0, RIGHT * 1.2]), 5.9)
    assert (parent.tolist(), parents.tolist()) == ([0], [0, 1, 1])
    np.testing.assert_allclose(normals_and_areas(halves)[1], [6.0, 4.32, 4.32])
    assert bisected(np.zeros((0, 3, 3)), 1.0)[0].shape == (0, 3, 3)


def test_walls_do_not_depend_on_the_point_that_a_ring_begins_at():
    angle = np.radians([0, 14, 30, 45, 60, 90, 180, 270])  # sides that turn little at first, and by right angles at last
    ring = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    wall, names = walls_of(ring)
    sides = [names[k] for k in wall]
    assert sides == ["east", "east", "northeast", "northeast", "north", "northwest", "southwest", "southeast"]
    for first in range(1, len(ring)):
        wall, names = walls_of(np.roll(ring, -first, axis=0))
        assert [names[k] for k in wall] == sides[first:] + sides[:first]
        assert len(names) == 6


def test_of_a_fine_mesh_the_largest_piece_of_each_cube_and_side_is_measured(level, monkeypatch):
    solid = body(box((100, 100, 104), (20, 3, 12)))
    every, all_centres, _ = wall_thickness(solid, level, (2.0, 2.0, 2.0))
    monkeypatch.setattr(inspection, "FEW", 10)
    some, centres, _ = wall_thickness(solid, level, (2.0, 2.0, 2.0))
    assert every.min() == pytest.approx(3.0)
    assert some.min() == pytest.approx(3.0)
    assert 0.2 * len(every) < len(some) < len(every) == len(all_centres)
    assert {tuple(centre) for centre in centres} < {tuple(centre) for centre in all_centres}
    places = np.array([(0.2, 0.3, 0.0), (0.8, 0.3, 0.0), (1.2, 0.3, 0.0), (0.4, 0.3, 0.0), (0.4, 0.3, 0.9)] * 3)
    normals = np.repeat([(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.8, 0.6, 0.0)], 5, axis=0)
    rows = inspection._spread(places, normals, np.tile([1.0, 3.0, 2.0, 3.0, 4.0], 3), 1.0)
    assert rows.tolist() == [2, 4, 7, 9, 12, 14]
    monkeypatch.setattr(inspection, "FEW", 15)
    assert inspection._spread(places, normals, np.ones(15), 1.0).tolist() == list(range(15))


def test_bodies_of_several_sources_get_numbers_where_they_share_a_name():
    hut, barn = body(box((0, 0, 0), (2, 2, 2)), "hut"), body(box((9, 0, 0), (2, 2, 2)), "barn")
    both = Bodies((hut,), ("read",)).and_more([barn, hut, hut])
    assert [solid.name for solid in both.solids] == ["hut 1", "barn", "hut 2", "hut 3"]
    assert both.changes == ("read",)
