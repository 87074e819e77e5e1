"""Ground without elevation is an open edge: the surface goes on into it, and what comes there leaves the run."""

import numpy as np
import pytest

from runout import DruckerPrager, Release, Terrain, simulate
from runout.errors import DemError
from runout.model.numerics import Numerics
from runout.simulation.scenario import build_scene
from runout.terrain import open_edge
from runout.terrain.open_edge import continued, filled, unknown_cells
from runout.terrain.sdf import sliding_surface

CELL = 5.0
MATERIAL = DruckerPrager(density=2000.0, youngs_modulus=2e6, poisson_ratio=0.3, friction_angle=30.0)


def catchment(rows=24, columns=44, hole=True):
    """Plane of 30 degrees that falls to the east, cut obliquely along the east as by a catchment, with a hole in the path."""
    y, x = np.mgrid[:rows, :columns].astype(float)
    z = 500.0 - CELL * x * np.tan(np.radians(30.0)) + 0.2 * CELL * y
    z[x > 34.0 + 0.25 * y] = np.nan
    if hole:
        z[12, 20] = np.nan
    return z


def clipped(**choices):
    terrain = Terrain.from_array(catchment(**choices), CELL)
    thickness = np.zeros(terrain.shape)
    thickness[8:16, 6:14] = 6.0
    return terrain, Release.from_array(thickness, terrain, placement="on_surface")


def test_a_plane_is_continued_as_a_plane_and_known_cells_are_kept():
    z = catchment()
    y, x = np.mgrid[: z.shape[0], : z.shape[1]].astype(float)
    plane = 500.0 - CELL * x * np.tan(np.radians(30.0)) + 0.2 * CELL * y
    found = continued(z, (CELL, CELL), reach=4 * CELL)
    near = (x <= 37.0 + 0.25 * y) & (x >= 1) & (y > 2) & (y < 21)
    np.testing.assert_array_equal(found[np.isfinite(z)], z[np.isfinite(z)])
    np.testing.assert_allclose(found[near], plane[near], atol=1e-9)
    assert np.isfinite(found).all()
    assert np.abs(filled(z, (CELL, CELL)) - plane)[near].max() > CELL  # what the nearest value alone would leave: a step


@pytest.mark.parametrize("spacing", [3.0, 5.0, 10.0])
def test_the_sliding_surface_keeps_its_slope_up_to_the_open_edge(spacing):
    terrain, _ = clipped()
    surface = sliding_surface(terrain, None, (spacing, spacing))
    x, y = np.array([34.9, 36.9, 20.5]) * CELL, np.array([23.5, 12.5, 11.0]) * CELL  # beside the edge and the hole
    _, east, north = surface.evaluate(x, y)
    np.testing.assert_allclose(east, -np.tan(np.radians(30.0)), rtol=1e-6)
    np.testing.assert_allclose(north, -0.2, rtol=1e-6)


def test_a_flow_over_an_open_edge_is_booked_and_its_maps_hold_no_value_there():
    terrain, release = clipped()
    result = simulate(terrain, release, MATERIAL, basal_friction_angle=12.0, cell_size=5.0, end_time=14.0)
    unknown = np.isnan(terrain.elevation)
    ledger = result.ledger
    total = (ledger["mass"] + ledger["escaped_mass"]).values
    np.testing.assert_allclose(total, total[0], rtol=1e-6)
    assert float(ledger["escaped_mass"][-1]) > 0.9 * total[0]
    for name, values in result.maps.data_vars.items():
        assert np.isnan(values.values[unknown]).all(), name
    assert np.isfinite(result.maps["max_flow_thickness"].values[~unknown]).all()


def test_an_open_edge_acts_as_the_rim_of_the_raster_does():
    """The same slope once cut off by the raster's rim, once by cells without elevation: the flow before the cut is the same."""
    y, x = np.mgrid[:24, :40].astype(float)
    slope = 500.0 - CELL * x * np.tan(np.radians(30.0)) + 0.0 * y
    found = []
    for z in (slope[:, :24], np.where(x >= 24, np.nan, slope)):
        terrain = Terrain.from_array(z, CELL)
        thickness = np.zeros(terrain.shape)
        thickness[6:18, 4:14] = 6.0
        release = Release.from_array(thickness, terrain, placement="on_surface")
        found.append(simulate(terrain, release, MATERIAL, basal_friction_angle=15.0, cell_size=5.0, end_time=9.0))
    rim, cut = found
    assert float(cut.ledger["escaped_mass"][-1]) == pytest.approx(float(rim.ledger["escaped_mass"][-1]), rel=1e-3)
    assert float(cut.ledger["escaped_mass"][-1]) > 0.5 * float(cut.ledger["mass"][0])
    for name in ("max_flow_thickness", "max_speed", "deposit_thickness"):
        np.testing.assert_allclose(cut.maps[name].values[:, :23], rim.maps[name].values[:, :23], atol=0.02, err_msg=name)


@pytest.mark.parametrize("spacing", [3.0, 7.0])
def test_a_release_beside_the_edge_begins_whole_on_known_ground(spacing):
    """Columns of the grid do not end where the cells of the release do."""
    z = 500.0 - 3.0 * np.mgrid[:40, :40][1].astype(float)
    z[:, 24:] = z[20, 12] = np.nan
    terrain = Terrain.from_array(z, CELL)
    thickness = np.zeros(terrain.shape)
    thickness[10:30, 8:24] = 6.0
    thickness[20, 12] = 0.0
    release = Release.from_array(thickness, terrain, placement="on_surface")
    scene, p = build_scene(terrain, release, MATERIAL, 20.0, Numerics(cell_size=spacing))
    x, y, z_p = p.position(np.array(scene.spacing)).T
    assert scene.holds(x, y).all()
    assert p.mass.sum() == pytest.approx(release.volume * MATERIAL.density, rel=1e-12)
    above = z_p - scene.surface.elevation(x, y)
    assert 0 < above.min() < above.max() < 6.5


def test_unknown_cells_under_a_release_are_refused_with_their_place():
    z = catchment()
    z[10, 10] = np.nan
    terrain = Terrain.from_array(z, CELL)
    thickness = np.zeros(terrain.shape)
    thickness[8:16, 6:14] = 6.0
    release = Release(thickness, terrain, placement="on_surface")  # made by hand: no reader has looked
    with pytest.raises(DemError, match=r"1 of 64 cells of the release have no elevation, first row 10, column 10"):
        simulate(terrain, release, MATERIAL, cell_size=5.0, end_time=1.0)


def test_unknown_cells_lie_where_the_raster_has_them():
    """Row 0 is in the north; the backends count from the south-west."""
    z = np.full((5, 7), 100.0)
    z[0, 6] = z[3, 1] = np.nan
    terrain = Terrain.from_array(z, (10.0, 20.0))
    found = unknown_cells(terrain)
    assert np.argwhere(found).tolist() == [[1, 1], [6, 4]]
    assert unknown_cells(Terrain.from_array(np.zeros((5, 7)), 10.0)) is None


def test_open_cells_are_the_unknown_ones_beside_the_reach_corner_to_corner_too():
    z = np.zeros((5, 6))
    z[:, 4:] = np.nan
    z[0, 0] = np.nan
    reach = np.zeros((5, 6), bool)
    reach[3, 3] = True
    found = open_edge.open_cells(Terrain(z, (5.0, 5.0)), reach)
    assert np.argwhere(found).tolist() == [[2, 4], [3, 4], [4, 4]]


def test_places_without_elevation_are_told_the_largest_first_with_where_they_lie():
    z = np.zeros((9, 12))
    z[3:5, 4:7] = np.nan  # a hole
    z[:, 11] = np.nan
    terrain = Terrain(z, (5.0, 4.0), 100.0, 200.0, None, "dem.tif")
    assert open_edge.note(terrain) == [
        "dem.tif: 15 of 108 cells have no elevation; they are an open edge, mass that enters them is booked as escaped"
    ]
    cells = np.isnan(z)
    cells[:5, 11] = False
    said = open_edge.statement(terrain, cells)
    assert "may come to 10 cells without elevation" in said
    hole = "a hole of 6 cells around row 4, column 5 (easting 127.5, northing 218.0)"
    rim = "4 cells along the edge of the known ground (easting 157.5 to 157.5, northing 202.0 to 214.0)"
    assert said.index(hole) < said.index(rim)
    assert "more places" not in said
    z[0:9:2, 0] = z[8, 2:10:2] = np.nan
    terrain = Terrain(z, (5.0, 4.0), 100.0, 200.0, None, "dem.tif")
    assert "; and 7 more places; " in open_edge.statement(terrain, np.isnan(z))
