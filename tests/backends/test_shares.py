"""Threads get equal shares: each stretch of the blocks' numbers holds its part of what is full and of what is empty."""

import numpy as np
import pytest
from scenes import SAND, box, plane, scene

from runout.backends.scan import index
from runout.backends.scan.backend import ScanBackend


def wedge():
    """A slope that is covered in its southern half alone, deeper in the west than in the east."""
    ground = plane(slope_x=-0.3, height=30.0)
    p = box((8.0, 8.0, 0.0), (60.0, 28.0, 9.0), (1.0, 1.0, 1.0), SAND.density, surface=ground)
    x = p.position(np.ones(3))
    above = x[:, 2] - (30.0 - 0.3 * x[:, 0])
    return scene(ground, materials=(SAND,), precision="float32"), p.take(np.flatnonzero(above < 9.0 - 0.12 * x[:, 0]))


@pytest.mark.parametrize("threads", [2, 4])
def test_every_thread_gets_its_part_of_the_particles(threads, monkeypatch):
    a_scene, p = wedge()
    shares = []
    for hands in (index.HANDS, 1):
        monkeypatch.setattr(index, "HANDS", hands)
        engine = ScanBackend()
        engine.load(a_scene, p)
        held = engine.index.held[: engine.index.nown]
        shares.append(max(part.sum() for part in np.array_split(held, threads)) * threads / held.sum())
    assert shares[0] < 1.12
    assert shares[0] < shares[1]


def test_dealing_the_blocks_changes_no_bit_of_any_particle(monkeypatch):
    a_scene, p = wedge()
    found = []
    for hands in (index.HANDS, 1):
        monkeypatch.setattr(index, "HANDS", hands)
        engine = ScanBackend()
        engine.load(a_scene, p)
        for _ in range(40):
            engine.step(engine.stable_step())
        q = engine.particles()
        found.append((q.node.tobytes(), q.offset.tobytes(), q.velocity.tobytes(), q.strain.tobytes()))
        assert len(np.unique(engine.index.bxyz, axis=0)) == engine.index.nall
    assert found[0] == found[1]
