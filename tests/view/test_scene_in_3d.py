"""What a picture in three dimensions shows."""

from dataclasses import replace

import numpy as np
import pytest

from runout import Release, Terrain
from runout.view import surfaces
from runout.view.film import ground_scene, window_around
from runout.view.scene import FlowScene


def test_a_scene_is_the_same_after_a_file(crowded, tmp_path):
    crowded.save(tmp_path / "scene.npz")
    read = FlowScene.load(tmp_path / "scene.npz")
    for name in ("easting", "northing", "ground", "times", "thickness", "speed", "particles"):
        assert np.array_equal(getattr(read, name), getattr(crowded, name), equal_nan=True), name
    assert (read.title, read.least_thickness, read.crs, read.image) == ("ramp", 0.1, None, None)
    assert np.array_equal(read.outlines[0], crowded.outlines[0])
    assert np.array_equal(read.meshes["dam"][1], crowded.meshes["dam"][1])


def test_chosen_frames_keep_the_first_and_the_last(crowded):
    assert list(crowded.frames(2).times) == [0.0, 7.0]
    assert crowded.frames(2).particles.shape == (2, 5, 4)
    assert crowded.frames(50) is crowded
    assert list(crowded.frames(1).times) == [0.0]


def test_a_coarser_scene_has_the_volume_and_the_place(scene):
    coarse = scene.coarsened(300)
    assert coarse.ground.shape == (12, 20)
    assert coarse.thickness.sum() * np.prod(coarse.cell_size) == pytest.approx(scene.thickness.sum() * np.prod(scene.cell_size))
    assert coarse.easting[0] == pytest.approx(scene.easting[:2].mean())
    assert scene.coarsened(10**6) is scene


def test_a_finer_scene_has_the_values_of_the_cells_and_the_area_of_the_flow(scene):
    fine = scene.refined(20_000)
    step = (fine.ground.shape[0] - 1) // (scene.ground.shape[0] - 1)
    assert step == 5
    assert fine.ground[::step, ::step] == pytest.approx(scene.ground, abs=1e-9)
    inside = (slice(None), slice(10, 14), slice(None))
    wet = scene.thickness[inside] > 0
    assert fine.thickness[:, ::step, ::step][inside][wet] == pytest.approx(5.0, abs=1e-4)
    area = (fine.thickness > 0).sum() * np.prod(fine.cell_size)
    assert area == pytest.approx((scene.thickness > 0).sum() * np.prod(scene.cell_size), rel=0.08)
    assert fine.extent == pytest.approx(scene.extent)


def test_a_single_covered_cell_stays_visible_on_the_finer_grid(scene):
    lonely = np.zeros_like(scene.thickness)
    lonely[1, 10, 20] = 2.0
    fine = replace(scene, thickness=lonely).refined(20_000)
    assert fine.thickness[1].max() == pytest.approx(2.0)
    assert not fine.thickness[0].any()


def test_the_free_surface_is_the_ground_plus_the_thickness(scene):
    wet = scene.thickness[1] > 0
    rise = surfaces.flow_points(scene, 1)[..., 2] - scene.points()[..., 2]
    assert rise[wet] == pytest.approx(5.0)
    assert not rise[~wet].any()
    faces = surfaces.flow_faces(scene, 1)
    assert faces.sum() == 7 * 7  # 6 x 6 cells and their rim
    corners = surfaces.quads(faces)
    assert corners.shape == (49, 4)
    x = scene.points().reshape(-1, 3)[corners]
    normals = np.cross(x[:, 1] - x[:, 0], x[:, 3] - x[:, 0])
    assert (normals[:, 2] > 0).all()


def test_cells_without_an_elevation_have_no_face(scene):
    ground = scene.ground.copy()
    ground[10, 15] = np.nan
    hole = replace(scene, ground=ground)
    assert surfaces.known_faces(hole).sum() == surfaces.known_faces(scene).sum() - 4
    assert np.isfinite(hole.points()).all()
    assert np.isfinite(hole.refined(5000).points()).all()


def test_the_scale_has_round_labels_and_a_unit(scene):
    scale = surfaces.scale_of(scene, "thickness")
    assert (scale.label, scale.top, scale.labels) == ("vertical thickness [m]", 5.0, 6)
    assert surfaces.scale_of(scene, "speed").label == "speed [m/s]"
    assert surfaces.scale_of(replace(scene, thickness=0 * scene.thickness), "speed").top == 1.0


def test_particles_have_their_speed_or_the_thickness_above_them(crowded):
    points, speed = surfaces.particle_values(crowded, 0, "speed")
    assert (points.shape, list(speed)) == ((5, 3), [0.0] * 5)
    assert list(surfaces.particle_values(crowded, 0, "thickness")[1]) == [5.0] * 5
    assert len(surfaces.particle_values(crowded, 2, "speed")[0]) == 4  # one has left
    assert points[0] == pytest.approx([60.0, 120.0, 80.0])


def test_an_outline_lies_on_the_surface(scene):
    line = scene.draped(scene.outlines[0], scene.points()[..., 2])
    expected = np.interp(line[:, 0], scene.easting - scene.origin[0], scene.ground[0])
    assert line[:, 2] == pytest.approx(expected, abs=1e-9)
    assert len(line) > 40


def test_the_ground_below_an_excavated_release_is_its_sliding_surface():
    terrain = Terrain.from_array(np.full((30, 40), 100.0), 10.0, origin=(1000.0, 2000.0))
    thickness = np.zeros((30, 40))
    thickness[10:14, 5:9] = 7.0
    release = Release.from_array(thickness, terrain)
    window = window_around(terrain, [release], np.zeros((30, 40), bool))
    made = ground_scene(terrain, [release], window, title="", least_thickness=0.1, meshes=None)
    assert (100.0 - made.ground).sum() == pytest.approx(7.0 * 16)
    assert made.easting[0] == terrain.easting[window[1]][0]
    assert made.outlines[0][:, 0].min() == pytest.approx(1050.0)
