"""Facades of bodies: neighbours that turn little are one, and a name says which side a facade faces; their areas above ground."""

import numpy as np
import pytest
import trimesh
from structure_bodies import SOUTH, WEST, body, box

from runout.model.terrain import Terrain
from runout.structures.build import build_structures
from runout.structures.facades import mesh_facades
from runout.structures.pieces import cut_pieces
from runout.structures.read import overhang_bodies
from runout.structures.readers import meshes
from runout.structures.readers.meshes import crossings, volume
from runout.structures.solid import Solid, facade_lines, footprint, normals_and_areas
from runout.terrain.mesh import Overhangs

DIRECTIONS = {
    **{name: (np.cos(k * np.pi / 4), np.sin(k * np.pi / 4), 0.0) for k, name in enumerate(
        ("east", "northeast", "north", "northwest", "west", "southwest", "south", "southeast"))},
    "top": (0.0, 0.0, 1.0),
    "underside": (0.0, 0.0, -1.0),
}  # fmt: skip


def facades_of(mesh):
    """Names of the facades of a mesh with their area [m2] and mean normal."""
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    row, names = mesh_facades(vertices, faces)
    normals, areas = normals_and_areas(vertices[faces])
    assert len(set(names)) == len(names)
    assert set(row) == set(range(len(names)))
    means = [(areas[row == k, None] * normals[row == k]).sum(0) / areas[row == k].sum() for k in range(len(names))]
    return {name: (areas[row == k].sum(), mean) for k, (name, mean) in enumerate(zip(names, means, strict=True))}


def prism(points, height=10.0):
    """Body with a plan (n, 2) that its centre sees all of, counterclockwise."""
    points, count = np.asarray(points, float), len(points)
    k, after, low, high = np.arange(count), np.roll(np.arange(count), -1), 2 * count, 2 * count + 1
    plan = np.concatenate([points, points, [points.mean(0)] * 2])
    z = np.repeat([0.0, height, 0.0, height], [count, count, 1, 1])
    lids = [(after, k, np.full(count, low)), (k + count, after + count, np.full(count, high))]
    walls = [(k, after, after + count), (k, after + count, k + count)]
    faces = np.concatenate([np.column_stack(corners) for corners in (*lids, *walls)])
    return trimesh.Trimesh(np.column_stack([plan, z]), faces, process=False)


def ring(count, radius=20.0):
    """Corners (count, 2) of a regular polygon with a side that faces east."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def ridge(slope_deg):
    """A roof without walls, 20 m long, whose two planes rise by an angle."""
    mesh = prism([(-5.0, 0.0), (5.0, 0.0), (0.0, 5.0 * np.tan(np.radians(slope_deg)))], 20.0)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    return mesh


@pytest.mark.parametrize("count", [4, 8])
def test_a_facade_is_named_after_the_side_that_it_faces(count):
    facades = facades_of(prism(ring(count)))
    assert len(facades) == count + 2
    wall = 2 * 20.0 * np.sin(np.pi / count) * 10.0
    for name, (area, normal) in facades.items():
        np.testing.assert_allclose(normal, DIRECTIONS[name], atol=1e-9, err_msg=name)
        assert area == pytest.approx(wall if normal[2] == 0 else 0.5 * count * 20.0**2 * np.sin(2 * np.pi / count))


def test_walls_that_face_the_same_of_eight_sides_get_numbers():
    facades = facades_of(prism(ring(16)))
    assert len(facades) == 18, "walls that turn by 22.5 degrees are facades of their own"
    assert {"top", "underside", "east", "north", "west", "south"} <= {name.split()[0] for name in facades}
    assert any(name.endswith(" 2") for name in facades)


def test_walls_that_turn_by_less_than_twenty_degrees_are_one():
    corner = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 10.0 + 5.0 * np.tan(np.radians(18.0))), (0.0, 10.0)]
    assert set(facades_of(prism(corner))) == {"south", "east", "north 1", "north 2", "west", "top", "underside"}, "36 degrees"
    flat = [*corner[:3], (5.0, 10.0 + 5.0 * np.tan(np.radians(9.5))), corner[4]]
    assert set(facades_of(prism(flat))) == {"south", "east", "north", "west", "top", "underside"}, "19 degrees"


def test_a_plane_is_a_top_up_to_a_slope_of_45_degrees_and_a_wall_beyond():
    flat, steep = facades_of(ridge(40.0)), facades_of(ridge(50.0))
    assert set(flat) == {"top 1", "top 2", "underside", "north", "south"}
    assert set(steep) == {"east", "west", "underside", "north", "south"}


def test_round_bodies_and_those_of_too_many_facades_are_one_facade():
    assert set(facades_of(trimesh.creation.icosphere(3, radius=5.0))) == {"surface"}
    assert set(facades_of(prism(ring(24)))) == {"surface", "top", "underside"}, "15 degrees from wall to wall"
    star = ring(22) * np.where(np.arange(22) % 2, 1.0, 0.6)[:, None]
    assert len(facades_of(prism(star))) == 24
    star = ring(24) * np.where(np.arange(24) % 2, 1.0, 0.6)[:, None]
    assert set(facades_of(prism(star))) == {"surface"}


def test_a_body_of_small_pieces_only_is_one_facade():
    corners = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    vertices = np.concatenate([corners + np.array((3.0 * k, 0.0, 0.0)) for k in range(51)])  # each less than 2 % of the area
    facade, names = mesh_facades(vertices, np.arange(153).reshape(-1, 3))
    assert names == ("surface",)
    assert not facade.any()


def test_small_faces_are_the_rest():
    corner = [(0.0, 0.0), (10.0, 0.0), (10.0, 9.6), (9.6, 10.0), (0.0, 10.0)]
    facades = facades_of(prism(corner))
    assert set(facades) == {"south", "east", "north", "west", "top", "underside", "rest"}
    assert facades["rest"][0] == pytest.approx(10.0 * np.hypot(0.4, 0.4))


def with_top(mesh, name, friction=0.4):
    """A body with two facades: its top, and the rest."""
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    is_top = normals_and_areas(vertices[faces])[0][:, 2] > 0.5
    return Solid(name, vertices, faces, is_top.astype(int), ("walls", "top"), friction, name)


def test_facades_keep_their_structure_their_area_and_their_friction(level):
    low, high = box((60, 100, 103), (10, 20, 10)), box((140, 100, 106), (20, 8, 20))
    structures = build_structures([with_top(low, "low", 0.2), with_top(high, "high", 0.5)], level, (2.0, 2.0, 2.0))
    assert structures.names == ("low", "high")
    assert structures.facades == ("walls", "top", "walls", "top")
    assert list(structures.structure) == [0, 0, 1, 1]
    patches = structures.field.patches
    area = np.bincount(patches.facade, patches.area)
    assert area == pytest.approx([2 * (10 + 20) * 8, 200, 2 * (20 + 8) * 16, 160])
    assert set(patches.friction[patches.facade < 2]) == {0.2}
    assert set(patches.friction[patches.facade >= 2]) == {0.5}
    np.testing.assert_allclose(patches.centre[patches.facade == 3][:, 2], 116.0)


def test_a_facade_without_a_patch_above_ground_has_no_name(level):
    buried = box((60, 100, 95), (10, 20, 6))
    structures = build_structures(
        [with_top(buried, "buried"), with_top(box((140, 100, 106), (20, 8, 20)), "house")], level, (2.0,) * 3
    )
    assert structures.names == ("buried", "house")
    assert (structures.facades, list(structures.structure)) == (("walls", "top"), [1, 1])


def test_pieces_are_cut_where_the_ground_cuts_walls():
    """A box of 20 x 10 m, 10 m above the ground in its middle, on a plane that rises eastwards by a fifth."""
    terrain = Terrain(np.tile(100.0 + 0.2 * (np.arange(40) + 0.5) * 5.0, (40, 1)), (5.0, 5.0), 0.0, 0.0)
    pieces, surface = cut_pieces([with_top(box((100, 100, 120), (20, 10, 20)), "box")], terrain, 2.0)
    _, areas = normals_and_areas(pieces.corners)
    assert areas.sum() == pytest.approx(2 * (20 * 10 + 20 * 20 + 10 * 20))
    above = pieces.visible
    assert areas[above & (pieces.facade == 1)].sum() == pytest.approx(200.0)
    assert areas[above & (pieces.facade == 0)].sum() == pytest.approx(2 * 20 * 10 + 10 * (12 + 8))
    height = pieces.corners[..., 2] - (100.0 + 0.2 * pieces.corners[..., 0])
    assert (height[above] > -1e-9).all()
    assert (height[~above] < 1e-9).all()
    assert normals_and_areas(surface)[1].sum() == pytest.approx(1600.0)


@pytest.mark.parametrize("pairs", [1, 20, 10**6])
def test_crossings_do_not_depend_on_how_many_edges_are_tried_at_a_time(monkeypatch, pairs):
    both = trimesh.util.concatenate([box((0.0, 0.0, 0.0), (4, 4, 4)), box((0.6, 0.5, 2.0), (2, 2, 2))])
    monkeypatch.setattr(meshes, "MOST_PAIRS", pairs)
    places = crossings(Solid("two", np.asarray(both.vertices), np.asarray(both.faces), np.zeros(24, int), ("surface",), 0.4, "two"))
    corners = {(x, y, 2.0) for x in (-0.4, 1.6) for y in (-0.5, 1.5)}
    diagonals = {(x, y, 2.0) for x, y in ((0.6, -0.5), (0.6, 1.5), (-0.4, 0.5), (1.6, 0.5), (-0.4, -0.4), (1.5, 1.5))}
    assert {tuple(np.round(point, 9).tolist()) for point in places} == corners | diagonals


# --- plan, overhangs and patches -------------------------------------------------------------------------------------------


def test_outlines_lie_on_the_map_and_walls_are_lines_in_it(level):
    house = with_top(box((60, 100, 103), (10, 20, 10)), "house")
    outline = footprint(house, level)
    assert outline.bounds == pytest.approx((WEST + 55, SOUTH + 90, WEST + 65, SOUTH + 110))
    assert outline.area == pytest.approx(200.0)
    walls, top = facade_lines(house, 0, level), facade_lines(house, 1, level)
    assert top.length == pytest.approx(60.0), "the border of the top"
    assert top.bounds == pytest.approx(outline.bounds)
    assert walls.geom_type == top.geom_type == "MultiLineString"
    vertices, faces = np.asarray(house.vertices), np.asarray(house.faces)
    normals, _ = normals_and_areas(vertices[faces])
    west = Solid("west", vertices, faces, np.where(normals[:, 0] < -0.5, 0, 1), ("west", "rest"), 0.4, "west")
    line = facade_lines(west, 0, level)
    assert line.length == pytest.approx(20.0)
    assert line.bounds == pytest.approx((WEST + 55, SOUTH + 90, WEST + 55, SOUTH + 110))


def overhangs_of(*cells):
    """Overhangs by (row, column, bottom, top)."""
    row, column, bottom, top = (np.array(values) for values in zip(*cells, strict=True))
    return Overhangs(row, column, bottom.astype(float), top.astype(float))


def test_overhangs_that_touch_are_one_body_with_the_volume_of_its_columns(level):
    """Three cells in a row with a level underside, and one far away; rows count from the north, places from the south."""
    bodies = overhang_bodies(overhangs_of((10, 5, 110, 112), (10, 6, 110, 112), (10, 7, 110, 112), (30, 20, 105, 109)), level, 0.5)
    assert [solid.place for solid in bodies] == [f"{level.source}: overhang of 3 cells", f"{level.source}: overhang of 1 cells"]
    long, single = bodies
    np.testing.assert_allclose(long.box, [[25.0, 145.0, 110.0], [40.0, 150.0, 112.0]])
    np.testing.assert_allclose(single.box, [[100.0, 45.0, 105.0], [105.0, 50.0, 109.0]])
    assert [volume(solid.vertices, solid.faces) for solid in bodies] == pytest.approx([3 * 25 * 2.0, 25 * 4.0])
    assert (single.friction, single.clearance, single.name) == (0.5, 0.0, "overhang")
    assert set(single.facades) == {"east", "west", "north", "south", "top", "underside"}


def test_corners_of_overhangs_have_the_mean_of_their_cells_and_layers_are_bodies_of_their_own(level):
    (stepped,) = overhang_bodies(overhangs_of((10, 5, 110, 112), (10, 6, 114, 118)), level, 0.5)
    between = stepped.vertices[np.abs(stepped.vertices[:, 0] - 30.0) < 1e-9]
    assert sorted(set(between[:, 2])) == [112.0, 115.0]
    two = overhang_bodies(overhangs_of((10, 5, 120, 122), (10, 5, 110, 112), (10, 6, 110, 113)), level, 0.5)
    assert sorted((solid.box[0, 2], solid.box[1, 2]) for solid in two) == [(110.0, 113.0), (120.0, 122.0)]


def test_a_wall_of_one_cell_and_a_rest_has_patches_of_about_a_cell(level):
    structures = build_structures([with_top(box((100.3, 100, 104), (20.6, 8, 12)), "house")], level, (2.0, 2.0, 2.0))
    patches = structures.field.patches
    area = np.bincount(patches.facade, patches.area)
    assert area == pytest.approx([2 * (20.6 + 8) * 10, 20.6 * 8])
    for k in range(2):
        of_it = np.sort(patches.area[patches.facade == k])
        median = of_it[np.searchsorted(np.cumsum(of_it), 0.5 * of_it.sum())]
        assert of_it.min() >= 0.5 * median
        assert of_it.max() <= 2.5 * 4.0
    assert np.linalg.norm(patches.normal, axis=1) == pytest.approx(np.ones(len(patches.area)))
    assert (np.abs(patches.normal).max(axis=1) > 0.99).all(), "no patch lies around an edge"


def test_a_body_with_corners_on_the_ground_is_cut_into_pieces_that_all_have_an_area(level):
    ring = [(100, 100), (120, 100), (120, 120), (100, 120)]  # corners at the elevation of the ground
    vertices = np.array([*((x, y, 100.0) for x, y in ring), (110, 110, 115.0), (110, 110, 85.0)])
    faces = [(k, (k + 1) % 4, 4) for k in range(4)] + [((k + 1) % 4, k, 5) for k in range(4)]
    pieces, _ = cut_pieces([body(trimesh.Trimesh(vertices, faces, process=False))], level, 2.0)
    _, areas = normals_and_areas(pieces.corners)
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(8 * 0.5 * 20.0 * np.hypot(10.0, 15.0))
    assert areas[pieces.visible].sum() == pytest.approx(0.5 * areas.sum())
