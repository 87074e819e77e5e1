"""Releases in another coordinate system than the terrain's: known by definition, transformed, and said."""

import numpy as np
import pyproj
import pytest
import shapely

from runout.errors import ReleaseError
from runout.io import polygon_reproject
from runout.io.layer_crs import crs_name, to_terrain
from runout.model.release import Release
from runout.model.terrain import Terrain

SQUARE = shapely.box(50.0, 50.0, 100.0, 100.0)
UTM_16 = "+proj=utm +zone=16 +datum=WGS84 +units=m +no_defs"
CORNER = (500_000.0, 4_000_000.0)


def centre(release):
    """Local middle of the released volume [m]."""
    t, h = release.terrain, release.thickness
    return np.array([h.sum(0) @ (t.easting - t.west), h.sum(1) @ (t.northing - t.south)]) / h.sum()


def placed(outline, place, size, within=1e-3):
    """Whether an outline is a square of ``size`` [m] around a local place."""
    assert np.array(outline.centroid.coords)[0] - CORNER == pytest.approx(place, abs=within)
    assert outline.area == pytest.approx(size**2, rel=1e-5)


@pytest.mark.parametrize("crs", ["EPSG:32617", "EPSG:4326", "EPSG:26916", "EPSG:3857", "EPSG:5070"])
def test_polygons_in_another_known_system_are_transformed_with_a_sentence(write_polygons, terrain, crs):
    release = Release.from_vector(write_polygons([SQUARE], crs=crs), terrain, thickness=2.0)
    placed(release.outline, (75.0, 75.0), 50.0)
    assert release.volume == pytest.approx(5000.0, rel=1e-5)
    (said,) = release.changes
    assert crs in said
    assert "transformed from" in said or "agree to 1 mm" in said


def test_a_system_without_a_name_is_known_by_its_definition(write_polygons, terrain):
    """A transverse Mercator of its own, 216 m beside UTM: it was once taken for the terrain's own."""
    shifted = "+proj=tmerc +lat_0=0 +lon_0=-87 +k=0.9996 +x_0=500216 +y_0=0 +datum=WGS84 +units=m +no_defs"
    wkt = pyproj.CRS(shifted).to_wkt()
    assert 'PROJCRS["unknown"' in wkt
    for crs in (shifted, wkt):
        release = Release.from_vector(write_polygons([SQUARE], crs=crs), terrain, thickness=2.0)
        placed(release.outline, (75.0, 75.0), 50.0)
        assert "+x_0=500216" in release.changes[0]


@pytest.mark.parametrize("name", ["release.gpkg", "release.shp"])
def test_the_terrains_system_without_its_name_is_the_same_and_changes_nothing(write_polygons, terrain, name):
    release = Release.from_vector(write_polygons([SQUARE], name, crs=UTM_16), terrain, thickness=2.0)
    assert (release.changes, release.outline.area) == ((), pytest.approx(2500.0, rel=1e-9))
    unnamed = Terrain(terrain.elevation, terrain.cell_size, *CORNER, pyproj.CRS(UTM_16).to_wkt())
    assert Release.from_vector(write_polygons([SQUARE]), unnamed, thickness=2.0).changes == ()
    release = Release.from_vector(write_polygons([SQUARE], crs="EPSG:32617"), unnamed, thickness=2.0)
    placed(release.outline, (75.0, 75.0), 50.0)


def test_an_ellipsoid_alone_is_taken_for_the_datum_that_has_it_and_this_is_said(write_polygons, terrain):
    path = write_polygons([SQUARE], "release.shp", crs="EPSG:32617")
    path.with_suffix(".prj").write_text(pyproj.CRS("+proj=utm +zone=17 +ellps=WGS84 +units=m +no_defs").to_wkt("WKT1_ESRI"))
    release = Release.from_vector(path, terrain, thickness=2.0)
    placed(release.outline, (75.0, 75.0), 50.0)
    assert "names no datum, which is taken to be that of the other" in release.changes[0]
    assert "; accuracy not stated)" in release.changes[0]


def test_axes_that_point_west_and_south_are_refused(write_polygons, terrain):
    path = write_polygons([SQUARE], "release.shp")
    path.with_suffix(".prj").write_text(pyproj.CRS("EPSG:5513").to_wkt("WKT1_GDAL"))
    with pytest.raises(ReleaseError, match="axes point west and south"):
        Release.from_vector(path, terrain, thickness=2.0)


def test_parameters_of_a_datum_in_a_proj_string_count(write_polygons, terrain):
    """An International ellipsoid with seven parameters: on the map some 200 m away, on the ground in the same place."""
    crs = "+proj=utm +zone=16 +ellps=intl +towgs84=-87,-98,-121,0,0,0,0 +units=m +no_defs"
    release = Release.from_vector(write_polygons([SQUARE], crs=crs), terrain, thickness=2.0)
    placed(release.outline, (75.0, 75.0), 50.0, within=0.02)  # heights, which such parameters change as well, are not known
    alone = crs.replace("+towgs84=-87,-98,-121,0,0,0,0 ", "")
    with pytest.raises(ReleaseError, match="names no datum, and the ellipsoids differ"):
        Release.from_vector(write_polygons([SQUARE], "alone.gpkg", crs=alone), terrain, thickness=2.0)


@pytest.mark.parametrize("crs", ["EPSG:32617", "EPSG:4326"])
@pytest.mark.parametrize("cell", [2.0, 5.0, 13.0])
def test_a_raster_in_another_system_keeps_its_volume_and_its_place(tmp_path, terrain, crs, cell):
    import rasterio
    from rasterio.transform import from_origin

    project = pyproj.Transformer.from_crs("EPSG:32616", crs, always_xy=True).transform
    x0, y0 = project(CORNER[0] + 90.0, CORNER[1] + 160.0)
    x1, _ = project(CORNER[0] + 190.0, CORNER[1] + 160.0)
    step = (x1 - x0) * cell / 100.0  # in units of the other map
    count = round(90.0 / cell)
    y, x = np.mgrid[-1 : 1 : count * 1j, -1 : 1 : count * 1j]
    values = np.maximum(0.0, 6.0 * (1.0 - x * x - y * y))
    path = tmp_path / "thickness.tif"
    shape = {"height": count, "width": count, "count": 1, "dtype": "float64"}
    with rasterio.open(path, "w", driver="GTiff", crs=crs, transform=from_origin(x0, y0, step, step), **shape) as raster:
        raster.write(values, 1)
    back = pyproj.Transformer.from_crs(crs, "EPSG:32616", always_xy=True).transform
    corners = np.array(
        back(*(np.array([x0, x0 + count * step, x0 + count * step, x0]), y0 - np.array([0, 0, 1, 1]) * count * step))
    )
    whole = shapely.Polygon(corners.T)
    release = Release.from_raster(path, terrain)
    assert release.volume == pytest.approx(values.mean() * whole.area, rel=2e-4)
    np.testing.assert_allclose(centre(release), np.array(whole.centroid.coords)[0] - CORNER, atol=0.25)
    assert release.thickness.max() == pytest.approx(values.max(), rel=0.05)
    assert "transformed from" in release.changes[0]
    assert "m3 are kept" in release.changes[1]


@pytest.mark.parametrize(("raster", "points"), [(5.0, 16), (2.0, 40), (40.0, 8)])
def test_points_of_a_cell_resolve_the_raster_along_its_longer_side(raster, points):
    along, across = np.meshgrid(np.arange(7) * raster, np.arange(5) * raster, indexing="ij")
    ground = Terrain(np.zeros((4, 5)), (10.0, 40.0), 0.0, 0.0)
    assert polygon_reproject._points(np.stack([along, across], axis=-1), ground) == points


def test_a_fine_raster_on_coarse_ground_loses_nothing(write_raster, terrain):
    values = np.full((12, 9), 3.0)
    release = Release.from_raster(write_raster(values, 0.05, (101.0, 101.0)), terrain)
    coarse = Terrain(terrain.elevation, terrain.cell_size, *CORNER, pyproj.CRS("EPSG:26916").to_wkt())
    nad = pyproj.CRS("EPSG:32616").to_wkt().replace('"EPSG",32616', '"OWN",1')
    assert release.volume == pytest.approx(3.0 * 12 * 9 * 0.05**2)
    assert Release.from_raster(write_raster(values, 0.05, (101.0, 101.0), crs=nad), coarse).volume == pytest.approx(release.volume)


def test_a_raster_that_lies_elsewhere_once_it_is_transformed_is_refused(write_raster, terrain):
    with pytest.raises(ReleaseError, match=r"100.0% of its .* m3 lies outside the terrain"):
        Release.from_raster(write_raster(np.ones((4, 4)), crs="EPSG:32617"), terrain)


@pytest.fixture(scope="module")
def geographic(tmp_path_factory):
    """A terrain whose file is in degrees, and was projected."""
    import rasterio
    from rasterio.transform import from_origin

    path = tmp_path_factory.mktemp("degrees") / "dem.tif"
    step = 1 / 3600
    z = 500.0 - 3.0 * np.arange(60)[:, None] - 2.0 * np.arange(70)[None, :]
    place = {"transform": from_origin(10.0, 47.0, step, step), "crs": "EPSG:4326"}
    with rasterio.open(path, "w", driver="GTiff", height=60, width=70, count=1, dtype="float64", **place) as raster:
        raster.write(z, 1)
    return Terrain.from_raster(path), place, path


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.filterwarnings("ignore")
def test_a_release_in_the_dems_own_system_is_accepted_when_the_dem_is_projected(geographic, tmp_path, stated):
    import geopandas
    import rasterio

    terrain, place, _ = geographic
    assert pyproj.CRS(terrain.own_crs) == pyproj.CRS("EPSG:4326")
    box = shapely.box(10.005, 46.99, 10.01, 46.995)
    frame = geopandas.GeoDataFrame({"a": [1]}, geometry=[box], crs="EPSG:4326" if stated else None)
    frame.to_file(tmp_path / "scar.shp")
    vector = Release.from_vector(tmp_path / "scar.shp", terrain, thickness=3.0, edge="vertical")
    exact = pyproj.Geod(ellps="WGS84").geometry_area_perimeter(box)[0]
    assert vector.volume == pytest.approx(3.0 * abs(exact), rel=1e-3)  # the map's own scale
    values = np.zeros((60, 70))
    values[18:36, 18:36] = 3.0
    shape = {"height": 60, "width": 70, "count": 1, "dtype": "float64"}
    given = place if stated else {"transform": place["transform"]}
    with rasterio.open(tmp_path / "scar.tif", "w", driver="GTiff", **shape, **given) as raster:
        raster.write(values, 1)
    found = Release.from_raster(tmp_path / "scar.tif", terrain)
    assert found.volume == pytest.approx(vector.volume, rel=2e-3)
    np.testing.assert_allclose(centre(found), centre(vector), atol=0.5)
    if not stated:
        for release in (vector, found):
            assert "taken to be in that of the elevation raster's file, EPSG:4326" in release.changes[0]


@pytest.mark.filterwarnings("ignore")
def test_a_file_without_a_system_on_the_projected_map_is_still_taken_for_the_terrains(geographic, tmp_path):
    import geopandas

    terrain, *_ = geographic
    west, south, *_ = terrain.extent
    frame = geopandas.GeoDataFrame({"a": [1]}, geometry=[shapely.box(west + 200, south + 300, west + 300, south + 400)])
    frame.to_file(tmp_path / "scar.gpkg")
    release = Release.from_vector(tmp_path / "scar.gpkg", terrain, thickness=3.0)
    assert release.volume == pytest.approx(30_000.0, rel=1e-9)
    assert "taken to be in the terrain's" in release.changes[0]


@pytest.mark.filterwarnings("ignore")
def test_a_file_without_a_system_that_lies_in_neither_map_is_taken_for_the_terrains(geographic, tmp_path):
    terrain, *_ = geographic
    found = to_terrain(tmp_path / "scar.gpkg", None, terrain, (12.0, 40.0, 12.1, 40.1), "ogr2ogr")
    assert found.forward is found.inverse is None
    assert "taken to be in the terrain's" in found.sentences[0]


@pytest.mark.filterwarnings("ignore")
def test_a_release_in_the_system_of_a_dem_without_a_datum_goes_where_the_elevations_went(tmp_path):
    import geopandas
    import rasterio
    from rasterio.transform import from_origin

    own, step = "+proj=longlat +ellps=bessel", 1 / 3600
    z = 500.0 - 3.0 * np.arange(60)[:, None] - 2.0 * np.arange(70)[None, :]
    place = {
        "transform": from_origin(10.0, 47.0, step, step),
        "crs": own,
        "height": 60,
        "width": 70,
        "count": 1,
        "dtype": "float64",
    }
    with rasterio.open(tmp_path / "dem.tif", "w", driver="GTiff", **place) as raster:
        raster.write(z, 1)
    terrain = Terrain.from_raster(tmp_path / "dem.tif")
    assert "names no datum" in terrain.changes[-1]
    frame = geopandas.GeoDataFrame(
        {"a": [1]}, geometry=[shapely.box(10.0 + 20 * step, 47 - 30 * step, 10.0 + 24 * step, 47 - 26 * step)]
    )
    frame.to_file(tmp_path / "scar.shp")
    (tmp_path / "scar.prj").write_text(pyproj.CRS(own).to_wkt("WKT1_ESRI"))
    release = Release.from_vector(tmp_path / "scar.shp", terrain, thickness=3.0)
    ground = terrain.elevation[release.thickness > 1.5].mean()
    assert ground == pytest.approx(z[26:30, 20:24].mean(), abs=2.0)


@pytest.mark.parametrize(
    ("system", "name"),
    [
        ("EPSG:32616", "EPSG:32616 (WGS 84 / UTM zone 16N)"),
        ("+proj=utm +zone=16 +ellps=intl", "+proj=utm +zone=16 +ellps=intl +units=m +no_defs"),
        ("+proj=utm +zone=16 +datum=WGS84 +title=x", "EPSG:32616"),
    ],
)
def test_a_system_is_called_by_its_code_its_name_or_its_parameters(system, name):
    assert name in crs_name(pyproj.CRS(system))


def test_a_transformation_is_said_with_its_operation_and_accuracy(write_polygons, terrain):
    (said,) = Release.from_vector(write_polygons([SQUARE], crs="EPSG:32617"), terrain, thickness=2.0).changes
    assert "from EPSG:32617 (WGS 84 / UTM zone 17N) to the terrain's EPSG:32616 (WGS 84 / UTM zone 16N) (" in said
    assert "UTM zone 17N + UTM zone 16N; accuracy 0 m)." in said
