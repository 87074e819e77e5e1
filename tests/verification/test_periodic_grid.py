"""Periodic grids: the fast backend gives what the slow one gives, and refuses what does not fit."""

import numpy as np
import pytest

from runout import DruckerPrager
from runout.backends.protocol import get_backend
from runout.errors import ConfigError
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.studies.verification_cases.bodies import lattice, particles_at

H, PERIOD = 0.1, (16, 8, 0)
SAND = DruckerPrager(density=1000.0, youngs_modulus=1e6, friction_angle=20.0)


def stirred():
    """A scene and a body whose particles fly in all directions, and across the ends of the period."""
    rng = np.random.default_rng(1)
    local = lattice((1.2, 0.4, 0.5), H)
    local += rng.uniform(-0.02, 0.02, local.shape)
    p = particles_at(local + np.array([10.0, 10.0, 5.035]), H, SAND.density, H / 4)
    p.velocity[:] = 0.3 * rng.normal(size=(len(p), 3)) + np.array([3.0, -2.0, 0.0])
    floor = Surface.through(np.full((12, 12), 5.035), (10.0, 10.0))
    return Scene((H,) * 3, floor, Raster(100, 100, (1.0, 1.0)), (SAND,), (0.3,), (2.0, 0.0, -9.81), precision="float64"), p


def test_periodic_scan_equals_the_periodic_reference():
    scene, p = stirred()
    slow, fast = get_backend("reference"), get_backend("scan", threads=1, index="dense")
    slow.period[:2], fast.period = PERIOD[:2], PERIOD
    for engine in (slow, fast):
        engine.load(scene, p)
    dt = 0.8 * slow.stable_step()
    for _ in range(160):
        slow.step(dt)
        fast.step(dt)
    a, b = slow.particles(), fast.particles()
    np.testing.assert_allclose(b.velocity, a.velocity, atol=1e-9)
    np.testing.assert_allclose(b.strain, a.strain, atol=1e-12)
    apart = (b.position(np.full(3, H)) - a.position(np.full(3, H))) / (H * np.array([16, 8, 1]))
    apart[:, :2] -= np.round(apart[:, :2])  # the slow one does not bring them back
    assert np.abs(apart).max() < 1e-10
    assert a.node[:, 0].max() >= p.node[:, 0].min() + PERIOD[0]  # some went round


def test_period_that_the_blocks_cannot_have_is_refused():
    scene, p = stirred()
    engine = get_backend("scan", threads=1, index="dense")
    engine.period = (0, 6, 0)
    with pytest.raises(ConfigError, match="multiple of 4 cells"):
        engine.load(scene, p)
    engine.period = (8, 0, 0)
    with pytest.raises(ConfigError, match="reach beyond the period"):
        engine.load(scene, p)
