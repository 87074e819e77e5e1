"""A vector file from elsewhere reaches neither the network nor other files; every reader of the project uses the one way in."""

import ast
import contextlib
import json
import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from hostile_files import geojson

from runout import ReleaseError, Terrain
from runout.model.release import Release

ROOT = Path(__file__).parents[2]
OWN_PRODUCTS = {  # modules that open what runout itself wrote
    "runout/io/netcdf.py",
    "runout/io/member_maps.py",
    "runout/io/geotiff.py",
    "runout/report/study.py",
    "runout/report/structures.py",
    "runout/hazard/members.py",
    "runout/hazard/merging.py",
    "runout/hazard/writers/qgis_project.py",
    "runout/hazard/writers/virtual_globe.py",
    "runout/hazard/structure_products.py",
    "runout/hazard/probe_series.py",
    "runout/view/film.py",
    "runout/ensemble/member.py",
}
LIBRARY_CALLS = ("rasterio.open", "geopandas.read_file", "gpd.read_file")
OPENERS = {"open_dataset", "open_dataarray", "Dataset", "read_dataframe", "read_info", "list_layers", "DatasetReader", "MemoryFile"}


@pytest.fixture
def terrain():
    return Terrain.from_array(np.add.outer(np.arange(20.0), np.arange(20.0)), 10.0)


def refused(path, terrain, words=None):
    with pytest.raises(ReleaseError, match=words):
        Release.from_vector(path, terrain, thickness=1.0)


@pytest.mark.parametrize("kind", ["link", "url", "LINK"])
@pytest.mark.parametrize("place", ["collection", "geometry", "escaped"])
def test_a_coordinate_system_behind_a_link_is_not_fetched(tmp_path, terrain, listener, kind, place):
    link = {"type": kind, "properties": {"href": f"{listener.url}/crs", "url": f"{listener.url}/crs"}}
    content = geojson(**({} if place == "geometry" else {"crs": link}))
    if place == "geometry":
        content["features"][0]["geometry"]["crs"] = link
    text = json.dumps(content)
    (tmp_path / "a.geojson").write_text(text.replace('"crs"', '"\\u0063rs"') if place == "escaped" else text, encoding="utf-8")
    refused(tmp_path / "a.geojson", terrain, "its coordinate system is a link")
    assert not listener.was_contacted()


@pytest.mark.parametrize(
    "text",
    [
        '<OGRVRTDataSource><OGRVRTLayer name="x"><SrcDataSource>{}/x.geojson</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>',
        "<OGRWFSDataSource><URL>{}/wfs</URL></OGRWFSDataSource>",
        "<kml><NetworkLink><Link><href>{}/x.kml</href></Link></NetworkLink></kml>",
        "{}/x.geojson",
    ],
)
@pytest.mark.parametrize("name", ["a.geojson", "a.gpkg", "a.shp", "a.vrt"])
def test_a_file_that_names_a_service_contacts_nobody(tmp_path, terrain, listener, text, name):
    (tmp_path / name).write_text(text.format(listener.url), encoding="utf-8")
    refused(tmp_path / name, terrain, "cannot be read as a vector file")
    assert not listener.was_contacted()


@pytest.mark.parametrize("name", ["{}/x.geojson", "/vsicurl/{}/x.shp", "WFS:{}/wfs", "PG:dbname=x", "zip+{}/x.zip"])
def test_names_of_services_are_no_files(terrain, listener, name):
    refused(name.format(listener.url), terrain, "no such file")
    assert not listener.was_contacted()


@pytest.fixture
def geopackage(tmp_path):
    """Path of a GeoPackage of one square, layer "release"."""
    frame = geopandas.GeoDataFrame({"depth": [4.0]}, geometry=[shapely.box(40, 40, 80, 80)], crs="EPSG:32632")
    frame.to_file(tmp_path / "release.gpkg", layer="release", engine="pyogrio")
    return tmp_path / "release.gpkg"


def test_a_plain_geopackage_is_read_and_one_with_a_view_for_a_layer_is_not(geopackage, terrain):
    assert Release.from_vector(geopackage, terrain, thickness=1.0).volume == pytest.approx(1600.0)
    with sqlite3.connect(geopackage) as database:
        database.execute("CREATE VIEW seen AS SELECT * FROM release")
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES ('seen', 'features', 'seen', 32632)"
        )
    refused(geopackage, terrain, "layer 'seen' is a view; write it as a table")


def test_a_view_that_is_only_in_the_journal_of_a_geopackage_is_refused(geopackage, terrain):
    with contextlib.closing(sqlite3.connect(geopackage)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA wal_autocheckpoint=0")
        database.execute("CREATE VIEW seen AS SELECT * FROM release")
        columns = "(table_name, data_type, identifier, srs_id)"
        database.execute(f"INSERT INTO gpkg_contents {columns} VALUES ('seen', 'features', 'seen', 32632)")
        database.commit()
        refused(geopackage, terrain, "layer 'seen' is a view; write it as a table")


def test_a_geopackage_whose_journal_cannot_be_read_is_refused(geopackage, terrain, monkeypatch):
    def refusing(*_, **__):
        raise sqlite3.OperationalError("unable to open database file")

    geopackage.with_name("release.gpkg-wal").write_bytes(b"changes")
    monkeypatch.setattr(sqlite3, "connect", refusing)  # as SQLite does in a folder that cannot be written
    refused(geopackage, terrain, "unable to open database file.*; close it in other programs, or copy it and its -wal file")


def test_a_geopackage_with_a_virtual_table_is_refused(geopackage, terrain):
    with sqlite3.connect(geopackage) as database:
        database.execute("PRAGMA writable_schema = ON")
        statement = "CREATE VIRTUAL TABLE other USING VirtualOGR(''/etc/passwd'')"
        database.execute(f"INSERT INTO sqlite_master VALUES ('table', 'other', 'other', 0, '{statement}')")
    refused(geopackage, terrain, "virtual table|cannot be read")


@pytest.mark.parametrize("name", ["a.gpkg", "a.shp", "a.geojson"])
def test_a_named_pipe_is_refused_at_once(tmp_path, terrain, name):
    os.mkfifo(tmp_path / name)
    refused(tmp_path / name, terrain, "is a named pipe")


def test_a_named_pipe_beside_the_file_is_refused_at_once(tmp_path, terrain):
    frame = geopandas.GeoDataFrame({"depth": [4.0]}, geometry=[shapely.box(40, 40, 80, 80)], crs="EPSG:32632")
    frame.to_file(tmp_path / "a.shp", engine="pyogrio")
    (tmp_path / "a.prj").unlink()
    os.mkfifo(tmp_path / "a.prj")
    refused(tmp_path / "a.shp", terrain, r"a\.prj: is a named pipe")


def test_formats_that_reach_services_are_not_loaded():
    code = (
        "from pathlib import Path; from runout.io.opening import open_vector; import sys\n"
        "open_vector(Path(sys.argv[1]), ValueError).layers(); import pyogrio\n"
        "print({'WFS', 'OGR_VRT', 'HTTP', 'OAPIF', 'GPSBabel'} & set(pyogrio.list_drivers()))"
    )
    path = ROOT / "sites" / "jacksboro" / "inputs" / "release.gpkg"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code, str(path)], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_rasters_and_vectors_are_opened_in_one_place():
    strays = []
    for path in sorted([*(ROOT / "runout").rglob("*.py"), *(ROOT / "pipelines").rglob("*.py")]):
        place = path.relative_to(ROOT).as_posix()
        if place == "runout/io/opening.py" or place in OWN_PRODUCTS:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            function = node.func if isinstance(node, ast.Call) else None
            name = getattr(function, "attr", getattr(function, "id", ""))
            if name in OPENERS or (name in ("open", "read_file") and ast.unparse(function) in LIBRARY_CALLS):
                strays.append(f"{place}:{node.lineno}: {ast.unparse(function)}")
    assert [stray for stray in strays if not stray.endswith("xr.Dataset")] == []  # that one is made, not opened
