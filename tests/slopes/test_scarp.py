"""Scarps against closed forms of their volume, and as release rasters."""

import json
import math
from xml.etree import ElementTree

import geopandas
import numpy as np
import pytest
import rasterio
import shapely

from runout import Release, ScarpPlane, Terrain, cli, scarp_ellipsoid, scarp_planes
from runout.errors import ExitCode, ReleaseError

CELL = 10.0
MIDDLE = (603.0, 602.0)


def ground(slope_east=0.0, slope_north=0.0, cell=CELL, size=1200.0):
    n = round(size / cell)
    x, y = np.meshgrid((np.arange(n) + 0.5) * cell, (n - 0.5 - np.arange(n)) * cell)
    return Terrain.from_array(1000.0 + slope_east * x + slope_north * y, cell)


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.4, -0.3)])
def test_half_ellipsoid_on_a_plane_has_its_volume_and_thins_out(slopes):
    terrain = ground(*slopes)
    made = scarp_ellipsoid(terrain, MIDDLE, (150.0, 100.0), 12.0)
    assert made.volume == pytest.approx(2.0 / 3.0 * math.pi * 150.0 * 100.0 * 12.0, rel=1e-3)
    assert made.thickness.max() == pytest.approx(12.0, rel=0.01)
    rim = made.thickness[(made.thickness > 0) & (np.roll(made.thickness, 1, 1) == 0)]
    assert rim.max() < 0.4 * 12.0


def test_an_ellipsoid_of_two_cells_has_its_volume():
    assert scarp_ellipsoid(ground(), MIDDLE, (12.0, 10.0), 3.0).volume == pytest.approx(2.0 / 3.0 * math.pi * 360.0, rel=5e-3)


def test_axes_follow_the_azimuth_and_the_slope():
    def spread(made):
        rows, columns = np.nonzero(made.thickness > 0)
        return np.ptp(columns) * CELL, np.ptp(rows) * CELL

    east, north = spread(scarp_ellipsoid(ground(), MIDDLE, (200.0, 50.0), 5.0, azimuth_deg=90.0))
    assert (east, north) == (pytest.approx(400, abs=30), pytest.approx(100, abs=30))
    east, north = spread(scarp_ellipsoid(ground(slope_north=0.5), MIDDLE, (200.0, 50.0), 5.0))  # downslope is south
    assert (east, north) == (pytest.approx(100, abs=30), pytest.approx(400, abs=30))


def test_tilt_of_the_slope_gives_the_half_ellipsoid_and_another_one_does_not():
    terrain, volume = ground(slope_north=0.5), 2.0 / 3.0 * math.pi * 100.0 * 100.0 * 8.0
    tilt = math.degrees(math.atan(0.5))
    assert scarp_ellipsoid(terrain, MIDDLE, (100, 100), 8, azimuth_deg=180, tilt_deg=tilt).volume == pytest.approx(volume, rel=1e-3)
    level = scarp_ellipsoid(terrain, MIDDLE, (100, 100), 8, azimuth_deg=180, tilt_deg=0.0)
    upper, lower = level.thickness[:60].sum(), level.thickness[60:].sum()
    assert upper > 5 * lower  # the ground rises to the north above a level plane


def test_four_planes_cut_a_pyramid():
    planes = [ScarpPlane(*MIDDLE, 60.0, 45.0, azimuth) for azimuth in (0.0, 90.0, 180.0, 270.0)]
    assert scarp_planes(ground(), planes).volume == pytest.approx(4.0 / 3.0 * 60.0**3, rel=2e-3)


def test_two_planes_within_an_outline_cut_a_wedge(tmp_path):
    box = shapely.box(403.0, 402.0, 803.0, 802.0)  # cuts cells
    geopandas.GeoDataFrame(geometry=[box]).to_file(tmp_path / "outline.gpkg")
    depth, dip = 40.0, 30.0
    planes = [(*MIDDLE, depth, dip, 0.0), (*MIDDLE, depth, dip, 180.0)]
    made = scarp_planes(ground(), planes, outline=tmp_path / "outline.gpkg")
    assert made.volume == pytest.approx(400.0 * depth**2 / math.tan(math.radians(dip)), rel=2e-3)


def test_a_gentle_plane_and_a_steep_one_behind_hold_a_wedge_on_a_slope():
    """Between a slope of tan a, a plane of tan b through a point d below it, and a plane of tan c behind: a triangle."""
    slope, gentle, steep, depth = 0.6, 0.4, 2.0, 20.0
    terrain = ground(slope_north=slope, cell=5.0)
    angles = [math.degrees(math.atan(t)) for t in (gentle, steep)]
    sides = [(MIDDLE[0] + s * 200.0, MIDDLE[1], 0.0, 88.0, 90.0 if s < 0 else 270.0) for s in (-1, 1)]
    made = scarp_planes(terrain, [(*MIDDLE, depth, angles[0], 180.0), (*MIDDLE, depth, angles[1], 180.0), *sides])
    area = 0.5 * depth * (depth / (slope - gentle) + depth / (steep - slope))  # of a section, to the south and to the north
    assert made.volume == pytest.approx(area * 400.0, rel=0.03)  # the sides dip 88 degrees


def test_a_stated_volume_is_met():
    assert scarp_ellipsoid(ground(), MIDDLE, (150, 100), 12, volume=2e5).volume == pytest.approx(2e5, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda t: scarp_ellipsoid(t, (60, 602), (150, 100), 12), "90 m beyond the west edge"),
        (lambda t: scarp_ellipsoid(t, (-60, 602), (150, 100), 12), "lies outside the terrain"),
        (lambda t: scarp_ellipsoid(t, MIDDLE, (150, 5), 12), "semi-axis is 5 m; it must be at least 10"),
        (lambda t: scarp_ellipsoid(t, MIDDLE, (150, 100), -3), "depth is -3"),
        (lambda t: scarp_planes(t, [(*MIDDLE, 20.0, 45.0, 0.0)]), "do not close the mass"),
        (lambda t: scarp_planes(t, [(*MIDDLE, 20.0, 95.0, 0.0)]), "plane: dip is 95"),
        (lambda t: scarp_planes(t, [(*MIDDLE, -20.0, 10.0, a) for a in (0.0, 180.0)]), "the planes hold no mass"),
        (lambda t: scarp_planes(t, []), "no plane is stated"),
    ],
)
def test_scarps_that_cannot_be_made_are_refused(make, message):
    with pytest.raises(ReleaseError, match=message):
        make(ground())


def test_command_writes_a_raster_with_the_printed_volume_that_a_site_takes(tmp_path, capsys):
    terrain = ground(0.4, -0.3)
    profile = {"driver": "GTiff", "height": 120, "width": 120, "count": 1, "dtype": "float64", "crs": "EPSG:32632"}
    with rasterio.open(tmp_path / "dem.tif", "w", transform=rasterio.transform.from_origin(0, 1200, 10, 10), **profile) as file:
        file.write(terrain.elevation, 1)
    stated = ["scarp", str(tmp_path / "dem.tif"), "--ellipsoid", "603", "602", "150", "100", "12", "--name", "east"]
    assert cli.main(["-q", "--out", str(tmp_path), *stated]) == ExitCode.OK
    printed = float(capsys.readouterr().out.split("volume: ")[1].split()[0])
    release = Release.from_raster(tmp_path / "scarp" / "east.tif", Terrain.from_raster(tmp_path / "dem.tif"), volume=printed)
    assert release.volume == pytest.approx(printed, rel=1e-8)
    style = ElementTree.fromstring((tmp_path / "scarp" / "east.qml").read_text().split("\n", 1)[1])
    assert next(style.iter("colorrampshader")).get("colorRampType") == "DISCRETE"
    assert json.loads((tmp_path / "scarp" / "east.json").read_text())["volume_m3"] == pytest.approx(printed, rel=1e-8)


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ([], "neither is given"),
        (["--ellipsoid", *"12345", "--plane", *"12345"], "both are given"),
        (["--plane", *"12345", "--tilt", "3"], "--tilt has no meaning with --plane"),
        (["--ellipsoid", *"12345", "--name", "a b"], "--name is 'a b'"),
    ],
)
def test_bad_choices_of_the_command_are_one_line(stated, message, capsys):
    assert cli.main(["-q", "scarp", "matplotlib:jacksboro_fault_dem", *stated]) == ExitCode.CONFIGURATION
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
