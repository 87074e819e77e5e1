"""Scales, units and corners that a raster's own header or side files state: they count, or are refused with the remedy."""

import struct

import numpy as np
import pytest
import rasterio

from runout import DemError, Terrain

WEST, SOUTH, NORTH = 600_000.0, 5_199_940.0, 5_200_000.0
ROWS, COLUMNS = 6, 8
OLD_PRJ = "Projection    UTM\nZone          32\nDatum         WGS84\nUnits         METERS\nZunits        {}\nParameters\n"
GRID = f"ncols {COLUMNS}\nnrows {ROWS}\nxllcorner {WEST}\nyllcorner {SOUTH}\ncellsize 10\nNODATA_value -9999\n"


def saga(folder, z, lines):
    z[::-1].astype("<f4").tofile(folder / "dem.sdat")
    place = f"POSITION_XMIN\t= {WEST + 5}\nPOSITION_YMIN\t= {SOUTH + 5}\nCELLSIZE\t= 10\n"
    place += f"CELLCOUNT_X\t= {COLUMNS}\nCELLCOUNT_Y\t= {ROWS}\n"
    head = "NAME\t= dem\nDATAFORMAT\t= FLOAT\nBYTEORDER_BIG\t= FALSE\n" + place + "NODATA_VALUE\t= -99999\nTOPTOBOTTOM\t= FALSE\n"
    (folder / "dem.sgrd").write_text(head + lines)
    return folder / "dem.sdat"


def terragen(folder, z, scale):
    head = b"binterr1.3" + struct.pack("<iihhhhh", COLUMNS, ROWS, 4, 1, 1, 32, -2)[:8]
    head += (
        struct.pack("<hhhhh", 4, 1, 1, 32, -2) + struct.pack("<dddd", WEST, WEST + 80, SOUTH, NORTH) + struct.pack("<hf", 0, scale)
    )
    (folder / "dem.bt").write_bytes(head + b"\0" * (256 - len(head)) + z[::-1].T.astype("<f4").tobytes())
    return folder / "dem.bt"


def envi(folder, z, lines):
    z.astype("<f4").tofile(folder / "dem.img")
    head = f"ENVI\nsamples = {COLUMNS}\nlines = {ROWS}\nbands = 1\nheader offset = 0\nfile type = ENVI Standard\ndata type = 4\n"
    place = f"map info = {{UTM, 1, 1, {WEST}, {NORTH}, 10, 10, 32, North, WGS-84}}\n"
    (folder / "dem.hdr").write_text(head + "interleave = bsq\nbyte order = 0\n" + place + lines)
    return folder / "dem.img"


def binary(folder, z, lines, prj=""):
    z.astype("<f4").tofile(folder / "dem.flt")
    (folder / "dem.hdr").write_text(GRID + "byteorder LSBFIRST\n" + lines)
    if prj:
        (folder / "dem.prj").write_text(OLD_PRJ.format(prj))
    return folder / "dem.flt"


def ascii_grid(folder, z, header=GRID, prj="", name="dem.asc"):
    (folder / name).write_text(header + "\n".join(" ".join(f"{v:.6f}" for v in row) for row in z) + "\n")
    if prj:
        (folder / name).with_suffix(".prj").write_text(OLD_PRJ.format(prj))
    return folder / name


FORMS = {
    "SAGA, Z_FACTOR": (0.5, lambda f, z: saga(f, z, "Z_FACTOR\t= 0.5\n")),
    "SAGA, UNIT": (0.3048, lambda f, z: saga(f, z, "UNIT\t= feet\n")),
    "SAGA, both": (0.1524, lambda f, z: saga(f, z, "UNIT\t= ft\nZ_FACTOR\t= 0.5\n")),
    "SAGA, neither": (1.0, lambda f, z: saga(f, z, "UNIT\t= \nZ_FACTOR\t= 1.0\n")),
    "BT": (0.5, lambda f, z: terragen(f, z, 0.5)),
    "BT in feet": (1200 / 3937, lambda f, z: terragen(f, z, 1200 / 3937)),
    "BT without a scale": (1.0, lambda f, z: terragen(f, z, 0.0)),
    "ENVI, gain": (0.5, lambda f, z: envi(f, z, "data gain values = {0.5}\n")),
    "ENVI, data units": (0.3048, lambda f, z: envi(f, z, "data units = feet\n")),
    "ENVI, z plot titles": (0.3048, lambda f, z: envi(f, z, "z plot titles = {Elevation, feet}\n")),
    "ENVI, title of no unit": (1.0, lambda f, z: envi(f, z, "z plot titles = {Wavelength, Value}\n")),
    "binary grid, zunits": (0.3048, lambda f, z: binary(f, z, "zunits FEET\n")),
    "binary grid, elev_unit": (1.0, lambda f, z: binary(f, z, "ELEV_UNIT METERS\n")),
    "binary grid, prj": (0.3048, lambda f, z: binary(f, z, "", "FEET")),
    "binary grid, header and prj": (0.3048, lambda f, z: binary(f, z, "zunits FEET\n", "FEET")),
    "ASCII grid, prj": (0.3048, lambda f, z: ascii_grid(f, z, prj="FEET")),
    "ASCII grid, metres": (1.0, lambda f, z: ascii_grid(f, z, prj="METERS")),
    "ASCII grid, decimetres": (0.1, lambda f, z: ascii_grid(f, z, prj="10")),
    "ASCII grid, none": (1.0, lambda f, z: ascii_grid(f, z, prj="NO")),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_vertical_scale_in_a_header_or_side_file_counts(tmp_path, slope, form):
    scale, write = FORMS[form]
    terrain = Terrain.from_raster(write(tmp_path, slope / scale))
    np.testing.assert_allclose(terrain.elevation, slope, rtol=2e-7)
    assert terrain.extent == (WEST, SOUTH, WEST + 80, NORTH)
    assert any("packed numbers" in change or "multiplied by" in change for change in terrain.changes) == (scale != 1.0)


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (lambda f, z: saga(f, z, "Z_FACTOR\t= 0\n"), "z_factor '0'; write a number other than 0"),
        (lambda f, z: saga(f, z, "Z_FACTOR\t= half\n"), "z_factor 'half'"),
        (lambda f, z: binary(f, z, "zunits METERS\n", "FEET"), r"different units \(METERS, FEET\)"),
        (lambda f, z: binary(f, z, "zunits FATHOMS\n"), r"elevations are in 'FATHOMS'; m, ft, .*gdal_edit.py -units"),
    ],
)
def test_a_scale_or_unit_that_cannot_be_used_is_refused_with_the_remedy(tmp_path, slope, write, said):
    with pytest.raises(DemError, match=said):
        Terrain.from_raster(write(tmp_path, slope))


@pytest.mark.parametrize("scale", [0.0, np.inf, np.nan])
def test_a_scale_of_zero_or_no_number_is_refused(geotiff, slope, scale):
    path = geotiff(slope)
    with rasterio.open(path, "r+") as file:
        file.scales = (scale,)
    with pytest.raises(DemError, match=r"states the scale .*gdal_edit.py -scale 1"):
        Terrain.from_raster(path)


def vrt(folder, names, band="", kind="SimpleSource", more=""):
    """A VRT of rasters of the same place; the last one is on top."""
    sources = "".join(
        f'<{kind}><SourceFilename relativeToVRT="1">{name}</SourceFilename><SourceBand>1</SourceBand>{more}</{kind}>'
        for name in names
    )
    (folder / "dem.vrt").write_text(
        f'<VRTDataset rasterXSize="{COLUMNS}" rasterYSize="{ROWS}"><SRS>EPSG:32632</SRS>'
        f"<GeoTransform>{WEST}, 10, 0, {NORTH}, 0, -10</GeoTransform>"
        f'<VRTRasterBand dataType="Float64" band="1">{band}{sources}</VRTRasterBand></VRTDataset>'
    )
    return folder / "dem.vrt"


@pytest.mark.parametrize("band", ["", "<Scale>0.5</Scale>", "<UnitType>m</UnitType>"])
def test_a_vrt_counts_the_scale_of_its_sources_once(tmp_path, geotiff, slope, band):
    geotiff(slope / 0.5, name="one.tif", scale=0.5, offset=0.0)
    terrain = Terrain.from_raster(vrt(tmp_path, ["one.tif"], band))
    np.testing.assert_allclose(terrain.elevation, slope)


def test_a_vrt_counts_its_own_scale_and_a_unit_of_its_sources(tmp_path, geotiff, slope):
    geotiff(slope / 0.5, name="one.tif")
    np.testing.assert_allclose(Terrain.from_raster(vrt(tmp_path, ["one.tif"], "<Scale>0.5</Scale>")).elevation, slope)
    geotiff(slope / 0.3048, name="one.tif", unit="ft")
    np.testing.assert_allclose(Terrain.from_raster(vrt(tmp_path, ["one.tif"])).elevation, slope)
    ratio = "<ScaleOffset>0</ScaleOffset><ScaleRatio>0.5</ScaleRatio>"
    geotiff(slope / 0.5, name="one.tif")
    np.testing.assert_allclose(Terrain.from_raster(vrt(tmp_path, ["one.tif"], "", "ComplexSource", ratio)).elevation, slope)


def test_sources_of_a_vrt_that_mean_different_things_are_refused(tmp_path, geotiff, slope):
    geotiff(slope, name="one.tif")
    geotiff(slope / 0.3048, name="two.tif", unit="ft")
    with pytest.raises(DemError, match=r"its sources differ: one.tif states .*two.tif .* in ft; .*gdal_translate -unscale"):
        Terrain.from_raster(vrt(tmp_path, ["one.tif", "two.tif"]))
    with pytest.raises(DemError, match=r"in m, its source two.tif .* in ft"):
        Terrain.from_raster(vrt(tmp_path, ["two.tif"], "<UnitType>m</UnitType>"))
    geotiff(slope, name="two.tif", scale=0.1, offset=0.0)
    with pytest.raises(DemError, match=r"value = 0.5 x number \+ 0, its source two.tif value = 0.1 x number"):
        Terrain.from_raster(vrt(tmp_path, ["two.tif"], "<Scale>0.5</Scale>"))


@pytest.mark.parametrize(("x", "y"), [("corner", "corner"), ("center", "center")])
@pytest.mark.parametrize("write", [ascii_grid, lambda f, z, header: binary_of(f, z, header)])
def test_a_grid_placed_by_corner_or_centre_lies_where_it_says(tmp_path, slope, x, y, write):
    place = {"corner": 0.0, "center": 5.0}
    header = GRID.replace(f"xllcorner {WEST}", f"xll{x} {WEST + place[x]}").replace(
        f"yllcorner {SOUTH}", f"yll{y} {SOUTH + place[y]}"
    )
    assert Terrain.from_raster(write(tmp_path, slope, header)).extent == (WEST, SOUTH, WEST + 80, NORTH)


def binary_of(folder, z, header):
    z.astype("<f4").tofile(folder / "dem.flt")
    (folder / "dem.hdr").write_text(header + "byteorder LSBFIRST\n")
    return folder / "dem.flt"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("xllcorner", "xllcenter", "xllcenter 600000.0 and yllcorner 5199940.0"),
        ("yllcorner", "YLLCENTER", "xllcorner 600000.0 and yllcenter 5199940.0"),
        (f"xllcorner {WEST}\n", "", "states yllcorner 5199940.0; xllcorner and yllcorner are needed"),
    ],
)
@pytest.mark.parametrize("write", [ascii_grid, binary_of])
def test_a_grid_placed_by_corner_along_one_axis_and_centre_along_the_other_is_refused(tmp_path, slope, write, old, new, said):
    with pytest.raises(DemError, match=said):
        Terrain.from_raster(write(tmp_path, slope, GRID.replace(old, new)))


def test_an_undeclared_mark_of_packed_elevations_is_told_as_the_stored_number(geotiff, slope):
    slope[2, 3] = 30000.0
    with pytest.raises(DemError, match=r"-a_nodata 300000`"):
        Terrain.from_raster(geotiff((slope * 10).astype(np.int32), scale=0.1, offset=0.0))


def test_side_files_of_another_raster_do_not_count(tmp_path, geotiff, slope):
    ascii_grid(tmp_path, slope / 0.3048, prj="FEET")
    np.testing.assert_array_equal(Terrain.from_raster(geotiff(slope)).elevation, slope)
    with rasterio.open(tmp_path / "dem.tif") as file:
        assert [name for name in file.files if name.endswith(".prj")] == []
