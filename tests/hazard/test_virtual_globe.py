"""The file for globes: readable by GDAL, and its picture lies where the cells are."""

import io
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import geopandas as gpd
import numpy as np
import pytest
import rasterio
from PIL import Image
from pyproj import Transformer
from synthetic_ensemble import Products, make_site, make_table

from runout.hazard.maps import classes_of
from runout.hazard.products import write_products
from runout.io import netcdf

KML = "{http://www.opengis.net/kml/2.2}"


def parts(products: Products) -> dict[str, bytes]:
    """Files of the archive by name."""
    with zipfile.ZipFile(products.results / "valley.kmz") as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_each_cell_has_its_colour_at_its_place_on_the_globe(products: Products) -> None:
    contents = parts(products)
    root = ElementTree.fromstring(contents["doc.kml"])
    west, south, east, north = (float(next(root.iter(f"{KML}{side}")).text) for side in ("west", "south", "east", "north"))
    picture = np.asarray(Image.open(io.BytesIO(contents["map.png"])))
    hazard = netcdf.read(products.results / "hazard.nc")
    painted = classes_of(hazard, "inundation_probability").painted(hazard["inundation_probability"].values)
    x, y = np.meshgrid(hazard["x"].values, hazard["y"].values)
    longitude, latitude = Transformer.from_crs("EPSG:32616", "EPSG:4326", always_xy=True).transform(x, y)
    rows = np.floor((north - latitude) / (north - south) * picture.shape[0]).astype(int)
    columns = np.floor((longitude - west) / (east - west) * picture.shape[1]).astype(int)
    coloured = painted[..., 3] > 0
    assert coloured.any()
    inside = (rows >= 0) & (rows < picture.shape[0]) & (columns >= 0) & (columns < picture.shape[1])
    assert inside[coloured].all()
    np.testing.assert_array_equal(picture[rows[inside], columns[inside]], painted[inside])


def test_gdal_reads_the_outlines_where_they_are(products: Products, tmp_path: Path) -> None:
    (tmp_path / "doc.kml").write_bytes(parts(products)["doc.kml"])
    for layer, title in (("release", "Release"), ("inundation", "Outlines of the probability")):
        read = gpd.read_file(tmp_path / "doc.kml", layer=title)
        expected = gpd.read_file(products.results / "outlines.gpkg", layer=layer)
        assert len(read) == len(expected) > 0
        areas = read.set_crs("EPSG:4326", allow_override=True).to_crs(expected.crs)
        for ours, theirs in zip(areas.geometry, expected.geometry, strict=True):
            assert ours.symmetric_difference(theirs).area < 1e-3 * theirs.area
    assert read["Name"].tolist()[0] == "5 % or more"


def test_it_has_a_legend_and_names_only_files_that_it_holds(products: Products) -> None:
    contents = parts(products)
    assert next(iter(contents)) == "doc.kml", "globes open the first one"
    named = {icon.text for icon in ElementTree.fromstring(contents["doc.kml"]).iter(f"{KML}href")}
    assert named == {"legend.png", "map.png"} == set(contents) - {"doc.kml"}
    assert Image.open(io.BytesIO(contents["legend.png"])).size[0] > 150


def test_local_coordinates_have_no_place_on_a_globe_and_the_readme_says_so(local_products: Products) -> None:
    assert not list(local_products.results.glob("*.kmz"))
    assert "valley.kmz" in (readme := (local_products.results / "README.txt").read_text())
    assert "Not written" in readme


def test_the_file_of_an_earlier_system_vanishes_and_those_of_users_stay(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    site, results = make_site(tmp_path)
    write_products(site, results, make_table(), None)
    own = results / "mine.kmz"
    own.write_bytes(b"")
    assert (results / "valley.kmz").is_file()
    for member in (results / "members").glob("*.nc"):
        member.unlink()
    (tmp_path / "local").mkdir()
    local, there = make_site(tmp_path / "local", None)
    for path in (there / "members").iterdir():
        path.replace(results / "members" / path.name)
    with caplog.at_level("INFO"):
        write_products(local, results, make_table(), None)
    assert not (results / "valley.kmz").exists()
    assert own.exists()
    assert "valley.kmz is not written: the elevation has no coordinate reference system" in caplog.text


def test_the_readme_names_each_main_map_and_each_folder(products: Products) -> None:
    text = (products.results / "README.txt").read_text()
    names = [path.relative_to(products.results) for path in products.paths if path.suffix != ".qml"]
    for path in names:
        top = path.parts[0] if path.parts[0] != "maps" else path.parts[1] + ("/" if len(path.parts) > 2 else "")
        assert top in text or top == "README.txt", path
    assert "3 of 5 members are valid" in text
    assert "They are not annual probabilities" in " ".join(text.split())
    assert max(map(len, text.splitlines())) <= 120
    assert "structures.nc" not in text, "only what is there"
    with rasterio.open(products.results / "maps" / "peak_pressure.tif") as raster:
        assert f"any member [{raster.units[0]}]" in text


def test_twelve_maps_at_most_lie_in_front(products: Products) -> None:
    front = sorted(path.stem for path in (products.results / "maps").glob("*.tif"))
    assert "inundation_probability" in front
    assert 8 <= len(front) <= 12
    assert len(list((products.results / "maps").rglob("*.tif"))) > 3 * len(front)
