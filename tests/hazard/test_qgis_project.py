"""The project for QGIS: its layers exist, with the styles beside the rasters, and QGIS opens, draws, plays and prints it."""

import json
import os
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pyogrio
import pytest
import rasterio
from synthetic_ensemble import SHAPE, Products, make_site, make_table, write_all

from runout.hazard.maps import GROUPS, map_layers
from runout.hazard.products import write_products
from runout.hazard.writers.outlines import arrival_edges
from runout.hazard.writers.qgis_project import MOST_MEMBERS, OUTLINES, reached_box, shown_members
from runout.io import netcdf

QGIS = os.environ.get("RUNOUT_QGIS_PYTHON", "/usr/bin/python3")
SYSTEMS = pytest.mark.parametrize("system", ["products", "local_products"])


def project(path: Path) -> ElementTree.Element:
    """XML of a project."""
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == [f"{path.stem}.qgs"]
        return ElementTree.fromstring(archive.read(f"{path.stem}.qgs"))


def canonical(element: ElementTree.Element) -> str:
    """Text of XML without the blanks between elements."""
    return ElementTree.canonicalize(ElementTree.tostring(element), strip_text=True)


@pytest.fixture
def made(system: str, request: pytest.FixtureRequest) -> Products:
    return request.getfixturevalue(system)


@SYSTEMS
def test_each_layer_has_its_file_and_the_style_that_lies_beside_it(made: Products) -> None:
    root = project(made.results / "valley.qgz")
    layers = {layer.findtext("id"): layer for layer in root.iter("maplayer")}
    stored = pyogrio.read_dataframe(made.results / "outlines.gpkg", layer="layer_styles").set_index("f_table_name")["styleQML"]
    assert len(layers) == len(list(root.iter("maplayer"))), "no two layers have the same name"
    for name, layer in layers.items():
        if name.startswith("member_"):
            continue
        source, _, table = layer.findtext("datasource").partition("|layername=")
        assert source.startswith("./"), "relative, so that the folder can be moved"
        file = made.results / source
        assert file.is_file(), name
        if table:
            style = ElementTree.fromstring(stored[table].split("\n", 1)[1])
            assert layer.get("labelsEnabled") == style.get("labelsEnabled")
        elif name == "map_hillshade":
            assert layer.find("pipe/rasterrenderer").get("type") == "hillshade"
            continue
        else:
            style = ElementTree.parse(file.with_suffix(".qml")).getroot()
        for part in style:
            assert canonical(layer.find(part.tag)) == canonical(part), name
    rasters = {layer.stem for layer in map_layers(netcdf.read(made.results / "hazard.nc"))}
    assert rasters == {name.removeprefix("map_") for name in layers if name.startswith("map_")} - {"hillshade"}
    tables = {name for name, _ in pyogrio.list_layers(made.results / "outlines.gpkg")} - {"layer_styles"}
    assert tables == {name.removeprefix("outlines_") for name in layers if name.startswith("outlines_")}


@SYSTEMS
def test_groups_begin_with_outlines_and_end_with_the_hillshade_and_the_first_view_is_the_map_that_answers(made: Products) -> None:
    root = project(made.results / "valley.qgz")
    groups = root.findall("layer-tree-group/layer-tree-group")
    assert groups[0].get("name") == "Outlines and release"
    assert groups[-1].get("name") == "Terrain"
    assert {group.get("name") for group in groups[1:]} <= {*GROUPS.values(), "Members: largest flow thickness (3)"}
    nodes = [node for group in groups for node in group]
    assert nodes[-1].get("id") == "map_hillshade"
    shown = [node.get("id") for node in nodes if node.get("checked") == "Qt::Checked"]
    assert shown == ["outlines_release", "outlines_inundation", "outlines_obstacles", "map_inundation_probability", "map_hillshade"]
    box = [float(root.find("ProjectViewSettings/DefaultViewExtent").get(key)) for key in ("xmin", "ymin", "xmax", "ymax")]
    hazard = netcdf.read(made.results / "hazard.nc")
    assert box == pytest.approx(reached_box(hazard))
    y, x = np.nonzero(hazard["members_reached"].values > 0)
    assert box[0] < hazard["x"].values[x].min()
    assert box[3] > hazard["y"].values[y].max()


def test_the_system_is_that_of_the_site_and_local_coordinates_have_none(products: Products, local_products: Products) -> None:
    for path, code in ((products.results, "EPSG:32616"), (local_products.results, None)):
        systems = list(project(path / "valley.qgz").iter("spatialrefsys"))
        assert {system.findtext("authid") or None for system in systems} == {code}
        assert {bool(system.findtext("wkt")) for system in systems} == {code is not None}


def test_the_same_products_give_the_same_bytes(products: Products, tmp_path: Path) -> None:
    again = write_all(tmp_path, "EPSG:32616")
    for name in ("valley.qgz", "valley.kmz", "README.txt"):
        assert (again.results / name).read_bytes() == (products.results / name).read_bytes(), name
    assert not (again.results / "valley.qgz").stat().st_mode & 0o222, "a user's changes do not vanish in the next run"


def test_titles_of_users_are_text_and_not_xml_nor_expressions(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    title = 'A <b>"steep"</b> & [% 1 + 1 %] \x0b valley'
    settings = SimpleNamespace(**vars(site.settings) | {"title": title, "description": "<script>x</script>"})
    write_products(replace(site, settings=settings), results, make_table(), None)
    root = project(results / "valley.qgz")
    assert root.findtext("title") == title.replace("\x0b", "")
    label = next(item for item in root.iter("LayoutItem") if item.get("id") == "title").get("labelText")
    assert label == 'A <b>"steep"</b> & [ % 1 + 1 %]  valley'
    with zipfile.ZipFile(results / "valley.kmz") as archive:
        description = ElementTree.fromstring(archive.read("doc.kml")).findtext("*/{*}description")
    assert description.startswith("&lt;script&gt;"), "globes read it as HTML"


def test_rings_of_arrival_hold_each_cell_that_is_reached_once(products: Products) -> None:
    hazard = netcdf.read(products.results / "hazard.nc")
    rings = pyogrio.read_dataframe(products.results / "outlines.gpkg", layer="arrival")
    times, edges = hazard["first_arrival_time"].values, arrival_edges(hazard)
    cell = abs(float(np.diff(hazard["x"])[0] * np.diff(hazard["y"])[0]))
    assert rings.area.sum() == pytest.approx(np.isfinite(times).sum() * cell)
    for row in rings.itertuples():
        assert ((times >= row.from_s) & (times < row.to_s)).sum() * cell == pytest.approx(row.geometry.area)
        assert (row.reached_at - rings["reached_at"].iloc[0]).total_seconds() == row.from_s - rings["from_s"].iloc[0]
    assert edges[-1] > np.nanmax(times)


def test_each_valid_member_is_a_band_of_members_nc_and_the_median_one_is_named(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    write_products(site, results, make_table().iloc[::-1], None)
    layers = {layer.findtext("id"): layer for layer in project(results / "valley.qgz").iter("maplayer")}
    median = json.loads((results / "run.json").read_text())["representative_member"]
    for number in range(3):
        layer = layers[f"member_{number}"]
        source, band = layer.findtext("datasource"), int(layer.find("pipe/rasterrenderer").get("band"))
        assert source == 'NETCDF:"./members.nc":max_flow_thickness'
        with rasterio.open(source.replace("./members.nc", str(results / "members.nc"))) as raster:
            np.testing.assert_array_equal(
                raster.read(band), netcdf.read(results / "members" / f"000{number}.nc")["max_flow_thickness"]
            )
        friction = f"basal friction angle {12 + 2.5 * number:g}°"
        words = f"median run-out, {friction}" if number == median else friction
        assert layer.findtext("layername").lower() == f"member {number}: {words}"


def test_of_many_members_some_have_a_layer_among_them_the_median_one() -> None:
    ensemble = SimpleNamespace(files=dict.fromkeys(range(500)))
    shown = shown_members(SimpleNamespace(ensemble=ensemble, representative=333))
    assert 333 in shown
    assert MOST_MEMBERS / 2 < len(shown) <= MOST_MEMBERS + 1
    assert set(np.diff([number for number in shown if number != 333])) == {25}


@SYSTEMS
def test_what_opens_first_of_hazard_nc_is_a_map_of_one_band(made: Products) -> None:
    with rasterio.open(made.results / "hazard.nc") as file:
        listed = file.tags(ns="SUBDATASETS")  # in the order of the file, in which a GIS lists them
        first = [listed[f"SUBDATASET_{number}_NAME"] for number in range(1, 11)]
    assert first[0].endswith(":inundation_probability")
    for name in first:
        with rasterio.open(name) as raster:
            assert raster.count == 1, f"{name}: three bands would be drawn as red, green and blue"


@pytest.fixture(scope="session")
def qgis() -> str:
    """A Python that has QGIS."""
    try:
        subprocess.run([QGIS, "-c", "import qgis.core"], check=True, capture_output=True, env=without_ours())
    except (OSError, subprocess.CalledProcessError):
        pytest.skip(f"{QGIS} has no QGIS; set RUNOUT_QGIS_PYTHON to a Python that has it")
    return QGIS


def without_ours() -> dict[str, str]:
    """Environment of another Python."""
    return {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "PROJ_", "GDAL_"))}


def opened(qgis: str, path: Path, out: Path) -> dict:
    """What QGIS shows of a project."""
    command = [qgis, str(Path(__file__).with_name("open_in_qgis.py")), str(path), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True, env=without_ours())
    return json.loads(done.stdout.splitlines()[-1])


@SYSTEMS
def test_qgis_opens_draws_plays_and_prints_the_project(made: Products, qgis: str, tmp_path: Path) -> None:
    before = {path: path.read_bytes() for path in made.paths}
    shown = opened(qgis, made.results / "valley.qgz", tmp_path)
    assert shown["read"]
    assert (shown["error"], shown["invalid"]) == ("", [])
    code = made.site.crs or ""
    assert (shown["crs_valid"], shown["crs"], shown["layer_crs"]) == (bool(code), code, [code])
    assert shown["title"] == "A made-up valley"
    assert shown["visible"][0] == OUTLINES["release"][1]
    assert shown["visible"][-1] == "Hillshade"
    assert shown["styles"]["map_inundation_probability"] == "singlebandpseudocolor"
    assert shown["styles"]["map_hillshade"] == "hillshade"
    assert shown["styles"]["outlines_arrival"] == "graduatedSymbol"
    assert shown["pixels"] > 10_000
    early, middle, late = shown["arrival"]
    assert 0 < early < middle < late
    assert shown["step"][1] == "seconds"
    items = shown["layouts"]["A4 landscape"]
    for item in ("Map", "Legend", "ScaleBar", "Picture", "Label"):
        assert f"QgsLayoutItem{item}" in items
    assert (tmp_path / "layout.pdf").read_bytes().startswith(b"%PDF")
    assert before == {path: path.read_bytes() for path in made.paths}, "products are as they were"


def test_snapshots_of_a_member_are_rasters_and_layers_of_their_time(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    terrain, times, frames = site.terrain(), [0.0, 2.5, 10.0], np.random.default_rng(2).random((3, *SHAPE), np.float32)
    for file in (results / "members").glob("*.nc"):
        group = netcdf.map_dataset(terrain, {}, title="snapshots").assign_coords(time=("time", times))
        netcdf.add_map(group, "flow_thickness", frames, ("time",))
        netcdf.write(netcdf.read(file), file, groups={"snapshots": group})
    write_products(site, results, make_table(), None)
    layers = {layer.findtext("id"): layer for layer in project(results / "valley.qgz").iter("maplayer")}
    spans = []
    for time, frame in zip(times, frames, strict=True):
        layer = layers[f"snapshot_{time:g}"]
        with rasterio.open(results / layer.findtext("datasource")) as raster:
            np.testing.assert_array_equal(raster.read(1), frame)
        fixed = layer.find("temporal[@mode='0']/fixedRange")
        spans.append((fixed.findtext("start"), fixed.findtext("end")))
    starts = ["2000-01-01T00:00:00Z", "2000-01-01T00:00:02.500000Z", "2000-01-01T00:00:10Z"]
    assert spans == list(zip(starts, [*starts[1:], "2000-01-01T00:00:17.500000Z"], strict=True))
    assert "maps/snapshots/" in (results / "README.txt").read_text()
    for file in (results / "members").glob("*.nc"):
        netcdf.write(netcdf.read(file), file)
    write_products(site, results, make_table(), None)
    assert not list((results / "maps" / "snapshots").glob("*"))
