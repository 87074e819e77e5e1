"""Systems whose longitudes count from Paris, Rome, Ferro or Oslo, in degrees or grads, place rasters and polygons rightly."""

import geopandas
import numpy as np
import pyproj
import pytest
import shapely

from runout import Release, Terrain
from runout.errors import ReleaseError
from runout.io import crs
from runout.io.grid import grid_mapping

ROWS, COLUMNS = 24, 30
CASES = {  # system, a place in its area as longitude and latitude from Greenwich [deg], UTM zone there
    "Paris in grads": ("EPSG:4807", (3.2, 45.1), 32631),
    "Paris, projected, parameters in grads": ("EPSG:27572", (3.2, 45.1), 32631),
    "Rome": ("EPSG:4806", (9.2, 45.9), 32632),
    "Ferro": ("EPSG:4805", (13.1, 47.2), 32633),
    "Ferro, projected": ("EPSG:31251", (10.6, 47.1), 32632),
    "Oslo, projected": ("EPSG:27393", (10.4, 61.2), 32632),
    "Paris by PROJ text": ("+proj=longlat +datum=WGS84 +pm=paris", (6.9, 45.9), 32632),
}


def ground(easting, northing):
    """Elevation [m] of places in a UTM zone."""
    return 1500.0 + 300.0 * np.sin(easting / 2000.0) + 200.0 * np.cos(northing / 1500.0)


def raster(name, system):
    """Values and affine map of cells of 20 m or so, in the unit of the system, by pyproj's own transformation to UTM."""
    _, at, utm = CASES[name]
    to_utm = pyproj.Transformer.from_crs(system, utm, always_xy=True)
    east, north = pyproj.Transformer.from_crs("EPSG:4326", utm, always_xy=True).transform(*at)
    (west, south), (other, top) = (to_utm.transform(east + d, north + d, direction="INVERSE") for d in (0.0, 600.0))
    dx, dy = (other - west) / COLUMNS, (top - south) / ROWS
    x, y = west + dx * (np.arange(COLUMNS) + 0.5), top - dy * (np.arange(ROWS) + 0.5)
    return ground(*to_utm.transform(*np.meshgrid(x, y))), (dx, 0.0, west, 0.0, -dy, top)


def error(terrain, utm):
    to_utm = pyproj.Transformer.from_crs(terrain.crs, utm, always_xy=True)
    east, north = to_utm.transform(*np.meshgrid(terrain.easting, terrain.northing))
    return np.nanmax(np.abs(terrain.elevation - ground(east, north)))


@pytest.mark.parametrize("form", ["GeoTIFF", "ASCII grid with .prj"])
@pytest.mark.parametrize("name", CASES)
def test_a_raster_lies_where_pyproj_places_it(geotiff, tmp_path, name, form):
    system = pyproj.CRS(CASES[name][0])
    if form == "GeoTIFF":
        path = geotiff(*raster(name, system), system.to_wkt())
    else:
        values, transform = raster(name, pyproj.CRS(system.to_wkt("WKT1_ESRI")))
        dx, _, west, _, dy, north = transform
        head = [f"ncols {COLUMNS}", f"nrows {ROWS}", f"xllcorner {west!r}", f"yllcorner {north + ROWS * dy!r}"]
        head += [f"dx {dx!r}", f"dy {-dy!r}"]
        path = tmp_path / "dem.asc"
        path.write_text("\n".join([*head, *(" ".join(f"{v:.4f}" for v in row) for row in values)]) + "\n")
        (tmp_path / "dem.prj").write_text(system.to_wkt("WKT1_ESRI"))
    terrain = Terrain.from_raster(path)
    assert terrain.elevation.size > 0.7 * ROWS * COLUMNS
    assert error(terrain, CASES[name][2]) < 0.05
    assert f"UTM zone {CASES[name][2] % 100}N" in str(terrain.crs) or system.is_projected


@pytest.mark.parametrize("name", [name for name in CASES if name != "Oslo, projected"])
@pytest.mark.parametrize("suffix", [".gpkg", ".shp"])
def test_polygons_lie_where_pyproj_places_them(tmp_path, name, suffix):
    text, at, utm = CASES[name]
    system = pyproj.CRS(text)
    east, north = np.round(pyproj.Transformer.from_crs("EPSG:4326", utm, always_xy=True).transform(*at), -1)
    terrain = Terrain.from_array(np.full((40, 40), 1500.0), 10.0, crs=utm, origin=(east, north))
    box = shapely.box(east + 100.0, north + 150.0, east + 300.0, north + 250.0)
    to_utm = pyproj.Transformer.from_crs(system, utm, always_xy=True, area_of_interest=pyproj.aoi.AreaOfInterest(*at, *at))
    corners = np.column_stack(to_utm.transform(*shapely.get_coordinates(box).T, direction="INVERSE"))
    path = tmp_path / f"scar{suffix}"
    geopandas.GeoDataFrame({"id": [1]}, geometry=[shapely.Polygon(corners)], crs=system).to_file(path, engine="pyogrio")
    if name == "Rome":  # PROJ knows no transformation of the datum by the code of this system
        with pytest.raises(ReleaseError, match=r"no transformation between them is known here.*ogr2ogr -t_srs"):
            Release.from_vector(path, terrain, thickness=5.0)
        return
    release = Release.from_vector(path, terrain, thickness=5.0)
    assert release.volume == pytest.approx(200.0 * 100.0 * 5.0, rel=1e-3)
    centre = [np.average(c, weights=release.thickness) for c in np.meshgrid(terrain.easting, terrain.northing)]
    assert centre == pytest.approx((east + 200.0, north + 200.0), abs=2.0)


@pytest.mark.parametrize(("name", "told"), [("Rome", True), ("Paris in grads", False)])
def test_a_datum_whose_shift_proj_does_not_know_is_told(geotiff, name, told):
    system = pyproj.CRS(CASES[name][0])
    terrain = Terrain.from_raster(geotiff(*raster(name, system), system.to_wkt()))
    assert any("PROJ knows no shift from its datum to WGS 84 here" in change for change in terrain.changes) == told


def test_longitudes_are_degrees_from_greenwich():
    paris = pyproj.CRS("EPSG:4807")
    assert crs.degrees_of_prime_meridian(paris) == pytest.approx(2.33722917)
    assert crs.degrees_of_prime_meridian(pyproj.CRS("EPSG:32632")) == 0.0
    assert crs.longitude_latitude(paris, 1.0, 50.0) == pytest.approx((0.9 + 2.33722917, 45.0))
    assert crs.utm_for(pyproj.CRS("EPSG:4326"), 189.0, 46.0, "dem.tif").to_epsg() == 32602


def test_the_scale_of_a_projection_is_that_at_the_place_whatever_its_meridian():
    assert crs.scale_error(pyproj.CRS("EPSG:27391"), 0.0, 0.0) == pytest.approx(0.0, abs=1e-6)  # on its axis
    assert crs.scale_error(pyproj.CRS("EPSG:27391"), 200_000.0, 0.0) == pytest.approx(200.0**2 / 2 / 6380.0**2, rel=0.01)
    assert crs.scale_error(pyproj.CRS("EPSG:27572"), 600_000.0, 2_200_000.0) == pytest.approx(1.0 - 0.99987742, abs=1e-6)


@pytest.mark.parametrize("code", [27572, 27391, 32632, 31251])
def test_grid_mappings_of_products_state_angles_in_degrees(code):
    attributes = {key: value for key, value in grid_mapping(f"EPSG:{code}").items() if key not in ("crs_wkt", "spatial_ref")}
    by_parameters = pyproj.CRS.from_wkt(pyproj.CRS.from_cf(attributes).to_wkt())
    to_own = pyproj.Transformer.from_crs(by_parameters, code, always_xy=True)
    assert to_own.transform(600_000.0, 2_200_000.0) == pytest.approx((600_000.0, 2_200_000.0), abs=1.0)
