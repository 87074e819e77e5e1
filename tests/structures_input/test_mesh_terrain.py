"""A surface mesh as terrain: heights at the cells; what overhangs becomes a body, other sheets are refused with their place."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from structure_bodies import SOUTH, WEST

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import SITE, write_site

import runout
from runout.config.site import read_site
from runout.errors import ConfigError, DemError, StructureError
from runout.model.structures import Structures
from runout.model.terrain import Terrain
from runout.slopes.place import read_place
from runout.structures.read import overhang_bodies
from runout.terrain.mesh import overhangs_on, read_mesh_terrain


def sheet(points, width=120.0, parts=24):
    """A surface whose section is a line of points (x, z), in map coordinates."""
    x, z = np.asarray(points, float).T
    y = np.linspace(0, width, parts + 1)
    grid = np.stack(np.broadcast_arrays(WEST + x[:, None], SOUTH + y, z[:, None]), axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(len(x) - 1), np.arange(parts), indexing="ij")
    a = (i * (parts + 1) + j).ravel()
    b = a + parts + 1
    return trimesh.Trimesh(grid, np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)]), process=False)


SLOPE = [(0, 100), (200, 60)]
# a roof 12 to 16 m thick over 50 m of ground
CAVE = [(0, 130), (80, 130), (110, 128), (110, 116), (60, 114), (60, 100), (200, 100)]


@pytest.mark.parametrize("kind", ["obj", "ply", "stl"])
def test_a_slope_has_its_heights(tmp_path, kind):
    mesh = sheet(SLOPE)
    if kind == "stl":  # single precision: near the origin
        mesh.apply_translation([-WEST, -SOUTH, 0])
    mesh.export(tmp_path / f"slope.{kind}")
    terrain, above = read_mesh_terrain(tmp_path / f"slope.{kind}", 4.0, "EPSG:32632")
    assert terrain.shape == (30, 50)
    assert terrain.elevation == pytest.approx(np.tile(100 - 0.2 * (np.arange(50) + 0.5) * 4, (30, 1)), abs=1e-4)
    assert terrain.extent[0] == pytest.approx(0.0 if kind == "stl" else WEST)
    assert len(above.row) == 0


@pytest.mark.parametrize(("east", "north"), [(8.0, 100.0), (100.0, 8.0)])
def test_a_part_of_less_than_three_cells_along_either_side_is_refused(tmp_path, east, north):
    sheet(SLOPE).export(tmp_path / "slope.ply")
    with pytest.raises(DemError, match=rf"terrain\.extent spans {east:g} x {north:g} m, .* cells of 4 m; give a mesh"):
        read_mesh_terrain(tmp_path / "slope.ply", 4.0, "EPSG:32632", (WEST, SOUTH, WEST + east, SOUTH + north))


def test_a_surface_that_faces_down_is_turned(tmp_path):
    mesh = sheet(SLOPE)
    mesh.invert()
    mesh.export(tmp_path / "slope.ply")
    terrain, _ = read_mesh_terrain(tmp_path / "slope.ply", 4.0)
    assert any("turned upwards" in change for change in terrain.changes)


def test_rock_over_a_cave_becomes_a_body_over_the_ground(tmp_path):
    sheet(CAVE).export(tmp_path / "cave.obj")
    terrain, above = read_mesh_terrain(tmp_path / "cave.obj", 5.0, "EPSG:32632")
    under = terrain.elevation[:, 12:22]
    assert under == pytest.approx(100)
    assert terrain.elevation[:, :12] == pytest.approx(130)
    assert len(above.row) == 24 * 10
    (rock,) = overhang_bodies(above, terrain, 0.4)
    assert rock.box[:, :2] == pytest.approx(np.array([[60, 0], [110, 120]]))
    assert rock.box[1, 2] == pytest.approx(130, abs=0.2)
    assert 113.9 < rock.box[0, 2] < 114.5
    assert set(rock.facades) == {"top", "underside", "east", "west", "north", "south"}


def test_a_second_sheet_is_refused_with_its_place(tmp_path):
    both = trimesh.util.concatenate([sheet(SLOPE), sheet([(60, 130), (90, 130)])])
    both.export(tmp_path / "two.ply")
    with pytest.raises(DemError, match=r"at easting 50006\d.\d, northing 5000002.5, elevation 130.0 sheets of the mesh lie"):
        read_mesh_terrain(tmp_path / "two.ply", 5.0)


def test_a_mesh_without_resolution_is_refused(tmp_path):
    sheet(SLOPE).export(tmp_path / "slope.ply")
    with pytest.raises(DemError, match=r"state terrain.resolution"):
        read_mesh_terrain(tmp_path / "slope.ply", None)


def test_a_mesh_in_degrees_is_refused(tmp_path):
    sheet(SLOPE).export(tmp_path / "slope.ply")
    with pytest.raises(DemError, match=r"its crs WGS 84 has degrees, a mesh has metres; export it in a projected system"):
        read_mesh_terrain(tmp_path / "slope.ply", 5.0, "EPSG:4326")


def test_a_site_on_a_mesh_without_resolution_is_refused_with_its_line(tmp_path):
    site = write_site(tmp_path / "cave", SITE.replace("inputs/dem.tif", "inputs/cave.obj"))
    sheet(CAVE).export(site / "inputs" / "cave.obj")
    with pytest.raises(ConfigError, match=r"site.yaml:3: terrain.resolution: required key is missing for a mesh; add resolution"):
        read_site(site)


def test_a_site_on_a_mesh_gets_its_overhang_as_a_structure(tmp_path):
    text = SITE.replace("inputs/dem.tif", "inputs/cave.obj\n  resolution: 5\n  crs: EPSG:32632")
    text = text.replace("cell_size: 10", "cell_size: 5")
    text = text.replace("    raster: inputs/thickness.tif\n", "    polygons: inputs/release.geojson\n    thickness: 3\n")
    site = write_site(tmp_path / "cave", text)
    sheet(CAVE).export(site / "inputs" / "cave.obj")
    corners = [[WEST + x, SOUTH + y] for x, y in ((10, 40), (30, 40), (30, 80), (10, 80), (10, 40))]
    (site / "inputs" / "release.geojson").write_text(
        '{"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}, "features": '
        f'[{{"type": "Feature", "properties": {{}}, "geometry": {{"type": "Polygon", "coordinates": [{corners}]}}}}]}}'
    )
    made = read_site(site).member_arguments({})["structures"]
    assert made.names == ("overhang",)
    assert "underside" in made.facades
    assert np.isnan(made.field.patches.friction).all()  # that of the ground
    (site / "site.yaml").write_text(text.replace("resolution: 5\n", "resolution: 5\n  overhang_friction_angle_deg: 35\n"))
    stated = read_site(site).member_arguments({})["structures"]
    np.testing.assert_allclose(stated.field.patches.friction, np.tan(np.radians(35)))


def test_python_makes_the_same_of_files_as_site_yaml(tmp_path):
    text = SITE.replace("inputs/dem.tif", "inputs/cave.obj\n  resolution: 5\n  crs: EPSG:32632\n  extent: EXTENT")
    extent = (WEST + 20.0, SOUTH, WEST + 180.0, SOUTH + 110.0)
    text = text.replace("EXTENT", str(list(extent))).replace("cell_size: 10", "cell_size: 5")
    text = text.replace("terrain:\n", "terrain:\n  overhang_friction_angle_deg: 35\n")
    site = write_site(tmp_path / "cave", text + "structures:\n  - {file: inputs/hut.obj, units: m, name: hut}\n")
    sheet(CAVE).export(site / "inputs" / "cave.obj")
    hut = trimesh.creation.box((20.0, 20.0, 30.0))
    hut.apply_translation((WEST + 150.0, SOUTH + 60.0, 105.0))
    hut.export(site / "inputs" / "hut.obj")
    read = read_site(site)
    stated = read.terrain()
    terrain = runout.Terrain.from_mesh(site / "inputs" / "cave.obj", cell_size=5.0, crs="EPSG:32632", extent=extent)
    assert (terrain.extent, terrain.crs, terrain.changes) == (stated.extent, stated.crs, stated.changes)
    np.testing.assert_array_equal(terrain.elevation, stated.elevation)
    ours = runout.Structures.from_sources(
        [runout.StructureSource(site / "inputs" / "hut.obj", units="m", name="hut")], terrain, 5.0,
        overhangs=site / "inputs" / "cave.obj", overhang_friction_angle_deg=35.0,
    )  # fmt: skip
    theirs = read.files.structures((5.0, 5.0, 5.0))
    assert ours.names == theirs.names == ("hut", "overhang")
    np.testing.assert_array_equal(ours.field.distance, theirs.field.distance)
    np.testing.assert_array_equal(ours.field.patches.friction, theirs.field.patches.friction)
    alone = runout.Structures.from_overhangs(site / "inputs" / "cave.obj", terrain, 5.0, friction_angle_deg=35.0)
    assert alone.names == ("overhang",)


def test_overhangs_keep_their_place_in_a_part_of_the_terrain(tmp_path):
    sheet(CAVE).export(tmp_path / "cave.ply")
    terrain = Terrain.from_mesh(tmp_path / "cave.ply", 5.0)
    part = terrain.part(slice(3, 20), slice(8, 30))
    whole, cut = overhangs_on(tmp_path / "cave.ply", terrain), overhangs_on(tmp_path / "cave.ply", part)
    assert set(zip(cut.row + 3, cut.column + 8, strict=True)) == {
        (row, column) for row, column in zip(whole.row, whole.column, strict=True) if 3 <= row < 20 and 8 <= column < 30
    }


def test_a_terrain_of_other_cells_has_no_overhangs_of_a_mesh(tmp_path):
    sheet(CAVE).export(tmp_path / "cave.ply")
    other = Terrain.from_array(np.zeros((20, 20)), 5.0, origin=(WEST + 1.0, SOUTH))
    with pytest.raises(DemError, match=r"the cells of array are not those of a mesh; make it with Terrain\.from_mesh"):
        Structures.from_overhangs(tmp_path / "cave.ply", other, 5.0)
    sheet(SLOPE).export(tmp_path / "slope.ply")
    level = Terrain.from_mesh(tmp_path / "slope.ply", 5.0)
    with pytest.raises(StructureError, match=r"slope\.ply: holds no structure; leave structures out of the run"):
        Structures.from_overhangs(tmp_path / "slope.ply", level, 5.0)


@pytest.mark.parametrize(("argument", "said"), [("cell_size", "resolution"), ("extent", "extent is")])
def test_arguments_of_a_terrain_of_a_mesh_are_checked(tmp_path, argument, said):
    sheet(SLOPE).export(tmp_path / "slope.ply")
    with pytest.raises(DemError, match=said):
        Terrain.from_mesh(tmp_path / "slope.ply", **{"cell_size": 5.0, argument: "five"})


def test_averaged_is_what_resolution_of_site_yaml_does(tmp_path):
    site = write_site(tmp_path / "flat", SITE.replace("inputs/dem.tif", "inputs/dem.tif\n  resolution: 20"))
    stated = read_site(site).terrain()
    ours = Terrain.from_raster(site / "inputs" / "dem.tif").averaged(20.0)
    assert ours.extent == stated.extent
    np.testing.assert_array_equal(ours.elevation, stated.elevation)
    with pytest.raises(ConfigError, match=r"dem.tif: resolution: 1 m is finer than the raster's own cells"):
        Terrain.from_raster(site / "inputs" / "dem.tif").averaged(1.0)


def test_friction_of_overhangs_has_no_meaning_with_a_raster(tmp_path):
    site = write_site(tmp_path / "flat", SITE.replace("inputs/dem.tif", "inputs/dem.tif\n  overhang_friction_angle_deg: 35"))
    with pytest.raises(ConfigError, match=r"site.yaml:5: terrain.overhang_friction_angle_deg: has no meaning with a raster"):
        read_site(site)


@pytest.mark.parametrize("name", ["cliff.obj", "cliff.glb", "cliff.dae"])
def test_a_mesh_in_place_of_a_raster_says_where_meshes_are_given(tmp_path, name):
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(DemError, match="is a mesh, not a raster; give a mesh as OBJ, PLY or STL in site"):
        Terrain.from_raster(tmp_path / name)
    with pytest.raises(DemError, match="is a mesh, not a raster"):
        read_place(tmp_path / name, None)
