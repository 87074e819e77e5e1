"""Malformed mesh files: one clear line for each, with the place and the remedy; parts of one body are joined."""

import struct

import numpy as np
import pytest
import trimesh
from structure_bodies import SOUTH, WEST, box

from runout.errors import DemError, StructureError
from runout.structures.read import read_bodies
from runout.structures.readers import meshes
from runout.structures.readers.meshes import Search, crossings, on_terrain, rounding_of, volume
from runout.structures.solid import Solid
from runout.structures.source import StructureSource
from runout.terrain.mesh import read_mesh_terrain

CENTRE = (WEST + 100.0, SOUTH + 80.0, 103.0)
HOUSE = box(CENTRE, (12, 8, 10))
VERTICES, FACES = np.array(HOUSE.vertices), np.array(HOUSE.faces)
AGAIN = "export it again as OBJ, PLY, STL or GLB"


def obj_text(vertices, faces):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices).tolist()]
    return "\n".join([*lines, *("f " + " ".join(str(row + 1) for row in face) for face in np.asarray(faces).tolist()), ""])


def write(path, vertices, faces):
    """A mesh without any repair by trimesh; binary STL is written by hand, since trimesh drops what is not finite."""
    if path.suffix == ".obj":
        path.write_text(obj_text(vertices, faces))
    elif path.suffix == ".ply":
        rows = [" ".join(map(repr, one)) for one in np.asarray(vertices).tolist()]
        rows += ["3 " + " ".join(map(str, face)) for face in np.asarray(faces).tolist()]
        kinds = "".join(f"property double {axis}\n" for axis in "xyz")
        head = f"element vertex {len(vertices)}\n{kinds}element face {len(faces)}\nproperty list uchar int vertex_indices\n"
        path.write_text(f"ply\nformat ascii 1.0\n{head}end_header\n" + "\n".join(rows) + "\n")
    elif path.suffix == ".stl":
        records = [struct.pack("<12fH", 0, 0, 0, *np.asarray(vertices)[face].ravel(), 0) for face in faces]
        path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + b"".join(records))
    else:
        trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


def refused(path, terrain, **stated):
    """The one line about a file of structures."""
    with pytest.raises(StructureError) as caught:
        read_bodies([StructureSource(path, **{"units": "m", **stated})], terrain)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path}: ")
    return line.removeprefix(f"{path}: ")


@pytest.mark.parametrize("kind", ["obj", "ply", "stl"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_vertices_that_are_no_finite_numbers_are_named(level, tmp_path, kind, value):
    vertices = VERTICES.copy()
    vertices[3, 1] = value
    said = refused(write(tmp_path / f"odd.{kind}", vertices, FACES), level)
    count = "4 of 36" if kind == "stl" else "1 of 8"
    assert said == f"{count} vertices are no finite numbers, the first is (500094, {value}, 108); {AGAIN}"


@pytest.mark.parametrize("row", [77, -2])
def test_faces_of_vertices_that_are_not_there_are_named(level, tmp_path, row):
    faces = FACES.copy()
    faces[3, 1] = row
    said = refused(write(tmp_path / "odd.ply", VERTICES, faces), level)
    assert said == f"face 4 has vertices 2, {row}, 0; the mesh has vertices 0 to 7; {AGAIN}"


@pytest.mark.parametrize(
    ("line", "new", "said"),
    [
        (3, "v 500094,5 5000076 98", "line 3: 'v 500094,5 5000076 98' has a word that is no number (decimals have a point)"),
        (3, "v 500094 5000076", "line 3: 'v 500094 5000076' has fewer than three coordinates"),
        (12, "f 1 2 9", "line 12: a face has vertex 9; the file has 8 vertices"),
        (12, "f 1 0 3", "line 12: a face has vertex 0; vertices count from 1"),
        (12, "f 0/1 2/1 3/1", "line 12: a face has vertex 0; vertices count from 1"),
    ],
)
def test_the_line_of_an_obj_file_is_named(level, tmp_path, line, new, said):
    lines = obj_text(VERTICES, FACES).splitlines()
    lines[line - 1] = new
    (tmp_path / "odd.obj").write_text("\n".join(lines) + "\n")
    assert refused(tmp_path / "odd.obj", level) == f"{said}; {AGAIN}"


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb"])
def test_files_that_are_empty_missing_or_a_folder_are_named(level, tmp_path, kind):
    (tmp_path / f"empty.{kind}").write_bytes(b"")
    (tmp_path / f"folder.{kind}").mkdir()
    assert refused(tmp_path / f"empty.{kind}", level) == "is empty (0 bytes); copy it again"
    assert refused(tmp_path / f"none.{kind}", level) == "no such file; check the path"
    assert refused(tmp_path / f"folder.{kind}", level) == "is a folder; name the mesh file in it"


@pytest.mark.parametrize(
    ("kind", "share", "said"),
    [
        ("stl", 0.6, "is cut off, or no STL file: it has 410 bytes, its header 684"),
        ("glb", 0.6, "is cut off, or no GLB file: it has "),
        ("ply", 0.1, "is cut off in its header"),
        ("ply", 0.8, "is cut off: 0 of its 12 faces can be read"),
        ("obj", 0.5, "holds no faces"),
        ("obj", 0.9, "body 'structure': the mesh is open at easting"),
    ],
)
def test_files_that_are_cut_off_are_refused(level, tmp_path, kind, share, said):
    whole = write(tmp_path / f"whole.{kind}", VERTICES, FACES).read_bytes()
    (tmp_path / f"cut.{kind}").write_bytes(whole[: int(share * len(whole))])
    assert refused(tmp_path / f"cut.{kind}", level).startswith(said)


def test_a_ply_file_with_fewer_elements_than_stated_is_refused(level, tmp_path):
    path = write(tmp_path / "cut.ply", VERTICES, FACES)
    path.write_text(path.read_text().replace("element vertex 8", "element vertex 900000000000"))
    assert "of its 900000000000 vertices can be read" in refused(path, level)


def test_the_format_of_a_file_is_named(level, tmp_path):
    (tmp_path / "house.stl").write_bytes(write(tmp_path / "house.ply", VERTICES, FACES).read_bytes())
    assert refused(tmp_path / "house.stl", level) == f"begins as a PLY file; rename it to house.ply, or {AGAIN}"
    (tmp_path / "house.fbx").write_bytes(b"Kaydara FBX Binary")
    assert refused(tmp_path / "house.fbx", level) == "meshes of .fbx are not read; export it as OBJ, PLY, STL or GLB"
    (tmp_path / "noise.glb").write_bytes(bytes(range(200)))
    assert refused(tmp_path / "noise.glb", level) == f"does not begin as a GLB file; {AGAIN}"


FAULTS = {
    "the mesh has faces twice at easting 500094.00, northing 5000078.67, elevation 104.67 (1 face); remove duplicate faces":
        (VERTICES, np.vstack([FACES, FACES[:1]])),
    "the mesh has faces without area at easting 500094.00, northing 5000076.00, elevation 103.00 (1 face); remove them":
        (np.vstack([VERTICES, [(VERTICES[0] + VERTICES[1]) / 2]]), np.vstack([FACES, [[0, 8, 1]]])),
    "the mesh has no volume; export a body, not a surface": (VERTICES * [1, 1, 0] + [0, 0, 103], FACES),
}  # fmt: skip


@pytest.mark.parametrize("said", FAULTS)
def test_faces_that_are_no_surface_of_a_body_are_named(level, tmp_path, said):
    assert refused(write(tmp_path / "odd.obj", *FAULTS[said]), level).startswith(f"body 'structure': {said}")


def test_two_boxes_that_share_an_edge_are_refused(level, tmp_path):
    both = trimesh.util.concatenate([HOUSE, box((CENTRE[0] + 12, CENTRE[1] + 8, 103), (12, 8, 10))])
    both.merge_vertices()
    said = refused(write(tmp_path / "odd.ply", np.array(both.vertices), np.array(both.faces)), level)
    assert "has edges of more than two faces at easting 500106.00, northing 5000084.00, elevation 103.00 (1 edge)" in said


def test_faces_that_cross_each_other_are_named(level, tmp_path):
    vertices = VERTICES.copy()
    vertices[np.flatnonzero(VERTICES[:, 2] > 103)[0], 2] = 80.0
    said = refused(write(tmp_path / "odd.obj", vertices, FACES), level)
    assert said.startswith("body 'structure': faces of the mesh cross each other at easting 500100.57, northing 5000080.38")


def test_faults_that_single_precision_may_have_made_say_so(level, tmp_path):
    ball = trimesh.creation.icosphere(4, radius=3.0)
    ball.apply_translation(CENTRE)
    said = refused(write(tmp_path / "ball.stl", ball.vertices, ball.faces), level)
    assert said.endswith("(single precision rounds its coordinates to 0.3 m: export it near the origin and state offset)")


def test_faces_with_two_equal_corners_are_left_out_and_said(level, tmp_path):
    read = read_bodies([StructureSource(write(tmp_path / "odd.obj", VERTICES, np.vstack([FACES, [[0, 0, 1]]])), units="m")], level)
    assert len(read.solids[0].faces) == 12
    assert any("1 face with two equal corners left out" in change for change in read.changes)


@pytest.mark.parametrize("shape", ["ball", "bent_tube", "ring"])
def test_sound_bodies_cross_nowhere(level, tmp_path, shape):
    mesh = {
        "ball": lambda: trimesh.creation.icosphere(3, radius=9.0),
        "ring": lambda: trimesh.creation.annulus(5.0, 9.0, 8.0),
        "bent_tube": lambda: trimesh.creation.torus(9.0, 3.0),
    }[shape]()
    mesh.apply_translation(CENTRE)
    (solid,) = read_bodies([StructureSource(write(tmp_path / "body.obj", mesh.vertices, mesh.faces), units="m")], level).solids
    assert len(crossings(solid)) == 0


PLACES = {
    "units: mm": (VERTICES * 1000.0, "its coordinates fit with units: mm"),
    "units: cm": (VERTICES * 100.0, "its coordinates fit with units: cm"),
    "units: ft": (VERTICES / 0.3048, "its coordinates fit with units: ft"),
    "kilometres": (VERTICES / 1000.0, "its coordinates fit in kilometres: export it in metres"),
    "swapped": (VERTICES[:, [1, 0, 2]], "easting and northing are swapped: export it with x to the east"),
    "y up": (np.column_stack([VERTICES[:, 0], VERTICES[:, 2], -VERTICES[:, 1]]), "y is up in it: export it with z up"),
    "y up, mirrored": (VERTICES[:, [0, 2, 1]], "y is up in it: export it with z up"),
    "local": (VERTICES - [WEST, SOUTH, 0], "its coordinates count from an origin of its own: state offset"),
    "another zone": (VERTICES + np.array([2e6, 0, 0]), "check units, offset and crs of the mesh"),
    "far": (VERTICES * 1e30, "check units, offset and crs of the mesh"),
}


@pytest.mark.parametrize("mistake", PLACES)
def test_a_mesh_beyond_the_terrain_is_refused_with_what_would_place_it(level, tmp_path, mistake):
    vertices, remedy = PLACES[mistake]
    said = refused(write(tmp_path / "far.obj", vertices, FACES), level)
    assert said.startswith("lies beyond the terrain array, at easting ")
    assert "; the terrain has easting 500000 to 500200, northing 5000000 to 5000200; " in said
    assert said.split("; ")[2].startswith(remedy)


def test_an_offset_that_is_too_much_is_named(level, tmp_path):
    source = StructureSource(write(tmp_path / "far.obj", VERTICES, FACES), units="m", offset=(WEST, SOUTH, 0.0))
    with pytest.raises(StructureError, match="it lies there without offset: remove offset"):
        read_bodies([source], level)


@pytest.mark.parametrize("kind", ["obj", "ply", "stl"])
def test_a_vertex_far_from_all_others_is_named(level, tmp_path, kind):
    ball = trimesh.creation.icosphere(2, radius=6.0)
    vertices = ball.vertices + np.array([100.0, 80.0, 103.0])
    vertices[5, 1] = 5e6
    path = write(tmp_path / f"spike.{kind}", vertices, ball.faces)
    x, _, z = vertices[5].astype(np.float32 if kind == "stl" else np.float64)
    where = f"the first at ({x:.10g}, 5000000, {z:.10g})"
    assert refused(path, level) == f"1 vertex lies far from all others, {where}; remove what is there, or {AGAIN}"
    with pytest.raises(DemError, match="far from all others"):
        read_mesh_terrain(path, 1.0)


def test_a_long_dam_and_a_mast_have_no_vertex_far_from_others(level, tmp_path):
    dam, mast = box(CENTRE, (190, 2, 10)), trimesh.creation.cone(2.0, 90.0)
    mast.apply_translation((CENTRE[0], CENTRE[1] + 40, 98.0))
    both = trimesh.util.concatenate([dam, mast])
    read = read_bodies([StructureSource(write(tmp_path / "both.obj", both.vertices, both.faces), units="m")], level)
    assert len(read.solids) == 2


def test_degrees_are_told_from_coordinates_of_an_own_origin(level, tmp_path):
    from pyproj import Transformer

    x, y = Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True).transform(VERTICES[:, 0], VERTICES[:, 1])
    path = write(tmp_path / "degrees.obj", np.column_stack([x, y, VERTICES[:, 2]]), FACES)
    assert refused(path, level).endswith("its coordinates are degrees: state crs, for example EPSG:4326")
    (solid,) = read_bodies([StructureSource(path, units="m", crs="EPSG:4326")], level).solids
    assert solid.box == pytest.approx(np.array([[94, 76, 98], [106, 84, 108]]), abs=2e-3)


def test_parts_with_a_material_each_are_one_body(level, tmp_path):
    lines = obj_text(VERTICES, FACES).splitlines()
    lines[14:14] = ["usemtl roof"]
    (tmp_path / "house.obj").write_text("\n".join(["mtllib none.mtl", *lines[:8], "usemtl wall", *lines[8:], ""]))
    turned = trimesh.Scene()
    for name, rows in (("wall", FACES[:6]), ("roof", FACES[6:])):
        local = VERTICES - [WEST, SOUTH, 0]
        part = trimesh.Trimesh(np.column_stack([local[:, 0], local[:, 2], -local[:, 1]]), rows, process=False)
        turned.add_geometry(part, node_name=name)
    (tmp_path / "house.glb").write_bytes(turned.export(file_type="glb"))
    for path, offset in (("house.obj", (0.0, 0.0, 0.0)), ("house.glb", (WEST, SOUTH, 0.0))):
        (solid,) = read_bodies([StructureSource(tmp_path / path, units="m", offset=offset)], level).solids
        assert solid.name == "structure"
        assert volume(solid.vertices, solid.faces) == pytest.approx(960)


def test_nodes_that_are_closed_keep_their_names_though_they_touch(level, tmp_path):
    scene = trimesh.Scene()
    for name, east in (("north wing", 0.0), ("south wing", 12.0)):
        local = VERTICES - [WEST - east, SOUTH, 0]
        part = trimesh.Trimesh(np.column_stack([local[:, 0], local[:, 2], -local[:, 1]]), FACES, process=False)
        scene.add_geometry(part, node_name=name)
    (tmp_path / "wings.glb").write_bytes(scene.export(file_type="glb"))
    read = read_bodies([StructureSource(tmp_path / "wings.glb", units="m", offset=(WEST, SOUTH, 0.0))], level)
    assert sorted(solid.name for solid in read.solids) == ["north wing", "south wing"]


def test_meshes_that_are_no_terrain_are_refused(tmp_path):
    cases = {
        "closed": (VERTICES, FACES, "is a closed body; a terrain is an open surface: remove the underside and the sides"),
        "thin": (VERTICES[:3], [[0, 1, 2]], "the mesh spans 0 x 8 m, 8 x 0 cells of 1 m; give a mesh with coordinates in metres"),
        "vast": (VERTICES[[1, 5, 7]] * 1e6, [[0, 1, 2]], "coordinates in metres, a terrain.extent, or larger cells"),
        "odd": (VERTICES * [1, 1, np.nan], FACES, "8 of 8 vertices are no finite numbers"),
    }
    for name, (vertices, faces, said) in cases.items():
        path = write(tmp_path / f"{name}.ply", vertices, faces)
        with pytest.raises(DemError) as caught:
            read_mesh_terrain(path, 1.0)
        assert str(caught.value).startswith(f"{path}: ")
        assert said in str(caught.value)
        assert "\n" not in str(caught.value)


def test_an_extent_beside_the_mesh_is_refused(tmp_path):
    path = write(tmp_path / "roof.ply", VERTICES, FACES[(VERTICES[FACES][:, :, 2] > 103).all(1)])
    with pytest.raises(DemError, match=r"none of 10 x 10 cells of 1 m has its centre on a face; check terrain\.extent"):
        read_mesh_terrain(path, 1.0, extent=(WEST, SOUTH, WEST + 10, SOUTH + 10))


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_vertices_beyond_the_earth_are_named(level, tmp_path, kind):
    for value, said in ((5e7, "elevation 50000000; remove what is there"), (1e300, "the first at (5.001e+05, 5e+06, 1e+300)")):
        vertices = VERTICES.copy()
        vertices[3, 2] = value
        found = refused(write(tmp_path / f"odd.{kind}", vertices, FACES), level)
        assert found.startswith("1 of 8 vertices lie beyond the Earth, the first at ")
        assert said in found


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (98, 2150, "reaches 2050 m above the ground, at easting 500100.0, northing 5000080.0, and may reach 2000 m"),
        (-9950, 108, "reaches 1.005e+04 m below the ground, at easting 500100.0, northing 5000080.0, and may reach 10000 m"),
    ],
)
def test_bodies_far_above_or_below_the_ground_are_named(level, tmp_path, low, high, said):
    vertices = np.column_stack([VERTICES[:, :2], np.where(VERTICES[:, 2] > 103, high, low)])
    assert refused(write(tmp_path / "odd.obj", vertices, FACES), level).startswith(f"body 'structure': {said}")
    inside = np.column_stack([VERTICES[:, :2], np.where(VERTICES[:, 2] > 103, 2050, 98)])
    assert len(read_bodies([StructureSource(write(tmp_path / "mast.obj", inside, FACES), units="m")], level).solids) == 1


def test_a_body_that_is_there_twice_is_named(level, tmp_path):
    one, other = (write(tmp_path / name, VERTICES, FACES) for name in ("one.obj", "other.ply"))
    with pytest.raises(StructureError) as caught:
        read_bodies([StructureSource(one, units="m"), StructureSource(other, units="m")], level)
    same = f"{other}: body 'structure': is the same body as {one}: body 'structure'; remove one of the two"
    assert caught.value.problems == [same]


def test_many_open_bodies_of_a_file_are_one_line(level, tmp_path):
    shifts = [np.array([0.0, 20.0 * k, 0.0]) for k in range(4)]
    vertices = np.concatenate([VERTICES + shift for shift in shifts])
    faces = np.concatenate([FACES[1:] + 8 * k for k in range(4)])
    said = refused(write(tmp_path / "odd.obj", vertices, faces), level)
    assert "the mesh is open at easting" in said
    assert said.endswith(" (and 3 more of its bodies have faults)")


@pytest.mark.parametrize(("count", "more"), [(1, ""), (2, " (and 1 more of its bodies have faults)")])
def test_one_body_with_a_fault_is_told_alone_and_a_second_one_is_counted(level, tmp_path, count, more):
    boxes = [box((100 + WEST, 40 + SOUTH + 30 * k, 103), (12, 8, 10)) for k in range(3)]
    faces = [np.asarray(one.faces)[int(k < count) :] + 8 * k for k, one in enumerate(boxes)]
    said = refused(write(tmp_path / "odd.obj", np.concatenate([one.vertices for one in boxes]), np.concatenate(faces)), level)
    assert said.startswith("body 'structure'")
    assert ("more of its bodies" in said) is (count > 1)
    assert said.endswith(more)


def crowded(count):
    """A closed body of needles that all cross the same place in plan, so that each edge has all faces in its box."""
    angle = np.linspace(0.0, np.pi, count, endpoint=False)
    way = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    side = np.column_stack([-np.sin(angle), np.cos(angle), np.zeros(count)]) * 1e-3
    height = np.column_stack([np.zeros((count, 2)), 4.0 * np.arange(count) / count])
    corners = np.stack([-9 * way + height, 9 * way + height, side + height, height + np.array([0, 0, 1e-4])], 1)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    return corners.reshape(-1, 3) + np.array([100, 80, 102]), (faces + 4 * np.arange(count)[:, None, None]).reshape(-1, 3)


def test_the_search_for_crossing_faces_ends_and_says_what_it_left_out(level, tmp_path, monkeypatch):
    vertices, faces = crowded(500)
    solid = Solid("a", vertices, faces, np.zeros(len(faces), int), ("surface",), 0.4, "a.ply: body 'a'")
    monkeypatch.setattr(meshes, "MOST_PAIRS", 5000)
    whole = Search(60.0)
    assert len(whole.crossings(solid, 0.0)) == len(crossings(solid))
    assert whole.left == []
    ended = Search(0.01)
    ended.crossings(solid, 0.0)
    assert [line.split(";")[0].split(" of its ")[1] for line in ended.left] == ["3000 edges"]
    monkeypatch.setattr(meshes, "SEARCH_SECONDS", 0.0)
    monkeypatch.setattr(meshes.Search.__init__, "__defaults__", (0.0,))
    read = read_bodies([StructureSource(write(tmp_path / "house.obj", VERTICES, FACES), units="m")], level)
    assert [change for change in read.changes if "crossing faces were searched at 0 of its 18 edges" in change]


def test_a_body_of_more_faces_than_are_searched_says_so(level, tmp_path, monkeypatch):
    monkeypatch.setattr(meshes, "MOST_FACES", 11)
    read = read_bodies([StructureSource(write(tmp_path / "house.obj", VERTICES, FACES), units="m")], level)
    assert [change for change in read.changes if "crossing faces were searched at 0 of its 18 edges" in change]


@pytest.mark.parametrize("units", ["m", "cm", "mm", "ft"])
def test_single_precision_rounds_coordinates_in_the_units_of_a_file(level, units):
    """2^-24 of 5e6 are 0.298; OBJ has text, whole numbers and more digits than single precision may be exact."""
    metres = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}[units]
    single = np.array([(5e6, 1.0, 0.5), (-2e6, 3.0, 4.0)])
    for name, vertices, expected in (
        ("a.stl", single, 5e6 * 2.0**-24 * metres),
        ("a.ply", single, 5e6 * 2.0**-24 * metres),
        ("a.PLY", np.round(single), 0.0),
        ("a.stl", np.round(single), 5e6 * 2.0**-24 * metres),
        ("a.glb", single + 1e-3, 0.0),
        ("a.obj", single, 0.0),
    ):
        assert rounding_of(StructureSource(name, units=units), vertices) == pytest.approx(expected), name
    assert rounding_of(StructureSource("a.stl"), -single) == pytest.approx(5e6 * 2.0**-24)


def test_a_mesh_lies_where_units_and_offset_place_it_and_a_word_says_whose_system_it_has(level):
    vertices = np.array([(1000.0, 2000.0, 101.0), (3000.0, 4000.0, 105.0)])
    source = StructureSource("a.obj", units="cm", offset=(WEST + 50.0, SOUTH + 60.0, 7.0))
    placed, said = on_terrain(vertices, source, level)
    np.testing.assert_allclose(placed, [(60.0, 80.0, 8.01), (80.0, 100.0, 8.05)])
    assert said == ["a.obj: states no crs; its coordinates are taken as the terrain's"]
    stated = StructureSource("a.obj", units="cm", crs="EPSG:32632", offset=(WEST + 50.0, SOUTH + 60.0, 7.0))
    again, said = on_terrain(vertices, stated, level)
    np.testing.assert_allclose(again, placed)
    assert said == []


ON = [(0, 0), (199, 0), (-12, 0), (0, -12), (0, 199)]
BESIDE = [(201, 0), (0, 201), (-14, 0), (0, -14)]


@pytest.mark.parametrize(("east", "north"), ON + BESIDE)
def test_a_mesh_is_on_the_terrain_if_its_box_meets_it(level, east, north):
    vertices = np.array([(WEST + east, SOUTH + north, 101.0), (WEST + east + 13, SOUTH + north + 13, 105.0)])
    source = StructureSource("a.obj", units="m")
    if (east, north) in ON:
        assert len(on_terrain(vertices, source, level)[0]) == 2
    else:
        with pytest.raises(
            StructureError, match=f"lies beyond the terrain array, at easting {WEST + east:.0f} to {WEST + east + 13:.0f}"
        ):
            on_terrain(vertices, source, level)


def test_a_large_hole_is_named_by_its_first_edge_and_small_ones_by_their_middle(level):
    for count, place in ((64, "easting 500100.00, northing 5000080.00, elevation 113.00 (64 edges)"), (65, "(65 edges)")):
        tower = trimesh.creation.cylinder(radius=5.0, height=20.0, sections=count)
        tower.apply_translation((100.0, 80.0, 103.0))
        faces = np.asarray(tower.faces)
        faces = faces[np.asarray(tower.vertices)[faces][:, :, 2].min(1) < 113.0]
        solid = Solid("a", np.asarray(tower.vertices), faces, np.zeros(len(faces), int), ("surface",), 0.4, "a")
        (said,) = meshes.mesh_faults(solid, level, 0.0, Search())
        assert said.startswith("a: the mesh is open at easting ")
        assert place in said
        x, y, z = (float(part.split()[1]) for part in said.split(" at ")[1].split(" (")[0].split(", "))
        middle = np.hypot(x - 500100.0, y - 5000080.0)
        assert middle == pytest.approx(0.0 if count == 64 else 5.0 * np.cos(np.pi / count), abs=0.01)
        assert z == 113.0


def test_a_small_body_turned_inside_out_is_turned_outwards(level, tmp_path):
    crate = box((CENTRE[0], CENTRE[1], 100.2), (0.6, 0.5, 0.4))  # 0.12 m3
    crate.invert()
    read = read_bodies([StructureSource(write(tmp_path / "crate.obj", crate.vertices, crate.faces), units="m")], level)
    (solid,) = read.solids
    assert volume(solid.vertices, solid.faces) == pytest.approx(0.12)
    assert [change for change in read.changes if change.endswith("its faces are turned outwards")]
    assert set(solid.facades) == {"east", "west", "north", "south", "top", "underside"}


def test_edges_cross_a_face_only_beyond_the_rounding_of_their_coordinates(level):
    """Edges of a box reach 0.2 m through the top of another one."""
    both = trimesh.util.concatenate([box((100, 80, 102), (8, 8, 4)), box((100.5, 80.3, 105.8), (2, 2, 4))])
    faces = np.asarray(both.faces)
    solid = Solid("a", np.asarray(both.vertices), faces, np.zeros(len(faces), int), ("surface",), 0.4, "a")
    assert len(crossings(solid)) > len(crossings(solid, 0.19)) > 0  # some run close to the diagonal of the top
    assert len(crossings(solid, 0.21)) == 0
