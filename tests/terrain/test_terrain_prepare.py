"""Units, unknown cells, coordinate systems, reach."""

import numpy as np
import pytest
from pyproj import CRS, Geod, Transformer

from runout import DemError, Terrain
from runout.errors import InputError
from runout.io.elevation_raster import ElevationRaster
from runout.terrain import prepare

ARC_SECOND = 1 / 3600


@pytest.mark.parametrize("number", [-9999.0, -32768.0, -3.4028234663852886e38, 1e20, np.nan])
@pytest.mark.parametrize("declared", [True, False])
def test_unknown_cells_are_found_in_every_disguise(geotiff, slope, number, declared):
    z = slope.astype(np.float32)
    z[3, 4] = number
    terrain = Terrain.from_raster(geotiff(z, nodata=number if declared else None))
    assert np.argwhere(np.isnan(terrain.elevation)).tolist() == [[3, 4]]
    if declared or np.isnan(number):
        assert terrain.changes == ()
    else:
        assert "1 cells hold" in terrain.changes[0]
        assert f"{np.float32(number):g}" in terrain.changes[0]


def test_cells_outside_a_mask_are_unknown(geotiff, slope):
    mask = np.full(slope.shape, 255, np.uint8)
    mask[1, 2] = 0
    terrain = Terrain.from_raster(geotiff(slope, mask=mask))
    assert np.argwhere(np.isnan(terrain.elevation)).tolist() == [[1, 2]]


def test_raster_without_any_elevation_is_refused(geotiff, slope):
    with pytest.raises(DemError, match="none of the 48 cells has an elevation"):
        Terrain.from_raster(geotiff(np.full_like(slope, -9999.0), nodata=-9999.0))


def test_absurd_elevations_are_refused_with_their_place(geotiff, slope):
    slope[4, 5] = 12345.0
    message = r"1 elevations outside -500 to 9000 m, the first 12345 at row 4, column 5; .*-a_nodata 12345"
    with pytest.raises(DemError, match=message):
        Terrain.from_raster(geotiff(slope))


@pytest.mark.parametrize(("unit", "metres"), [("ft", 0.3048), ("US survey foot", 1200 / 3937), ("cm", 0.01), ("metre", 1.0)])
def test_elevations_in_other_units_become_metres(geotiff, slope, unit, metres):
    terrain = Terrain.from_raster(geotiff(slope / metres, unit=unit))
    np.testing.assert_allclose(terrain.elevation, slope, rtol=1e-14)
    assert len(terrain.changes) == (metres != 1.0)
    assert all(unit in sentence for sentence in terrain.changes)


def test_millimetres_are_read_with_their_unit_and_asked_about_without_it(geotiff, slope):
    stored = (slope * 1000).astype(np.int32)
    with pytest.raises(DemError, match=r"all 48 numbers of its cells are 1454000 to 1999000, .*gdal_edit\.py -units mm"):
        Terrain.from_raster(geotiff(stored))
    stored[2, 3] = -9999
    terrain = Terrain.from_raster(geotiff(stored, unit="mm"))
    slope[2, 3] = np.nan
    np.testing.assert_allclose(terrain.elevation, slope)


def test_elevations_in_an_unknown_unit_are_refused(geotiff, slope):
    with pytest.raises(DemError, match="elevations are in 'fathom'"):
        Terrain.from_raster(geotiff(slope, unit="fathom"))


def test_vertical_system_in_feet_is_converted_and_left_out_of_the_map(geotiff, slope):
    terrain = Terrain.from_raster(geotiff(slope / 0.3048006096012192, crs="EPSG:32616+6360"))
    np.testing.assert_allclose(terrain.elevation, slope, rtol=1e-12)
    assert CRS(terrain.crs).to_epsg() == 32616


def test_system_that_the_file_lacks_is_taken_from_the_caller(geotiff, slope):
    terrain = Terrain.from_raster(geotiff(slope, crs=None), crs="EPSG:32633")
    assert CRS(terrain.crs).to_epsg() == 32633
    assert "UTM zone 33N as given" in terrain.changes[0]
    with pytest.raises(DemError, match=r"the file states WGS 84 / UTM zone 32N, crs says WGS 84 / UTM zone 33N"):
        Terrain.from_raster(geotiff(slope), crs="EPSG:32633")
    assert Terrain.from_raster(geotiff(slope), crs=32632).changes == ()
    with pytest.raises(DemError, match=r"crs 'EPSG:1' is not known.*write for example EPSG"):
        Terrain.from_raster(geotiff(slope), crs="EPSG:1")


def test_raster_without_system_is_local_metres_unless_it_looks_like_degrees(geotiff, slope):
    terrain = Terrain.from_raster(geotiff(slope, crs=None))
    assert terrain.crs is None
    assert terrain.changes == ("no coordinate system is stated; coordinates are taken as local metres",)
    with pytest.raises(DemError, match=r"looks like degrees.*EPSG:4326"):
        Terrain.from_raster(geotiff(slope, (ARC_SECOND, 0, 11.0, 0, -ARC_SECOND, 47.0), crs=None))


def geographic(function, crs="EPSG:4326", west=-84.41, north=36.73, shape=(60, 80), cell=3 * ARC_SECOND, target="EPSG:32616"):
    """Values at the cell centres of a geographic raster of a function of easting and northing, and the transform."""
    x = west + (np.arange(shape[1]) + 0.5) * cell
    y = north - (np.arange(shape[0]) + 0.5) * cell
    place = Transformer.from_crs(crs, target, always_xy=True).transform(*np.meshgrid(x, y))
    return function(*place), (cell, 0.0, west, 0.0, -cell, north)


def test_an_empty_rim_is_cut_off_before_it_is_turned_into_a_slanted_one(geotiff):
    values, transform = geographic(lambda easting, northing: 900 + 0.3 * (easting - 735000))
    values[:, -3:] = np.nan
    terrain = Terrain.from_raster(geotiff(values, transform, "EPSG:4326"))
    assert np.isfinite(terrain.elevation).all()
    assert terrain.changes[0] == "the rim has no elevation; cut off by 0 rows, 3 columns"


def test_plane_survives_projection_to_utm(geotiff):
    def plane(easting, northing):
        return 900 + 0.3 * (easting - 735000) - 0.2 * (northing - 4067000)

    values, transform = geographic(plane)
    terrain = Terrain.from_raster(geotiff(values, transform, "EPSG:4326"))
    error = terrain.elevation - plane(terrain.easting[None, :], terrain.northing[:, None])
    assert np.abs(error).max() < 5e-4  # measured 0.00015 m at the rim, 3e-6 m inside
    assert np.abs(error[3:-3, 3:-3]).max() < 1e-5
    assert "geographic coordinates (WGS 84): projected to WGS 84 / UTM zone 16N (EPSG:32616)" in terrain.changes[0]


def test_waves_of_twelve_cells_survive_projection_to_utm(geotiff):
    def waves(easting, northing):
        return 500 + 100 * np.sin(2 * np.pi * easting / 1000) * np.cos(2 * np.pi * northing / 1000)

    values, transform = geographic(waves)
    terrain = Terrain.from_raster(geotiff(values, transform, "EPSG:4326"))
    error = terrain.elevation - waves(terrain.easting[None, :], terrain.northing[:, None])
    assert np.abs(error[5:-5, 5:-5]).max() < 0.07  # measured 0.056 m of 100 m; GDAL's cubic warp 2.5 m
    assert np.abs(error).max() < 5.0  # the rim is continued, not known


def test_projected_terrain_covers_the_original_but_for_the_wedges(geotiff):
    values, transform = geographic(lambda e, n: 0 * e + 500.0)
    terrain = Terrain.from_raster(geotiff(values, transform, "EPSG:4326"))
    assert not np.isnan(terrain.elevation).any()
    corner = Transformer.from_crs(4326, 32616, always_xy=True).transform(-84.41, 36.73)
    assert 0 <= terrain.extent[0] - corner[0] < 250
    geod = Geod(ellps="WGS84")
    east = -84.41 + 80 / 1200
    area = abs(geod.polygon_area_perimeter([-84.41, -84.41, east, east], [36.73, 36.68, 36.68, 36.73])[0])
    assert 0.93 * area < terrain.size[0] * terrain.size[1] < area


def test_hole_stays_a_hole_after_projection_and_spoils_no_neighbour(geotiff):
    values, transform = geographic(lambda e, n: 500 + 0.1 * (e - 735000))
    values[20:30, 40:50] = np.nan
    terrain = Terrain.from_raster(geotiff(values, transform, "EPSG:4326"))
    unknown = np.isnan(terrain.elevation)
    assert 85 < unknown.sum() < 115
    near = np.abs(terrain.elevation - (500 + 0.1 * (terrain.easting - 735000)))
    assert np.nanmax(near) < 10  # one cell of the slope


@pytest.mark.parametrize(
    ("crs", "west", "north", "code"),
    [
        ("EPSG:4326", -70.2, -33.3, 32719),
        ("EPSG:4326", 5.0, 60.5, 32631),
        ("EPSG:4326", 289.8, -33.3, 32719),
        ("EPSG:4269", -84.4, 36.7, 26916),
        ("EPSG:4258", 11.0, 47.0, 25832),
        ("EPSG:2056+5728", None, None, None),
    ],
)
def test_utm_zone_and_datum_fit_the_place(geotiff, crs, west, north, code):
    values = np.full((20, 20), 700.0) + np.arange(20)
    if west is None:  # a projected national system stays what it is
        terrain = Terrain.from_raster(geotiff(values, (10.0, 0.0, 2600000.0, 0.0, -10.0, 1200000.0), crs))
        assert CRS(terrain.crs).to_epsg() == 2056
        assert terrain.changes == ()
        return
    terrain = Terrain.from_raster(geotiff(values, (ARC_SECOND, 0, west, 0, -ARC_SECOND, north), crs))
    assert CRS(terrain.crs).to_epsg() == code


def test_raster_wider_than_a_zone_or_at_the_pole_is_refused(geotiff):
    values = np.full((20, 20), 700.0)
    with pytest.raises(DemError, match=r"spans 20\.0 deg of longitude.*crop"):
        Terrain.from_raster(geotiff(values, (1.0, 0, 5.0, 0, -0.1, 47.0), "EPSG:4326"))
    with pytest.raises(DemError, match=r"no UTM zone covers.*EPSG:3413"):
        Terrain.from_raster(geotiff(values, (ARC_SECOND, 0, 5.0, 0, -ARC_SECOND, 88.0), "EPSG:4326"))


def test_web_mercator_is_projected_because_its_metres_are_no_metres(geotiff):
    x, y = Transformer.from_crs(4326, 3857, always_xy=True).transform(11.4, 47.0)
    terrain = Terrain.from_raster(geotiff(np.full((40, 40), 700.0), (10.0, 0, x, 0, -10.0, y), "EPSG:3857"))
    assert CRS(terrain.crs).to_epsg() == 32632
    assert terrain.cell_size[0] == pytest.approx(10 * np.cos(np.radians(47)), rel=0.01)
    assert "distances wrong by 46" in terrain.changes[0]


def test_continental_map_is_kept_with_a_remark_and_westing_southing_axes_are_refused(geotiff):
    values = np.full((40, 40), 700.0)
    terrain = Terrain.from_raster(geotiff(values, (25.0, 0, 2.7e6, 0, -25.0, 2.1e6), "EPSG:3035"))
    assert CRS(terrain.crs).to_epsg() == 3035
    assert "distances wrong by 1." in terrain.changes[0]
    with pytest.raises(DemError, match=r"Lo29 point west and south.*gdalwarp"):
        prepare.on_metric_map(ElevationRaster(values, (25.0, 0, 1e4, 0, -25.0, 3e6), CRS(2053), "m", "dem.tif"))


def test_engineering_system_is_local():
    site = CRS.from_wkt('LOCAL_CS["site",UNIT["metre",1]]')
    terrain = prepare.terrain(ElevationRaster(np.full((4, 4), 700.0), (25.0, 0, 0, 0, -25.0, 100.0), site, None, "dem.tif"))
    assert terrain.crs is None
    assert "local metres" in terrain.changes[0]


def test_map_in_feet_is_projected_if_the_unit_of_its_elevations_is_known(geotiff):
    feet = 1200 / 3937
    transform = (30.0, 0.0, 1500000.0, 0.0, -30.0, 700000.0)
    with pytest.raises(
        DemError, match=r"the map is in US survey foot.*unit of the elevations is not stated.*gdal_edit\.py -units ft"
    ):
        Terrain.from_raster(geotiff(np.full((40, 40), 3000.0), transform, "EPSG:2264"))
    terrain = Terrain.from_raster(geotiff(np.full((40, 40), 3000.0), transform, "EPSG:2264", unit="us-ft"))
    assert terrain.elevation[20, 20] == pytest.approx(3000 * feet, rel=1e-12)
    assert terrain.cell_size[0] == pytest.approx(30 * feet, rel=2e-3)
    assert CRS(terrain.crs).to_epsg() == 26917
    assert "coordinates in US survey foot" in terrain.changes[-1]


def test_unknown_cells_under_a_mass_are_refused_with_file_cells_and_fix():
    z = np.full((5, 6), 100.0)
    z[1, 2] = z[3, 4] = np.nan
    terrain = Terrain(z, (10.0, 20.0), west=1000.0, south=2000.0, source="dem.tif")
    mask = np.zeros(z.shape, bool)
    prepare.require_known(terrain, mask, "the release 'scar'")
    mask[1:4, 1:4] = True
    place = r"first row 1, column 2 \(1025\.0 E, 2070\.0 N\)"
    message = rf"dem\.tif: 1 of 9 cells of the release 'scar' have no elevation, {place}; .*gdal_fillnodata"
    with pytest.raises(DemError, match=message):
        prepare.require_known(terrain, mask, "the release 'scar'")


def test_mass_on_a_flat_reaches_its_height_over_the_tangent():
    thickness = np.zeros((101, 101))
    thickness[50, 50] = 20.0
    terrain = Terrain(np.zeros((101, 101)), (5.0, 10.0))
    reached = prepare.reachable(terrain, thickness, np.arctan(0.2))  # 100 m and one cell's diagonal
    y, x = np.mgrid[-50:51, -50:51] * np.array([10.0, 5.0])[:, None, None]
    np.testing.assert_array_equal(reached, np.hypot(x, y) <= 100 + np.hypot(5, 10) + 1e-9)


def test_mass_flows_down_but_not_over_a_ridge_above_the_energy_line():
    x = np.arange(60) * 10.0
    profile = 600 - x  # 45 degrees
    profile[30] = 700.0
    terrain = Terrain(np.tile(profile, (9, 1)), 2 * (10.0,))
    thickness = np.zeros(terrain.shape)
    thickness[4, 10] = 5.0
    reached = prepare.reachable(terrain, thickness, np.radians(20))
    assert reached[:, 11:30].all()
    assert not reached[:, 30:].any()
    assert not reached[:, :5].any()


def test_no_path_leads_through_unknown_cells_but_around_them():
    z = np.tile(600 - np.arange(60) * 10.0, (9, 1))
    z[1:, 20:25] = np.nan
    thickness = np.zeros(z.shape)
    thickness[4, 10] = 5.0
    around = prepare.reachable(Terrain(z, (10.0, 10.0)), thickness, np.radians(20))
    np.testing.assert_array_equal(around[:, 11:], np.isfinite(z[:, 11:]))
    z[0, 20:25] = np.nan
    closed = prepare.reachable(Terrain(z, (10.0, 10.0)), thickness, np.radians(20))
    assert closed[:, 11:20].all()
    assert not closed[:, 20:].any()


def test_reach_of_nothing_is_nothing_and_a_wrong_angle_is_refused():
    terrain = Terrain(np.zeros((5, 5)), (1.0, 1.0))
    assert not prepare.reachable(terrain, np.zeros((5, 5)), 0.3).any()
    with pytest.raises(InputError, match=r"angle is 20"):
        prepare.reachable(terrain, np.zeros((5, 5)), 20.0)


@pytest.mark.parametrize(("height", "rim", "told"), [(900.0, 900.0, True), (900.0, 1.0, False), (0.0, 0.0, False)])
def test_cells_at_zero_below_cliffs_on_all_sides_are_told(geotiff, slope, height, rim, told):
    """A lake or the sea at 0 m has a shore."""
    elevation = slope + height - slope.min()
    elevation[1:5, 2:7] = rim
    elevation[2:4, 3:6] = 0.0
    terrain = Terrain.from_raster(geotiff(elevation))
    assert any("6 cells hold 0" in change for change in terrain.changes) == told
