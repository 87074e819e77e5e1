"""What only the reference backend offers, for verification: a grid that repeats, and a body force."""

import numpy as np
from scenes import at, box, cloud, loaded, scene

from runout.backends.protocol import get_backend


def test_uniform_push_is_gravity():
    """A change of velocity of dt g before a step is the same as gravity g in it."""
    results = []
    for gravity, change in (((0.0, 0.0, -9.81), (0.0, 0.0, 0.0)), ((0.0, 0.0, 0.0), (0.0, 0.0, -9.81e-3))):
        backend, p = loaded(get_backend("reference"), scene(gravity=gravity), cloud(100)), None
        for _ in range(5):
            backend.push(np.broadcast_to(change, (100, 3)))
            backend.step(1e-3)
        p = backend.particles()
        results.append((p.position(np.ones(3)), p.velocity, p.strain))
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-13)


def test_block_that_fills_the_period_is_endless():
    """Without faces it may be strained without being pushed apart; the same block alone springs back."""
    speeds = []
    for period in ((4, 4, 4), None):
        p = box((20.0, 20.0, 2.0), (4.0, 4.0, 4.0), (1.0, 1.0, 1.0))
        p.strain[:] = (0.01, 0.01, 0.01, 0.0, 0.0, 0.0)
        backend = loaded(get_backend("reference"), scene(gravity=(0, 0, 0)), p)
        if period:
            backend.period = np.array(period)
        backend.step(1e-3)
        speeds.append(np.abs(backend.particles().velocity).max())
    assert speeds[0] < 1e-15
    assert speeds[1] > 1e-3


def test_place_within_the_period_does_not_matter():
    """Two particles a period apart see the same nodes."""
    p = at([(20.3, 20.4, 2.2), (24.3, 20.4, 2.2)], (1.0, 1.0, 1.0))
    p.velocity[0, 0] = 2.0
    backend = loaded(get_backend("reference"), scene(gravity=(0, 0, 0)), p)
    backend.period = np.array((4, 4, 4))
    backend.step(1e-3)
    np.testing.assert_allclose(backend.particles().velocity[:, 0], 1.0, atol=1e-13)
