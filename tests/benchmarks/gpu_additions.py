"""What a scene of the throughput benchmark may have besides: other laws of friction, structures with and without mass at them."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "structures"))

from boxes import Box, field_of_boxes

from runout import VelocityWeakening
from runout.model.scene import Scene

FRICTION = np.tan(np.radians(15.0))
WALL = (2.0, 12.0)  # half its thickness and half its height [m]
PATCH = 4.0  # [m]


def with_wall(scene: Scene, east: float) -> Scene:
    """The scene with a wall across the whole raster at ``east`` [m]."""
    width = scene.raster.rows * scene.spacing[1]
    ground = float(scene.surface.elevation(np.array([east]), np.array([width / 2]))[0])
    wall = Box((east, width / 2, ground), (WALL[0], width / 2, WALL[1]), 0.0, 0.4)
    return replace(scene, structures=field_of_boxes([wall], scene.spacing[0] / 2, 2.5 * scene.spacing[0], PATCH))


ADDITIONS: dict[str, Callable[[Scene, float], Scene]] = {
    "none": lambda scene, _: scene,
    "velocity weakening": lambda scene, _: replace(
        scene, friction=(VelocityWeakening(static_friction=FRICTION, dynamic_friction=0.8 * FRICTION),)
    ),
    "a wall that the mass does not reach": lambda scene, toe: with_wall(scene, toe + 36.0),
    "a wall at the toe": lambda scene, toe: with_wall(scene, toe + 3.0),
}
"""Changes of a scene by name; the second argument is the easting of the toe [m]."""
