"""Particles in the store of scan: the bits of the formulas for arrays, at rest and in motion."""

import numpy as np
import pytest
from scenes import SAND, scene

from runout.backends.scan.backend import ScanBackend
from runout.model.particles import ARRAYS, Particles
from runout.model.surface import Surface
from runout.physics.moments import momentum_at

SPACING = (1.0, 1.5, 0.7)
SHUFFLE = np.random.default_rng(5).permutation(4000)


def mass_in_motion():
    """Particles in any order, with numbers in all arrays."""
    rng = np.random.default_rng(4)
    p = Particles.at(rng.uniform((5.0, 5.0, 3.0), (25.0, 25.0, 12.0), (len(SHUFFLE), 3)), np.array(SPACING))
    for name in ("velocity", "affine", "strain", "history", "ground_force"):
        getattr(p, name)[:] = rng.normal(0.0, 1e-3, getattr(p, name).shape)
    p.mass[:], p.volume[:], p.radius[:] = rng.uniform(100.0, 200.0, (3, len(p)))
    p.identity[:] = SHUFFLE
    return p


def loaded(p, precision):
    surface = Surface.through(np.zeros((31, 31)), (1.0, 1.0))
    engine = ScanBackend(threads=1)
    engine.load(scene(surface, SPACING, (SAND,), precision=precision), p)
    return engine.store


def at_rest(p):
    """The same particles at rest, with the shared zeros."""
    resting = Particles.at_rest(len(p))
    for name in ("node", "offset", "strain", "mass", "volume", "radius", "identity"):
        setattr(resting, name, getattr(p, name))
    assert resting.rests
    return resting


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("prepared", [lambda p: p, at_rest], ids=["moving", "at rest"])
def test_records_have_the_bits_of_the_formulas_for_arrays(precision, prepared):
    p = prepared(mass_in_motion())
    store = loaded(p, precision)
    slot = np.flatnonzero(store.particles.particle_index[: store.end] | (store.particles.rec[: store.end, 0] > 0))
    index = store.particles.particle_index[slot]
    row = np.argsort(p.identity)[store.particles.label[index, 1]]
    p = p.take(row)
    slopes = [p.mass * p.affine[:, :, j].T * SPACING[j] for j in range(3)]
    momentum = momentum_at(p.mass * p.velocity.T, *slopes, 1.0 - p.offset.T)
    columns = [p.mass, *momentum]
    for j in range(3):
        columns += [p.offset[:, j], *slopes[j]]
    assert len(slot) == len(p)
    expected = np.column_stack(columns).astype(precision)
    assert store.particles.rec[slot].tobytes() == expected.tobytes()
    state = np.column_stack([p.strain, p.history, p.volume]).astype(precision)
    assert store.particles.state[slot].tobytes() == state.tobytes()
    assert (store.radius[index] == p.radius.astype(precision)).all()
    assert (store.particles.force[index, 1:] == p.ground_force.astype(precision)).all()
    assert store.largest_radius == p.radius.max()


def test_particles_that_rest_have_the_zeros_themselves():
    p = Particles.at_rest(10)
    assert p.rests
    p.velocity = np.zeros((10, 3))
    assert not p.rests
    assert not Particles.zeros(10).rests
    assert set(vars(p)) == set(ARRAYS)
