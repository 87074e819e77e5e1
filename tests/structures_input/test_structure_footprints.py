"""Footprints become closed bodies with named facades; what cannot be used is named, all at once."""

import json
import math

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate
from structure_bodies import SOUTH, WEST, write_footprints

from runout.errors import StructureError
from runout.model.structures import Structures
from runout.model.terrain import Terrain
from runout.structures.build import build_structures
from runout.structures.facades import walls_of
from runout.structures.inspection import low_structures
from runout.structures.read import read_bodies, require_sound
from runout.structures.readers.footprints import read_footprints
from runout.structures.readers.meshes import volume
from runout.structures.solid import normals_and_areas
from runout.structures.source import StructureSource, Top

HOUSE = shapely.box(80, 90, 100, 102)


def only(path, terrain, **stated):
    (solid,) = read_bodies([StructureSource(path, **stated)], terrain).solids
    return solid


def facade_area(solid, name):
    return normals_and_areas(solid.corners)[1][solid.facade == solid.facades.index(name)].sum()


def test_house_has_a_facade_for_each_wall_and_a_top(level, tmp_path):
    house = only(write_footprints(tmp_path / "h.gpkg", [HOUSE], height=[8.0], name=["school"], friction_deg=[30.0]), level)
    assert house.name == "school"
    assert set(house.facades) == {"south", "east", "north", "west", "top", "underside"}
    assert facade_area(house, "top") == pytest.approx(240)
    assert volume(house.vertices, house.faces) == pytest.approx(240 * (8 + 10))  # two cells into the ground
    assert house.box[1, 2] == pytest.approx(108)
    assert house.friction == pytest.approx(math.tan(math.radians(30)))
    made = build_structures([house], level, (2.0, 2.0, 2.0))
    assert set(made.facades) == {"south", "east", "north", "west", "top"}
    area = np.bincount(made.field.patches.facade, made.field.patches.area)
    assert dict(zip(made.facades, area.round(6), strict=True)) == {"south": 160, "east": 96, "north": 160, "west": 96, "top": 240}


def test_a_courtyard_stays_open(level, tmp_path):
    yard = HOUSE.buffer(10, join_style="mitre").difference(HOUSE)
    solid = only(write_footprints(tmp_path / "y.gpkg", [yard], height=[6.0]), level)
    assert facade_area(solid, "top") == pytest.approx(yard.area)
    assert {"inner north", "inner south", "inner east", "inner west"} <= set(solid.facades)
    assert facade_area(solid, "inner south") == pytest.approx(20 * 16)
    assert volume(solid.vertices, solid.faces) == pytest.approx(yard.area * 16)


def test_height_counts_from_the_mean_ground_or_a_base_or_along_the_ground(tmp_path):
    slope = Terrain(np.tile(100 + 0.2 * (np.arange(40) + 0.5) * 5, (40, 1)), (5.0, 5.0), 500000.0, 5000000.0, "EPSG:32632")
    path = write_footprints(tmp_path / "s.gpkg", [HOUSE], height=[8.0])
    assert only(path, slope).box[1, 2] == pytest.approx(100 + 0.2 * 90 + 8)
    assert only(path, slope, base=116.0).box[1, 2] == pytest.approx(124)
    tops = only(path, slope, top=Top.ALONG_GROUND).vertices
    tops = tops[tops[:, 2] > 110]
    assert tops[:, 2] == pytest.approx(108 + 0.2 * tops[:, 0])


def test_the_top_of_a_dam_across_a_valley_follows_its_ground_from_cell_to_cell(tmp_path):
    """A valley whose bottom, at 100 m east, is 25 m below the ends of the dam."""
    x = (np.arange(40) + 0.5) * 5
    valley = Terrain(np.tile(100 + 0.5 * np.abs(x - 100), (40, 1)), (5.0, 5.0), WEST, SOUTH, "EPSG:32632")
    path = write_footprints(tmp_path / "dam.gpkg", [shapely.box(50, 90, 150, 96)], height=[6.0])
    dam, flat = only(path, valley, top=Top.ALONG_GROUND), only(path, valley)
    tops = dam.vertices[len(dam.vertices) // 2 :]
    ground = 100 + 0.5 * np.maximum(np.abs(tops[:, 0] - 100), 2.5)  # linear between the centres of cells
    np.testing.assert_allclose(tops[:, 2], ground + 6.0, atol=1e-9)
    assert np.diff(np.unique(tops[:, 0].round(6))).max() <= 5.0
    assert len(flat.vertices) == 8
    assert dam.box[0, 2] == pytest.approx(101.25 - 10.0), "two cells below the lowest ground"


def test_a_gallery_hangs_above_the_ground(level, tmp_path):
    roof = only(write_footprints(tmp_path / "g.gpkg", [HOUSE], height=[9.0], clearance=[5.0]), level)
    assert roof.box[:, 2] == pytest.approx([105, 109])
    assert "underside" in build_structures([roof], level, (2.0, 2.0, 2.0)).facades


@pytest.mark.parametrize(("sides", "walls"), [(4, 4), (8, 8), (64, 8)])
def test_a_round_pier_has_at_most_eight_walls(sides, walls):
    angle = (np.arange(sides) + 0.5) * 2 * np.pi / sides
    wall, names = walls_of(10 * np.column_stack([np.cos(angle), np.sin(angle)]))
    assert len(names) == walls == len(set(wall))


def test_points_along_a_wall_do_not_divide_it():
    ring = shapely.get_coordinates(shapely.segmentize(HOUSE, 3.0).exterior)[:-1]
    wall, names = walls_of(ring[::-1] if not shapely.is_ccw(shapely.LinearRing(ring)) else ring)
    assert sorted(names) == ["east", "north", "south", "west"]
    assert len(wall) == len(ring)


def test_all_problems_are_said_at_once(level, tmp_path):
    bow = shapely.Polygon([(20, 20), (40, 40), (40, 20), (20, 40)])
    shapes = [HOUSE, bow, shapely.box(190, 90, 210, 110), shapely.box(20, 150, 40, 170), shapely.box(60, 150, 80, 170), HOUSE]
    path = write_footprints(
        tmp_path / "bad.gpkg",
        shapes,
        height=[-2.0, 5.0, 5.0, 5.0, 5.0, np.nan],
        base=[np.nan, np.nan, np.nan, 140.0, 60.0, np.nan],
    )
    with pytest.raises(StructureError) as caught:
        read_bodies([StructureSource(path), StructureSource(tmp_path / "none.obj", units="m")], level)
    said = caught.value.problems
    assert len(said) == 7, said
    for text in (
        "feature 1: attribute 'height' is -2 m",
        "polygon 2 is not valid, its outline crosses itself (self-intersection) at easting 500030",
        "feature 3: the structure at easting 500200.0, northing 5000100.0 lies beyond",
        "feature 4: floats",
        "feature 5: is buried, its top lies 35 m below",
        "feature 6: its height is empty",
        "none.obj: no such file",
    ):
        assert sum(text in problem for problem in said) == 1, (text, said)


def test_a_wall_of_less_than_two_cells_is_refused(level, tmp_path):
    path = write_footprints(tmp_path / "w.gpkg", [shapely.box(80, 90, 120, 93)], height=[6.0])
    solids = read_bodies([StructureSource(path)], level).solids
    require_sound(solids, level, (1.5, 1.5, 1.5))
    with pytest.raises(StructureError, match=r"a wall is 3 m thick, less than two cells of 2 m, .*cell_size to 1.5 or less"):
        require_sound(solids, level, (2.0, 2.0, 2.0))


@pytest.mark.parametrize("angle", [0, 17, 45])
@pytest.mark.parametrize(("raster", "slope", "height"), [(2.0, 0.0, 6.0), (5.0, 0.3, 8.0), (10.0, 0.6, 3.0)])
def test_a_house_of_two_cells_is_accepted_whatever_its_height_and_direction(angle, raster, slope, height, tmp_path):
    """What stands in the ground has no thickness from its roof down to its foot, which depends on the raster."""
    count = int(200 / raster)
    terrain = Terrain.from_array(np.tile(300 - slope * raster * np.arange(count), (count, 1)), raster, origin=(WEST, SOUTH))
    house = rotate(shapely.box(87.5, 90, 112.5, 109.9), angle)
    path = write_footprints(tmp_path / "h.gpkg", [house], height=[height])
    solids = read_bodies([StructureSource(path)], terrain).solids
    require_sound(solids, terrain, (10.0, 10.0, 10.0))
    with pytest.raises(StructureError, match=r"a wall is (19.9|20) m thick, less than two cells of 11 m"):
        require_sound(solids, terrain, (11.0, 11.0, 11.0))
    if slope == 0:
        assert "is 6 m high, less than one cell of 10 m" in low_structures(solids, terrain, (10.0, 10.0, 10.0))[0]


@pytest.mark.parametrize("raster", [2.0, 10.0, 40.0])
def test_a_low_thin_dam_is_refused_however_deep_its_foot(raster, tmp_path):
    """On a coarse raster the foot reaches deep, and the middle of its walls lies in the ground."""
    terrain = Terrain(np.full((10, 10), 100.0), (raster, raster), WEST, SOUTH)
    middle = 5 * raster
    solid = only(write_footprints(tmp_path / "d.gpkg", [shapely.box(5, middle, 15, middle + 1.5)], height=[1.0]), terrain)
    with pytest.raises(StructureError, match=r"a wall is 1\.5 m thick"):
        require_sound([solid], terrain, (10.0, 10.0, 10.0))


def test_a_roof_that_hangs_close_above_the_ground_is_measured(level, tmp_path):
    path = write_footprints(tmp_path / "r.gpkg", [HOUSE], height=[2.0], clearance=[0.5])
    with pytest.raises(StructureError, match=r"a wall is 1\.5 m thick, less than two cells of 4 m"):
        require_sound(read_bodies([StructureSource(path)], level).solids, level, (4.0, 4.0, 4.0))


def test_a_dam_lower_than_a_cell_is_warned_of(level, tmp_path, caplog):
    path = write_footprints(tmp_path / "d.gpkg", [shapely.box(80, 60, 100, 120)], name=["dam"], height=[3.0])
    Structures.from_file(path, level, 4.0)
    assert "the structure 'dam' is 3 m high, less than one cell of 4 m; whether the flow overtops it" in caplog.text
    caplog.clear()
    Structures.from_file(path, level, 3.0)
    assert "less than one cell" not in caplog.text


def test_hollow_walls_and_slabs_are_measured(level, tmp_path):
    shell = HOUSE.buffer(0.5, join_style="mitre").difference(HOUSE)
    path = write_footprints(tmp_path / "t.gpkg", [shell, shapely.box(20, 20, 40, 40)], height=[6.0, 6.0], clearance=[np.nan, 5.5])
    with pytest.raises(StructureError) as caught:
        require_sound(read_bodies([StructureSource(path)], level).solids, level, (1.0, 1.0, 1.0))
    assert [problem.split("a wall is ")[1][:5] for problem in caught.value.problems] == ["0.5 m", "0.5 m"]


def test_walls_of_finely_drawn_outlines_are_measured(level, tmp_path):
    """A ring of 1200 points, as a laser scan draws it: its wall of 3 m is found, and thick ones pass."""
    disc = shapely.Point(90, 96)
    ring = disc.buffer(30, quad_segs=150).difference(disc.buffer(27, quad_segs=150))
    solid = only(write_footprints(tmp_path / "r.gpkg", [ring], height=[8.0]), level)
    with pytest.raises(StructureError, match="a wall is 3 m thick, less than two cells of 2 m"):
        require_sound([solid], level, (2.0, 2.0, 2.0))
    require_sound([solid], level, (1.4, 1.4, 1.4))


def test_a_structure_in_a_release_is_refused(level, tmp_path):
    from runout.model.release import Release

    thickness = np.zeros(level.shape)
    thickness[10:24, 10:24] = 3.0
    path = write_footprints(tmp_path / "r.gpkg", [HOUSE], height=[8.0], name=["barn"])
    solids = read_bodies([StructureSource(path)], level).solids
    with pytest.raises(StructureError, match="the structure 'barn' overlaps release top on 8 cells"):
        require_sound(solids, level, (2.0, 2.0, 2.0), [Release(thickness, level, placement="on_surface", name="top")])


def test_a_list_in_place_of_a_height_is_named_and_one_in_place_of_a_name_is_read(level, tmp_path):
    """GeoJSON allows them; they are read as arrays, or by older libraries not at all."""
    path = write_footprints(tmp_path / "l.geojson", [HOUSE], height=[8.0], name=["barn"])
    collection = json.loads(path.read_text(encoding="utf-8"))
    collection["features"][0]["properties"]["name"] = []
    path.write_text(json.dumps(collection), encoding="utf-8")
    assert len(read_bodies([StructureSource(path)], level).solids) == 1
    collection["features"][0]["properties"]["height"] = [8.0, 9.0]
    path.write_text(json.dumps(collection), encoding="utf-8")
    with pytest.raises(StructureError, match=r"attribute 'height' (is .*it must be a number|for the height)"):
        read_bodies([StructureSource(path)], level)


def test_a_missing_attribute_names_those_that_are_there(level, tmp_path):
    path = write_footprints(tmp_path / "a.gpkg", [HOUSE], hoehe=[8.0])
    with pytest.raises(StructureError, match=r"no attribute 'height'.*numeric attributes: hoehe"):
        read_bodies([StructureSource(path)], level)


def test_empty_names_and_frictions_are_those_of_the_source_and_several_parts_are_one_structure(level, tmp_path):
    two = shapely.MultiPolygon([HOUSE, shapely.box(20, 20, 40, 40)])
    values = {"height": [8.0, 9.0], "name": [None, "hall"], "friction_deg": [np.nan, 5.0]}
    path = write_footprints(tmp_path / "m.gpkg", [two, HOUSE.buffer(20)], **values)
    first, second = read_bodies([StructureSource(path, name="shed", friction_angle_deg=30.0)], level).solids
    assert (first.name, second.name) == ("shed", "hall")
    assert first.friction == pytest.approx(math.tan(math.radians(30)))
    assert {"south 1", "south 2"} <= set(first.facades)
    assert volume(first.vertices, first.faces) == pytest.approx((240 + 400) * 18)


@pytest.mark.parametrize(
    ("stated", "bottom", "top"),
    [
        ({"height": 8.0}, 90.0, 108.0),  # two cells below the lowest ground
        ({"height": 40.0}, 80.0, 140.0),  # half of its height
        ({"height": 8.0, "base": 97.0}, 87.0, 105.0),
        ({"height": 8.0, "base": 100.0}, 90.0, 108.0),
        ({"height": 8.0, "base": 101.0}, 101.0, 109.0),  # above the ground: as it stands
        ({"height": 8.0, "base": 101.0, "clearance": 3.0}, 104.0, 109.0),
        ({"height": 8.0, "clearance": 3.0}, 103.0, 108.0),
        ({"height": 8.0, "clearance": 0.0}, 90.0, 108.0),
        ({"height": 8.0, "base": 97.0, "top": "along_ground"}, 87.0, 105.0),
    ],
)
def test_a_body_reaches_from_its_foot_to_its_height(level, tmp_path, stated, bottom, top):
    path = write_footprints(tmp_path / "h.gpkg", [HOUSE], use=["barn"])
    (solid,) = read_footprints(StructureSource(path, **stated), level).solids
    np.testing.assert_allclose(solid.box[:, 2], [bottom, top])
    assert solid.clearance == (stated.get("clearance") or None)


def test_a_number_states_what_no_attribute_does_and_an_empty_attribute_counts_from_the_ground(level, tmp_path):
    values = {"tall": [6.0, 7.0], "base": [np.nan, 100.5], "clearance": [2.0, np.nan], "name": ["  ", "hall"]}
    path = write_footprints(tmp_path / "n.gpkg", [HOUSE, shapely.box(20, 20, 40, 40)], **values)
    read = read_footprints(StructureSource(path, height="tall", name="shed", friction_angle_deg=45.0), level)
    assert read.problems == ()
    np.testing.assert_allclose([solid.box[:, 2] for solid in read.solids], [(102.0, 106.0), (100.5, 107.5)])
    assert [solid.name for solid in read.solids] == ["shed", "hall"]
    assert [solid.clearance for solid in read.solids] == [2.0, None]
    assert [solid.friction for solid in read.solids] == pytest.approx([1.0, 1.0])
    assert [solid.place for solid in read.solids] == [f"{path}: feature 1", f"{path}: feature 2"]


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (
            {"height": 4.0, "clearance": 4.0},
            "clearance is 4 m and height 4 m, both above the ground; a structure needs a clearance",
        ),
        ({"height": 4.0, "clearance": 5.5}, "clearance is 5.5 m and height 4 m"),
        ({"height": 4.0, "base": "sole"}, "no attribute 'sole'"),
        ({"height": 4.0, "clearance": "gap"}, "no attribute 'gap'"),
    ],
)
def test_a_structure_below_its_own_underside_or_of_attributes_that_are_not_there_is_refused(level, tmp_path, stated, said):
    read = read_footprints(StructureSource(write_footprints(tmp_path / "h.gpkg", [HOUSE], use=["barn"]), **stated), level)
    assert read.solids == ()
    assert len(read.problems) == 1
    assert said in read.problems[0]
    assert read_footprints(
        StructureSource(write_footprints(tmp_path / "i.gpkg", [HOUSE], use=["barn"]), height=4.0, clearance=3.9), level
    ).solids
