"""Every law of runout that yields moves a slab alike on all backends, from its stress at rest."""

from functools import cache

import numpy as np
import pytest
from scenes import SAND, box, engine_of, plane, scene

from runout.backends.initial_stress import strain_at_rest
from runout.model.laws import LAWS

SLOPE, STEPS, DT = 0.4, 60, 2e-3
YIELDING = [law for law in LAWS.of_runout() if law.update]


@cache
def moved(law, name):
    """Particles of a slab of a law after some steps on a backend, in order; of the reference once for all others."""
    engine = engine_of(name)
    choices = {} if law.name == SAND.law else {"substeps": 1}  # others compile no kernels of substeps
    a_scene = scene(plane(-SLOPE, 0.0, 30.0), materials=(law.example,), friction=(0.3,), **choices)
    slab = box((40.0, 36.0, 0.0), (4.0, 3.0, 2.0), (1.0, 1.0, 1.0), law.example.density, surface=a_scene.surface)
    above = slab.position(np.ones(3))[:, 2] - a_scene.surface.elevation(*slab.position(np.ones(3)).T[:2])
    n = len(slab)
    slab.strain = strain_at_rest(law.example, 2.0 - above, (np.full(n, -SLOPE), np.zeros(n)), np.full(n, 0.3))
    engine.load(a_scene, slab)
    for _ in range(STEPS):
        engine.step(DT)
    found = engine.particles()
    return found.take(np.argsort(found.identity))


@pytest.mark.parametrize("name", ["scan", "hash"])
@pytest.mark.parametrize("law", YIELDING, ids=lambda law: law.name)
def test_backends_move_a_slab_of_every_law_alike(law, name):
    expected, found = moved(law, "reference"), moved(law, name)
    speed = np.linalg.norm(expected.velocity, axis=1).max()
    assert speed > 0.01
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=1e-6 * speed)
    np.testing.assert_allclose(found.strain, expected.strain, atol=1e-6 * np.abs(expected.strain).max())
    np.testing.assert_allclose(found.history, expected.history, atol=1e-6 * max(1e-3, np.abs(expected.history).max()))
