"""The copy of an input reads as the original, needs no file outside of its folder, and does not change when the original does."""

import contextlib
import os
import shutil
import sqlite3
import subprocess
import sys

import geopandas
import netCDF4
import numpy as np
import pytest
import rasterio
import rasterio.shutil
from rasterio.transform import from_origin
from shapely import box

from runout import Terrain
from runout.errors import InputError
from runout.io import input_copies, opening
from runout.io.input_copies import copy_raster, copy_vector, raster_difference, vector_difference
from runout.io.opening import open_raster, open_vector

Z = (np.add.outer(np.arange(20.0), np.arange(30.0)) + 100.0).astype("float32")
PLACE = {"transform": from_origin(500000, 5000200, 10, 10), "crs": "EPSG:32632"}
WORLD = "10\n0\n0\n-10\n500005\n5000195\n"

pytestmark = pytest.mark.filterwarnings("ignore")


def tiff(path, mask=None, values=Z, **place):
    path.parent.mkdir(parents=True, exist_ok=True)
    shape = {"height": 20, "width": 30, "count": 1, "dtype": "float32"}
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open(path, "w", driver="GTiff", **shape, **place) as file:
        file.write(values, 1)
        if mask is not None:
            file.write_mask(mask)
    return path


def of_driver(folder, driver, name, **choices):
    rasterio.shutil.copy(tiff(folder / "source" / "source.tif", **PLACE), folder / name, driver=driver, **choices)
    return folder / name


def with_world_file(folder, name, suffix):
    (folder / "g").with_suffix(suffix).write_text(WORLD)
    return tiff(folder / name, crs="EPSG:32632")


def with_mask(folder):
    return tiff(folder / "g.tif", mask=Z > 110, **PLACE)


def with_scale(folder):
    band = "<PAMRasterBand band='1'><UnitType>m</UnitType><Offset>100</Offset><Scale>0.5</Scale></PAMRasterBand>"
    (folder / "g.tif.aux.xml").write_text(f"<PAMDataset>{band}</PAMDataset>")
    return tiff(folder / "g.tif", **PLACE)


def grid_with_system(folder):
    path = of_driver(folder, "AAIGrid", "G.ASC")
    assert (folder / "G.prj").is_file()
    return path


def tile_named_by_its_place(folder):
    """An SRTM tile: its name is its place."""
    heights = np.add.outer(np.arange(1201) % 50, np.arange(1201) % 70).astype("int16")
    place = {"transform": from_origin(10 - 1 / 2400, 47 + 1 / 2400, 1 / 1200, 1 / 1200), "crs": "EPSG:4326"}
    with rasterio.open(folder / "t.tif", "w", driver="GTiff", height=1201, width=1201, count=1, dtype="int16", **place) as file:
        file.write(heights, 1)
    rasterio.shutil.copy(folder / "t.tif", folder / "N46E010.hgt", driver="SRTMHGT")
    return folder / "N46E010.hgt"


def netcdf(folder):
    with netCDF4.Dataset(folder / "g.nc", "w") as file:
        for name, values in {"y": 5000195.0 - 10 * np.arange(20), "x": 500005.0 + 10 * np.arange(30)}.items():
            file.createDimension(name, len(values))
            file.createVariable(name, "f8", (name,))[:] = values
            file[name].standard_name = f"projection_{name}_coordinate"
        for name, values in {"elevation": Z, "soil": Z * 0 + 1}.items():
            file.createVariable(name, "f4", ("y", "x"))[:] = values
            file[name].grid_mapping = "crs"
        file.createVariable("crs", "i4").crs_wkt = rasterio.crs.CRS.from_epsg(32632).to_wkt()
    return folder / "g.nc"


def link(folder):
    (folder / "g.tif").symlink_to(tiff(folder / "elsewhere" / "real.tif", **PLACE))
    return folder / "g.tif"


def virtual(folder, source="tiles/a.tif", relative=1, name="g.vrt", more=""):
    path = tiff(folder / "tiles" / "a.tif", **PLACE)
    text = (
        f'<VRTDataset rasterXSize="30" rasterYSize="20"><SRS>EPSG:32632</SRS><GeoTransform>500000,10,0,5000200,0,-10</GeoTransform>'
        f'<VRTRasterBand dataType="Float32" band="1">{more}<SimpleSource><SourceFilename relativeToVRT="{relative}">'
        f"{source if relative else path}</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"
    )
    (folder / name).write_text(text)
    return folder / name


def virtual_of_a_virtual(folder):
    return virtual(folder, virtual(folder, name="inner.vrt").name)


RASTERS = {
    "tfw": lambda f: with_world_file(f, "g.tif", ".tfw"),
    "tifw": lambda f: with_world_file(f, "g.tif", ".tifw"),
    "wld": lambda f: with_world_file(f, "g.tif", ".wld"),
    "upper case": lambda f: with_world_file(f, "g.TIF", ".TFW"),
    "mask": with_mask,
    "scale": with_scale,
    "system": grid_with_system,
    "SAGA": lambda f: of_driver(f, "SAGA", "g.sdat"),
    "Idrisi": lambda f: of_driver(f, "RST", "g.rst"),
    "EHdr": lambda f: of_driver(f, "EHdr", "g.bil"),
    "floats": lambda f: of_driver(f, "EHdr", "g.flt"),
    "ENVI": lambda f: of_driver(f, "ENVI", "g"),
    "Erdas": lambda f: of_driver(f, "HFA", "g.img", USE_SPILL="YES"),
    "Surfer": lambda f: of_driver(f, "GSAG", "g.grd"),
    "BT": lambda f: of_driver(f, "BT", "g.bt"),
    "XYZ": lambda f: of_driver(f, "XYZ", "g.xyz"),
    "GeoPackage": lambda f: of_driver(f, "GPKG", "g.gpkg"),
    "SRTM": tile_named_by_its_place,
    "link": link,
    "odd name": lambda f: tiff(f / "a;b #ä [1]%20!.tif", **PLACE),
    "VRT": virtual,
    "VRT, absolute": lambda f: virtual(f, relative=0),
    "VRT of a VRT": virtual_of_a_virtual,
    "VRT, scaled": lambda f: virtual(f, more="<UnitType>m</UnitType><Offset>10</Offset><Scale>0.5</Scale>"),
}


@pytest.fixture
def target(tmp_path):
    (tmp_path / "copies").mkdir()
    return tmp_path / "copies"


@pytest.mark.parametrize("kind", RASTERS)
def test_the_copy_of_a_raster_reads_as_the_original_when_that_is_gone(kind, tmp_path, target):
    (tmp_path / "original").mkdir()
    source = RASTERS[kind](tmp_path / "original")
    with open_raster(source, InputError) as dataset:
        values, transform, crs, scales = dataset.read(1, masked=True), dataset.transform, dataset.crs, dataset.scales
    name = copy_raster(str(source), target, "dem")
    shutil.rmtree(tmp_path / "original")
    assert name.startswith("dem")
    with open_raster(target / name, InputError) as copy:
        found = copy.read(1, masked=True)
        assert (copy.transform, copy.crs, copy.scales) == (transform, crs, scales)
    np.testing.assert_array_equal(np.ma.getmaskarray(found), np.ma.getmaskarray(values))
    np.testing.assert_array_equal(found.filled(0), values.filled(0))


def test_a_netcdf_file_is_copied_to_the_byte(tmp_path, target):
    source = netcdf(tmp_path)
    assert copy_raster(str(source), target, "dem") == "dem.nc"
    assert (target / "dem.nc").read_bytes() == source.read_bytes()


@pytest.mark.parametrize("quoted", ['NETCDF:"{}":elevation', "NETCDF:{}:elevation"])
def test_a_variable_of_a_file_is_named_in_the_copy(quoted, tmp_path, target):
    source = netcdf(tmp_path)
    assert copy_raster(quoted.format(source), target, "dem") == quoted.format("dem.nc")
    source.unlink()
    np.testing.assert_array_equal(Terrain.from_raster(quoted.format(target / "dem.nc")).elevation, Z)


def test_a_file_whose_path_is_a_letter_of_its_prefix_is_found(tmp_path, monkeypatch):
    netcdf(tmp_path).rename(tmp_path / "C")
    monkeypatch.chdir(tmp_path)
    np.testing.assert_array_equal(Terrain.from_raster('NETCDF:"C":elevation').elevation, Z)


def test_the_copy_of_a_virtual_raster_names_copies_of_its_sources(tmp_path, target):
    assert copy_raster(str(virtual_of_a_virtual(tmp_path)), target, "dem") == "dem.vrt"
    with open_raster(target / "dem.vrt", InputError) as copy:
        assert copy.files == [str(target / "dem.vrt"), str(target / "dem" / "1.vrt")]
    assert (target / "dem" / "1" / "1.tif").is_file()


def test_tiles_of_a_virtual_raster_keep_their_masks(tmp_path, target):
    (tmp_path / "tiles").mkdir()
    with_mask(tmp_path / "tiles").rename(tmp_path / "tiles" / "a.tif")
    mask = next((tmp_path / "tiles").glob("*.msk"))
    mask.rename(mask.with_name("a.tif.msk"))
    text = (
        '<VRTDataset rasterXSize="30" rasterYSize="20"><SRS>EPSG:32632</SRS><GeoTransform>500000,10,0,5000200,0,-10</GeoTransform>'
    )
    band = '<SimpleSource><SourceFilename relativeToVRT="1">tiles/a.tif</SourceFilename><SourceBand>{}</SourceBand></SimpleSource>'
    bands = f'<VRTRasterBand dataType="Float32" band="1">{band.format(1)}</VRTRasterBand><MaskBand><VRTRasterBand dataType="Byte">'
    (tmp_path / "g.vrt").write_text(f"{text}{bands}{band.format('mask,1')}</VRTRasterBand></MaskBand></VRTDataset>")
    name = copy_raster(str(tmp_path / "g.vrt"), target, "dem")
    assert (target / "dem" / "1.tif.msk").is_file()
    with open_raster(target / name, InputError) as copy, open_raster(tmp_path / "g.vrt", InputError) as original:
        masks = [np.ma.getmaskarray(raster.read(1, masked=True)) for raster in (copy, original)]
    assert masks[0].any()
    np.testing.assert_array_equal(*masks)


def test_a_virtual_raster_of_a_nation_is_cut_by_the_user(tmp_path, target):
    path = virtual(tmp_path)
    path.write_text(path.read_text().replace('rasterXSize="30" rasterYSize="20"', 'rasterXSize="200000" rasterYSize="100000"'))
    with pytest.raises(InputError, match=r"has 200000 x 100000 cells, more than are copied .*; cut it: `gdal_translate -projwin"):
        copy_raster(str(path), target, "dem")
    assert not list(target.iterdir())


def test_a_virtual_raster_with_a_source_elsewhere_is_refused(tmp_path, target):
    (tmp_path / "inner").mkdir()
    tiff(tmp_path / "secret.tif", **PLACE)
    path = virtual(tmp_path / "inner", "../secret.tif")
    with pytest.raises(InputError, match="lies outside"):
        copy_raster(str(path), target, "dem")


def test_a_source_with_metadata_is_a_geotiff(tmp_path):
    path = virtual(tmp_path)
    with rasterio.open(tmp_path / "tiles" / "a.tif", "r+") as file:
        file.update_tags(1, mean="110")
    assert b"<GDALMetadata>" in (tmp_path / "tiles" / "a.tif").read_bytes()
    np.testing.assert_array_equal(Terrain.from_raster(path).elevation, Z)


def frame(**attributes):
    geometry = [box(500040, 5000040, 500080, 5000080), box(500100, 5000040, 500140, 5000080)]
    return geopandas.GeoDataFrame({"h": [4.0, 5.0], **attributes}, geometry=geometry, crs="EPSG:32632")


def vector(folder, name, **choices):
    folder.mkdir(exist_ok=True)
    frame().to_file(folder / f"plain{os.path.splitext(name)[1]}", engine="pyogrio", **choices)
    for part in list(folder.iterdir()):
        part.rename(folder / part.name.replace("plain", os.path.splitext(name)[0], 1))
    return folder / name


def shapefile_in_upper_case(folder):
    path = vector(folder, "x.shp")
    for part in list(folder.iterdir()):
        part.rename(folder / part.name.upper())
    return path.with_name("X.SHP")


VECTORS = {
    "GeoPackage": (lambda f: vector(f, "x.gpkg"), "release.gpkg"),
    "odd name": (lambda f: vector(f, "a;b #ä [1]%20.gpkg"), "release.gpkg"),
    "odd shapefile": (lambda f: vector(f, "a;b.c.shp"), "release.shp"),
    "upper case": (shapefile_in_upper_case, "release.shp"),
    "code page": (lambda f: vector(f, "x.shp", encoding="ISO-8859-1"), "release.shp"),
    "GeoJSON": (lambda f: vector(f, "x.geojson"), "release.geojson"),
    "FlatGeobuf": (lambda f: vector(f, "x.fgb"), "release.fgb"),
    "geodatabase": (lambda f: vector(f, "x.gdb", driver="OpenFileGDB", layer="rel"), "release.gdb"),
}


@pytest.mark.parametrize("kind", VECTORS)
def test_the_copy_of_a_vector_file_reads_as_the_original_when_that_is_gone(kind, tmp_path, target):
    make, expected = VECTORS[kind]
    source = make(tmp_path / "original")
    assert copy_vector(str(source), target, "release") == expected
    shutil.rmtree(tmp_path / "original")
    file = open_vector(target / expected, InputError)
    found = file.read(file.layers()[0])[0].sort_values("h", ignore_index=True)  # FlatGeobuf has an order of its own
    assert found.crs == frame().crs
    assert found.geometry.geom_equals(frame().geometry).all()
    assert found["h"].tolist() == [4.0, 5.0]


def test_layers_that_are_not_used_are_not_read(tmp_path, target, monkeypatch):
    frame().to_file(tmp_path / "x.gpkg", layer="release", engine="pyogrio")
    frame(h=[1.0, 2.0]).loc[[0, 1, 1]].to_file(tmp_path / "x.gpkg", layer="parcels", engine="pyogrio")
    monkeypatch.setattr(opening, "MOST_FEATURES", 2)
    with pytest.raises(InputError, match="has 3 features"):
        copy_vector(str(tmp_path / "x.gpkg"), target, "all")
    assert copy_vector(str(tmp_path / "x.gpkg"), target, "release", "release") == "release.gpkg"


def edited_in_its_journal(path):
    """Open connection to a GeoPackage whose last change of h to 7 is in its -wal file only."""
    frame().to_file(path, layer="rel", engine="pyogrio")
    database = sqlite3.connect(path)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA wal_autocheckpoint=0")
    for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type='trigger'").fetchall():
        database.execute(f'DROP TRIGGER "{name}"')
    database.execute("UPDATE rel SET h=7")
    database.commit()
    return contextlib.closing(database)


@pytest.mark.parametrize("through", ["file", "link"])
def test_a_geopackage_that_is_open_is_copied_with_its_last_saved_change(through, tmp_path, target):
    path = tmp_path / "x.gpkg"
    with edited_in_its_journal(path) as database:
        if through == "link":
            (tmp_path / "other").mkdir()
            path = tmp_path / "other" / "link.gpkg"
            path.symlink_to(tmp_path / "x.gpkg")
        assert copy_vector(str(path), target, "release") == "release.gpkg"
        database.execute("UPDATE rel SET h=9")
        database.commit()
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    assert [p.name for p in target.iterdir()] == ["release.gpkg"]
    assert geopandas.read_file(target / "release.gpkg")["h"].tolist() == [7.0, 7.0]
    assert [p.name for p in target.iterdir()] == ["release.gpkg"]


def test_a_geopackage_that_is_being_written_is_refused_at_once(tmp_path, target):
    path = vector(tmp_path / "original", "x.gpkg")
    code = (
        "import sqlite3, sys; d = sqlite3.connect(sys.argv[1]); d.execute('BEGIN EXCLUSIVE'); print('locked', flush=True); input()"
    )
    with subprocess.Popen([sys.executable, "-c", code, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "locked\n"
        with pytest.raises(InputError, match="locked"):
            input_copies._copy_database(path, target / "release.gpkg")
        other.communicate("\n")
    assert copy_vector(str(path), target, "release") == "release.gpkg"


def test_a_file_that_changes_while_it_is_copied_is_refused(tmp_path, target, monkeypatch):
    path = with_mask(tmp_path)

    def other(source, copy):
        copy.write_bytes(source.read_bytes() + b" ")

    monkeypatch.setattr(shutil, "copyfile", other)
    with pytest.raises(InputError, match="changed while it was copied; close it in other programs and try again"):
        copy_raster(str(path), target, "dem")


def test_a_copy_that_reads_otherwise_is_refused(tmp_path, target, monkeypatch):
    path = with_mask(tmp_path)
    monkeypatch.setattr(input_copies, "files_of", lambda source: [path])
    with pytest.raises(InputError, match=r"another content than the file \(values of band 1\)"):
        copy_raster(str(path), target, "dem")
    assert not [p for p in target.rglob("*") if p.is_file()]


def test_an_unreadable_side_file_is_named(tmp_path, target, monkeypatch):
    path = with_mask(tmp_path)
    copyfile = shutil.copyfile

    def refused(source, copy):
        if source.suffix == ".msk":
            raise PermissionError(13, "Permission denied", str(source))
        copyfile(source, copy)

    monkeypatch.setattr(shutil, "copyfile", refused)
    with pytest.raises(InputError, match=r"g\.tif\.msk: cannot be read \(Permission denied\)"):
        copy_raster(str(path), target, "dem")


def test_each_difference_of_two_rasters_is_found(tmp_path):
    base = tiff(tmp_path / "base.tif", **PLACE)
    others = {
        "crs": {**PLACE, "crs": "EPSG:32633"},
        "georeference": {**PLACE, "transform": from_origin(500000.001, 5000200, 10, 10)},
        "values of band 1": {**PLACE, "values": np.where(Z == 120, Z + 1e-4, Z)},
    }
    for number, (difference, choices) in enumerate(others.items()):
        assert raster_difference(str(base), str(tiff(tmp_path / f"{number}.tif", **choices))) == difference
    assert raster_difference(str(base), str(tiff(tmp_path / "mask.tif", mask=Z > 110, **PLACE))) == "values of band 1"
    assert raster_difference(str(base), str(tiff(tmp_path / "same.tif", **PLACE))) == ""


def test_each_difference_of_two_vector_files_is_found(tmp_path):
    others = {
        "": frame(),
        "coordinate system": frame().set_crs("EPSG:32633", allow_override=True),
        "geometries": frame().set_geometry(frame().translate(1e-3)),
        "attributes": frame(h=[4.0, np.nan]),
    }
    frame().to_file(tmp_path / "base.gpkg", layer="x")
    for number, (difference, other) in enumerate(others.items()):
        other.to_file(tmp_path / f"{number}.gpkg", layer="x")
        assert vector_difference(str(tmp_path / "base.gpkg"), str(tmp_path / f"{number}.gpkg")) == difference
    frame().to_file(tmp_path / "base.gpkg", layer="y")
    assert vector_difference(str(tmp_path / "base.gpkg"), str(tmp_path / "0.gpkg")) == "layers"
