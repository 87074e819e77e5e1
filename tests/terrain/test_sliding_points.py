"""Points that slide in place of a mass: closed forms on planes, drag, stragglers, and the energy line."""

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


def slid(release, frictions, end_time=10.0, drag=0.0, **choices):
    """Slide against coefficients of members [1], and a drag [1/m]."""
    coefficient = np.array(frictions)

    def resistance(columns):
        return G * coefficient[columns.member] * columns.cosine, drag / columns.thinness

    return slide([release], resistance, len(frictions), (CELL, CELL), end_time, **choices)


def test_points_on_a_plane_gain_the_speed_of_a_sliding_block():
    tangent, end = 0.6, 8.0
    found = slid(plane(tangent), [0.0, 0.3], end)
    cosine = 1 / np.sqrt(1 + tangent**2)
    for k, friction in enumerate((0.0, 0.3)):
        wanted = G * cosine * (tangent - friction) * found.time[-1]
        assert found.speed[-1, k] == pytest.approx(wanted, rel=2e-3)
        assert found.fastest[-1, k] == pytest.approx(wanted, rel=2e-3)
    assert found.time[-1] == pytest.approx(end)
    assert (found.share == 1).all()


def test_drag_ends_the_acceleration_at_the_terminal_speed():
    """v = v_t tanh(t a / v_t) with a = g (sin - mu cos), v_t^2 = a / drag."""
    tangent, friction, drag = 0.6, 0.2, 0.01
    found = slid(plane(tangent), [friction], 25.0, drag)
    a = G * (tangent - friction) / np.sqrt(1 + tangent**2)
    terminal = np.sqrt(a / drag)
    np.testing.assert_allclose(found.speed[:, 0], terminal * np.tanh(found.time * a / terminal), rtol=0.02)
    assert found.fastest.max() == pytest.approx(terminal, rel=1e-3)


def test_columns_are_as_thick_as_points_gather_and_drag_falls_with_their_thickness():
    """They part on a ridge, stretch on a plane, and gather in channels, up to the thickness of the resistance."""
    slope, north = plane(0.6).terrain.elevation, (np.arange(40) - 19.5)[:, None] * CELL
    grounds = [release_on(slope + bend * north**2) for bend in (-0.002, 0.0, 0.002, 0.01)]
    found = [slid(one, [0.2], drag=0.01 * 2.0 / 5.0, most=[5.0]) for one in grounds]
    speeds = [one.speed[-1, 0] for one in found]
    assert sorted(speeds) == speeds
    assert speeds[0] < 0.8 * slid(grounds[0], [0.2], drag=0.01).speed[-1, 0] < speeds[-1]
    assert found[-1].fastest.max() == pytest.approx(slid(grounds[-1], [0.2], drag=0.01 * 2.0 / 5.0).fastest.max(), rel=0.05)
    free, thin = (slid(grounds[1], [0.2], most=most) for most in (None, [2.0]))
    np.testing.assert_array_equal(free.speed, thin.speed)


def test_points_that_friction_holds_stay_at_rest_and_end_the_slide():
    found = slid(plane(0.3), [0.31])
    assert found.speed.shape == (1, 1)
    assert found.speed[-1, 0] == 0


def test_points_run_out_as_far_as_the_energy_line_says_less_a_plastic_impact_at_the_kink():
    x = np.arange(300) * CELL
    found = slid(release_on(np.broadcast_to(np.maximum(0.0, 0.5 * (400.0 - x)), (40, 300)).copy()), [0.25], 90.0)
    on_slope = 400.0 - 6 * CELL  # in plan, from the middle of the release
    head = on_slope * (0.5 - 0.25) * 0.8  # of the velocity along the plain: cosine squared of the slope
    way = float(found.speed[:, 0] @ np.diff(found.time, prepend=0.0))
    assert found.speed[-1, 0] == 0
    assert way == pytest.approx(on_slope * np.sqrt(1.25) + head / 0.25, rel=0.02)


def test_a_hollow_of_two_cells_holds_the_points_that_start_in_it_back():
    """The ground is the sliding surface of a run, and points start all over their cells: a few stay, or come late."""
    tangent = 0.3
    z = np.broadcast_to(1000.0 - tangent * np.arange(200) * CELL, (40, 200)).copy()
    z[18:20, 5:7] -= 3.0
    even, hollow = (slid(release_on(one), [0.1], 6.0) for one in (plane(tangent).terrain.elevation, z))
    assert (even.share[-1], hollow.share[-1]) == (1.0, 1.0)
    assert hollow.speed[-1, 0] < 0.97 * even.speed[-1, 0]
    assert hollow.fastest[-1, 0] > 0.97 * even.fastest[-1, 0]


def test_points_that_leave_the_terrain_or_what_is_known_of_it_are_gone():
    for elevation in (np.broadcast_to(200 - 0.6 * np.arange(40) * CELL, (40, 40)).copy(), None):
        if elevation is None:
            elevation = np.broadcast_to(200 - 0.6 * np.arange(200) * CELL, (40, 200)).copy()
            elevation[:, 60:] = np.nan
        found = slid(release_on(elevation), [0.1], 60.0)
        assert found.share[0, 0] == 1
        assert found.share[-1, 0] == 0
        assert found.time[-1] < 30.0
