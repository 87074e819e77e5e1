"""What a raster says of its systems reaches terrain and products: the horizontal one by definition, and the datum of heights."""

import numpy as np
import pyproj
import pytest

from runout import Release, Terrain, log
from runout.errors import DemError
from runout.io import netcdf
from runout.io.geotiff import write_cog

DEGREES = (1 / 3600, 0.0, 10.0, 0.0, -1 / 3600, 47.0)
HEIGHT = "EGM96 height (EPSG:5773)"


@pytest.mark.parametrize(("crs", "transform"), [("EPSG:32632+5773", None), ("EPSG:4326+5773", DEGREES)])
def test_the_datum_of_a_compound_system_reaches_every_product(geotiff, tmp_path, crs, transform):
    import rasterio

    z = np.full((40, 40), 500.0) - np.arange(40)
    path = geotiff(z, **({"transform": transform} if transform else {}), crs=crs)
    terrain = Terrain.from_raster(path)
    assert terrain.vertical_datum == HEIGHT
    assert pyproj.CRS(terrain.crs).to_epsg() == 32632
    dataset = netcdf.map_dataset(terrain, {"elevation": terrain.elevation}, title="terrain")
    assert dataset.attrs["vertical_datum"] == HEIGHT
    assert netcdf.read(netcdf.write(dataset, tmp_path / "t.nc")).attrs["vertical_datum"] == HEIGHT
    with rasterio.open(write_cog(dataset, "elevation", tmp_path / "t.tif")) as raster:
        assert raster.tags()["vertical_datum"] == HEIGHT
        assert raster.crs.to_epsg() == 32632


def test_the_datum_may_be_stated_where_the_file_names_none_and_is_unknown_otherwise(geotiff):
    path = geotiff(np.full((8, 8), 500.0))
    assert Terrain.from_raster(path).vertical_datum is None
    assert Terrain.from_raster(path, "EPSG:32632+5773").vertical_datum == HEIGHT
    assert Terrain.from_array(np.zeros((4, 4)), 5.0, "EPSG:32632+5773").vertical_datum == HEIGHT
    with pytest.raises(DemError, match="crs says"):
        Terrain.from_raster(path, "EPSG:32633+5773")


def test_heights_above_an_ellipsoid_are_called_that(geotiff):
    terrain = Terrain.from_raster(geotiff(np.full((40, 40), 500.0), transform=DEGREES, crs="EPSG:4979"))
    assert terrain.vertical_datum == "height above the ellipsoid of WGS 84"


def test_a_system_without_a_name_is_that_of_the_products(geotiff, tmp_path):
    own = "+proj=tmerc +lat_0=47 +lon_0=10.3 +k=1 +x_0=5000 +y_0=8000 +ellps=bessel +towgs84=577,90,463,5.1,1.5,5.3,2.4 +units=m"
    terrain = Terrain.from_raster(geotiff(np.full((40, 40), 500.0), transform=(10.0, 0, 5000.0, 0, -10.0, 8400.0), crs=own))
    system = pyproj.CRS(terrain.crs)
    dataset = netcdf.map_dataset(terrain, {"elevation": terrain.elevation}, title="terrain")
    stored = pyproj.CRS(netcdf.read(netcdf.write(dataset, tmp_path / "t.nc"))["crs"].attrs["crs_wkt"])
    for found in (system, stored):
        to_degrees = pyproj.Transformer.from_crs(found, "EPSG:4326", always_xy=True)
        exact = pyproj.Transformer.from_crs(own, "EPSG:4326", always_xy=True).transform(5200.0, 8200.0)
        assert to_degrees.transform(5200.0, 8200.0) == pytest.approx(exact, abs=1e-8)
    thickness = np.zeros((40, 40))
    thickness[10:20, 10:20] = 3.0
    path = geotiff(thickness, transform=(10.0, 0, 5000.0, 0, -10.0, 8400.0), crs=own, name="scar.tif")
    release = Release.from_raster(path, terrain)
    assert release.changes == ()
    np.testing.assert_array_equal(release.thickness, thickness)


def test_a_map_in_kilometres_is_projected_and_its_unit_is_named(geotiff, capfd):
    z = 500.0 + 2.0 * np.arange(40) * np.ones((30, 1))
    path = geotiff(z, transform=(0.01, 0, 632.0, 0, -0.01, 5190.4), crs="+proj=utm +zone=32 +datum=WGS84 +units=km", unit="m")
    capfd.readouterr()
    with log.muted():  # a command of another test may have sent the messages of runout to the terminal
        terrain = Terrain.from_raster(path)
    assert capfd.readouterr().err == ""  # libgeotiff complains where it does not find the units of PROJ
    np.testing.assert_allclose(terrain.elevation, z, atol=1e-6)
    assert terrain.extent == pytest.approx((632000.0, 5190100.0, 632400.0, 5190400.0))
    assert any(change.startswith("coordinates in kilometre") for change in terrain.changes)
