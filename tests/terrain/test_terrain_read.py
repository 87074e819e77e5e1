"""Every way in: formats, row orders, bands, georeferences."""

import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from pyproj import CRS

from runout import DemError, Terrain

UTM = "EPSG:32632"


def test_marker_in_the_north_west_corner_of_a_geotiff_stays_there(geotiff, slope):
    terrain = Terrain.from_raster(geotiff(slope))
    assert terrain.elevation[0, 0] == 1999.0
    assert (terrain.easting[0], terrain.northing[0]) == (600005.0, 5199995.0)
    assert terrain.extent == (600000.0, 5199940.0, 600080.0, 5200000.0)
    np.testing.assert_array_equal(terrain.elevation, slope)
    assert CRS(terrain.crs).to_epsg() == 32632
    assert terrain.changes == ()


def test_georeference_comes_home_to_the_last_bit(geotiff):
    random = np.random.default_rng(3)
    for rows in random.integers(3, 400, 40):
        dx, dy = random.uniform(0.3, 90, 2)
        transform = (dx, 0.0, random.uniform(-9e5, 9e5), 0.0, -dy, random.uniform(-1e7, 1e7))
        terrain = Terrain.from_raster(geotiff(np.full((rows, 3), 700.0), transform, crs=None))
        home = (terrain.cell_size[0], 0.0, terrain.extent[0], 0.0, -terrain.cell_size[1], terrain.extent[3])
        assert home == transform


def test_a_rim_without_elevations_is_cut_off_and_said(geotiff, slope):
    """What gets there leaves the DEM; unknown cells within stay, whether they reach the rim or not."""
    inside = slope.copy()
    inside[0, 0] = inside[2, 3] = np.nan
    around = np.full((slope.shape[0] + 3, slope.shape[1] + 2), np.nan)
    around[1:-2, :-2] = inside
    terrain = Terrain.from_raster(geotiff(around, (10.0, 0.0, 600000.0, 0.0, -10.0, 5200010.0)))
    np.testing.assert_array_equal(terrain.elevation, inside)
    assert terrain.extent == (600000.0, 5199940.0, 600080.0, 5200000.0)
    assert terrain.changes == ("the rim has no elevation; cut off by 3 rows, 2 columns",)


def test_rows_and_columns_in_any_order_give_the_same_terrain(geotiff, slope):
    usual = Terrain.from_raster(geotiff(slope))
    south_first = Terrain.from_raster(geotiff(slope[::-1], (10.0, 0.0, 600000.0, 0.0, 10.0, 5199940.0)))
    east_first = Terrain.from_raster(geotiff(slope[:, ::-1], (-10.0, 0.0, 600080.0, 0.0, -10.0, 5200000.0)))
    for other, words in ((south_first, "rows ran from south to north"), (east_first, "columns ran from east to west")):
        np.testing.assert_array_equal(other.elevation, usual.elevation)
        assert other.extent == usual.extent
        assert len(other.changes) == 1
        assert words in other.changes[0]


def test_rotated_raster_is_refused_with_the_command_that_mends_it(geotiff, slope):
    with pytest.raises(DemError, match=r"rotated or sheared \(by 5\.71 deg\).*gdalwarp -r cubic .*dem\.tif"):
        Terrain.from_raster(geotiff(slope, (10.0, 1.0, 600000.0, 1.0, -10.0, 5200000.0)))


@pytest.mark.parametrize(("east", "south"), [(0.1, 0.0), (0.0, -0.1)])
def test_raster_that_is_sheared_along_one_axis_is_refused(geotiff, slope, east, south):
    with pytest.raises(DemError, match=r"rotated or sheared"):
        Terrain.from_raster(geotiff(slope, (10.0, east, 600000.0, south, -10.0, 5200000.0)))


def test_raster_without_georeference_is_refused(geotiff, slope):
    with pytest.raises(DemError, match=r"no georeference.*-a_ullr"):
        Terrain.from_raster(geotiff(slope, None, None))


def test_unequal_cells_are_kept_and_reported(geotiff, slope):
    terrain = Terrain.from_raster(geotiff(slope, (10.0, 0.0, 600000.0, 0.0, -25.0, 5200000.0)))
    assert terrain.cell_size == (10.0, 25.0)
    assert "10 m east-west by 25 m north-south" in terrain.changes[0]


def test_several_bands_are_refused_and_an_alpha_band_is_a_mask(geotiff, slope):
    with pytest.raises(DemError, match=r"has 3 bands.*gdal_translate -b 1"):
        Terrain.from_raster(geotiff(np.stack([slope] * 3)))
    opaque = np.full(slope.shape, 255.0)
    opaque[2, 3] = 0
    terrain = Terrain.from_raster(geotiff(np.stack([slope, opaque]).astype(np.float32), alpha="yes"))
    assert np.argwhere(np.isnan(terrain.elevation)).tolist() == [[2, 3]]


def test_whole_metres_and_packed_numbers_are_read_as_metres_and_reported(geotiff, slope):
    whole = Terrain.from_raster(geotiff(slope.astype(np.int16)))
    assert whole.elevation.dtype == np.float64
    np.testing.assert_array_equal(whole.elevation, slope)
    assert "whole numbers (int16)" in whole.changes[0]
    packed = Terrain.from_raster(geotiff((slope * 10 - 1000).astype(np.int16), scale=0.1, offset=100.0))
    np.testing.assert_allclose(packed.elevation, slope, rtol=1e-15)
    assert "0.1 x number + 100" in packed.changes[0]


@pytest.mark.parametrize("stated", [True, False])
def test_esri_ascii_grid_with_and_without_prj(tmp_path, slope, stated):
    lines = ["ncols 8", "nrows 6", "xllcorner 600000", "yllcorner 5199940", "cellsize 10", "NODATA_value -9999"]
    z = slope + 0.5
    z[5, 7] = -9999
    (tmp_path / "dem.asc").write_text("\n".join([*lines, *(" ".join(f"{v:g}" for v in row) for row in z)]) + "\n")
    if stated:
        (tmp_path / "dem.prj").write_text(CRS(UTM).to_wkt("WKT1_ESRI"))
    terrain = Terrain.from_raster(tmp_path / "dem.asc")
    assert terrain.extent == (600000.0, 5199940.0, 600080.0, 5200000.0)
    assert terrain.elevation[0, 0] == 1999.5
    assert np.argwhere(np.isnan(terrain.elevation)).tolist() == [[5, 7]]
    if stated:
        assert CRS(terrain.crs).to_epsg(min_confidence=60) == 32632
        assert terrain.changes == ()
    else:
        assert terrain.crs is None
        assert terrain.changes == ("no coordinate system is stated; coordinates are taken as local metres",)


def dataset_of(slope, name="elevation", **attributes):
    x, y = 600005.0 + 10 * np.arange(8), 5199995.0 - 10 * np.arange(6)
    dataset = xr.Dataset({name: (("y", "x"), slope, attributes)}, {"x": x, "y": y})
    dataset["crs"] = ((), 0, {"crs_wkt": CRS(UTM).to_wkt()})
    dataset[name].attrs["grid_mapping"] = "crs"
    return dataset


@pytest.mark.parametrize("order", ["descending", "ascending", "transposed", "with a time"])
def test_netcdf_in_any_order_of_rows_and_dimensions(tmp_path, slope, order):
    dataset = dataset_of(slope)
    dataset = {
        "descending": dataset, "ascending": dataset.isel(y=slice(None, None, -1)),
        "transposed": dataset.transpose("x", "y"), "with a time": dataset.expand_dims(time=1),
    }[order]  # fmt: skip
    dataset.to_netcdf(tmp_path / "dem.nc")
    terrain = Terrain.from_raster(tmp_path / "dem.nc")
    np.testing.assert_array_equal(terrain.elevation, slope)
    assert terrain.extent == (600000.0, 5199940.0, 600080.0, 5200000.0)
    assert CRS(terrain.crs).to_epsg() == 32632


def test_netcdf_with_several_variables_needs_one_named_like_an_elevation(tmp_path, slope):
    clear = dataset_of(slope).assign(slope=(("y", "x"), slope / 100))
    clear.to_netcdf(tmp_path / "clear.nc")
    np.testing.assert_array_equal(Terrain.from_raster(tmp_path / "clear.nc").elevation, slope)
    clear.rename(elevation="a").to_netcdf(tmp_path / "vague.nc")
    with pytest.raises(DemError, match=r"vague\.nc: cannot tell which variable.*a, slope"):
        Terrain.from_raster(tmp_path / "vague.nc")


def test_netcdf_fill_values_packing_and_units_are_understood(tmp_path, slope):
    z = slope.copy()
    z[1, 1] = np.nan
    packing = {"dtype": "int16", "scale_factor": 0.5, "add_offset": 1000.0, "_FillValue": -32768}
    dataset_of(z / 0.3048, units="ft").to_netcdf(tmp_path / "dem.nc", encoding={"elevation": packing})
    terrain = Terrain.from_raster(tmp_path / "dem.nc")
    assert np.argwhere(np.isnan(terrain.elevation)).tolist() == [[1, 1]]
    assert np.nanmax(np.abs(terrain.elevation - slope)) <= 0.25 * 0.3048 + 1e-9
    assert "elevations were in ft" in terrain.changes[-1]


def test_netcdf_without_coordinates_or_with_uneven_ones_is_refused(tmp_path, slope):
    dataset_of(slope).drop_vars(["x", "y"]).to_netcdf(tmp_path / "bare.nc")
    with pytest.raises(DemError, match="no x coordinate"):
        Terrain.from_raster(tmp_path / "bare.nc")
    dataset = dataset_of(slope)
    dataset.assign_coords(x=dataset.x.where(dataset.x != 600035, 600037)).to_netcdf(tmp_path / "uneven.nc")
    with pytest.raises(DemError, match=r"'x' is not evenly spaced.*gdalwarp"):
        Terrain.from_raster(tmp_path / "uneven.nc")


def test_files_that_are_missing_or_no_rasters_are_named_with_a_remedy(geotiff, tmp_path, slope):
    whole = geotiff(slope)
    with pytest.raises(DemError, match=r"den\.tif: no such file; did you mean 'dem\.tif'"):
        Terrain.from_raster(tmp_path / "den.tif")
    with pytest.raises(DemError, match="is a folder"):
        Terrain.from_raster(tmp_path)
    (tmp_path / "text.tif").write_text("not a raster")
    with pytest.raises(DemError, match=r"text\.tif: cannot be read as a raster.*gdalinfo"):
        Terrain.from_raster(tmp_path / "text.tif")
    (tmp_path / "cut.tif").write_bytes(whole.read_bytes()[:-100])
    with pytest.raises(DemError, match=r"cut\.tif: cannot be read"):
        Terrain.from_raster(tmp_path / "cut.tif")
    (tmp_path / "text.nc").write_text("not a raster")
    with pytest.raises(DemError, match=r"text\.nc: cannot be read as NetCDF"):
        Terrain.from_raster(tmp_path / "text.nc")


def test_sample_of_matplotlib_lies_in_tennessee_on_cells_of_equal_area():
    terrain = Terrain.from_raster("matplotlib:jacksboro_fault_dem")
    assert CRS(terrain.crs).to_epsg() == 32616
    # 3 arc-seconds are 74.9 m by 92.5 m there; a square of the same area has 83.2 m
    assert terrain.cell_size == (83.2, 83.2)
    assert terrain.cell_area == pytest.approx(74.9 * 92.5, rel=2e-3)
    assert not np.isnan(terrain.elevation).any()
    assert 236 <= terrain.elevation.min() < 245
    assert 1065 < terrain.elevation.max() <= 1077
    assert any("74.9 m east-west by 92.5 m north-south" in sentence for sentence in terrain.changes)
    # the highest ridge of the file, row 297 and column 219 from the north-west, is Cross Mountain
    row, column = np.unravel_index(np.argmax(terrain.elevation), terrain.shape)
    from pyproj import Transformer

    back = Transformer.from_crs(terrain.crs, 4326, always_xy=True)
    longitude, latitude = back.transform(terrain.easting[column], terrain.northing[row])
    assert longitude == pytest.approx(-84.41375 + 219.5 / 1200, abs=1.5 / 1200)
    assert latitude == pytest.approx(36.44625 - 297.5 / 1200, abs=1.5 / 1200)


def test_other_samples_of_matplotlib_are_refused():
    with pytest.raises(DemError, match="the only one is 'matplotlib:jacksboro_fault_dem'"):
        Terrain.from_raster("matplotlib:topobathy")


def test_array_of_a_mask_becomes_a_terrain_with_unknown_cells(slope):
    terrain = Terrain.from_array(np.ma.masked_greater(slope, 1990), (10.0, 20.0), crs=UTM, origin=(6e5, 5.2e6))
    assert np.argwhere(np.isnan(terrain.elevation)).tolist() == [[0, 0]]
    assert terrain.extent == (6e5, 5.2e6, 600080.0, 5200120.0)
    assert CRS(terrain.crs).to_epsg() == 32632
    assert terrain.changes == ()


def test_array_in_degrees_or_feet_or_nowhere_is_refused(slope):
    for crs in ("EPSG:4326", "EPSG:2264"):
        with pytest.raises(DemError, match="not a projected system in metres"):
            Terrain.from_array(slope, 10.0, crs=crs)
    with pytest.raises(DemError, match="origin"):
        Terrain.from_array(slope, 10.0, origin=(np.nan, 0.0))
    with pytest.raises(DemError, match="cell size"):
        Terrain.from_array(slope, -10.0)


@pytest.mark.parametrize(
    ("name", "shape", "cell", "unknown"),
    [
        ("frank_slide_1903/Frankslide_topography.asc", (201, 201), 20.0, 0),
        ("cascades_2021_landlab/pre_runout_DEM.asc", (122, 79), 10.0, 0),  # its last column has no elevation
        ("maipo_debrisflow_runoptGPP/elev_12_5m.tif", (238, 547), 12.5, 0),
        ("avaframe/avaKot/Inputs/avaKot.asc", (517, 439), 4.997688906601, 90023),
    ],
)
def test_measured_rasters_are_read_whole(measured, name, shape, cell, unknown):
    terrain = Terrain.from_raster(measured(name))
    assert terrain.shape == shape
    assert terrain.cell_size == (cell, cell)
    assert np.isnan(terrain.elevation).sum() == unknown
    assert np.nanmin(terrain.elevation) > 100


def test_import_of_the_package_is_cheap():
    code = "import runout.terrain.read, runout.terrain.prepare, runout.terrain.sdf, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"rasterio", "pyproj", "xarray", "scipy", "matplotlib", "netCDF4"} & set(loaded)


@pytest.mark.parametrize(
    ("transform", "said"),
    [
        ((1e-9, 0.0, 600000.0, 0.0, -10.0, 5200000.0), r"has cells of 1e-09 x 10 map units; 1e-07 to 1e\+06 can be used"),
        ((10.0, 0.0, 600000.0, 0.0, -2e6, 5200000.0), r"has cells of 10 x 2e\+06 map units"),
        (
            (10.0, 0.0, 3e9, 0.0, -10.0, 5200000.0),
            r"its corner lies at 3e\+09, 5\.2e\+06, farther from the origin than a map reaches",
        ),
    ],
)
def test_a_georeference_that_no_map_has_is_refused_with_the_remedy(geotiff, slope, transform, said):
    with pytest.raises(DemError, match=rf"dem\.tif: {said}.*gdal_edit\.py -a_ullr"):
        Terrain.from_raster(geotiff(slope, transform))
