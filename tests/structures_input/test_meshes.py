"""Meshes become bodies: units, offset and axes are those stated; open ones are refused with the place of the hole."""

import numpy as np
import pytest
import trimesh
from structure_bodies import SOUTH, WEST, box

from runout.errors import StructureError
from runout.structures.read import read_bodies, structures_from_sources
from runout.structures.readers.meshes import volume
from runout.structures.source import StructureSource

CENTRE = (WEST + 100.0, SOUTH + 80.0, 103.0)


def bodies(path, terrain, **stated):
    return read_bodies([StructureSource(path, **{"units": "m", **stated})], terrain)


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb"])
def test_a_box_comes_as_it_is_from_every_kind_of_file(level, tmp_path, kind):
    house = box((100, 80, 103), (12, 8, 10))
    if kind == "glb":  # y is up
        house.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    house.apply_scale(1000.0)
    house.export(tmp_path / f"house.{kind}")
    read = bodies(tmp_path / f"house.{kind}", level, units="mm", offset=(WEST, SOUTH, 0.0), crs="EPSG:32632")
    (solid,) = read.solids
    assert solid.box == pytest.approx(np.array([[94, 76, 98], [106, 84, 108]]), abs=1e-3)
    assert set(solid.facades) == {"east", "west", "north", "south", "top", "underside"}
    assert volume(solid.vertices, solid.faces) == pytest.approx(960, rel=1e-4)


def test_a_hole_is_named_with_its_place(level, tmp_path):
    house = box(CENTRE, (12, 8, 10))
    lid = np.abs(house.triangles[:, :, 2] - 108).max(1) < 1e-6
    house.update_faces(~lid)
    house.export(tmp_path / "open.obj")
    place = r"easting 500100.00, northing 5000080.00, elevation 108.00 \(4 edges\)"
    with pytest.raises(StructureError, match=f"the mesh is open at {place}"):
        bodies(tmp_path / "open.obj", level)


def test_inverted_faces_are_turned_and_said(level, tmp_path):
    house = box(CENTRE, (12, 8, 10))
    house.invert()
    house.export(tmp_path / "inside_out.ply")
    read = bodies(tmp_path / "inside_out.ply", level)
    assert volume(read.solids[0].vertices, read.solids[0].faces) == pytest.approx(960)
    assert any("turned outwards" in change for change in read.changes)


def test_one_face_turned_against_its_neighbours_is_refused(level, tmp_path):
    house = box(CENTRE, (12, 8, 10))
    house.faces[3] = house.faces[3][::-1]
    (tmp_path / "twist.ply").write_bytes(trimesh.Trimesh(house.vertices, house.faces, process=False).export(file_type="ply"))
    with pytest.raises(StructureError, match="turned against each other at easting"):
        bodies(tmp_path / "twist.ply", level)


def test_several_bodies_of_a_file_are_structures_of_their_own_and_cavities_are_not(level, tmp_path):
    cavity = box(CENTRE, (4, 4, 4))
    cavity.invert()
    parts = [box(CENTRE, (12, 8, 10)), cavity, box((WEST + 50, SOUTH + 50, 103), (10, 10, 10))]
    trimesh.util.concatenate(parts).export(tmp_path / "two.obj")
    read = bodies(tmp_path / "two.obj", level, name="house")
    assert [s.name for s in read.solids] == ["house 1", "house 2"]
    assert [s.place for s in read.solids] == [f"{tmp_path / 'two.obj'}: body 'house' {number}" for number in (1, 2)]
    assert sorted(volume(s.vertices, s.faces) for s in read.solids) == pytest.approx([960 - 64, 1000])


def test_a_sheet_without_volume_inside_a_body_is_no_cavity_and_is_refused(level, tmp_path):
    sheet = box(CENTRE, (4, 4, 0))
    trimesh.util.concatenate([box(CENTRE, (12, 8, 10)), sheet]).export(tmp_path / "sheet.obj")
    with pytest.raises(StructureError, match="the mesh has no volume; export a body, not a surface"):
        bodies(tmp_path / "sheet.obj", level)


def test_a_sphere_is_one_facade(level, tmp_path):
    ball = trimesh.creation.icosphere(3, radius=5.0)
    ball.apply_translation(CENTRE)
    ball.export(tmp_path / "ball.obj")
    assert bodies(tmp_path / "ball.obj", level).solids[0].facades == ("surface",)


def test_units_must_be_stated_and_a_hanging_mesh_its_clearance(level, tmp_path):
    box((CENTRE[0], CENTRE[1], 120.0), (12, 8, 10)).export(tmp_path / "bridge.obj")
    with pytest.raises(StructureError, match="state the units of the mesh: m, cm, mm, ft"):
        bodies(tmp_path / "bridge.obj", level, units=None)
    with pytest.raises(StructureError, match=r"floats 15 m above the ground, at easting 500100.0.*state clearance"):
        bodies(tmp_path / "bridge.obj", level)
    assert bodies(tmp_path / "bridge.obj", level, clearance=15.0).solids


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"offset": (1.0, 2.0)}, "offset is (1.0, 2.0); give three finite numbers in m: easting, northing, elevation"),
        ({"offset": (1.0, 2.0, np.nan)}, "give three finite numbers in m"),
        ({"offset": "abc"}, "give three finite numbers in m"),
        ({"units": 3}, "units is 3; give text"),
        ({"name": None}, "name is None; give text"),
        ({"height": 4.0, "layer": "a"}, "height has no meaning with a mesh; leave it out\nhouse.obj: layer has no meaning"),
    ],
)
def test_what_is_stated_wrongly_of_a_mesh_is_named_at_once(stated, said):
    with pytest.raises(StructureError) as caught:
        StructureSource("house.obj", **stated)
    assert str(caught.value).startswith("house.obj: ")
    assert said in str(caught.value)


def test_sources_and_systems_that_are_none_are_named(level, tmp_path):
    box(CENTRE, (12, 8, 10)).export(tmp_path / "house.obj")
    with pytest.raises(StructureError, match=r"sources\[0\] is 'house.obj'; give a runout.StructureSource of the file"):
        structures_from_sources(["house.obj"], level, 2.0)
    with pytest.raises(StructureError, match=r"house.obj: crs 'nowhere' is not known .*; write for example EPSG:32632"):
        bodies(tmp_path / "house.obj", level, crs="nowhere")
    with pytest.raises(StructureError, match=r"b.gpkg: units has no meaning with footprints"):
        StructureSource("b.gpkg", units="m")


def test_a_roof_on_posts_does_not_float(level, tmp_path):
    roof, post = box((CENTRE[0], CENTRE[1], 112.0), (12, 8, 4)), box((CENTRE[0], CENTRE[1], 104.0), (4, 4, 12))
    trimesh.util.concatenate([roof, post]).export(tmp_path / "shelter.obj")
    assert len(bodies(tmp_path / "shelter.obj", level).solids) == 2


def test_a_file_that_is_no_mesh_is_refused(level, tmp_path):
    (tmp_path / "text.stl").write_text("no mesh at all")
    with pytest.raises(StructureError, match=r"text.stl: is cut off, or no STL file"):
        bodies(tmp_path / "text.stl", level)


def test_coordinates_that_single_precision_rounds_are_reported(level, tmp_path):
    box(CENTRE, (12, 8, 10)).export(tmp_path / "far.stl")
    assert any("rounded to 0.3 m by single precision" in change for change in bodies(tmp_path / "far.stl", level).changes)
