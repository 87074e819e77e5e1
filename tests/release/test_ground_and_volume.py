"""Releases on unknown ground, beyond the terrain, with a stated volume, and lines out of a scar."""

import json

import numpy as np
import pytest
import shapely

from runout.config.extent import polygon_bounds, thickness_bounds
from runout.errors import ReleaseError
from runout.model.release import Release
from runout.model.terrain import Terrain
from runout.release import taper
from runout.release.arrangement import particles_for
from runout.release.ground import require_elevation, require_inside
from runout.release.read import matched


@pytest.mark.parametrize(("unknown", "more"), [(1, None), (3, None), (4, " and 1 more"), (9, " and 6 more")])
def test_unknown_cells_below_a_release_are_counted_and_three_are_named(unknown, more):
    z = np.zeros((5, 10))
    z[2, :unknown] = np.nan
    terrain = Terrain(z, (5.0, 4.0), 1000.0, 2000.0, None, "dem.tif")
    thickness = np.zeros((5, 10))
    thickness[2] = 1.0
    with pytest.raises(ReleaseError, match=rf"{unknown} of 10 cells under the release r.gpkg have no elevation") as refused:
        require_elevation(thickness, terrain, "r.gpkg")
    said = str(refused.value)
    assert said.count("row 2") == min(unknown, 3)
    assert "row 2, column 0 (easting 1002.50, northing 2010.00)" in said
    assert (" more" in said) == (more is not None)
    assert (more or "") in said
    require_elevation(np.where(np.isnan(z), 0.0, thickness), terrain, "r.gpkg")


def test_a_release_beyond_the_terrain_is_told_by_how_much_and_where():
    terrain = Terrain(np.zeros((5, 10)), (5.0, 4.0), 1000.0, 2000.0, None, "dem.tif")
    require_inside(shapely.box(1000.0, 2000.0, 1050.0, 2020.0), terrain, "r.gpkg")
    with pytest.raises(ReleaseError, match=r"10 m beyond the east edge, 5 m beyond the north edge of .*\(69.2% of its area"):
        require_inside(shapely.box(1040.0, 2012.0, 1060.0, 2025.0), terrain, "r.gpkg")
    with pytest.raises(ReleaseError, match="3 m beyond the west edge, 2 m beyond the south edge of"):
        require_inside(shapely.box(997.0, 1998.0, 1010.0, 2010.0), terrain, "r.gpkg")
    with pytest.raises(ReleaseError, match=r"lies outside the terrain dem\.tif"):
        require_inside(shapely.box(1060.0, 2000.0, 1070.0, 2010.0), terrain, "r.gpkg")


@pytest.mark.parametrize(
    ("stated", "sentences"), [(100.0, 0), (100.0 + 9e-5, 0), (100.0 + 1.5e-4, 1), (100.9, 1), (99.2, 1), (None, 0)]
)
def test_a_stated_volume_within_one_percent_is_met_and_said(stated, sentences):
    thickness = np.array([[1.0, 3.0]])
    found, said = matched(thickness, 25.0, stated, "r.tif")
    assert found.sum() * 25.0 == pytest.approx(100.0 if stated is None else stated, rel=1e-12)
    assert found[0, 1] == pytest.approx(3.0 * found[0, 0])
    assert len(said) == sentences


@pytest.mark.parametrize("stated", [98.9, 101.2])
def test_a_stated_volume_that_differs_by_more_is_refused(stated):
    with pytest.raises(ReleaseError, match=r"area and thickness give 100 m3, the stated volume is .* m3 \([+-]1\.[12]%\)"):
        matched(np.array([[1.0, 3.0]]), 25.0, stated, "r.tif")
    with pytest.raises(ReleaseError, match="the thickness is 0 everywhere"):
        matched(np.zeros((1, 2)), 25.0, stated, "r.tif")


def test_thick_masses_on_ground_of_less_than_half_their_friction_have_level_particles():
    assert particles_for(4.5, 0.19, 0.4) == (3, 3, 1)
    assert particles_for(4.49, 0.19, 0.4) == particles_for(4.5, 0.2, 0.4) == (2, 2, 4)


def test_lines_from_the_rim_rise_with_the_way_from_the_nearest_outlet():
    """Level ground of 100 m with an outlet of 90 m in the middle of the south side; cells of 3 m by 4 m."""
    ground, inside = np.full((5, 7), 100.0), np.zeros((5, 7), bool)
    inside[1:4, 1:6] = True
    ground[4, 3] = 90.0
    line = taper.rising_from_rim(ground, inside, (3.0, 4.0), 0.5)
    assert line[3, 3] == pytest.approx(90.0 + 0.5 * 4.0)
    assert line[2, 3] == pytest.approx(90.0 + 0.5 * 8.0)
    assert line[3, 4] == line[3, 2] == pytest.approx(90.0 + 0.5 * 5.0)
    assert line[2, 5] == line[2, 1] == pytest.approx(90.0 + 0.5 * 10.0)
    np.testing.assert_array_equal(line[~inside], ground[~inside])
    steep = taper.rising_from_rim(ground, inside, (3.0, 4.0), 50.0)
    assert steep[1, 1] == pytest.approx(100.0 + 50.0 * 3.0)


def test_blocks_are_means_and_what_is_left_over_is_repeated():
    values = np.arange(15.0).reshape(3, 5)
    np.testing.assert_array_equal(taper._blocks(values, 1), values)
    np.testing.assert_allclose(taper._blocks(values, 2), [[3.0, 5.0, 6.5], [10.5, 12.5, 14.0]])


def test_all_of_a_mass_in_a_pit_is_trapped_and_none_on_top_of_the_ground():
    terrain = Terrain(np.full((20, 30), 50.0), (5.0, 4.0))
    thickness = np.zeros((20, 30))
    thickness[8:12, 10:20] = 3.0
    assert taper.trapped_share(Release(thickness, terrain), 0.0) == pytest.approx(1.0)
    assert taper.trapped_share(Release(thickness, terrain, placement="on_surface"), 0.0) == pytest.approx(0.0, abs=1e-6)


def test_bounds_of_polygons_are_their_edges_and_system(write_polygons):
    place = polygon_bounds(write_polygons([shapely.box(10.0, 20.0, 30.0, 45.0), shapely.box(50.0, 5.0, 61.0, 9.0)]), None, None)
    assert place.edges == pytest.approx((500_010.0, 4_000_005.0, 500_061.0, 4_000_045.0))
    assert place.crs.to_epsg() == 32616


@pytest.mark.parametrize(("east", "north", "degrees"), [(170.0, 80.0, True), (190.0, 80.0, False), (170.0, 95.0, False)])
def test_geojson_beyond_the_globe_is_in_the_system_of_the_elevations(tmp_path, east, north, degrees):
    path = tmp_path / "release.geojson"
    ring = shapely.box(east - 1.0, north - 1.0, east, north)
    feature = {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(ring)}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    place = polygon_bounds(path, None, "that of the elevations")
    assert place.edges == pytest.approx((east - 1.0, north - 1.0, east, north))
    assert (place.crs == "that of the elevations") is not degrees


def test_bounds_of_a_thickness_raster_are_those_of_its_cells_that_hold_some(write_raster):
    values = np.zeros((6, 8))
    values[1:3, 2:7] = -2.0
    place = thickness_bounds(write_raster(values), "state an extent")
    assert place.edges == pytest.approx((500_010.0, 4_000_015.0, 500_035.0, 4_000_025.0))
    unknown = np.where(values == 0.0, -9999.0, values)
    assert thickness_bounds(write_raster(unknown, nodata=-9999.0), "state an extent").edges == pytest.approx(place.edges)
    with pytest.raises(ReleaseError, match="the release is empty"):
        thickness_bounds(write_raster(np.zeros((3, 4))), "state an extent")
