"""Where the camera stands."""

import math
from dataclasses import replace

import numpy as np
import pytest

from runout.errors import ConfigError
from runout.view import camera as cameras

ASPECT = 16 / 9


def in_picture(camera, points):
    """Coordinates in the picture, -1 to 1."""
    towards = camera.position - camera.focus
    depth = np.linalg.norm(towards)
    right = np.cross(camera.up, towards / depth)
    at = points - camera.position
    half = math.tan(math.radians(cameras.VIEW_ANGLE_DEG) / 2) * -(at @ (towards / depth))
    return at @ right / half / ASPECT, at @ camera.up / half


def test_the_whole_flow_is_in_the_picture_left_of_the_colour_bar(scene):
    for direction in (None, (0.0, 0.5), (math.pi, math.pi / 2)):
        x, y = in_picture(cameras.camera_for(scene, direction, ASPECT), scene.points()[scene.reached])
        assert np.abs(y).max() <= 0.85
        assert x.min() >= -0.97
        assert x.max() <= 0.75
        assert max(np.ptp(x) / 1.6, np.ptp(y) / 1.6) > 0.75  # it fills one of the sides


def test_the_camera_faces_the_slope(scene):
    azimuth, elevation = cameras.best_direction(scene, ASPECT)
    assert 0 < math.degrees(azimuth) < 180  # the ramp falls to the east
    assert elevation == pytest.approx(math.radians(33))


def test_the_camera_stands_where_no_ridge_hides_the_flow(scene):
    plain = replace(scene, ground=np.zeros_like(scene.ground))
    points = plain.points()[plain.reached]
    for side, wall in (("south", slice(17, 19)), ("north", slice(5, 7))):
        ground = np.zeros_like(scene.ground)
        ground[wall, :] = 150.0
        seen = {
            name: cameras._visible(replace(scene, ground=ground), points, cameras._towards(math.radians(angle), math.radians(33)))
            for name, angle in cameras.NAMED.items()
        }
        other = "north" if side == "south" else "south"
        assert not seen[side].any()
        assert seen[other].all(), side


@pytest.mark.parametrize(
    ("text", "expected"), [("south", (180, 33)), ("top", (180, 90)), ("135,30", (135, 30)), ("45", (45, 33)), ("auto", None)]
)
def test_a_stated_direction(text, expected):
    found = cameras.stated_direction(text)
    assert found is None if expected is None else np.degrees(found) == pytest.approx(expected)


@pytest.mark.parametrize("text", ["above", "10,100", "10,0", "nan,30", "1,2,3"])
def test_a_direction_that_is_none_is_refused(text):
    with pytest.raises(ConfigError, match="135,30"):
        cameras.stated_direction(text)


def test_from_the_top_north_is_up(scene):
    camera = cameras.camera_for(scene, cameras.stated_direction("top"), ASPECT)
    assert camera.up == pytest.approx([0, 1, 0], abs=1e-12)
    assert (camera.position - camera.focus)[:2] == pytest.approx([0, 0], abs=1e-6)
