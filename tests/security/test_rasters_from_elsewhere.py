"""A raster from elsewhere reaches neither the network nor files outside its site, and neither hangs nor fills the memory."""

import contextlib
import os

import numpy as np
import pytest
from hostile_files import vrt

from runout import DemError, Release, ReleaseError, Terrain
from runout.io.opening import RASTER_DRIVERS, open_raster

WMS = """<GDAL_WMS><Service name="TMS"><ServerUrl>{}/${{z}}/${{x}}.png</ServerUrl></Service><DataWindow><UpperLeftX>0</UpperLeftX>
<UpperLeftY>10</UpperLeftY><LowerRightX>10</LowerRightX><LowerRightY>0</LowerRightY><SizeX>256</SizeX><SizeY>256</SizeY></DataWindow>
<BandsCount>1</BandsCount></GDAL_WMS>"""


def refused(path, words=None) -> str:
    with pytest.raises(DemError, match=words) as caught:
        Terrain.from_raster(path)
    return str(caught.value)


@pytest.fixture
def slope_grid(tmp_path):
    """Path of a text grid of a slope."""
    rows = "\n".join(" ".join(f"{r + c}.5" for c in range(20)) for r in range(20))
    head = "ncols 20\nnrows 20\nxllcorner 500000\nyllcorner 5000000\ncellsize 10\n"
    (tmp_path / "dem.asc").write_text(head + rows + "\n", encoding="utf-8")
    return tmp_path / "dem.asc"


@pytest.fixture
def site(tmp_path):
    """Folder of inputs of a site; secret.tif lies outside the site."""
    (tmp_path / "site" / "inputs").mkdir(parents=True)
    (tmp_path / "site" / "site.yaml").write_text("name: site\n", encoding="utf-8")
    return tmp_path / "site" / "inputs"


def test_a_vrt_of_sources_in_its_site_is_read(site, raster):
    raster(site.parent / "tiles" / "a.tif")
    (site / "dem.vrt").write_text(vrt("../tiles/a.tif", 1), encoding="utf-8")
    (site / "outer.vrt").write_text(vrt("dem.vrt", 1), encoding="utf-8")
    for name in ("dem.vrt", "outer.vrt"):
        assert Terrain.from_raster(site / name).elevation[3, 4] == 7.0


@pytest.mark.parametrize("relative", [0, 1])
@pytest.mark.parametrize("through", ["path", "link", "nested"])
def test_a_source_outside_the_site_is_refused(site, raster, tmp_path, relative, through):
    secret = raster(tmp_path / "secret.tif")
    name = "../../secret.tif" if relative else str(secret)
    if through == "link":
        (site / "link.tif").symlink_to(secret)
        name = "link.tif" if relative else str(site / "link.tif")
    (site / "dem.vrt").write_text(vrt(name, relative), encoding="utf-8")
    (site / "outer.vrt").write_text(vrt("dem.vrt", 1), encoding="utf-8")
    refused(site / ("outer.vrt" if through == "nested" else "dem.vrt"), "lies outside")


@pytest.mark.parametrize(
    "source",
    [
        "/vsicurl/{}/x.tif",
        "/vsicurl_streaming/{}/x.tif",
        "{}/x.tif",
        "WMS:{}/wms",
        "vrt://{}/x.tif",
        "NETCDF:{}/x.nc:z",
        "HDF5:x.h5",
    ],
)
def test_a_vrt_of_an_address_contacts_nobody(site, listener, source):
    (site / "dem.vrt").write_text(vrt(source.format(listener.url)), encoding="utf-8")
    refused(site / "dem.vrt", "no file on this machine")
    assert not listener.was_contacted()


def test_a_vrt_around_a_service_description_contacts_nobody(site, listener):
    (site / "tile.tif").write_text(WMS.format(listener.url), encoding="utf-8")
    (site / "grid.asc").write_text("ncols 2\n" + WMS.format(listener.url), encoding="utf-8")
    for name in ("tile.tif", "grid.asc"):
        (site / "dem.vrt").write_text(vrt(name, 1), encoding="utf-8")
        refused(site / "dem.vrt", "neither GeoTIFF")
    assert not listener.was_contacted()


@pytest.mark.parametrize(
    "choices",
    [
        {"band": ' subClass="VRTDerivedRasterBand"', "inner": "<PixelFunctionType>f</PixelFunctionType>"},
        {"band": ' subClass="VRTRawRasterBand"'},
        {"dataset": ' subClass="VRTPansharpenedDataset"'},
        {"more": "<OpenOptions><OOI key='a'>b</OOI></OpenOptions>"},
        {"more": "<SRS>{}/crs</SRS>"},
    ],
)
def test_a_vrt_that_does_more_than_copy_bands_is_refused(site, raster, listener, choices):
    raster(site / "a.tif")
    text = vrt("a.tif", 1, **choices).replace("{}", listener.url)
    (site / "dem.vrt").write_text(text, encoding="utf-8")
    refused(site / "dem.vrt", "VRT")
    assert not listener.was_contacted()


@pytest.mark.parametrize("name", ["dem.tif", "dem.vrt", "dem.asc", "dem.xml"])
def test_a_file_that_describes_a_service_is_no_raster(tmp_path, listener, name):
    (tmp_path / name).write_text(WMS.format(listener.url), encoding="utf-8")
    refused(tmp_path / name, "cannot be read as a raster")
    assert not listener.was_contacted()


@pytest.mark.parametrize("name", ["/vsicurl/{}/x.tif", "{}/x.tif", "WMS:{}/x", "/vsistdin/", "WCS:{}/x", "zip+{}/x.zip!x.tif"])
def test_names_of_services_are_no_files(listener, name):
    refused(name.format(listener.url), "no such file|virtual file name")
    assert not listener.was_contacted()


@pytest.mark.parametrize("inside", [True, False])
def test_overviews_elsewhere_are_refused(tmp_path, raster, listener, inside):
    elsewhere = f"/vsicurl/{listener.url}/overviews.tif"
    path = raster(tmp_path / "dem.tif", 600, **({"OVERVIEW_FILE": elsewhere} if inside else {}))
    if not inside:
        text = f'<PAMDataset><Metadata domain="OVERVIEWS"><MDI key="OVERVIEW_FILE">{elsewhere}</MDI></Metadata></PAMDataset>'
        (tmp_path / "dem.tif.aux.xml").write_text(text, encoding="utf-8")
    refused(path, "for its overviews")
    assert not listener.was_contacted()


@pytest.mark.parametrize("name", ["dem.tif", "dem.nc", "dem.vrt", "dem.tif.aux.xml", "dem.prj"])
def test_a_named_pipe_is_refused_at_once(tmp_path, raster, name):
    if name in ("dem.tif.aux.xml", "dem.prj"):
        raster(tmp_path / "dem.tif")
    os.mkfifo(tmp_path / name)
    assert "named pipe" in refused(tmp_path / (name if "aux" not in name and "prj" not in name else "dem.tif"))


def test_devices_and_empty_files_are_refused(tmp_path):
    refused("/dev/zero", "is a device")
    (tmp_path / "dem.tif").touch()
    refused(tmp_path / "dem.tif", "is empty")


def test_a_huge_sparse_raster_is_refused_before_it_is_read(tmp_path):
    import rasterio
    from rasterio.transform import from_origin

    shape = {
        "width": 1_000_000,
        "height": 1_000_000,
        "count": 1,
        "dtype": "float32",
        "tiled": True,
        "SPARSE_OK": True,
        "BIGTIFF": "YES",
    }
    path = tmp_path / "huge.tif"
    with rasterio.open(path, "w", driver="GTiff", transform=from_origin(0, 0, 1, 1), blockxsize=8192, blockysize=8192, **shape):
        pass
    refused(path, "1000000 x 1000000 cells need about .* GB of memory.*state the part under study, terrain.extent")


@pytest.mark.parametrize("transform", [(np.nan, 0, 0, 0, -10, 0), (10, 0, np.inf, 0, -10, 0), (1e-300, 0, 0, 0, -1e-300, 0)])
def test_a_georeference_that_cannot_be_computed_with_is_refused(tmp_path, transform):
    import rasterio

    shape = {"width": 20, "height": 20, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "dem.tif", "w", driver="GTiff", transform=rasterio.Affine(*transform), **shape) as file:
        file.write(np.ones((20, 20), "float32"), 1)
    refused(tmp_path / "dem.tif", "no finite numbers|map units|no georeference")


@pytest.mark.parametrize("kind", ["complex64", "complex128"])
def test_complex_numbers_are_refused_for_elevation_and_thickness(tmp_path, raster, kind):
    import rasterio

    terrain = Terrain.from_raster(raster(tmp_path / "dem.tif"))
    shape = {"width": 20, "height": 20, "count": 1, "dtype": kind, "crs": "EPSG:32632"}
    with rasterio.open(
        tmp_path / "c.tif", "w", driver="GTiff", transform=rasterio.Affine(10, 0, 5e5, 0, -10, 5_000_200), **shape
    ) as file:
        file.write(np.ones((20, 20), kind), 1)
    refused(tmp_path / "c.tif", "complex numbers")
    with pytest.raises(ReleaseError, match="complex numbers"):
        Release.from_raster(tmp_path / "c.tif", terrain)


def test_formats_of_services_are_not_among_those_that_are_read(tmp_path, raster):
    assert {"WMS", "WCS", "WMTS", "HTTP", "VRT", "GTI", "STACTA", "STACIT", "EEDAI", "PDF"}.isdisjoint(RASTER_DRIVERS)
    with open_raster(raster(tmp_path / "a.tif"), DemError) as dataset:
        assert dataset.driver == "GTiff"


@pytest.mark.parametrize(
    "crs", ["+proj=utm +zone=32 +nadgrids={}/x.gsb", "+proj=utm +zone=32 +nadgrids=@{}/x.gsb,@null", "+init={}/x:1"]
)
@pytest.mark.parametrize("inside", [True, False])
def test_a_coordinate_system_with_grids_elsewhere_is_refused(tmp_path, slope_grid, listener, crs, inside):
    text = crs.format(listener.url)
    if inside:
        (tmp_path / "dem.prj").write_text(text, encoding="utf-8")
        with contextlib.suppress(DemError):  # GDAL keeps some of them and drops others
            Terrain.from_raster(slope_grid)
    else:
        with pytest.raises(DemError, match="grid file"):
            Terrain.from_raster(slope_grid, crs=text)
    assert not listener.was_contacted()
