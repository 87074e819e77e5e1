"""Files that site.yaml names beside DEM and release: probes, observations, structures and protected areas."""

import geopandas as gpd
import numpy as np
import pytest
import rasterio
import shapely
import trimesh
from rasterio.transform import from_origin

from runout.config.site import read_site
from runout.errors import ConfigError, InputError, StructureError

WEST, SOUTH, NORTH = 500_000.0, 5_000_000.0, 5_000_200.0


def write_layer(path, geometries, layer=None, **attributes):
    gpd.GeoDataFrame(attributes, geometry=geometries, crs="EPSG:32632").to_file(path, layer=layer)


def write_raster(path, values):
    """Cells of the terrain, 20 x 30 of 10 m; NaN as -9999."""
    profile = {"driver": "GTiff", "height": 20, "width": 30, "count": 1, "dtype": "float32", "nodata": -9999.0}
    with rasterio.open(path, "w", crs="EPSG:32632", transform=from_origin(WEST, NORTH, 10.0, 10.0), **profile) as file:
        file.write(np.where(np.isnan(values), -9999.0, values).astype("f4"), 1)


@pytest.fixture
def with_block(edited):
    """A function that adds a block to site.yaml and returns the site."""

    def add(block):
        return read_site(edited("ensemble:\n", f"{block}ensemble:\n"))

    return add


# --- probes ----------------------------------------------------------------------------------------------------------------


def test_probes_are_listed_or_read_from_the_layer_that_is_named(with_block, site_folder):
    path = site_folder / "inputs" / "probes.gpkg"
    write_layer(path, [shapely.Point(WEST + 55, SOUTH + 45)], "old", name=["old"])
    write_layer(path, [shapely.LineString([(WEST + 100, SOUTH + 20), (WEST + 100, SOUTH + 120)])], "lines", name=["gate"])
    site = with_block(
        "probes:\n  points: [{name: house, x: 500105, y: 5000055}, {name: road, x: 500155, y: 5000065}]\n"
        "  cross_sections: inputs/probes.gpkg\n  cross_sections_layer: lines\n  interval: 0.5\n"
    )
    probes = site.files.probes()
    assert [(p.name, *p.vertices[0]) for p in probes.points] == [
        ("house", WEST + 105, SOUTH + 55),
        ("road", WEST + 155, SOUTH + 65),
    ]
    assert [line.name for line in probes.cross_sections] == ["gate"]
    assert probes.cross_sections[0].length == 100.0
    assert probes.interval == 0.5


def test_points_of_a_file_are_those_of_its_layer(with_block, site_folder):
    path = site_folder / "inputs" / "probes.gpkg"
    for layer, east in (("old", 55), ("new", 65)):
        write_layer(path, [shapely.Point(WEST + east, SOUTH + 45)], layer, name=[layer])
    probes = with_block("probes: {points: inputs/probes.gpkg, points_layer: new}\n").files.probes()
    assert [(p.name, p.vertices[0][0]) for p in probes.points] == [("new", WEST + 65)]
    assert probes.cross_sections == ()


def test_a_probe_beyond_the_terrain_is_named_with_its_line(with_block):
    site = with_block("probes:\n  points:\n    - {name: here, x: 500105, y: 5000055}\n    - {name: far, x: 600000, y: 5000055}\n")
    with pytest.raises(ConfigError) as refused:
        site.files.probes()
    (line,) = str(refused.value).splitlines()
    assert line.startswith("site.yaml:21: probes.points[1]")
    assert "far" in line


def test_a_file_of_probes_that_cannot_be_used_is_named_with_its_line(with_block, site_folder):
    write_layer(site_folder / "inputs" / "probes.gpkg", [shapely.Point(WEST + 55, SOUTH + 45)], name=["a"])
    site = with_block("probes:\n  cross_sections: inputs/probes.gpkg\n")
    with pytest.raises(ConfigError, match=r"^site\.yaml:19: probes\.cross_sections: .*inputs/probes\.gpkg"):
        site.files.probes()


# --- observations ----------------------------------------------------------------------------------------------------------


def test_observations_come_with_what_their_settings_say(with_block, site_folder):
    inputs, nan = site_folder / "inputs", np.nan
    write_layer(inputs / "outline.gpkg", [shapely.box(WEST + 20, SOUTH + 20, WEST + 60, SOUTH + 50)])
    write_layer(inputs / "thalweg.gpkg", [shapely.LineString([(WEST + 20, SOUTH + 40), (WEST + 250, SOUTH + 40)])])
    write_layer(inputs / "gauges.gpkg", [shapely.Point(WEST + 55, SOUTH + 45)], t=[12.0], v=[3.0], depth=[1.5])
    thickness, change = np.full((20, 30), 2.0), np.full((20, 30), -1.0)
    thickness[0, :3], change[0, :3] = nan, nan
    write_raster(inputs / "deposit.tif", thickness)
    write_raster(inputs / "dod.tif", change)
    site = with_block(
        "observations:\n"
        "  outline: {polygons: inputs/outline.gpkg, shows: deposit}\n"
        "  deposit: {raster: inputs/deposit.tif, thickness: slope_normal}\n"
        "  difference: {raster: inputs/dod.tif, detection_limit: 0.3, nodata: zero}\n"
        "  gauges: {points: inputs/gauges.gpkg, arrival_time: t, speed: v}\n"
        "  thalweg: {line: inputs/thalweg.gpkg}\n"
    )
    observed = site.files.observations().require()
    assert (observed.outline.area, observed.outline_shows) == (1200.0, "deposit")
    assert np.isnan(observed.deposit[0, :3]).all(), "not known"
    np.testing.assert_allclose(observed.deposit[5:], 2.0 * np.hypot(1.0, 0.3), rtol=1e-4)  # the plane falls by 0.3
    np.testing.assert_array_equal(observed.change[0, :4], [0.0, 0.0, 0.0, -1.0])
    assert observed.detection_limit == 0.3
    assert {name: values.tolist() for name, values in observed.gauges.values.items()} == {"arrival_time": [12.0], "speed": [3.0]}
    assert observed.thalweg.length == 230.0
    assert observed.grid.shape == (20, 30)


def test_a_vertical_deposit_stays_as_it_is_and_unknown_ground_is_unknown(with_block, site_folder):
    write_raster(site_folder / "inputs" / "deposit.tif", np.full((20, 30), 2.0))
    lines = (site_folder / "inputs" / "dem.asc").read_text().splitlines()
    lines[6] = lines[6].replace("100.000", "-9999", 1)
    (site_folder / "inputs" / "dem.asc").write_text("\n".join(lines) + "\n")
    observed = with_block("observations:\n  deposit: {raster: inputs/deposit.tif}\n").files.observations().require()
    assert np.isnan(observed.deposit[0, 0])
    np.testing.assert_array_equal(observed.deposit.ravel()[1:], 2.0)
    assert (observed.outline, observed.change, observed.gauges, observed.thalweg) == (None,) * 4


def test_observations_that_cannot_be_read_are_named_each_with_its_line_and_others_are_there(with_block, site_folder):
    write_layer(site_folder / "inputs" / "outline.gpkg", [shapely.box(WEST + 20, SOUTH + 20, WEST + 60, SOUTH + 50)])
    write_layer(site_folder / "inputs" / "far.gpkg", [shapely.box(WEST + 9e4, SOUTH, WEST + 9.1e4, SOUTH + 50)])
    write_raster(site_folder / "inputs" / "deposit.tif", np.full((20, 30), -2.0))
    site = with_block(
        "observations:\n  outline: {polygons: inputs/outline.gpkg}\n  deposit: {raster: inputs/deposit.tif}\n"
        "  thalweg: {line: inputs/outline.gpkg}\n"
    )
    reading = site.files.observations()
    assert reading.content.outline.area == 1200.0
    assert [str(problem).split(": ")[:2] for problem in reading.problems] == [
        ["site.yaml:20", "observations.deposit"],
        ["site.yaml:21", "observations.thalweg"],
    ]
    with pytest.raises(InputError, match=r"site\.yaml:20: observations\.deposit"):
        reading.require()


# --- structures ------------------------------------------------------------------------------------------------------------


def test_structures_have_the_places_units_and_tops_that_are_stated(with_block, site_folder):
    house = trimesh.creation.box((10.0, 10.0, 8.0))
    house.apply_translation((0.0, 0.0, 4.0))
    house.apply_scale(100.0)
    house.export(site_folder / "inputs" / "house.obj")
    write_layer(site_folder / "inputs" / "dam.gpkg", [shapely.box(WEST + 100, SOUTH + 20, WEST + 140, SOUTH + 30)], h=[6.0])
    site = with_block(
        "structures:\n"
        "  - {file: inputs/house.obj, name: house, units: cm, offset: [500205, 5000105, 40]}\n"
        "  - {file: inputs/dam.gpkg, name: level, height: h, friction_angle_deg: 30}\n"
        "  - {file: inputs/dam.gpkg, name: along, height: 6, base: 90, clearance: 2}\n"
    )
    mesh, level, hanging = site.files.bodies().solids
    np.testing.assert_allclose(mesh.box, [[200.0, 100.0, 40.0], [210.0, 110.0, 48.0]], atol=1e-6)
    assert (mesh.name, level.name) == ("house", "level")
    assert level.friction == pytest.approx(np.tan(np.radians(30.0)))
    assert mesh.friction == pytest.approx(np.tan(np.radians(20.0)))
    np.testing.assert_allclose(level.box[:, :2], [[100.0, 20.0], [140.0, 30.0]], atol=1e-6)
    assert hanging.clearance == 2.0
    assert hanging.box[1, 2] == pytest.approx(96.0)


def test_the_area_behind_a_dam_is_that_of_cells_and_dams_of_one_name_get_numbers(with_block, site_folder):
    inputs = site_folder / "inputs"
    for k in (4, 5):
        write_layer(inputs / f"dam_{k}.gpkg", [shapely.box(WEST + 100, SOUTH + 10 * k, WEST + 140, SOUTH + 10 * k + 5)])
    write_layer(inputs / "behind.gpkg", [shapely.box(WEST + 150, SOUTH + 20, WEST + 175, SOUTH + 30)], "village")
    write_layer(inputs / "behind.gpkg", [shapely.box(WEST + 200, SOUTH, WEST + 210, SOUTH + 10)] * 2, "road")
    block = "".join(
        f"  - {{file: inputs/dam_{h}.gpkg, height: {h}, name: dam, protects: inputs/behind.gpkg, protects_layer: {layer}}}\n"
        for h, layer in ((4, "village"), (5, "road"))
    )
    areas = with_block(f"structures:\n{block}").files.protected_areas()
    assert list(areas) == ["dam", "dam 2"]
    expected = np.zeros((20, 30))
    expected[17, 15:18] = 100.0, 100.0, 50.0
    np.testing.assert_allclose(areas["dam"], expected, atol=1e-6)
    assert areas["dam 2"].sum() == pytest.approx(100.0), "an area that is drawn twice counts once"
    assert areas["dam 2"][19, 20] == pytest.approx(100.0)


def test_a_protected_area_beyond_the_terrain_is_named_with_its_line(with_block, site_folder):
    inputs = site_folder / "inputs"
    write_layer(inputs / "dam.gpkg", [shapely.box(WEST + 100, SOUTH + 20, WEST + 140, SOUTH + 30)])
    write_layer(inputs / "behind.gpkg", [shapely.box(WEST + 500, SOUTH + 20, WEST + 600, SOUTH + 40)])
    site = with_block("structures:\n  - file: inputs/dam.gpkg\n    height: 4\n    protects: inputs/behind.gpkg\n")
    with pytest.raises(
        StructureError, match=r"site\.yaml:21: structures\[0\]\.protects: .*at easting 500550\.0, northing 5000030\.0"
    ):
        site.files.protected_areas()


# --- terrain ---------------------------------------------------------------------------------------------------------------


def test_zones_and_rasters_of_friction_come_together_and_a_site_without_them_has_none(edited, site_folder):
    inputs = site_folder / "inputs"
    assert read_site(site_folder).friction_zones(read_site(site_folder).terrain()) is None
    write_layer(inputs / "zones.gpkg", [shapely.box(WEST + 100, SOUTH, WEST + 120, SOUTH + 10)], k=[1.5])
    values = np.full((20, 30), np.nan)
    values[19, 0] = 35.0
    write_raster(inputs / "friction.tif", values)
    block = "dem.asc\n  friction_zones:\n    - {polygons: inputs/zones.gpkg, factor: k}\n"
    site = read_site(edited("dem.asc\n", f"{block}  friction_rasters: {{friction_angle_deg: inputs/friction.tif}}\n"))
    zones = site.friction_zones(site.terrain())
    factor = np.ones((30, 20))
    factor[10:12, 0] = 1.5
    np.testing.assert_allclose(zones.factor, factor)
    share, own = zones.gridded["friction"]
    assert (share[0, 0], own[0, 0]) == pytest.approx((0.0, np.tan(np.radians(35.0))))
    assert share.sum() == share.size - 1


def test_obstacles_raise_the_ground_of_a_site(edited, site_folder):
    write_layer(site_folder / "inputs" / "dams.gpkg", [shapely.box(WEST + 100, SOUTH, WEST + 125, SOUTH + 10)])
    plain = read_site(site_folder).terrain().elevation
    site = read_site(edited("dem.asc\n", "dem.asc\n  obstacles: [{polygons: inputs/dams.gpkg, height: 6}]\n"))
    raised = np.zeros((20, 30))
    raised[19, 10:13] = 6.0, 6.0, 3.0
    np.testing.assert_allclose(site.terrain().elevation - plain, raised, atol=1e-6)
    assert site.terrain().changes[-1].endswith("obstacles on 250 m2 change the ground by 6 to 6 m")


@pytest.mark.parametrize(("edge", "placement", "is_whole"), [("vertical", "excavated", True), ("tapered", "on_surface", False),
                                                            (None, "excavated", False), (None, "on_surface", True)])  # fmt: skip
def test_the_edge_of_a_release_is_the_one_that_is_stated(edited, edge, placement, is_whole):
    stated = "" if edge is None else f"    edge: {edge}\n"
    (release,) = read_site(edited("    thickness: 4.0\n", f"    thickness: 4.0\n    placement: {placement}\n{stated}")).releases()
    assert release.volume == pytest.approx(4.0 * 1600.0)
    assert bool(np.ptp(release.thickness[12:16, 4:8]) < 1e-9) is is_whole


def test_a_raster_of_lost_elevation_is_a_release_of_its_sign(edited, site_folder):
    lines = (site_folder / "inputs" / "dem.asc").read_text().splitlines()[:6]
    rows = [" ".join("-3" if 12 <= r < 16 and 4 <= c < 8 else "0" for c in range(30)) for r in range(20)]
    (site_folder / "inputs" / "lost.asc").write_text("\n".join([*lines, *rows]) + "\n")
    old = "    polygons: inputs/release.geojson\n    thickness: 4.0\n"
    (release,) = read_site(edited(old, "    raster: inputs/lost.asc\n    sign: negative\n    volume: 4800\n")).releases()
    assert release.thickness[12:16, 4:8].tolist() == [[3.0] * 4] * 4
    assert (release.name, release.volume) == ("scar", 4800.0)
