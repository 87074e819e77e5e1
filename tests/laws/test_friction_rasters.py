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
