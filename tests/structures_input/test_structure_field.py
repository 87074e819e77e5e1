"""The signed distance of structures is exact at the nodes of the lattice; areas of patches add up."""

import numpy as np
import pytest
import trimesh
from structure_bodies import body, box, distance_to_box, nodes

from runout.errors import CapacityError, StructureError
from runout.model.terrain import Terrain
from runout.structures.build import build_structures
from runout.structures.pieces import bisected
from runout.structures.solid import normals_and_areas

TURNED = trimesh.transformations.euler_matrix(0.3, 0.5, 0.7)
SINGLE = 1e-5  # [m] of float32 distances of some metres


@pytest.mark.parametrize("turned", [None, TURNED], ids=["along axes", "turned"])
def test_distance_to_a_box_is_exact(level, turned):
    centre, size = (100.0, 100.0, 105.0), (20.0, 10.0, 18.0)
    field = build_structures([body(box(centre, size, turned))], level, (2.0, 2.0, 2.0)).field
    local = (nodes(field) - centre) @ (np.eye(3) if turned is None else turned[:3, :3])
    wanted = distance_to_box(local, 0.0, size)
    assert np.abs(field.distance - wanted).max() < SINGLE
    assert (np.abs(wanted) < field.band).any((1, 2, 3)).all()
    assert field.spacing == 1.0


def test_distance_to_a_cylinder_is_that_of_trimesh(level):
    cylinder = trimesh.creation.cylinder(radius=6.0, height=20.0, sections=24)
    cylinder.apply_translation((80.3, 90.1, 104.0))
    field = build_structures([body(cylinder)], level, (2.0, 2.0, 2.0)).field
    chosen = np.random.default_rng(1).choice(field.distance.size, 300, replace=False)
    points = nodes(field).reshape(-1, 3)[chosen]
    _, away, _ = trimesh.proximity.closest_point_naive(cylinder, points)
    inside = np.linalg.norm(points[:, :2] - (80.3, 90.1), axis=1) < 6.0 * np.cos(np.pi / 24)
    inside &= np.abs(points[:, 2] - 104.0) < 10.0
    sure = inside | (np.linalg.norm(points[:, :2] - (80.3, 90.1), axis=1) > 6.0) | (np.abs(points[:, 2] - 104.0) > 10.0)
    assert np.abs(field.distance.ravel()[chosen] - np.where(inside, -away, away))[sure].max() < SINGLE


def test_every_block_near_the_surface_is_there(level):
    centre, size = (100.0, 100.0, 105.0), (20.0, 10.0, 18.0)
    field = build_structures([body(box(centre, size))], level, (2.0, 2.0, 2.0)).field
    points = np.random.default_rng(2).uniform((80, 85, 90), (120, 115, 121), (4000, 3))
    near = points[np.abs(distance_to_box(points, centre, size)) < field.band]
    block = np.floor((near - field.origin) / (8 * field.spacing)).astype(int)
    assert (block >= 0).all()
    assert (block < field.blocks.shape).all()
    assert (field.blocks[tuple(block.T)] >= 0).all()


def test_bodies_that_touch_have_no_wall_between_them(level):
    west, east = box((100, 100, 105), (20, 10, 18)), box((120.1, 100, 105), (20, 10, 18))
    made = build_structures([body(west, "west"), body(east, "east")], level, (2.0, 2.0, 2.0))
    field, both = made.field, distance_to_box(nodes(made.field), (110.05, 100, 105), (40.1, 10, 18))
    assert np.abs(field.distance - both).max() < 0.2  # twice the gap, beside its mouth
    assert (np.sign(field.distance) == np.sign(both))[np.abs(both) > 0.3].all()
    assert field.patches.area.sum() == pytest.approx(2 * (40 + 10) * 14 + 400)


def test_an_overhang_keeps_its_free_space(level):
    post, roof = box((100, 100, 104), (4, 20, 12)), box((108, 100, 112), (20, 20, 4))
    field = build_structures([body(post, "post"), body(roof, "roof")], level, (2.0, 2.0, 2.0)).field
    union = np.minimum(
        distance_to_box(nodes(field), (100, 100, 104), (4, 20, 12)), distance_to_box(nodes(field), (108, 100, 112), (20, 20, 4))
    )
    outside = union > 0.01
    assert np.abs(field.distance - union)[outside].max() < SINGLE
    assert (field.distance[union < -0.01] < 0).all()


def test_patches_have_the_area_above_ground_and_about_the_size_of_a_cell(level):
    made = build_structures([body(box((100, 100, 105), (20, 10, 18)))], level, (2.0, 2.0, 2.0))
    patches = made.field.patches
    assert patches.area.sum() == pytest.approx(2 * (20 + 10) * 14 + 200)
    assert patches.area.max() <= 10.0  # two cells, and half of one that joined
    assert np.median(patches.area) > 2.0
    assert np.abs(np.linalg.norm(patches.normal, axis=1) - 1).max() < 1e-12
    assert (patches.centre[:, 2] > 100).all()
    assert set(patches.friction) == {0.4}


def test_a_node_has_a_patch_that_faces_it(level):
    centre, size = (100.0, 100.0, 105.0), (20.0, 10.0, 18.0)
    field = build_structures([body(box(centre, size))], level, (2.0, 2.0, 2.0)).field
    points = nodes(field)
    x, y, z = np.moveaxis(points, -1, 0)
    south = (np.abs(x - 100) < 9) & (y < 95) & (y > 91) & (z > 101) & (z < 113)
    patches = field.patches
    assert south.any()
    assert (patches.normal[field.patch[south]] @ [0.0, -1.0, 0.0] > 0.99).all()
    assert np.linalg.norm(patches.centre[field.patch[south]][:, [0, 2]] - points[south][:, [0, 2]], axis=1).max() < 2.0


def test_a_node_beside_an_edge_has_a_patch_of_the_face_that_it_lies_before(level):
    centre, size = (100.0, 100.0, 105.0), (20.0, 10.0, 18.0)
    field = build_structures([body(box(centre, size))], level, (2.0, 2.0, 2.0)).field
    points = nodes(field)
    beyond = np.abs(points - centre) - np.asarray(size) / 2
    ordered = np.sort(beyond, axis=-1)
    edge = (ordered[..., 1] > 0) & (ordered[..., 2] > ordered[..., 1] + 0.1) & (points[..., 2] > 101)
    axis = beyond.argmax(-1)[edge]
    faced = np.take_along_axis(field.patches.normal[field.patch[edge]], axis[:, None], 1)[:, 0]
    outward = np.take_along_axis(np.sign(points - centre)[edge], axis[:, None], 1)[:, 0]
    assert edge.sum() > 1000
    np.testing.assert_allclose(faced, outward)


def test_halving_edges_keeps_every_area():
    corners = np.random.default_rng(3).uniform(0, 50, (20, 3, 3))
    pieces, parent = bisected(corners, 4.0)
    assert np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2).max() <= 4.0
    assert np.bincount(parent, normals_and_areas(pieces)[1]) == pytest.approx(normals_and_areas(corners)[1])


def test_the_same_structures_are_made_once(level):
    solids = [body(box((50, 50, 103), (10, 10, 10)))]
    assert build_structures(solids, level, (2.0, 2.0, 2.0)) is build_structures(list(solids), level, (2.0, 2.0, 2.0))
    assert build_structures([], level, (2.0, 2.0, 2.0)) is None


def test_structures_too_far_apart_for_the_table_are_refused():
    wide = Terrain(np.zeros((20, 20)), (5e3, 5e3))
    far = [body(box((1e4, 1e4, 3), (10, 10, 10))), body(box((9e4, 9e4, 3), (10, 10, 10)))]
    with pytest.raises(CapacityError, match="larger cells"):
        build_structures(far, wide, (1.0, 1.0, 1.0))


def test_structures_tell_what_they_are_in_a_line_and_in_a_table(level):
    solids = [body(box((20 + 25 * k, 60, 103), (10, 10, 10)), f"house <{k}>") for k in range(7)]
    made = build_structures(solids, level, (2.0, 2.0, 2.0))
    line, table = repr(made), made._repr_html_()
    assert line.startswith("Structures(structures: 7: house <0>, house <1>, house <2>, house <3>, house <4> and 2 more, ")
    assert ", facades: 7 of " in line
    assert len(line) < 600
    area = float(made.field.patches.area.sum())
    assert area == pytest.approx(7 * (4 * 80 + 100), rel=0.02)  # 8 m of the walls, and the tops
    assert f"facades: 7 of {area:.4g} m2 above ground, in {len(made.field.patches.area)} patches" in line
    assert "distance field: lattice of 1 m, " in line
    assert table.startswith("<table>")
    assert "<b>Structures</b>" in table
    assert "house &lt;4&gt; and 2 more" in table


def test_more_pieces_than_memory_holds_are_refused_at_once():
    corners = np.array([[[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 20.0, 0.0]]])
    with pytest.raises(StructureError, match=r"about 4e\+08 of them, more than 5e\+06; use a larger simulation\.cell_size"):
        bisected(corners, 0.001)
