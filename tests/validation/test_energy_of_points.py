"""Single points beside the mass of avaKot: what they lose on planes and at a kink."""

import math

import numpy as np
import pytest

from runout import Release, Terrain
from runout.studies.validation_cases.avakot import Points

CELL = 5.0


def release_on(elevation):
    """A release near the western rim."""
    terrain = Terrain(elevation, (CELL, CELL))
    thickness = np.zeros(elevation.shape)
    thickness[18:22, 4:8] = 2.0
    return Release(thickness, terrain, placement="on_surface")


def plane(tangent):
    return release_on(np.broadcast_to(1000.0 - tangent * np.arange(200) * CELL, (40, 200)))


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_points_on_a_plane_lose_only_to_friction(mu):
    tangent = 0.6
    assert Points.on(plane(tangent), mu).slide(10.0).lost == pytest.approx(mu / tangent, abs=2e-3)


def test_drag_ends_the_acceleration_at_the_terminal_speed():
    tangent, drag = 0.6, 0.02
    points = Points.on(plane(tangent), 0.0, drag).slide(20.0)
    terminal = math.sqrt(9.81 * math.sin(math.atan(tangent)) / drag)
    np.testing.assert_allclose(np.linalg.norm(points.velocity, axis=0), terminal, rtol=0.01)


def bowl(drop):
    """A parabola that ends level; behind it a cliff."""
    x = (np.arange(300) + 0.5) * CELL
    ground = np.where(x < 600.0, (600.0 - x) ** 2 / 1200.0, 0.0) + np.where(x < 650.0, drop, 0.0)
    return release_on(np.broadcast_to(ground, (40, 300)))


def test_points_follow_a_bend_that_is_resolved_without_a_loss():
    assert Points.on(bowl(0.0)).slide(17.0).lost < 0.03


def test_points_lose_the_velocity_into_the_ground_where_they_land():
    """They leave a cliff of 200 m level, and keep that velocity on the ground below."""
    points = Points.on(bowl(200.0)).slide(26.0)
    assert points.place[0].max() < 1500.0
    assert points.lost == pytest.approx(200.0 / points.start.mean(), abs=0.02)


def test_points_that_leave_an_edge_fly():
    x = np.arange(200) * CELL
    ground = np.where(x < 100.0, 500.0 - x, 300.0 - 3.0 * np.maximum(x - 110.0, 0.0))
    points = Points.on(release_on(np.broadcast_to(ground, (40, 200))))
    assert points.lifted(5.0) == 0.0
    assert max(points.slide(1.0).lifted(5.0) for _ in range(10)) == 1.0
