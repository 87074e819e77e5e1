from pathlib import Path

import geopandas as gpd
import numpy as np
import pyogrio
import pyproj
import pytest
from shapely import GeometryCollection, LineString, Polygon, box

from runout.io.vector import outline, write_outlines
from runout.model.release import Release
from runout.model.terrain import Terrain


@pytest.fixture
def release(terrain: Terrain) -> Release:
    """A rectangle of 4 x 5 cells of 3 m."""
    thickness = np.zeros(terrain.shape)
    thickness[2:6, 3:8] = 3.0
    return Release(thickness, terrain, name="scar")


def test_inundation_outlines_follow_the_cells_of_each_level(terrain: Terrain, release: Release, tmp_path: Path) -> None:
    probability = np.zeros(terrain.shape, np.float32)
    probability[10:30, 5:15] = 0.5
    probability[12:16, 6:10] = 0.95
    probability[20, 8] = 0.0  # a hole
    path = write_outlines(tmp_path / "o.gpkg", terrain, [release], probability, levels=(0.95, 0.5), attributes={"members_valid": 7})
    assert set(pyogrio.list_layers(path)[:, 0]) == {"release", "inundation"}
    frame = gpd.read_file(path, layer="inundation")
    assert frame["probability"].tolist() == [0.5, 0.95]
    assert (frame["members_valid"] == 7).all()
    np.testing.assert_allclose(frame.area, [199 * terrain.cell_area, 16 * terrain.cell_area])
    np.testing.assert_allclose(frame["area_m2"], frame.area)
    west, _, _, north = terrain.extent
    np.testing.assert_allclose(frame.total_bounds[[0, 3]], [west + 50.0, north - 125.0])
    assert len(frame.geometry[0].geoms[0].interiors) == 1
    assert frame.crs == (terrain.crs and pyproj.CRS(terrain.crs))


def test_the_release_layer_states_volume_and_placement(terrain: Terrain, release: Release, tmp_path: Path) -> None:
    west, south, _, _ = terrain.extent
    drawn = Release(release.thickness, terrain, outline=box(west + 3, south + 4, west + 50, south + 60), name="drawn")
    path = write_outlines(tmp_path / "o.gpkg", terrain, [release, drawn], np.zeros(terrain.shape))
    frame = gpd.read_file(path, layer="release").set_index("name")
    assert frame.loc["scar", "volume_m3"] == pytest.approx(20 * 3.0 * terrain.cell_area)
    assert frame.geometry["scar"].area == pytest.approx(20 * terrain.cell_area)
    assert frame.loc["scar", "mean_thickness_m"] == pytest.approx(3.0)
    assert frame.geometry["drawn"].equals(drawn.outline), "a drawn outline is kept, not redrawn from cells"
    assert frame.loc["drawn", "placement"] == "excavated"


def test_without_releases_there_is_no_layer_of_them(terrain: Terrain, tmp_path: Path) -> None:
    path = write_outlines(tmp_path / "o.gpkg", terrain, [], np.full(terrain.shape, 0.3), styles={"release": "<qgis/>"})
    assert set(pyogrio.list_layers(path)[:, 0]) - {"layer_styles"} == {"inundation"}


def test_levels_that_no_cell_reaches_are_left_out(terrain: Terrain, release: Release, tmp_path: Path) -> None:
    path = write_outlines(tmp_path / "o.gpkg", terrain, [release], np.full(terrain.shape, 0.3), levels=(0.25, 0.5))
    assert gpd.read_file(path, layer="inundation")["probability"].tolist() == [0.25]
    dry = write_outlines(tmp_path / "dry.gpkg", terrain, [release], np.zeros(terrain.shape))
    assert gpd.read_file(dry, layer="inundation").empty


def test_cells_that_touch_at_a_corner_make_valid_polygons(terrain: Terrain) -> None:
    mask = np.zeros(terrain.shape, bool)
    mask[3, 3] = mask[4, 4] = True
    polygons = outline(mask, terrain)
    assert polygons.is_valid
    assert len(polygons.geoms) == 2
    assert all(isinstance(polygon, Polygon) and polygon.area == pytest.approx(terrain.cell_area) for polygon in polygons.geoms)


def test_obstacles_are_polygons_with_their_height_and_without_what_only_touches_the_rim(
    terrain: Terrain, release: Release, tmp_path: Path
) -> None:
    west, south, _, _ = terrain.extent
    dam = box(west, south, west + 30, south + 20)
    with_line = GeometryCollection([dam, LineString([(west, south), (west, south + 50)])])
    path = write_outlines(tmp_path / "o.gpkg", terrain, [release], np.zeros(terrain.shape), obstacles=[(with_line, -2.5)])
    frame = gpd.read_file(path, layer="obstacles")
    assert frame["height_m"].tolist() == [-2.5]
    assert frame.geometry[0].equals(dam)
