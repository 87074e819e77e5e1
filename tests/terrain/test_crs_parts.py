"""What coordinate systems say of themselves: datum, ellipsoid, heights, scale; which UTM zone fits."""

import pytest
from pyproj import CRS

from runout.errors import DemError
from runout.io import crs

UTM_32, SWISS, WEB = CRS("EPSG:32632"), CRS("EPSG:2056"), CRS("EPSG:3857")


@pytest.mark.parametrize(
    ("system", "named"),
    [
        ("EPSG:32632", True),
        ("EPSG:2056", True),
        ("+proj=utm +zone=32 +ellps=GRS80", False),
        ("+proj=utm +zone=32 +datum=WGS84", True),
        ("+proj=utm +zone=32 +ellps=intl +towgs84=-87,-98,-121", True),
    ],
)
def test_an_ellipsoid_alone_is_no_datum(system, named):
    assert crs.names_datum(CRS(system)) is named


def test_ellipsoids_are_the_same_by_their_size_and_flattening():
    grs, wgs = CRS("+proj=utm +zone=32 +ellps=GRS80"), CRS("+proj=utm +zone=32 +ellps=WGS84")
    assert crs.same_ellipsoid(grs, CRS("EPSG:25832"))
    assert not crs.same_ellipsoid(grs, wgs)  # 1e-4 m apart in the small axis
    assert not crs.same_ellipsoid(wgs, CRS("+proj=utm +zone=32 +ellps=intl"))
    assert not crs.same_ellipsoid(wgs, CRS("+proj=utm +zone=32 +a=6378138 +rf=298.257223563"))
    assert not crs.same_ellipsoid(wgs, CRS("EPSG:5773"))


def test_systems_are_the_same_by_their_horizontal_coordinates():
    assert crs.same(UTM_32, CRS("EPSG:32632+5773"))
    assert crs.same(UTM_32, CRS(UTM_32.to_wkt("WKT1_ESRI")))
    assert not crs.same(UTM_32, CRS("EPSG:32633"))
    assert crs.horizontal(CRS("EPSG:32632+5773")) == UTM_32
    assert crs.vertical(UTM_32) is crs.vertical(None) is None
    assert crs.vertical_name(CRS("EPSG:32632+5773")) == "EGM96 height (EPSG:5773)"
    assert crs.vertical_name(UTM_32) is None
    assert crs.vertical_name(CRS("EPSG:4979")) == "height above the ellipsoid of WGS 84"


def test_scale_error_is_that_of_the_projection_at_the_place():
    assert crs.scale_error(UTM_32, 500_000.0, 5_200_000.0) == pytest.approx(0.0004, abs=1e-6)
    assert crs.scale_error(UTM_32, 800_000.0, 5_200_000.0) == pytest.approx(0.00071, abs=3e-5)
    assert crs.scale_error(WEB, 0.0, 4_300_000.0) == pytest.approx(0.24, abs=0.01)
    assert crs.longitude_latitude(UTM_32, 500_000.0, 0.0) == pytest.approx((9.0, 0.0), abs=1e-9)


def test_utm_zone_of_a_place_is_in_the_datum_of_the_system_if_that_has_one():
    assert crs.utm_for(CRS("EPSG:4326"), 9.0, 46.0, "dem.tif").to_epsg() == 32632
    assert crs.utm_for(CRS("EPSG:4326"), -70.0, -33.0, "dem.tif").to_epsg() == 32719
    assert crs.utm_for(CRS("EPSG:4258"), 9.0, 46.0, "dem.tif").to_epsg() == 25832
    assert crs.utm_for(CRS("EPSG:4149"), 9.0, 46.0, "dem.tif").to_epsg() == 32632
    with pytest.raises(DemError, match=r"dem.tif: no UTM zone covers longitude 9.000, latitude 89.000"):
        crs.utm_for(CRS("EPSG:4326"), 9.0, 89.0, "dem.tif")


def test_only_projected_systems_in_metres_and_to_the_east_and_north_serve():
    assert crs.projected_in_metres(CRS("EPSG:32632+5773"), "dem.tif") == UTM_32
    assert crs.metres_per_unit(CRS("EPSG:2225")) == pytest.approx(1200 / 3937)
    for other in ("EPSG:4326", "EPSG:2225"):
        with pytest.raises(DemError, match="is not a projected system in metres"):
            crs.projected_in_metres(CRS(other), "dem.tif")
    crs.require_east_and_north(SWISS, "dem.tif")
    with pytest.raises(DemError, match="point west and south"):
        crs.require_east_and_north(CRS("EPSG:5513"), "dem.tif")
    assert not crs.is_local(UTM_32)
    assert not crs.is_local(CRS("EPSG:4326"))
    assert crs.is_local(CRS("EPSG:5773"))


def test_systems_that_pyproj_builds_from_parts_are_parsed():
    built = CRS.from_cf({"grid_mapping_name": "transverse_mercator", "longitude_of_central_meridian": 9.0})
    assert type(built) is not CRS
    assert crs.horizontal(crs.parse(built, "dem.tif")).is_projected
