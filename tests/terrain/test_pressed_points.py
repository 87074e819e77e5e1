"""Points that press on each other: volume, slope and depth of the mass that they stand for."""

import numpy as np
import pytest
from test_sliding_points import CELL, G, plane, release_on

from runout import DruckerPrager
from runout.terrain.sliding_points import POINTS, Points, _Squares, forecast_depth, lateral_pressure


def depth(release, friction, pressure=1.0, end_time=15.0):
    def resistance(columns):
        return G * friction * columns.cosine, 0.0

    return forecast_depth([release], resistance, np.array([pressure]), (CELL, CELL), end_time, [2.0])


def test_squares_hold_the_volume_and_the_slope_of_a_wedge():
    ground = release_on(np.zeros((40, 40)))
    squares = _Squares.under([ground], POINTS)
    x, y = np.meshgrid(np.linspace(20, 100, 201), np.linspace(20, 100, 201))
    place = np.array([x.ravel(), y.ravel()])
    squares.volume = 80.0**2 * 2.0 / x.size  # 2 m thick
    thickness, slope = squares.lay(place)
    assert squares.peak.sum() * squares.size**2 == pytest.approx(squares.volume * x.size)
    inside = (np.abs(place - 60.0) < 30.0).all(0)
    np.testing.assert_allclose(thickness[inside], 2.0, rtol=0.02)
    assert np.abs(slope[:, inside]).max() < 0.02
    wedge = np.array([20.0 + 80.0 * np.sqrt((x.ravel() - 20.0) / 80.0), y.ravel()])  # thickness grows to the east, to 4 m
    thickness, slope = squares.lay(wedge)
    inside = (np.abs(wedge - 60.0) < 25.0).all(0)
    np.testing.assert_allclose(thickness[inside], 4.0 * (wedge[0, inside] - 20.0) / 80.0, rtol=0.1)
    np.testing.assert_allclose(slope[:, inside].mean(1), [4.0 / 80.0, 0.0], atol=2e-3)


def test_a_mass_that_friction_holds_keeps_its_depth():
    held = depth(plane(0.2), 3.0)
    assert held == pytest.approx(2.0, rel=0.25)  # the rim of a release of eight squares is spread over two
    assert depth(release_on(np.zeros((40, 200))), 3.0) == pytest.approx(held, rel=0.05)


def test_a_flow_is_thinner_the_less_friction_and_the_more_pressure_it_has():
    ramp = release_on(np.broadcast_to(np.maximum(0.0, 200.0 - 0.5 * np.arange(200) * CELL), (40, 200)).copy())
    assert depth(ramp, 0.2) < depth(ramp, 0.35) < depth(ramp, 3.0)
    assert depth(ramp, 0.3, 1.0) < depth(ramp, 0.3, 0.5) < depth(ramp, 0.3, 0.01)


def test_a_mass_that_leaves_the_terrain_has_had_a_depth():
    assert 0.0 < depth(plane(0.6, columns=20), 0.1) < 2.0


def test_lateral_pressure_lies_between_a_liquid_and_a_mass_at_rest():
    sand = DruckerPrager(density=1800.0, friction_angle=30.0)
    np.testing.assert_allclose(lateral_pressure([sand]), [0.75])


def test_points_without_pressure_slide_as_before():
    release = plane(0.6)
    alone, pressed = Points.of([release], 1, 50), Points.of([release], 1, 50)
    from runout.terrain.sliding_points import Ground

    ground = Ground.under([release], (CELL, CELL))
    resist = lambda columns: (0.0 * columns.cosine, 0.0)  # noqa: E731
    uphill = np.array([[0.6], [0.0]])  # cancels the slope
    assert (alone.advance(ground, resist, 0.1) > 0.4).all()
    assert (pressed.advance(ground, resist, 0.1, uphill) < 1e-2).all()
