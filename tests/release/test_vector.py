"""Releases of vector files that are as they should be."""

import logging
import math

import numpy as np
import pyogrio
import pytest
import shapely

from runout.model.release import Placement, Release
from runout.model.terrain import Terrain

TRIANGLE = shapely.Polygon([(31.3, 22.7), (131.3, 22.7), (72.9, 122.7)])  # 5000 m2
SQUARE = shapely.box(50.0, 50.0, 100.0, 100.0)


@pytest.mark.parametrize("name", ["release.gpkg", "release.shp", "release.fgb"])
def test_triangle_of_5000_m2_keeps_its_exact_volume_in_every_format(write_polygons, terrain, name):
    release = Release.from_vector(write_polygons([TRIANGLE], name), terrain, thickness=20.0, edge="vertical")
    assert release.volume == pytest.approx(100_000.0, rel=1e-9)  # the corner at 4 000 000 m costs digits in the file
    assert release.thickness.max() == pytest.approx(20.0, rel=1e-12)
    assert release.placement is Placement.EXCAVATED
    assert (release.name, release.changes) == ("release", ())


def test_thickness_lies_on_the_cells_below_the_polygon_north_up(write_polygons, terrain):
    release = Release.from_vector(write_polygons([shapely.box(10.0, 185.0, 22.5, 195.0)]), terrain, thickness=4.0, edge="vertical")
    expected = np.zeros(terrain.shape)
    expected[1:3, 2:4] = 4.0
    expected[1:3, 4] = 2.0
    np.testing.assert_allclose(release.thickness, expected, atol=1e-8)


def test_hole_is_respected(write_polygons, terrain):
    ring = SQUARE.difference(shapely.box(60.0, 60.0, 80.0, 80.0))
    release = Release.from_vector(write_polygons([ring]), terrain, thickness=1.0)
    assert release.volume == pytest.approx(2500.0 - 400.0, rel=1e-9)
    assert release.thickness[40 - 14, 14] == 0.0  # centre of the hole


def test_multipolygons_and_several_polygons_are_united(write_polygons, terrain):
    pair = shapely.MultiPolygon([shapely.box(0, 0, 10, 10), shapely.box(20, 0, 30, 10)])
    release = Release.from_vector(write_polygons([pair, shapely.box(200, 100, 210, 120)]), terrain, thickness=3.0)
    assert release.volume == pytest.approx(3.0 * 400.0, rel=1e-9)
    assert release.outline.area == pytest.approx(400.0, rel=1e-9)


def test_overlap_counts_once_and_is_reported(write_polygons, terrain, caplog):
    path = write_polygons([SQUARE, shapely.box(90.0, 50.0, 140.0, 100.0), SQUARE])
    with caplog.at_level(logging.WARNING):
        release = Release.from_vector(path, terrain, thickness=2.0)
    assert release.volume == pytest.approx(2.0 * 90.0 * 50.0, rel=1e-9)
    assert "polygons 1 and 2, 1 and 3, 2 and 3 overlap and have one thickness; the common 3000 m2 count once" in release.changes[0]
    assert release.changes[0] in caplog.text


def test_thickness_comes_from_an_attribute_of_each_polygon(write_polygons, terrain):
    neighbours = [SQUARE, shapely.box(100.0, 50.0, 113.0, 100.0)]
    release = Release.from_vector(write_polygons(neighbours, depth=[2.0, 10.0]), terrain, thickness="depth", edge="vertical")
    assert release.volume == pytest.approx(2.0 * 2500.0 + 10.0 * 650.0, rel=1e-9)
    np.testing.assert_allclose(release.thickness[25, [15, 20, 22]], [2.0, 10.0, 10.0 * 3.0 / 5.0], rtol=1e-8)


def test_volume_alone_gives_the_thickness(write_polygons, terrain):
    release = Release.from_vector(write_polygons([TRIANGLE]), terrain, volume=12_345.0, edge="vertical")
    assert release.volume == pytest.approx(12_345.0, rel=1e-14)
    assert release.thickness.max() == pytest.approx(12_345.0 / 5000.0, rel=1e-8)


def test_volume_within_one_percent_is_met_exactly_and_reported(write_polygons, terrain):
    release = Release.from_vector(write_polygons([TRIANGLE]), terrain, thickness=20.0, volume=100_500.0)
    assert release.volume == pytest.approx(100_500.0, rel=1e-14)
    assert "scaled by 1.005" in release.changes[0]


def test_file_without_crs_is_taken_in_the_terrains_and_reported(write_polygons, terrain):
    for name in ("release.shp", "release.gpkg"):
        release = Release.from_vector(write_polygons([SQUARE], name, crs=None), terrain, thickness=1.0)
        assert release.volume == pytest.approx(2500.0, rel=1e-9)
        assert "states no coordinate system; taken to be in the terrain's, EPSG:32616" in release.changes[0]


def test_geojson_in_degrees_is_reprojected_and_reported(write_polygons, terrain):
    release = Release.from_vector(write_polygons([SQUARE], "release.geojson", crs="EPSG:4326"), terrain, thickness=1.0)
    assert release.volume == pytest.approx(2500.0, rel=1e-3)  # seven decimals of a degree: 1 cm
    assert "reprojected from longitude and latitude" in release.changes[0]
    assert release.outline.centroid.x == pytest.approx(500_075.0, abs=0.02)


def test_geojson_in_metres_without_crs_is_taken_in_the_terrains(tmp_path, terrain):
    path = tmp_path / "release.geojson"
    square = shapely.transform(SQUARE, lambda c: c + np.array([500_000.0, 4_000_000.0]))
    path.write_text(f'{{"type": "Feature", "properties": {{}}, "geometry": {shapely.to_geojson(square)}}}')
    release = Release.from_vector(path, terrain, thickness=1.0)
    assert release.volume == pytest.approx(2500.0, rel=1e-9)
    assert "cannot be in degrees" in release.changes[0]


def test_geojson_on_a_local_terrain_is_in_its_coordinates(tmp_path, terrain):
    path = tmp_path / "release.geojson"
    path.write_text(shapely.to_geojson(SQUARE))
    local = Terrain(terrain.elevation, terrain.cell_size)
    assert Release.from_vector(path, local, thickness=1.0).volume == pytest.approx(2500.0, rel=1e-12)


def test_same_system_written_differently_is_the_same(write_polygons, terrain):
    import pyproj

    old_style = pyproj.CRS(32616).to_wkt("WKT1_ESRI")
    esri = Terrain(terrain.elevation, terrain.cell_size, terrain.west, terrain.south, old_style)
    compound = Terrain(terrain.elevation, terrain.cell_size, terrain.west, terrain.south, pyproj.CRS("EPSG:32616+5703").to_wkt())
    for other in (esri, compound):
        assert Release.from_vector(write_polygons([SQUARE]), other, thickness=1.0).changes == ()


def test_layer_is_chosen_by_name(write_polygons, terrain):
    path = write_polygons([SQUARE])
    pyogrio.write_dataframe(pyogrio.read_dataframe(write_polygons([TRIANGLE], "other.gpkg")), path, layer="triangle")
    assert Release.from_vector(path, terrain, thickness=1.0, layer="triangle").volume == pytest.approx(5000.0, rel=1e-9)


def test_basal_friction_angle_of_an_attribute_is_read_in_degrees(write_polygons, terrain):
    path = write_polygons([SQUARE], friction=[18.0])
    release = Release.from_vector(path, terrain, thickness=1.0, basal_friction_angle_deg="friction", placement="on_surface")
    assert release.basal_friction_angle == pytest.approx(math.radians(18.0))
    assert release.placement is Placement.ON_SURFACE


def test_polygon_may_touch_the_edge_of_the_terrain(write_polygons, terrain):
    whole = shapely.box(0.0, 0.0, 300.0, 200.0)
    release = Release.from_vector(write_polygons([whole]), terrain, thickness=1.0, edge="vertical")
    np.testing.assert_allclose(release.thickness, 1.0, rtol=1e-12)
