"""Drainage, sinks and flow paths of small terrains with known answers, and what happens without landlab."""

import logging
import sys

import numpy as np
import pytest

from runout import Terrain, cli
from runout.errors import ExitCode, LibraryError
from runout.scores.slope_normal import terrain_slope
from runout.slopes import drainage as drainage_module
from runout.slopes.drainage import drainage
from runout.slopes.sinks import hidden_share, sinks, terrain_figures

CELL = (10.0, 8.0)


def plane(rows=12, columns=9):
    """Elevation that falls to the south by 2 m a cell; the middle column is lowest."""
    z = 100.0 - 2.0 * np.arange(rows)[:, None] + 0.001 * (np.arange(columns)[None, :] - columns // 2) ** 2
    return np.broadcast_to(z, (rows, columns)).copy()


def test_water_of_a_plane_goes_straight_down_and_leaves_at_the_rim():
    z = plane()
    found = drainage(Terrain.from_array(z, CELL))
    rows, columns = z.shape
    inner = np.s_[1 : rows - 1, 1 : columns - 1]
    below = np.arange(z.size).reshape(z.shape) + columns
    assert np.array_equal(found.receiver[inner], below[inner])
    cells = np.broadcast_to(np.arange(1, rows - 1)[:, None], found.area[inner].shape)
    assert found.area[inner] == pytest.approx(80.0 * cells)
    outlets = found.receiver.ravel() == np.arange(z.size)
    assert found.area.ravel()[outlets & (found.area.ravel() > 80.0)].sum() == pytest.approx(80.0 * (columns - 2) * (rows - 2))
    assert found.sink_depth.max() == pytest.approx(0.0, abs=1e-6)


def test_a_pit_is_found_with_its_depth_area_volume_and_place():
    z = plane()
    z[5, 3:6] -= 5.0
    terrain = Terrain.from_array(z, CELL, origin=(1000.0, 2000.0))
    found, totals = sinks(drainage(terrain))
    spill = z[6, 4]  # water leaves to the south
    assert len(found) == totals["number"] == 1
    depth = spill - z[5, 3:6]
    assert found[0].depth == pytest.approx(depth.max(), abs=1e-3)
    assert found[0].area == 3 * 80.0
    assert found[0].volume == pytest.approx(depth.sum() * 80.0, rel=1e-3)
    assert (found[0].easting, found[0].northing) == (terrain.easting[4], terrain.northing[5])
    assert found[0].outline.bounds == (1030.0, 2048.0, 1060.0, 2056.0)
    share = hidden_share(drainage(terrain))
    assert share == pytest.approx((3 + 5 * 4) / z.size)  # the pit, and the cells above it and diagonally above


def test_unknown_cells_are_an_open_edge():
    z = plane()
    z[6:9, 3:6] = np.nan
    found = drainage(Terrain.from_array(z, CELL))
    assert np.array_equal(np.isnan(found.area), np.isnan(z))
    assert np.nanmax(found.sink_depth) == pytest.approx(0.0, abs=1e-6)
    assert found.area[9, 4] == pytest.approx(80.0)  # no water comes from beyond the hole


def test_flow_paths_end_where_they_meet_and_drain_what_they_state():
    y, x = np.mgrid[:40, :41]
    z = 2.0 * (40 - y) + 10.0 * np.abs(x - 20)  # a valley to the south
    terrain = Terrain.from_array(z, 10.0)
    drained = drainage(terrain)
    figures = terrain_figures(drained, terrain_slope(terrain.elevation, terrain.cell_size))
    main = max(figures.paths, key=lambda path: path["drainage_area_m2"])
    assert main["geometry"].coords[-1] == (terrain.easting[20], terrain.northing[-1])
    assert main["drainage_area_m2"] == pytest.approx(39 * 38 * 100.0)  # all but the rim
    assert sum(figures.classes.values()) == pytest.approx(1.0)
    assert figures.steepest_deg == pytest.approx(np.degrees(np.arctan(np.hypot(0.2, 1.0))))


def test_a_terrain_of_too_many_cells_is_averaged_with_a_warning(caplog):
    with caplog.at_level(logging.WARNING):
        coarse = drainage_module.manageable(Terrain.from_array(plane(40, 30), CELL), largest=400)
    assert coarse.shape == (20, 15)
    assert coarse.cell_size == (20.0, 16.0)
    assert "averaged over blocks of 2 x 2 cells" in caplog.text


def test_without_landlab_one_line_has_the_command_that_installs_it(monkeypatch, capsys):
    for name in [name for name in sys.modules if name.split(".")[0] == "landlab"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "landlab", None)
    with pytest.raises(LibraryError, match="pip install 'runout\\[slopes\\]'"):
        drainage_module.landlab_components()
    assert cli.main(["suggest-release", "dem.tif"]) == ExitCode.FAILURE
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "pip install 'runout[slopes]'" in told
