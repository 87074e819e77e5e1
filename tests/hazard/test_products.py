import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import geopandas as gpd
import netCDF4
import numpy as np
import pyogrio
import pytest
import rasterio
from synthetic_ensemble import (
    FAILED,
    MARKER,
    MEMBERS,
    MISSING,
    SHAPE,
    Products,
    make_site,
    make_table,
    make_terrain,
    member_maps,
    write_member,
)

from runout.errors import ExitCode, PartialEnsembleError, StorageError
from runout.hazard.figures import FIGURES
from runout.hazard.maps import BOUNDARY_MAPS, CELL_ERRORS, HEADLINE_MAPS, TERRAIN_MAPS, map_layers
from runout.hazard.members import Ensemble, members_file
from runout.hazard.products import ground_slope, write_products
from runout.hazard.reach import representative
from runout.io import netcdf
from runout.io.member_maps import MemberMaps
from runout.model.terrain import Terrain
from runout.quantities import QUANTITIES
from runout.variables import VARIABLES

SYSTEMS = pytest.mark.parametrize("system", ["products", "local_products"])
CORNER = {
    "peak_flow_thickness": MARKER,
    "inundation_probability": 1.0,
    "thickness_exceedance_probability": 1.0,
    "peak_speed": 6.0,
    "peak_pressure": 72_000.0,
    "peak_momentum_flux": 0.5 * MARKER * 36.0,
    "momentum_flux_exceedance_probability": 1.0,
    "joint_exceedance_probability": 2 / 3,
    "peak_deposit_thickness": MARKER / 2,
    "mean_deposit_thickness": MARKER / 2,
    "flow_thickness_percentile": MARKER,
    "members_reached": 3,
    "first_arrival_time": 0.0,
}


def require_in_place(raster: rasterio.DatasetReader, terrain: Terrain) -> None:
    """Fail unless a raster has the terrain's system, extent and orientation, and states its missing value."""
    assert raster.crs == (terrain.crs and rasterio.crs.CRS.from_wkt(terrain.crs))
    np.testing.assert_allclose(raster.bounds, terrain.extent, atol=1e-6)
    assert raster.transform.e == -terrain.cell_size[1], "north up"
    assert raster.shape == terrain.shape
    assert set(raster.nodatavals) == {-9999}


@SYSTEMS
def test_gdal_opens_every_map_of_hazard_nc_in_its_place(system: str, request: pytest.FixtureRequest) -> None:
    made: Products = request.getfixturevalue(system)
    path = made.results / "hazard.nc"
    with netCDF4.Dataset(path) as file:
        names = [v.name for v in file.variables.values() if v.dimensions[-2:] == ("y", "x")]
    assert len(names) > 20
    for name in names:
        with rasterio.open(f'NETCDF:"{path}":{name}') as raster:
            require_in_place(raster, made.site.terrain())
            if name in CORNER:
                assert raster.read(1)[0, 0] == pytest.approx(CORNER[name])
                assert raster.read(1)[0, -1] != CORNER[name], "the marker is in one corner only"


@SYSTEMS
def test_gdal_opens_every_map_of_members_nc_in_its_place(system: str, request: pytest.FixtureRequest) -> None:
    made: Products = request.getfixturevalue(system)
    for name, values in member_maps(2).items():
        with rasterio.open(f'NETCDF:"{made.results / "members.nc"}":{name}') as raster:
            require_in_place(raster, made.site.terrain())
            assert raster.count == MEMBERS
            np.testing.assert_array_equal(raster.read(3, masked=True).filled(np.nan), values.astype(np.float32))


@SYSTEMS
def test_every_cog_holds_the_map_of_hazard_nc_with_a_style(system: str, request: pytest.FixtureRequest) -> None:
    made: Products = request.getfixturevalue(system)
    hazard = netcdf.read(made.results / "hazard.nc")
    layers = list(map_layers(hazard))
    plain = len({*HEADLINE_MAPS, *TERRAIN_MAPS, *BOUNDARY_MAPS, *(name for name in CELL_ERRORS if name in hazard)})
    assert len(layers) == plain + 2 * (3 + 2 + 2 + 1 + 2 + 2) + 3 * (len(QUANTITIES) + 1)
    for layer in layers:
        name, selection = layer.name, layer.selection
        with rasterio.open(made.results / f"{layer.path}.tif") as raster:
            require_in_place(raster, made.site.terrain())
            assert raster.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
            assert "3 of 5 members are valid" in raster.tags()["ensemble"]
            divisor = 1000.0 if VARIABLES[name].units == "Pa" else 1.0
            assert raster.units[0] == ("kPa" if VARIABLES[name].units == "Pa" else VARIABLES[name].units)
            expected = (hazard[name].sel(selection).values / divisor).astype(np.float32)
            read = raster.read(1, masked=True)
            np.testing.assert_array_equal(read.astype(np.float32).filled(np.nan), expected)
            assert float(raster.tags(1)["STATISTICS_MAXIMUM"]) == pytest.approx(read.max())
        style = ElementTree.parse(made.results / f"{layer.path}.qml").getroot()
        values = [float(item.get("value", "")) for item in style.iter("item")]
        assert values == sorted(values)
        assert values[-1] == np.inf or name in ("elevation", "ground_slope", "boundary_distance_mean")


def test_pressure_is_in_kilopascal_in_the_rasters_their_names_and_their_styles(products: Products) -> None:
    maps = products.results / "maps"
    with rasterio.open(maps / "peak_pressure.tif") as raster:
        assert raster.read(1)[0, 0] == pytest.approx(72.0)
    labels = [item.get("label") for item in ElementTree.parse(maps / "peak_pressure.qml").getroot().iter("item")]
    assert labels[:3] == ["0 kPa", "above 0 to 1 kPa", "1 to 3 kPa: windows break"]
    with rasterio.open(maps / "probability" / "pressure_exceedance_probability_over_30kPa.tif") as raster:
        assert raster.tags()["pressure_threshold"] == "30 kPa"
    assert float(netcdf.read(products.results / "hazard.nc")["peak_pressure"].max()) == pytest.approx(72_000.0), "SI in NetCDF"


def test_the_products_are_those_that_are_promised(products: Products) -> None:
    names = {path.relative_to(products.results).as_posix() for path in products.paths}
    assert {"hazard.nc", "members.nc", "outlines.gpkg", "run.json"} < names
    assert all(path.is_file() for path in products.paths)
    assert not list(products.results.rglob("*.part"))


def test_missing_members_are_stated_in_every_product(products: Products) -> None:
    statement = netcdf.read(products.results / "hazard.nc").attrs["ensemble"]
    assert statement == (
        f"3 of 5 members are valid; 1 failed: member {FAILED}: the time step fell below 1e-6 s; 1 have not run: {MISSING}; "
        "the weights of the valid members are scaled to a sum of 1"
    )
    counts = {"members_planned": 5, "members_valid": 3, "members_failed": 1, "members_missing": 1}
    hazard = netcdf.read(products.results / "hazard.nc")
    assert {name: int(hazard[name]) for name in counts} == counts
    assert float(hazard["effective_sample_size"]) == pytest.approx(3.0)
    record = json.loads((products.results / "run.json").read_text())["ensemble"]
    assert record["failures"] == {str(FAILED): "the time step fell below 1e-6 s"}
    assert record["not_run"] == [MISSING]
    outlines = gpd.read_file(products.results / "outlines.gpkg", layer="inundation")
    assert {name: int(outlines[name].iloc[0]) for name in counts} == counts


def test_members_nc_holds_the_table_and_nothing_for_members_without_a_result(products: Products) -> None:
    members = netcdf.read(products.results / "members.nc")
    table = make_table()
    np.testing.assert_array_equal(members["realization"], table.index)
    np.testing.assert_array_equal(members["basal_friction_angle_deg"], table["basal_friction_angle_deg"])
    np.testing.assert_array_equal(members["weight"], table["weight"])
    np.testing.assert_array_equal(members["seed"], table["seed"])
    assert members["status"].values.tolist() == ["valid", "valid", "valid", "failed", "missing"]
    assert members["failure_reason"].values[FAILED] == "the time step fell below 1e-6 s"
    assert np.isnan(members["max_speed"].values[[FAILED, MISSING]]).all()
    for name in FIGURES:
        assert members[name].attrs == VARIABLES[name].attributes()
        assert np.isnan(members[name].values[[FAILED, MISSING]]).all()
    valid = members["status"].values == "valid"
    highest = np.nanmax(members["max_speed"].values[valid], axis=(1, 2))
    np.testing.assert_array_equal(members["highest_speed"].values[valid], highest)
    origin = json.loads((products.results / "run.json").read_text())
    assert origin["representative_member"] == representative(members[[*FIGURES, "weight"]].to_dataframe()[valid])


def test_text_labels_are_netcdf_strings(products: Products) -> None:
    with netCDF4.Dataset(products.results / "members.nc") as file:
        assert file["status"].dtype is str
        assert file["max_speed"].chunking() == [1, *SHAPE]


def test_outlines_contain_each_other_and_cover_what_the_map_says(products: Products) -> None:
    outlines = gpd.read_file(products.results / "outlines.gpkg", layer="inundation")
    probability = netcdf.read(products.results / "hazard.nc")["inundation_probability"].values
    cell = products.site.terrain().cell_area
    assert outlines["probability"].tolist() == [0.05, 0.25, 0.5, 0.75, 0.95]
    for row in outlines.itertuples():
        assert row.geometry.area == pytest.approx((probability >= row.probability - 1e-6).sum() * cell)
    assert outlines.geometry.iloc[0].contains(outlines.geometry.iloc[-1])
    release = gpd.read_file(products.results / "outlines.gpkg", layer="release")
    assert release["volume_m3"].iloc[0] == pytest.approx(3 * 4 * 5.0 * cell)
    assert outlines.crs == release.crs == rasterio.crs.CRS.from_epsg(32616)


def test_a_geopackage_carries_a_style_for_each_of_its_layers(products: Products) -> None:
    path = products.results / "outlines.gpkg"
    assert set(pyogrio.list_layers(path)[:, 0]) == {"release", "inundation", "obstacles", "arrival", "layer_styles"}
    assert gpd.read_file(path, layer="obstacles")["height_m"].tolist() == [4.0]
    styles = pyogrio.read_dataframe(path, layer="layer_styles").set_index("f_table_name")
    assert set(styles.index) == {"release", "inundation", "obstacles", "arrival"}
    assert styles["useAsDefault"].all()
    assert (styles["f_geometry_column"] == pyogrio.read_info(path, layer="release")["geometry_name"]).all()
    assert (styles["f_table_schema"] == "").all(), "QGIS asks for an empty one"
    parsed = {name: ElementTree.fromstring(text.split("\n", 1)[1]) for name, text in styles["styleQML"].items()}
    categories = [float(c.get("value", "")) for c in parsed["inundation"].iter("category")]
    assert categories == gpd.read_file(path, layer="inundation")["probability"].tolist()
    assert all(0 < len(style.findall(".//symbol")) <= len(style.findall(".//layer")) for style in parsed.values())


def test_the_hazard_file_says_where_it_comes_from(products: Products) -> None:
    attributes = netcdf.read(products.results / "hazard.nc").attrs
    assert attributes["Conventions"] == "CF-1.11, ACDD-1.3"
    assert attributes["seed"] == 7
    assert json.loads(attributes["inputs"])[0]["name"] == "inputs/dem.tif"
    assert attributes["configuration_sha256"] == json.loads((products.results / "run.json").read_text())["configuration_sha256"]
    assert attributes["summary"].startswith("A hypothetical release. Hazard maps of")
    assert "conditional" in attributes["summary"]
    assert attributes["changes_of_inputs"] == "turned north up"
    assert json.loads((products.results / "run.json").read_text())["changes"] == ["turned north up"]


def test_the_report_of_a_run_decides_which_members_count(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    write_products(site, results, make_table(), SimpleNamespace(valid=(0, 2), failed={3: "..."}))
    status = netcdf.read(results / "members.nc")["status"].values.tolist()
    assert status == ["valid", "missing", "valid", "failed", "missing"], "member 1 has a file, but of an older configuration"
    write_products(site, results, make_table(), {0: "done", 1: "done", 2: "left", 3: "failed", 4: "left"})
    assert netcdf.read(results / "members.nc")["status"].values.tolist() == ["valid", "valid", "missing", "failed", "missing"]


def test_weights_of_the_table_reach_the_maps(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    write_products(site, results, make_table([0.1, 0.2, 0.3, 0.2, 0.2]), None)
    hazard = netcdf.read(results / "hazard.nc")
    assert float(hazard["inundation_probability"][12, 6]) == pytest.approx(0.5), "only member 2, of 0.3 in 0.6"
    assert float(hazard["effective_sample_size"]) == pytest.approx(0.36 / 0.14)


def test_maps_of_thresholds_that_are_no_longer_asked_for_vanish(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    write_products(site, results, make_table(), None)
    own = results / "maps" / "drawn by hand.tif"
    own.write_bytes(b"")
    (results / "maps" / "probability" / "pressure_exceedance_probability_over_3kPa.tif.aux.xml").write_bytes(b"")
    changed = SimpleNamespace(**vars(site.settings.hazard) | {"speed_thresholds": [2.5], "pressure_thresholds": [5e3]})
    settings = SimpleNamespace(**vars(site.settings) | {"hazard": changed})
    write_products(replace(site, settings=settings), results, make_table(), None)
    assert [p.name for p in sorted((results / "maps").rglob("pressure_exceedance_probability*"))] == [
        f"pressure_exceedance_probability_over_5kPa.{kind}" for kind in ("qml", "tif")
    ]
    assert sorted(p.name for p in (results / "maps").rglob("speed_exceedance*.tif")) == [
        "speed_exceedance_probability_over_2.5.tif",
        "speed_exceedance_standard_error_over_2.5.tif",
    ]
    assert own.exists()


def test_a_quantity_without_thresholds_keeps_its_percentiles(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    changed = SimpleNamespace(**vars(site.settings.hazard) | {"speed_thresholds": []})
    settings = SimpleNamespace(**vars(site.settings) | {"hazard": changed})
    write_products(replace(site, settings=settings), results, make_table(), None)
    hazard = netcdf.read(results / "hazard.nc")
    assert "speed_exceedance_probability" not in hazard
    assert float(hazard["speed_percentile"].sel(percentile=50)[0, 0]) == 4.0
    assert (results / "maps" / "peak_speed.qml").is_file()


def test_an_ensemble_without_a_valid_member_makes_no_map(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    for path in (results / "members").glob("*.nc"):
        path.unlink()
    with pytest.raises(PartialEnsembleError, match="0 of 5 members are valid; 1 failed: member 3: the time step") as caught:
        write_products(site, results, make_table(), None)
    assert caught.value.exit_code == ExitCode.PARTIAL_ENSEMBLE
    assert not (results / "hazard.nc").exists()


def test_members_of_another_elevation_raster_are_refused(tmp_path: Path) -> None:
    site, results = make_site(tmp_path)
    terrain = make_terrain()
    moved = Terrain(terrain.elevation, terrain.cell_size, terrain.west + 5.0, terrain.south, terrain.crs)
    for number in range(3):
        write_member(results / "members", number, moved)
    with pytest.raises(StorageError, match=r"0000\.nc: its grid is not that of dem\.tif; remove the members"):
        write_products(site, results, make_table(), None)


def test_a_member_of_another_shape_is_refused_and_no_file_of_members_is_left(tmp_path: Path) -> None:
    terrain, other = make_terrain(), make_terrain().part(slice(0, 30), slice(0, 40))
    maps = {name: values[:30, :40] for name, values in member_maps(0).items()}
    path = netcdf.write(netcdf.map_dataset(other, maps, title="other"), tmp_path / "0000.nc")
    ensemble = Ensemble(make_table(), {0: path}, {})
    with (
        pytest.raises(StorageError, match=r"0000\.nc: its grid is not that of the other members; remove it"),
        MemberMaps(path) as member,
        members_file(ensemble, tmp_path / "members.nc", terrain, {}) as members,
    ):
        members.copy(0, member)
    assert not (tmp_path / "members.nc").exists()


def test_the_slope_of_a_plane_is_its_angle() -> None:
    slope = ground_slope(make_terrain())
    assert slope[3, 4] == pytest.approx(np.degrees(np.arctan(np.hypot(3 / 12, 2 / 10))))
    assert np.isnan(slope[-1, -1])
