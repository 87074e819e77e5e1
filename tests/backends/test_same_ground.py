"""Every backend finds the ground where the sliding surface is: crests of dams, walls and floors of pits, and the mass in them."""

import numpy as np
import pytest
from scenes import SAND, at, loaded, scene

from runout import Placement, Release, Terrain
from runout.backends.resting_particles import sample_particles
from runout.terrain import sdf
from runout.terrain.crests import Mass

H, CELL, NEAR = 1.5, 2.0, 0.01  # m, m, cells of the grid


def terrain_with_dams():
    """Cells of 2 m on a slope; a dam of 5 m, two cells wide, along the raster and one oblique to it."""
    x, y = (np.arange(30) + 0.5) * CELL, (np.arange(36)[::-1, None] + 0.5) * CELL
    z = 20.0 - 0.2 * x + 0 * y
    oblique = np.abs((x - 36) * np.cos(0.5) + (y - 40) * np.sin(0.5)) < CELL
    return Terrain.from_array(z + 5.0 * (oblique | (np.abs(y - 62) < CELL)), (CELL, CELL))


def pit(terrain):
    """An excavated mass with vertical walls, 6 m thick."""
    thickness = np.zeros(terrain.shape)
    thickness[20:28, 5:11] = 6.0
    return Release(thickness, terrain, placement=Placement.EXCAVATED)


@pytest.fixture(scope="module", params=["crests everywhere", "crests in a window"])
def ground(request):
    """In a window, its border runs across both dams."""
    terrain = terrain_with_dams()
    mass = None if request.param == "crests everywhere" else Mass(pit(terrain).thickness, np.radians(45.0))
    made = sdf.sliding_surface(terrain, pit(terrain).thickness, (H, H), mass)
    assert (made.change.shape[0] > 40) == (mass is None)
    return made


def test_contact_begins_at_the_sliding_surface_on_crests_and_on_walls(backend, ground):
    """Single particles a hundredth of a cell above the ground touch nothing; those as far below it do."""
    node = np.stack(np.meshgrid(np.arange(3, 36, 4.0), np.arange(3, 44, 4.0), indexing="ij"), axis=-1).reshape(-1, 2)
    place = (node + np.random.default_rng(2).uniform(-0.5, 0.5, node.shape)) * H  # four cells apart, so that none feels another
    z, east, north = ground.evaluate(*place.T)
    assert np.hypot(east, north).max() > 1.0
    up = NEAR * H * np.sqrt(1.0 + east**2 + north**2)
    s = scene(ground, (H, H, H), (SAND,), contact_band=1e-4)
    for side, touching in ((1.0, 0), (-1.0, len(place))):
        p = at(np.column_stack([place, z + side * up]), (H, H, H))
        loaded(backend, s, p).step(1e-5)
        assert backend.ledger().contact_particles == touching


def test_an_excavated_mass_begins_on_the_ground_of_contact(backend, ground):
    """No particle lies deeper than its own size allows: before up to 0.15 cells at the walls of a pit on scan and hash."""
    particles = sample_particles([pit(terrain_with_dams())], [SAND], ground, (H, H, H), 8)
    x = particles.position(np.full(3, H))
    s = scene(ground, (H, H, H), (SAND,))
    assert s.ground is s.surface
    z, east, north = s.ground.evaluate(x[:, 0], x[:, 1])
    gap = (x[:, 2] - z) / np.sqrt(1.0 + east**2 + north**2)
    assert gap.min() > 0.0
    loaded(backend, s, particles).step(1e-6)
    assert 0 < backend.ledger().contact_particles <= (gap < particles.radius + 0.01 * H).sum()
