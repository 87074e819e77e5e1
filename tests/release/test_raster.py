"""Releases of thickness rasters and arrays."""

import numpy as np
import pytest

from runout.errors import ReleaseError
from runout.model.release import Release
from runout.model.terrain import Terrain


def mound(rows, columns):
    y, x = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : columns * 1j]
    return np.maximum(0.0, 8.0 * (1.0 - x * x - y * y))


def test_raster_on_the_terrains_grid_is_taken_as_it_is(write_raster, terrain):
    values = mound(40, 60)
    release = Release.from_raster(write_raster(values), terrain)
    np.testing.assert_array_equal(release.thickness, values)
    assert release.changes == ()


@pytest.mark.parametrize(("cell", "corner"), [(2.0, (33.3, 41.7)), (7.3, (12.1, 3.9)), (5.0, (52.5, 31.0))])
def test_raster_on_another_grid_keeps_its_volume_and_its_centre(write_raster, terrain, cell, corner):
    values = mound(18, 20)
    release = Release.from_raster(write_raster(values, cell, corner), terrain)
    assert release.volume == pytest.approx(values.sum() * cell * cell, rel=1e-12)
    x = (release.thickness.sum(0) @ (terrain.easting - terrain.west)) / release.thickness.sum()
    y = (release.thickness.sum(1) @ (terrain.northing - terrain.south)) / release.thickness.sum()
    assert (x, y) == pytest.approx((corner[0] + 10 * cell, corner[1] + 9 * cell), abs=0.005)  # a thousandth of a cell
    assert "resampled by area" in release.changes[0]


def test_nodata_and_nan_mean_that_nothing_is_released(write_raster, terrain):
    values = mound(40, 60)
    values[20, 30], values[21, 30] = -9999.0, np.nan
    release = Release.from_raster(write_raster(values, nodata=-9999.0), terrain)
    assert release.thickness[20, 30] == release.thickness[21, 30] == 0.0


def test_negative_raster_is_refused_with_the_choice_and_read_with_it(write_raster, terrain):
    path = write_raster(-mound(40, 60))
    with pytest.raises(ReleaseError, match=r"are negative; .*sign='negative'"):
        Release.from_raster(path, terrain)
    assert Release.from_raster(path, terrain, sign="negative").volume == pytest.approx(mound(40, 60).sum() * 25.0)
    with pytest.raises(ReleaseError, match=r"are positive; .*sign='positive'"):
        Release.from_raster(write_raster(mound(40, 60)), terrain, sign="negative")
    with pytest.raises(ReleaseError, match="sign is 'minus'; choose one of positive, negative"):
        Release.from_raster(path, terrain, sign="minus")


def test_raster_of_erosion_and_deposition_is_refused(write_raster, terrain):
    values = mound(40, 60)
    values[:, 30:] *= -1
    with pytest.raises(ReleaseError, match="erosion and deposition"):
        Release.from_raster(write_raster(values), terrain)


def test_raster_without_crs_is_taken_in_the_terrains_and_reported(write_raster, terrain):
    release = Release.from_raster(write_raster(mound(40, 60), crs=None), terrain)
    assert "states no coordinate system" in release.changes[0]


def test_thickness_beyond_the_terrain_is_refused_but_zeros_are_not(write_raster, terrain):
    with pytest.raises(ReleaseError, match=r"% of its .* m3 lies outside the terrain plane.tif"):
        Release.from_raster(write_raster(mound(40, 60), corner=(200.0, 0.0)), terrain)
    wide = np.pad(mound(20, 30), 50)
    assert Release.from_raster(write_raster(wide, corner=(-200.0, -200.0)), terrain).volume == pytest.approx(wide.sum() * 25.0)


def test_stated_volume_is_checked_against_the_raster(write_raster, terrain):
    path, volume = write_raster(mound(40, 60)), mound(40, 60).sum() * 25.0
    assert Release.from_raster(path, terrain, volume=1.005 * volume).volume == pytest.approx(1.005 * volume, rel=1e-14)
    with pytest.raises(ReleaseError, match=r"stated volume is .*\(-4.8%\)"):
        Release.from_raster(path, terrain, volume=1.05 * volume)


def test_nodata_of_the_terrain_under_the_raster_is_refused(write_raster, terrain):
    z = terrain.elevation.copy()
    z[18:22, 30] = np.nan
    holed = Terrain(z, terrain.cell_size, terrain.west, terrain.south, terrain.crs, "holed.tif")
    with pytest.raises(ReleaseError, match=r"holed.tif: 4 of \d+ cells .* and 1 more"):
        Release.from_raster(write_raster(mound(40, 60)), holed)


def test_missing_empty_and_foreign_files_are_refused(write_raster, terrain, tmp_path):
    with pytest.raises(ReleaseError, match="no such file"):
        Release.from_raster(tmp_path / "absent.tif", terrain)
    with pytest.raises(ReleaseError, match="the release is empty; the raster is 0 or nodata everywhere"):
        Release.from_raster(write_raster(np.zeros((40, 60))), terrain)
    text = tmp_path / "thickness.txt"
    text.write_text("no raster")
    with pytest.raises(ReleaseError, match="cannot be read as a raster"):
        Release.from_raster(text, terrain)


def test_array_is_checked_against_the_terrain(terrain):
    values = mound(40, 60)
    assert Release.from_array(values, terrain, name="scar").volume == pytest.approx(values.sum() * 25.0)
    with pytest.raises(ReleaseError, match=r"shape \(60, 40\)"):
        Release.from_array(values.T, terrain)
    with pytest.raises(ReleaseError, match="negative thickness"):
        Release.from_array(-values, terrain)
    with pytest.raises(ReleaseError, match="1 cells have no thickness"):
        Release.from_array(np.where(np.arange(2400).reshape(40, 60) == 7, np.nan, values), terrain)


def test_rotated_many_banded_and_unreferenced_rasters_are_refused(terrain, tmp_path):
    import rasterio
    from affine import Affine

    shape = {"driver": "GTiff", "height": 40, "width": 60, "dtype": "float64"}
    turned = Affine.translation(500_000.0, 4_000_200.0) @ Affine.rotation(20.0) @ Affine.scale(5.0, -5.0)
    for transform, bands, words in ((turned, 1, "rotated"), (Affine.identity(), 1, "georeference"), (turned, 2, "2 bands")):
        path = tmp_path / "thickness.tif"
        with rasterio.open(path, "w", count=bands, transform=transform, **shape) as raster:
            raster.write(np.stack([mound(40, 60)] * bands))
        with pytest.raises(ReleaseError, match=words):
            Release.from_raster(path, terrain)


def test_shifted_raster_of_the_same_shape_is_resampled(write_raster, terrain):
    values = np.pad(mound(20, 30), ((10, 10), (15, 15)))
    release = Release.from_raster(write_raster(values, corner=(2.5, 0.0)), terrain)
    np.testing.assert_allclose(release.thickness[:, 1:], 0.5 * (values[:, 1:] + values[:, :-1]), rtol=1e-12)
    assert "resampled by area" in release.changes[0]


def turned_to_the_east(path, values):
    """The raster with columns from the east and rows from the south."""
    import rasterio
    from affine import Affine

    shape = {"driver": "GTiff", "height": 40, "width": 60, "count": 1, "dtype": "float64", "crs": "EPSG:32616"}
    with rasterio.open(path, "w", transform=Affine(-5.0, 0.0, 500_300.0, 0.0, 5.0, 4_000_000.0), **shape) as raster:
        raster.write(values[::-1, ::-1], 1)
    return path


def with_alpha(path, values):
    """Garbage below an alpha band that is transparent outside the mound."""
    import rasterio
    from affine import Affine

    shape = {"driver": "GTiff", "height": 40, "width": 60, "count": 2, "dtype": "float64", "crs": "EPSG:32616", "alpha": "yes"}
    with rasterio.open(path, "w", transform=Affine(5.0, 0.0, 500_000.0, 0.0, -5.0, 4_000_200.0), **shape) as raster:
        raster.write(np.stack([np.where(values > 0, values, 77.0), 255.0 * (values > 0)]))
    return path


def as_netcdf(path, values, name="thickness", **more):
    import pyproj
    import xarray as xr

    x, y = 500_002.5 + 5.0 * np.arange(60), 4_000_197.5 - 5.0 * np.arange(40)
    maps = {key: (("y", "x"), own, {"units": "m", "grid_mapping": "crs"}) for key, own in {name: values, **more}.items()}
    crs = {"crs": ((), 0, {"crs_wkt": pyproj.CRS("EPSG:32616").to_wkt()})}
    coordinates = {"y": ("y", y, {"units": "m", "axis": "Y"}), "x": ("x", x, {"units": "m", "axis": "X"})}
    xr.Dataset({**maps, **crs}, coordinates).to_netcdf(path)
    return path


@pytest.mark.parametrize(("write", "name"), [(turned_to_the_east, "t.tif"), (with_alpha, "t.tif"), (as_netcdf, "t.nc")])
def test_a_thickness_raster_takes_the_forms_of_an_elevation_raster(tmp_path, terrain, write, name):
    values = mound(40, 60)
    np.testing.assert_allclose(Release.from_raster(write(tmp_path / name, values), terrain).thickness, values)


def test_of_a_netcdf_file_with_elevation_and_thickness_the_thickness_is_released(tmp_path, terrain):
    path = as_netcdf(tmp_path / "both.nc", mound(40, 60), "depth", elevation=np.full((40, 60), 900.0))
    assert Release.from_raster(path, terrain).thickness.max() < 8.0
    with pytest.raises(ReleaseError, match=r"which variable is the thickness .*name the variable after the file"):
        Release.from_raster(as_netcdf(tmp_path / "none.nc", mound(40, 60), "a", b=mound(40, 60)), terrain)


def test_a_release_in_a_huge_raster_of_another_system_is_sought_on_the_terrain_alone(write_raster, terrain, monkeypatch):
    monkeypatch.setattr("runout.release.read.LARGEST_WHOLE", 1000)
    wide = np.pad(mound(20, 30), 60)
    release = Release.from_raster(write_raster(wide, corner=(-240.0, -250.0)), terrain)
    assert release.volume == pytest.approx(wide.sum() * 25.0)
    assert any("cells are read" in change for change in release.changes)
