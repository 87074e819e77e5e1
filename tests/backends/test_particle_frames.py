"""Particles that snapshots keep."""

import numpy as np
import pytest

from runout.errors import ConfigError
from runout.model.particles import Particles
from runout.simulation.observers import ParticleSample
from runout.simulation.run import RunControl

SAMPLES = [(10, 20, 10, 1), (10, 10, 10, 1), (10, 3, 3, 4), (9, 4, 3, 3), (7, 0, 0, 1)]


@pytest.mark.parametrize(("count", "most", "size", "stride"), SAMPLES)
def test_a_sample_has_at_most_the_stated_number(count, most, size, stride):
    assert ParticleSample.of(count, most) == ParticleSample(size, stride)


def test_a_frame_follows_identities_and_has_nan_for_particles_that_have_left():
    particles = Particles.at(np.arange(30.0).reshape(10, 3) + 5.0, (2.0, 2.0, 1.0))
    particles.velocity[:] = (3.0, 0.0, 4.0)
    shuffled = particles.take(np.array([9, 8, 0, 6, 1]))
    frame = ParticleSample.of(10, 4).take(shuffled, (2.0, 2.0, 1.0))  # identities 0, 3, 6 and 9
    assert frame[0] == pytest.approx([5.0, 6.0, 7.0, 5.0])
    assert np.isnan(frame[1]).all()
    assert frame[2] == pytest.approx([23.0, 24.0, 25.0, 5.0])
    assert frame[3, 0] == pytest.approx(32.0)


def test_a_negative_number_of_particles_is_refused():
    with pytest.raises(ConfigError, match="snapshot_particles is -1"):
        RunControl(1.0, snapshot_particles=-1)
