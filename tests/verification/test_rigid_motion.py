"""Free fall and rotation of whole bodies on the sparse backend (U4 and U5 of the suite)."""

import numpy as np
from bodies import lattice, particles_at
from closed_forms import rotated, symplectic_free_fall

from runout import Elastic
from runout.backends.protocol import get_backend
from runout.model.scene import Raster, Scene

ROCK = Elastic(density=1550.0, youngs_modulus=1e6, poisson_ratio=0.3)
SPACING = 0.1


def loaded(particles, gravity):
    backend = get_backend("scan", threads=1)
    backend.load(Scene((SPACING,) * 3, None, Raster(10, 10, (2.0, 2.0)), (ROCK,), (0.0,), gravity, precision="float64"), particles)
    return backend


def test_falling_cube_follows_symplectic_euler_to_rounding():
    """0.5 m cube, 200 steps, off the grid: position to 1e-12 m, no strain."""
    p = particles_at(lattice((0.5, 0.5, 0.5), SPACING) + np.array([5.013, 5.027, 3.041]), SPACING, ROCK.density, 0.0)
    backend, steps, dt = loaded(p, (0.0, 0.0, -9.81)), 200, 1e-3
    for _ in range(steps):
        backend.step(dt)
    q, (height, velocity) = backend.particles(), symplectic_free_fall(steps, dt)
    np.testing.assert_allclose(
        q.position(np.full(3, SPACING)) - p.position(np.full(3, SPACING)), [(0, 0, height)] * len(p), atol=1e-12
    )
    np.testing.assert_allclose(q.velocity, [(0, 0, velocity)] * len(p), atol=1e-12)
    assert np.abs(q.strain).max() < 1e-12


def test_spinning_cube_keeps_its_shape_and_nearly_all_its_energy():
    """1 m cube, 1 rad/s, 1 s: 9.2e-5 of the energy lost, none gained; every particle within 0.13 mm of its place."""
    centre = np.array([10.0, 10.0, 0.0])
    local = lattice((1.0, 1.0, 1.0), SPACING) - 0.5
    p = particles_at(centre + local, SPACING, ROCK.density, 0.0)
    spin = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    p.velocity[:] = local @ spin.T
    p.affine[:] = spin
    backend = loaded(p, (0.0, 0.0, 0.0))
    start, steps = backend.ledger().kinetic_energy, 850
    assert 1.0 / steps < backend.stable_step()
    for _ in range(steps):
        backend.step(1.0 / steps)
    row = backend.ledger()
    loss = 1 - (row.kinetic_energy + row.elastic_energy) / start
    assert 0 <= loss < 1.2e-4
    found = backend.particles().position(np.full(3, SPACING)) - centre
    np.testing.assert_allclose(found, rotated(local, 1.0), atol=2e-4)
