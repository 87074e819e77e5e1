"""A result depends on more files than site.yaml names: each of them is known, and each change of one is noticed."""

import os
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import rasterio.shutil
from rasterio.transform import from_origin
from shapely import box

from runout.io.input_copies import files_of
from runout.workflow.stages import digest_files

Z = np.arange(30, dtype="float32").reshape(5, 6)
PLACE = {"transform": from_origin(0, 50, 10, 10), "crs": "EPSG:32632"}
WORLD = "10\n0\n0\n-10\n5\n45\n"
ASCII = "ncols 6\nnrows 5\nxllcorner 0\nyllcorner 0\ncellsize 10\nnodata_value -9999\n"

pytestmark = pytest.mark.filterwarnings("ignore")


def raster(path, driver="GTiff", mask=False, **place):
    shape = {"height": 5, "width": 6, "count": 1, "dtype": "float32"}
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open(path, "w", driver=driver, **shape, **place) as file:
        file.write(Z, 1)
        if mask:
            file.write_mask(Z > 3)
    return path


def tiff_with_world_file(folder):
    (folder / "dem.tfw").write_text(WORLD)
    (folder / "dem.tif.aux.xml").write_text("<PAMDataset/>")
    return raster(folder / "dem.tif"), {"dem.tfw", "dem.tif.aux.xml"}


def tiff_with_mask(folder):
    return raster(folder / "dem.tif", mask=True, **PLACE), {"dem.tif.msk"}


def ascii_grid(folder):
    path = folder / "dem.asc"
    path.write_text(ASCII + "\n".join(" ".join(map(str, row)) for row in Z))
    (folder / "dem.prj").write_text(rasterio.crs.CRS.from_epsg(32632).to_wkt())
    return path, {"dem.prj"}


def envi(folder):
    return raster(folder / "dem.img", "ENVI", **PLACE), {"dem.hdr"}


def nested_virtual(folder):
    (folder / "tiles").mkdir()
    tile, sides = tiff_with_world_file(folder / "tiles")
    rasterio.shutil.copy(tile, folder / "inner.vrt", driver="VRT")
    text = (folder / "inner.vrt").read_text()
    outer = folder / "dem.vrt"
    outer.write_text(text.replace("tiles/dem.tif", "inner.vrt"))
    return outer, {"inner.vrt", "tiles/dem.tif"} | {f"tiles/{name}" for name in sides}


def shapefile(folder):
    frame = geopandas.GeoDataFrame({"h": [1.0]}, geometry=[box(0, 0, 9, 9)], crs="EPSG:32632")
    frame.to_file(folder / "scar.shp")
    (folder / "scar.prj").rename(folder / "scar.PRJ")
    return folder / "scar.shp", {"scar.shx", "scar.dbf", "scar.PRJ", "scar.cpg"}


def virtual_vector(folder):
    _, sides = shapefile(folder)
    path = folder / "scar.vrt"
    source = '<SrcDataSource relativeToVRT="1">scar.shp</SrcDataSource>'
    path.write_text(f'<OGRVRTDataSource><OGRVRTLayer name="scar">{source}</OGRVRTLayer></OGRVRTDataSource>')
    return path, {"scar.shp", *sides}


def geopackage(folder):
    path = folder / "scar.gpkg"
    geopandas.GeoDataFrame({"h": [1.0]}, geometry=[box(0, 0, 9, 9)], crs="EPSG:32632").to_file(path)
    (folder / "scar.gpkg-wal").write_bytes(b"changes")
    return path, {"scar.gpkg-wal"}


def binary_terrain(folder):
    rasterio.shutil.copy(raster(folder / "source.tif", **PLACE), folder / "dem.bt", driver="BT")
    return folder / "dem.bt", {"dem.prj", "dem.bt.aux.xml"} & set(os.listdir(folder))


def linked_geopackage(folder):
    (folder / "real").mkdir()
    path, _ = geopackage(folder / "real")
    (folder / "scar.gpkg").symlink_to(path)
    return folder / "scar.gpkg", {"real/scar.gpkg-wal"}


MAKERS = [
    *(tiff_with_world_file, tiff_with_mask, ascii_grid, envi, nested_virtual, shapefile, virtual_vector, geopackage),
    *(binary_terrain, linked_geopackage),
]


@pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)
def test_every_side_file_is_listed_and_a_change_of_any_of_them_is_noticed(make, tmp_path):
    path, sides = make(tmp_path)
    (tmp_path / "notes.txt").write_text("beside, and of no consequence")
    listed = files_of(path)
    assert listed[0] == path
    assert {os.path.relpath(p, tmp_path) for p in listed[1:]} == sides
    before = digest_files(files_of(path))
    for name in sorted(sides):
        side = tmp_path / name
        content = side.read_bytes()
        side.write_bytes(content + b" ")
        assert digest_files([*listed]) != before, name
        side.write_bytes(content)
    assert digest_files(files_of(path)) == before


def test_a_side_file_that_appears_or_goes_is_noticed(tmp_path):
    path = raster(tmp_path / "dem.tif", **PLACE)
    without = digest_files(files_of(path))
    (tmp_path / "dem.tif.aux.xml").write_text("<PAMDataset/>")
    assert digest_files(files_of(path)) != without
    (tmp_path / "dem.tif.aux.xml").unlink()
    assert digest_files(files_of(path)) == without


def test_overviews_count_for_nothing(tmp_path):
    path = raster(tmp_path / "dem.tif", **PLACE)
    with rasterio.Env(TIFF_USE_OVR=True), rasterio.open(path, "r+") as file:
        file.build_overviews([2])
    assert Path(f"{path}.ovr").is_file()
    assert files_of(path) == [path]


def test_virtual_files_that_name_each_other_end(tmp_path):
    text = '<VRTDataset rasterXSize="6" rasterYSize="5"><VRTRasterBand dataType="Float32" band="1"><SimpleSource>{}</SimpleSource>'
    text += "</VRTRasterBand></VRTDataset>"
    for own, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{own}.vrt").write_text(text.format(f'<SourceFilename relativetoVRT="1">{other}.vrt</SourceFilename>'))
    assert files_of(tmp_path / "a.vrt") == [tmp_path / "a.vrt", tmp_path / "b.vrt"]


def test_one_raster_of_several_in_a_file_depends_on_that_file(tmp_path):
    path = raster(tmp_path / "dem.tif", mask=True, **PLACE)
    assert files_of(f"GTIFF_DIR:1:{path}") == [path, tmp_path / "dem.tif.msk"]


def test_what_is_missing_or_no_raster_is_listed_alone(tmp_path):
    (tmp_path / "dem.tif").write_bytes(b"elevations")
    for name in ("dem.tif", "none.tif"):
        assert files_of(tmp_path / name) == [tmp_path / name]
