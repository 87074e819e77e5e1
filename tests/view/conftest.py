"""Scenes."""

from dataclasses import replace

import numpy as np
import pytest
from ramp_scene import ramp_scene


@pytest.fixture
def scene():
    return ramp_scene()


@pytest.fixture
def crowded(scene):
    """The scene with particles, of which one leaves, and a structure."""
    particles = np.zeros((3, 5, 4))
    particles[..., 0], particles[..., 1] = scene.easting[6], scene.northing[11]
    particles[..., 2], particles[..., 3] = 80.0, [[0.0], [20.0], [5.0]]
    particles[2, 4] = np.nan
    corners = np.array([[250.0, 100.0, 0.0], [270.0, 100.0, 0.0], [260.0, 120.0, 0.0], [260.0, 110.0, 30.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    mesh = (corners + np.array([*scene.origin, 0.0]), faces)
    return replace(scene, particles=particles, meshes={"dam": mesh})
