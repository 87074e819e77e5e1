"""Crests are corrected where the mass may come; what that takes does not follow the number of nodes under the raster."""

import numpy as np
import pytest

from runout import Terrain
from runout.terrain import crests, sdf
from runout.terrain.crests import Mass
from runout.terrain.prepare import reachable


def ridges(n=120, cell=5.0, slope=0.3):
    """A slope to the east with dams two cells wide across it, every 12 cells, and a mass near its top."""
    x = np.arange(n)
    z = 200.0 - slope * cell * x + 4.0 * (x % 12 < 2) + np.zeros((n, 1))
    thickness = np.zeros((n, n))
    thickness[55:62, 20:28] = 5.0
    return Terrain.from_array(z, (cell, cell)), thickness


@pytest.mark.parametrize(("degrees", "most"), [(8.0, 14_000), (20.0, 5_000), (25.0, 1_500)])
def test_window_holds_all_that_the_mass_may_reach(degrees, most):
    terrain, thickness = ridges()
    angle = np.radians(degrees)
    reach = reachable(terrain, thickness, angle)[::-1].T
    box, top = sdf._extent(terrain, None, Mass(thickness, angle), (1, 1))
    found = crests.crest_window(terrain.elevation[::-1].T, terrain.cell_size, box, top, angle)
    for (first, last), axis in zip(found, (1, 0), strict=True):
        cells = np.flatnonzero(reach.any(axis=axis))
        assert first <= cells[0]
        assert last > cells[-1]
    assert crests._cells(found) < most


def test_reach_on_level_ground_is_the_same_on_every_side():
    box = (30, 33), (40, 42)
    found = crests._reached(np.zeros((80, 90)), (1.0, 1.0), box, 4.5, np.radians(45.0))
    margins = {abs(a - b) for ends, own in zip(found, box, strict=True) for a, b in zip(ends, own, strict=True)}
    assert margins == {5}  # cells that 4.5 m above the ground reach at 45 degrees


@pytest.mark.parametrize(("h", "angle"), [(3.0, 0.0), (10.0, 0.0), (30.0, 0.0), (3.0, 0.25), (70.0, 0.0)])
def test_a_raster_of_nine_million_cells_takes_a_bounded_table(h, angle):
    """Cells of 30 m; under it are up to 9e8 nodes of 3 m."""
    ground = np.broadcast_to(-0.5 * 30.0 * np.arange(3000)[:, None], (3000, 3000))
    cell = (30.0, 30.0)
    box = (1000, 1020), (2950, 2970)
    found = crests.crest_window(ground, cell, box, -14000.0, angle, crests.most_cells(cell, (h, h)))
    cells = crests._cells(found)
    assert cells <= 250_000
    assert all(first <= low and high <= last for (first, last), (low, high) in zip(found, box, strict=True))
    if crests.needs_table(cell, (h, h)):
        assert 8 * cells * (30.0 / h) ** 2 <= 16e6  # bytes
    else:
        assert h < 0.25 * 30.0


def test_a_mass_wider_than_the_bound_has_crests_in_its_middle():
    found = crests.crest_window(np.zeros((3000, 3000)), (5.0, 5.0), ((0, 3000), (0, 3000)), 10.0, 0.0, 100_000)
    assert 90_000 < crests._cells(found) <= 100_000
    assert found[0] == found[1]
    assert abs(sum(found[0]) - 3000) <= 1


def test_outside_the_window_the_ground_is_that_of_the_raster_and_nowhere_has_it_a_step(monkeypatch):
    terrain, thickness = ridges()
    monkeypatch.setattr(crests, "LARGEST_WINDOW", 900)
    ground = sdf.sliding_surface(terrain, None, (5.0, 5.0), Mass(thickness, 0.0))
    assert ground.change.size < 1600
    assert ground._tiles == {}
    y, near, far = 0.5 * (120 - 58) * 10.0, np.linspace(120.0, 121.0, 40), np.linspace(480.0, 481.0, 40)
    monkeypatch.undo()
    plain = sdf.raster_surface(terrain, None, (5.0, 5.0)).on_nodes((5.0, 5.0), (0, 0), (121, 121))
    whole = sdf.sliding_surface(terrain, None, (5.0, 5.0))
    np.testing.assert_array_equal(ground.elevation(far, y), plain.elevation(far, y))
    np.testing.assert_allclose(ground.elevation(near, y), whole.elevation(near, y), atol=1e-9)
    x = np.linspace(5.0, 595.0, 200_000)
    for line in (y, 10.0, 300.0):
        height, slope, _ = ground.evaluate(x, np.full_like(x, line))
        assert np.abs(np.diff(height)).max() < 1.5 * np.abs(slope).max() * (x[1] - x[0])


def test_ground_is_the_same_whatever_is_asked_for_with_it():
    terrain, thickness = ridges()
    ground = sdf.sliding_surface(terrain, None, (4.0, 4.0), Mass(thickness, 0.2))
    x, y = np.random.default_rng(2).uniform(10.0, 590.0, (2, 300))
    together = ground.evaluate(x, y)
    box = ground.on_nodes((0, 0), (151, 151)).evaluate(x, y)
    alone = ground.evaluate(x[:1], y[:1])
    for one, other, single in zip(together, box, alone, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11)
        assert single[0] == one[0]
    assert ground.elevation(np.zeros((0,)), np.zeros((0,))).shape == (0,)
    assert ground.elevation(np.zeros((3, 1)), np.zeros((1, 2))).shape == (3, 2)
