"""Files for ParaView, read back with its collections."""

from dataclasses import replace

import numpy as np
import pytest
from ramp_scene import ramp_scene

from runout.view import process

pv = pytest.importorskip("pyvista", reason="pyvista is not installed (extra view)")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    scene = ramp_scene()
    particles = np.broadcast_to([scene.easting[6], scene.northing[11], 80.0, 4.0], (3, 2, 4))
    made = tmp_path_factory.mktemp("files")
    process.make("files", replace(scene, particles=particles), {}, made)
    return made / "made"


def test_the_collection_has_the_times_and_the_surfaces(folder, scene):
    reader = pv.get_reader(folder / "flow.pvd")
    assert reader.time_values == [0.0, 2.5, 7.0]
    for frame, time in enumerate(reader.time_values):
        reader.set_active_time_value(time)
        grid = reader.read()[0]
        assert grid["thickness"].sum() == pytest.approx(scene.thickness[frame].sum())
        thickest = grid.points[np.argmax(grid["thickness"])]
        wet = grid.points[grid["thickness"] > 0]
        columns = np.nonzero(scene.thickness[frame])[1]
        assert wet[:, 0].mean() == pytest.approx(10.0 * columns.mean())
        ground = np.interp(thickest[0], scene.easting - scene.origin[0], scene.ground[0])
        assert thickest[2] == pytest.approx(ground + 5.0, abs=1e-3)
        assert (grid["vtkGhostType"] > 0).sum() == (scene.thickness[frame] == 0).sum()
        assert list(grid.field_data["map_origin"]) == list(scene.origin)


def test_maps_lie_flat_with_a_value_for_each_cell(folder, scene):
    reader = pv.get_reader(folder / "maps.pvd")
    assert reader.time_values == [0.0, 2.5, 7.0]
    reader.set_active_time_value(2.5)
    raster = reader.read()[0]
    assert raster.bounds == pytest.approx((-5, 395, -5, 235, 0, 0))
    for name, values in (("thickness", scene.thickness[1]), ("speed", scene.speed[1]), ("elevation", scene.ground)):
        np.testing.assert_allclose(raster[name].reshape(values.shape)[::-1], np.nan_to_num(values), err_msg=name)
    volume = raster.compute_cell_sizes()["Area"] @ raster["thickness"]
    assert volume == pytest.approx(100.0 * scene.thickness[1].sum())


def test_particles_have_a_collection_of_their_own(folder):
    reader = pv.get_reader(folder / "particles.pvd")
    assert reader.time_values == [0.0, 2.5, 7.0]
    cloud = reader.read()[0]
    assert cloud.n_points == 2
    assert list(cloud["speed"]) == [4.0, 4.0]


def test_the_terrain_is_where_it_was(folder, scene):
    terrain = pv.read(folder / "terrain.vts")
    assert terrain.bounds == pytest.approx((0, 390, 0, 230, 0, scene.ground.max()), abs=1e-3)
    assert terrain["elevation"] == pytest.approx(terrain.points[:, 2], abs=1e-3)
