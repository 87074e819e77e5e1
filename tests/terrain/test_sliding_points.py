"""Points that slide in place of a mass: closed forms on planes, and the energy line."""

import numpy as np
import pytest

from runout import Release, Terrain
from runout.terrain.sliding_points import slide

G, CELL = 9.81, 5.0


def release_on(elevation):
    """A square release near the western rim."""
    terrain = Terrain(elevation, (CELL, CELL))
    thickness = np.zeros(elevation.shape)
    thickness[18:22, 4:8] = 2.0
    return Release(thickness, terrain, placement="on_surface")


def plane(tangent, columns=200):
    return release_on(np.broadcast_to(-tangent * np.arange(columns) * CELL, (40, columns)) + 1000.0)


def slid(release, frictions, end_time=10.0):
    coefficient = np.array(frictions)[:, None]
    return slide([release], lambda number, x, y: coefficient + 0 * x, len(frictions), (CELL, CELL), (end_time, CELL / 30.0))


def test_points_on_a_plane_gain_the_speed_of_a_sliding_block():
    tangent, end = 0.6, 8.0
    found = slid(plane(tangent), [0.0, 0.3], end)
    cosine = 1 / np.sqrt(1 + tangent**2)
    for k, friction in enumerate((0.0, 0.3)):
        wanted = G * cosine * (tangent - friction) * found.time[-1]
        assert found.speed[-1, k] == pytest.approx(wanted, rel=2e-3)
        assert found.fastest[-1, k] == pytest.approx(wanted, rel=2e-3)
    assert (found.share == 1).all()


def test_points_that_friction_holds_stay_at_rest_and_end_the_slide():
    found = slid(plane(0.3), [0.31])
    assert found.speed.shape == (1, 1)
    assert found.speed[-1, 0] == 0


def test_points_run_out_as_far_as_the_energy_line_says_less_a_plastic_impact_at_the_kink():
    x = np.arange(300) * CELL
    found = slid(release_on(np.broadcast_to(np.maximum(0.0, 0.5 * (400.0 - x)), (40, 300)).copy()), [0.25], 90.0)
    on_slope = 400.0 - 6 * CELL  # in plan, from the middle of the release
    head = on_slope * (0.5 - 0.25) * 0.8  # of the velocity along the plain: cosine squared of the slope
    assert found.speed[-1, 0] == 0
    assert float(found.speed[:, 0].sum() * found.time[0]) == pytest.approx(on_slope * np.sqrt(1.25) + head / 0.25, rel=0.02)


def test_points_that_leave_the_terrain_or_what_is_known_of_it_are_gone():
    for elevation in (np.broadcast_to(200 - 0.6 * np.arange(40) * CELL, (40, 40)).copy(), None):
        if elevation is None:
            elevation = np.broadcast_to(200 - 0.6 * np.arange(200) * CELL, (40, 200)).copy()
            elevation[:, 60:] = np.nan
        found = slid(release_on(elevation), [0.1], 60.0)
        assert found.share[0, 0] == 1
        assert found.share[-1, 0] == 0
        assert found.time[-1] < 30.0
