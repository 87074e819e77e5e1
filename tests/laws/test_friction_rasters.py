"""Parameters of friction laws from rasters: on the cells of the terrain, below zones, by release and member; what is refused."""

import math

import numpy as np
import pytest
import rasterio
from ramp_site import CELL, NORTH, SITE, WEST, write_site
from rasterio.transform import from_origin
from test_friction_of_a_site import ANGLE, SAMPLED, write_zone

import runout
from runout import FrictionZones, Voellmy
from runout.errors import ConfigError
from runout.model.scene import Raster, Scene
from runout.workflow.check import inspect

SAMPLED_XI = "    basal_xi: {distribution: uniform, low: 500, high: 1500}\n"
VOELLMY = SITE.replace(ANGLE, "basal_friction: {law: voellmy, mu: 0.2, xi: 1000}").replace(SAMPLED, SAMPLED_XI)
RASTERS = "  friction_rasters: {xi: inputs/xi.tif, mu: inputs/mu.tif}\n"
GRIDDED = VOELLMY.replace("  dem: inputs/dem.tif\n", "  dem: inputs/dem.tif\n" + RASTERS)
ZONED = GRIDDED.replace(RASTERS, RASTERS + "  friction_zones:\n    - {polygons: inputs/zone.geojson, ZONE}\n")


def write_raster(folder, name, values, west=WEST, nodata=-9999.0):
    """A raster of cells of twice the size of those of the terrain, from the north-west corner on."""
    values = np.asarray(values, np.float32)
    profile = {"driver": "GTiff", "height": values.shape[0], "width": values.shape[1], "count": 1, "dtype": "float32"}
    place = {"crs": "EPSG:32632", "transform": from_origin(west, NORTH, 2 * CELL, 2 * CELL), "nodata": nodata}
    with rasterio.open(folder / "inputs" / name, "w", **profile, **place) as raster:
        raster.write(values, 1)


def gridded_site(folder, text=GRIDDED, **values):
    """A site with rasters of xi, which states nothing in its west, and mu."""
    folder = write_site(folder, text)
    rows, columns = 60, 60
    xi = np.full((rows, columns), 400.0)
    xi[:, :10] = -9999.0
    for name, own in {"xi": xi, "mu": np.full((rows, columns), 0.3), **values}.items():
        write_raster(folder, f"{name}.tif", own)
    write_zone(folder)
    return folder


def table_of(zones, terrain, friction):
    """Numbers (nx, ny) that contact reads on each cell, by name."""
    raster = Raster(*terrain.shape, terrain.cell_size)
    material = runout.DruckerPrager(density=200.0, friction_angle=30.0)
    scene = Scene((1.0, 1.0, 1.0), None, raster, (material,), (friction,), friction_zones=zones)
    return scene.basal.table()[scene.basal.kind]


def test_cells_take_the_values_at_their_centres_and_keep_those_of_the_mass_elsewhere(tmp_path):
    site = runout.read_site(gridded_site(tmp_path / "site"))
    terrain = site.terrain()
    found = table_of(site.friction_zones(terrain), terrain, Voellmy(mu=0.2, xi=1000.0))
    assert found["mu"] == pytest.approx(0.3)
    assert found["drag"][:20] == pytest.approx(200.0 * 9.81 / 1000.0)
    assert found["drag"][20:] == pytest.approx(200.0 * 9.81 / 400.0)
    assert inspect(tmp_path / "site").problems == []


def test_members_sample_what_rasters_leave(tmp_path):
    site = runout.read_site(gridded_site(tmp_path / "site"))
    arguments = site.member_arguments({"basal_xi": 800.0})
    found = table_of(arguments["friction_zones"], site.terrain(), arguments["basal_friction"])
    assert found["drag"].max() == pytest.approx(200.0 * 9.81 / 400.0)
    assert found["drag"].min() == pytest.approx(200.0 * 9.81 / 800.0)


def test_zones_change_what_rasters_state(tmp_path):
    for zone, number, inside in (
        ("factor: 2", "mu", 0.6),
        ("basal_friction: {mu: 0.1}", "mu", 0.1),
        ("basal_friction: {xi: 100}", "drag", 200.0 * 9.81 / 100.0),
    ):
        site = runout.read_site(gridded_site(tmp_path / number / str(inside), ZONED.replace("ZONE", zone)))
        terrain = site.terrain()
        zones = site.friction_zones(terrain)
        found = table_of(zones, terrain, Voellmy(mu=0.2, xi=1000.0))[number]
        outside = {"mu": 0.3, "drag": 200.0 * 9.81 / 400.0}[number]
        assert found[34, 12] == pytest.approx(inside)  # a cell amid the zone
        assert found[34, 21] == pytest.approx(outside)
        assert "friction zones: 1 on" in zones.statement()


def test_angles_are_in_degrees(tmp_path):
    folder = gridded_site(tmp_path / "site", SITE, angle=np.full((60, 60), 30.0))
    terrain = runout.read_site(folder).terrain()
    zones = FrictionZones.from_rasters({"friction_angle_deg": folder / "inputs" / "angle.tif"}, terrain)
    assert zones.least_angle(math.radians(10.0)) == pytest.approx(math.radians(30.0))


@pytest.mark.parametrize(
    ("text", "values", "said"),
    [
        (GRIDDED.replace("xi: inputs/xi.tif", "chi: inputs/xi.tif"), {}, "friction_rasters.chi: the friction law voellmy"),
        (GRIDDED.replace("inputs/xi.tif", "inputs/xy.tif"), {}, "there is no file 'inputs/xy.tif'"),
        (GRIDDED, {"xi": np.zeros((60, 60))}, r"xi.tif: xi is 0 at easting .* cells in all; .* gdal_edit.py -a_nodata 0 "),
        (GRIDDED, {"xi": np.full((60, 60), -9999.0)}, "xi.tif: no cell of the terrain has a value"),
    ],
)
def test_wrong_rasters_get_the_place_and_the_remedy(tmp_path, text, values, said):
    folder = gridded_site(tmp_path / "site", text, **values)

    def zones():
        site = runout.read_site(folder)
        return site.friction_zones(site.terrain())

    with pytest.raises((ConfigError, runout.ZoneError), match=said):
        zones()


def test_check_states_where_the_mass_passes_on_less_shear_than_drag_needs(tmp_path):
    at_base = VOELLMY.replace("law: voellmy,", "law: voellmy_base,")
    assert not any("a steady flow needs" in text for text in inspect(write_site(tmp_path / "column", VOELLMY)).warnings)
    steep = at_base.replace("friction_angle_deg: 30}", "friction_angle_deg: 10}")
    found = inspect(write_site(tmp_path / "steep", steep))
    assert any("a steady flow needs a shear stress" in text and "friction_angle_deg of" in text for text in found.warnings)
    firm = at_base.replace("friction_angle_deg: 30}", "friction_angle_deg: 50}")
    assert not any("a steady flow needs" in text for text in inspect(write_site(tmp_path / "firm", firm)).warnings)


def angles(folder, terrain, values, **more):
    write_raster(folder, "angle.tif", values, **more)
    return FrictionZones.from_rasters({"friction_angle_deg": folder / "inputs" / "angle.tif"}, terrain)


def beside(background, own=25.0):
    """Angles in the east, and one value in all cells of the west."""
    return np.where(np.arange(60) < 15, background, own) * np.ones((60, 1))


@pytest.mark.parametrize("background", [0.0, 1e-3])
def test_a_value_around_the_mapped_area_that_hardly_is_meant_is_asked_about(tmp_path, background):
    folder = gridded_site(tmp_path / "site")
    terrain = runout.read_site(folder).terrain()
    zones = angles(folder, terrain, beside(background), nodata=None)
    share = float(np.mean(zones.gridded["friction"][1] < 0.1))
    (asked,) = zones.warnings
    assert f"friction_angle_deg is {background:g} on {100 * share:.3g} % of the cells of the terrain, 25 to 25" in asked
    assert f"gdal_edit.py -a_nodata {np.float32(background):.9g} " in asked
    assert asked in zones.changes


def test_check_warns_of_zeros_of_a_friction_raster_and_declared_ones_are_those_of_the_mass(tmp_path):
    at = SITE.replace(
        "  dem: inputs/dem.tif\n", "  dem: inputs/dem.tif\n  friction_rasters: {friction_angle_deg: inputs/angle.tif}\n"
    )
    folder = gridded_site(tmp_path / "site", at)
    write_raster(folder, "angle.tif", beside(0.0), nodata=None)
    assert any("is 0 on" in text and "-a_nodata 0" in text for text in inspect(folder).warnings)
    write_raster(folder, "angle.tif", beside(0.0), nodata=0.0)
    assert not any("-a_nodata" in text for text in inspect(folder).warnings)


@pytest.mark.parametrize("values", [beside(12.0), np.linspace(2.0, 30.0, 60) * np.ones((60, 1)), np.full((60, 60), 20.0)])
def test_plausible_angles_are_not_asked_about(tmp_path, values):
    folder = gridded_site(tmp_path / "site")
    assert angles(folder, runout.read_site(folder).terrain(), values).warnings == ()


def test_zero_where_the_law_takes_zero_is_not_asked_about_and_of_xi_it_is_refused(tmp_path):
    folder = gridded_site(tmp_path / "site", xi=beside(1.0, 800.0), c=beside(0.0, 500.0), mu=beside(0.0, 0.3))
    terrain, names = runout.read_site(folder).terrain(), {"cohesion": "c", "xi": "xi", "mu": "mu"}
    paths = {key: folder / "inputs" / f"{name}.tif" for key, name in names.items()}
    zones = FrictionZones.from_rasters(paths, terrain, law="voellmy")
    assert len(zones.warnings) == 2
    assert "xi is 1 on" in zones.warnings[0]
    assert "mu is 0 on" in zones.warnings[1]


def test_an_angle_in_radians_or_another_unit_is_told_from_one_in_degrees(tmp_path):
    folder = gridded_site(tmp_path / "site")
    terrain = runout.read_site(folder).terrain()
    write_raster(folder, "angle.tif", np.full((60, 60), 0.5))
    path = folder / "inputs" / "angle.tif"
    for unit, degrees in (("rad", math.degrees(0.5)), ("m", None)):
        with rasterio.open(path, "r+") as raster:
            raster.units = (unit,)
        if degrees is None:
            with pytest.raises(runout.ZoneError, match=r"values of friction_angle_deg are in 'm'; deg, .*gdal_edit.py -units"):
                FrictionZones.from_rasters({"friction_angle_deg": path}, terrain)
        else:
            zones = FrictionZones.from_rasters({"friction_angle_deg": path}, terrain)
            assert zones.least_angle(1.0) == pytest.approx(math.radians(degrees))


@pytest.mark.parametrize("values", [np.full((60, 60), 0.5), beside(0.5)])
def test_angles_that_look_like_radians_are_refused(tmp_path, values):
    folder = gridded_site(tmp_path / "site")
    said = r"friction_angle_deg is 0.5 at easting .* radians.*gdal_edit.py -units rad .*-a_nodata 0.5 "
    with pytest.raises(runout.ZoneError, match=said):
        angles(folder, runout.read_site(folder).terrain(), values)


def test_a_raster_far_larger_than_the_terrain_is_read_on_it_alone(tmp_path):
    folder = gridded_site(tmp_path / "site")
    terrain = runout.read_site(folder).terrain()
    place = {"crs": "EPSG:32632", "transform": from_origin(WEST - 5e5, NORTH + 5e5, CELL, CELL), "nodata": -1.0}
    tiles = {
        "tiled": True,
        "sparse_ok": True,
        "bigtiff": "yes",
        "width": 100_000,
        "height": 100_000,
        "count": 1,
        "dtype": "float32",
    }
    with rasterio.open(tmp_path / "huge.tif", "w", driver="GTiff", **tiles, **place) as raster:
        start = round(5e5 / CELL)
        raster.write(np.full((8, 8), 33.0, "float32"), 1, window=((start, start + 8), (start, start + 8)))
    zones = FrictionZones.from_rasters({"friction_angle_deg": tmp_path / "huge.tif"}, terrain)
    assert zones.gridded["friction"][1][:8, -8:] == pytest.approx(math.tan(math.radians(33.0)))
    assert (zones.gridded["friction"][0] == 1.0).sum() == terrain.elevation.size - 64
    assert "of its 100000 x 100000 cells are read" in zones.changes[0]


@pytest.mark.parametrize("turn", [slice(None), slice(None, None, -1)])
def test_a_friction_raster_takes_rows_and_columns_in_any_order(tmp_path, turn):
    folder = gridded_site(tmp_path / "site")
    terrain = runout.read_site(folder).terrain()
    values = (20.0 + np.arange(60) / 10 + np.arange(60)[:, None] / 100).astype("float32")
    usual = angles(folder, terrain, values).gridded["friction"][1]
    sign = 1 if turn.step is None else -1
    place = rasterio.Affine(2 * CELL * sign, 0, WEST + (0 if sign > 0 else 120 * CELL), 0, 2 * CELL, NORTH - 120 * CELL)
    profile = {
        "driver": "GTiff",
        "height": 60,
        "width": 60,
        "count": 1,
        "dtype": "float32",
        "crs": "EPSG:32632",
        "transform": place,
    }
    with rasterio.open(tmp_path / "turned.tif", "w", **profile) as raster:
        raster.write(values[::-1, turn], 1)
    zones = FrictionZones.from_rasters({"friction_angle_deg": tmp_path / "turned.tif"}, terrain)
    np.testing.assert_array_equal(zones.gridded["friction"][1], usual)
    with rasterio.open(tmp_path / "turned.tif", "r+") as raster:
        raster.transform = place @ rasterio.Affine.rotation(10.0)
    with pytest.raises(runout.ZoneError, match="rotated or sheared"):
        FrictionZones.from_rasters({"friction_angle_deg": tmp_path / "turned.tif"}, terrain)
