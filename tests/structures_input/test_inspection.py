"""What is wrong with bodies on a terrain: spans, thickness of walls, places in the air and in the ground, cells of a release."""

import numpy as np
import pytest
import trimesh
from structure_bodies import SOUTH, WEST, body, box

from runout.model.release import Placement, Release
from runout.model.terrain import Terrain
from runout.structures.ground import elevation_at, ground_under
from runout.structures.inspection import (
    low_structures,
    placement_problems,
    release_overlaps,
    repeated_bodies,
    thin_walls,
    vertical_span,
    wall_thickness,
)
from runout.structures.readers.meshes import Search, mesh_faults


def hanging(mesh, name="body", clearance=5.0):
    solid = body(mesh, name)
    return type(solid)(solid.name, solid.vertices, solid.faces, solid.facade, solid.facades, solid.friction, solid.place, clearance)


def inclined(east=0.2):
    """Ground that rises eastwards from 100 m, in cells of 5 m."""
    return Terrain(np.tile(100.0 + east * (np.arange(40) + 0.5) * 5.0, (40, 1)), (5.0, 5.0), WEST, SOUTH, "EPSG:32632")


def test_the_span_of_a_body_over_a_place_is_from_its_lowest_to_its_highest_face():
    wedge = trimesh.Trimesh(
        [(0, 0, 0), (8, 0, 0), (8, 4, 0), (0, 4, 0), (8, 0, 6), (8, 4, 6)],
        [(0, 2, 1), (0, 3, 2), (1, 2, 5), (1, 5, 4), (0, 1, 4), (3, 5, 2), (0, 4, 5), (0, 5, 3)],
        process=False,
    )
    wedge.apply_translation((10.0, 20.0, 100.0))
    points = np.array([(11.0, 21.0), (14.3, 22.2), (17.5, 23.9), (9.9, 22.0), (18.1, 22.0), (14.0, 24.1)])
    span = vertical_span(body(wedge), points)
    np.testing.assert_allclose(span[:3], [(100.0, 100.75), (100.0, 103.225), (100.0, 105.625)])
    assert span[3:].tolist() == [[np.inf, -np.inf]] * 3
    both = trimesh.util.concatenate([wedge, box((14.0, 22.0, 120.0), (2.0, 2.0, 4.0))])
    np.testing.assert_allclose(vertical_span(body(both), points[1:2]), [(100.0, 122.0)])


def test_walls_are_as_thick_as_the_way_to_the_other_side_and_tops_stand_on_ground(level):
    solid = body(box((100, 100, 104), (20, 6, 12)))
    thickness, centres, across = wall_thickness(solid, level, (2.0, 2.0, 1.0))
    on_wall = {"x": np.abs(np.abs(centres[:, 0] - 100) - 10) < 1e-9, "y": np.abs(np.abs(centres[:, 1] - 100) - 3) < 1e-9}
    top = np.abs(centres[:, 2] - 110) < 1e-9
    assert all(part.any() for part in (*on_wall.values(), top))
    assert (centres[:, 2] > 100.0).all()
    np.testing.assert_allclose(thickness[on_wall["y"]], np.inf)  # 6 m is farther than two cells of 2 m
    assert np.isinf(thickness[top]).all()
    np.testing.assert_allclose(across[top], 1.0)
    np.testing.assert_allclose(across[on_wall["x"]], 2.0)
    coarse, centres, _ = wall_thickness(solid, level, (4.0, 4.0, 4.0))
    on_y = np.abs(np.abs(centres[:, 1] - 100) - 3) < 1e-9
    np.testing.assert_allclose(coarse[on_y], 6.0)
    assert np.isinf(coarse[~on_y]).all()


def test_a_hanging_slab_is_as_thick_as_it_is_and_a_slab_on_the_ground_is_not(level):
    slab = box((100, 100, 106), (20, 20, 3))
    thickness, centres, _ = wall_thickness(hanging(slab), level, (2.0, 2.0, 2.0))
    np.testing.assert_allclose(thickness[np.abs(np.abs(centres[:, 2] - 106) - 1.5) < 1e-9], 3.0)
    on_ground, centres, _ = wall_thickness(body(box((100, 100, 101.5), (20, 20, 3))), level, (2.0, 2.0, 2.0))
    assert np.isinf(on_ground).all()
    assert (centres[:, 2] > 100.0).all()


def test_a_slab_close_above_the_ground_hangs_only_if_it_states_a_clearance(level):
    """Its underside is 1 m above the ground, less than a quarter of a cell of the terrain."""
    slab = box((100, 100, 102.5), (20, 20, 3))
    for solid, expected in ((body(slab), np.inf), (hanging(slab, clearance=1.0), 3.0)):
        thickness, centres, _ = wall_thickness(solid, level, (2.0, 2.0, 2.0))
        top = np.abs(centres[:, 2] - 104.0) < 1e-9
        assert top.any()
        np.testing.assert_allclose(thickness[top], expected)


@pytest.mark.parametrize(("width", "cell", "named"), [(3.0, 2.0, "1.5"), (1.0, 2.0, "0.5"), (7.0, 4.0, "3.5")])
def test_a_thin_wall_is_named_with_the_cell_size_that_resolves_it(level, width, cell, named):
    (problem,) = thin_walls([body(box((100, 100, 104), (20, width, 12)))], level, (cell,) * 3)
    assert problem.startswith(f"body: a wall is {width:g} m thick, less than two cells of {cell:g} m, at easting 500")
    assert problem.endswith(f"or set simulation.cell_size to {named} or less")
    assert thin_walls([body(box((100, 100, 104), (20, 2.0 * cell, 12)))], level, (cell,) * 3) == []


def test_what_rests_on_a_body_that_stands_does_not_float(level):
    post, beam = body(box((100, 100, 104), (4, 4, 12)), "post"), body(box((110, 100, 112), (24, 4, 4)), "beam")
    lamp = body(box((121, 100, 116), (2, 2, 4)), "lamp")
    assert placement_problems([lamp, beam, post], level) == []
    floating = placement_problems([lamp, beam], level)
    assert [problem.split(" above")[0] for problem in floating] == ["lamp: floats 14 m", "beam: floats 10 m"]
    assert placement_problems([hanging(box((110, 100, 112), (24, 4, 4)), "beam")], level) == []


@pytest.mark.parametrize(
    ("centre", "size", "said"),
    [
        ((100, 100, 90), (10, 10, 18), "is buried, its top lies 1 m below the ground, at easting 500100.0, northing 5000100.0"),
        ((100, 100, 106.3), (10, 10, 10), "floats 1.3 m above the ground, at easting 500100.0"),
        ((198, 100, 104), (10, 10, 10), "lies partly beyond the terrain"),
        ((300, 100, 104), (10, 10, 10), "lies wholly beyond the terrain"),
        ((100, 100, 1101), (10, 10, 2002), "reaches 2002 m above the ground, at easting 500100.0"),
        ((100, 100, -4850), (10, 10, 10102), "reaches 1e+04 m below the ground"),
    ],
)  # fmt: skip
def test_bodies_in_the_air_in_the_ground_and_beyond_the_terrain_are_named(level, centre, size, said):
    (problem,) = placement_problems([body(box(centre, size))], level)
    assert problem.startswith(f"body: {said}")


def test_bodies_at_the_limits_are_accepted(level):
    for centre, size in (
        ((100, 100, 1100), (10, 10, 2000)),
        ((100, 100, -4850), (10, 10, 10100)),
        ((100, 100, 106.2), (10, 10, 10)),
    ):
        assert placement_problems([body(box(centre, size))], level) == []


def test_cells_of_a_release_in_a_body_are_counted(level):
    thickness = np.zeros(level.shape)
    thickness[18:22, 18:22] = 4.0  # 90 m to 110 m east and north
    dug, heaped = (
        Release(thickness, level, name="scar", placement=placement) for placement in (Placement.EXCAVATED, Placement.ON_SURFACE)
    )
    low, high = body(box((100, 100, 98), (10, 12, 6)), "low"), body(box((100, 100, 106), (10, 12, 4)), "high")
    assert release_overlaps([high], [dug]) == []
    (problem,) = release_overlaps([low, high], [dug])
    assert problem.startswith("low: the structure 'low' overlaps release scar on 4 cells, at easting 500100.0, northing 5000100.0")
    assert [problem.split(":")[0] for problem in release_overlaps([low, high], [heaped])] == ["low"]
    assert (
        release_overlaps([body(box((100, 100, 103), (10, 12, 4)), "between")], [heaped])[0].split(" on ")[1].startswith("4 cells")
    )
    assert release_overlaps([body(box((130, 100, 98), (10, 12, 6)))], [dug]) == []


def test_a_release_off_the_diagonal_is_compared_along_both_axes(level):
    thickness = np.zeros(level.shape)
    thickness[28:32, 28:32] = 4.0  # 140 m to 160 m east, 40 m to 60 m north
    scar = Release(thickness, level, name="scar")
    (problem,) = release_overlaps([body(box((150, 50, 98), (10, 12, 6)), "low")], [scar])
    assert "on 4 cells" in problem
    for elsewhere in ((50, 150), (150, 150), (50, 50)):
        assert release_overlaps([body(box((*elsewhere, 98), (10, 12, 6)), "low")], [scar]) == []


def test_bodies_lower_than_a_cell_are_warned_of_by_the_height_of_the_grid(level):
    low = body(box((100, 100, 101), (20, 20, 3)), "low")
    (warning,) = low_structures([low, body(box((60, 60, 103), (10, 10, 10)))], level, (2.0, 2.0, 3.0))
    assert warning.startswith("low: the structure 'low' is 2.5 m high, less than one cell of 3 m")
    assert low_structures([low], level, (4.0, 4.0, 2.5)) == []


def test_equal_bodies_are_found_whatever_the_order_of_their_faces(level):
    one, other = body(box((60, 60, 103), (10, 10, 10)), "one"), body(box((60, 60, 103), (10, 10, 10)), "other")
    turned = type(other)("other", other.vertices, other.faces[::-1], other.facade, other.facades, other.friction, "other")
    moved = body(box((60.001, 60, 103), (10, 10, 10)), "moved")
    assert repeated_bodies([one, moved, turned]) == ["other: is the same body as one; remove one of the two"]


def test_elevation_between_cells_is_linear_and_unknown_beyond_the_raster():
    terrain = inclined()
    points = np.array([(2.5, 2.5), (50.0, 73.2), (101.3, 197.5), (1.0, 100.0), (199.0, 100.0), (-0.1, 50.0), (50.0, 200.1)])
    elevation = elevation_at(terrain, points)
    np.testing.assert_allclose(elevation[:3], 100.0 + 0.2 * points[:3, 0])
    np.testing.assert_allclose(elevation[3:5], [100.5, 139.5], err_msg="half a cell at the rim is level")
    assert np.isnan(elevation[5:]).all()
    north = Terrain(terrain.elevation.T[::-1], (5.0, 5.0), WEST, SOUTH, "EPSG:32632")
    np.testing.assert_allclose(elevation_at(north, np.array([(50.0, 73.2)])), 100.0 + 0.2 * 73.2)


def test_ground_under_a_footprint_has_its_lowest_mean_and_highest_elevation():
    import shapely

    ground = ground_under(shapely.box(50.0, 80.0, 90.0, 100.0), inclined())
    assert (ground.lowest, ground.mean, ground.highest) == pytest.approx((110.0, 114.0, 118.0))
    small = ground_under(shapely.box(50.0, 80.0, 50.5, 80.5), inclined())
    assert (small.lowest, small.mean, small.highest) == pytest.approx((110.0, 110.05, 110.1))
    beyond = ground_under(shapely.box(190.0, 80.0, 210.0, 100.0), inclined())
    assert np.isnan([beyond.lowest, beyond.mean, beyond.highest]).all()


def test_a_small_body_high_above_the_origin_has_a_volume_and_a_sheet_has_none(level):
    for place in ((5.0, 190.0, 2500.0), (195.0, 3.0, 101.0)):
        small = body(box(place, (0.4, 0.3, 0.2)))
        assert list(mesh_faults(small, level, 0.0, Search())) == []
    sheet = body(box((100.0, 100.0, 101.0), (20.0, 10.0, 0.0)))
    assert list(mesh_faults(sheet, level, 0.0, Search())) == ["body: the mesh has no volume; export a body, not a surface"]
