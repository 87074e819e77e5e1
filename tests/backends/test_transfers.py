"""Transfers: what moves from particles to nodes and back keeps mass, momentum and affine fields."""

import numpy as np
import pytest
from scenes import ROCK, SAND, angular_momentum, at, box, cloud, loaded, plane, scene, single_precision

from runout.model.limits import CFL

SPACING = (1.0, 0.7, 0.5)


def test_mass_momentum_and_angular_momentum_survive_a_step_to_the_grid_and_back(backend):
    p = cloud(spacing=SPACING)
    before, momentum = angular_momentum(p, SPACING), p.mass @ p.velocity
    loaded(backend, scene(spacing=SPACING, gravity=(0, 0, 0)), p).step(1e-3)
    q = backend.particles()
    size = (p.mass * np.linalg.norm(p.velocity, axis=1)).sum()
    assert q.mass.sum() == p.mass.sum()
    np.testing.assert_allclose(q.mass @ q.velocity, momentum, atol=1e-13 * size)
    np.testing.assert_allclose(angular_momentum(q, SPACING), before, atol=1e-13 * size * 40.0)


def test_momentum_survives_a_hundred_steps_of_a_colliding_elastic_body(backend):
    p = box((30.1, 30.2, -2.9), (4.0, 2.1, 2.0), SPACING)
    x = p.position(np.array(SPACING))
    p.velocity[:, 0] = np.where(x[:, 0] < 32.0, 1.0, -1.0)
    p.velocity[:, 1] = 0.3 * (x[:, 2] + 2.0)
    before, momentum = angular_momentum(p, SPACING), p.mass @ p.velocity
    loaded(backend, scene(spacing=SPACING, gravity=(0, 0, 0)), p)
    for _ in range(100):
        backend.step(backend.stable_step())
    q = backend.particles()
    size = (p.mass * np.linalg.norm(p.velocity, axis=1)).sum()
    assert backend.ledger().elastic_energy > 0.01 * backend.ledger().kinetic_energy
    np.testing.assert_allclose(q.mass @ q.velocity, momentum, atol=1e-12 * size)
    np.testing.assert_allclose(angular_momentum(q, SPACING), before, atol=1e-12 * size * 40.0)


def test_gravity_adds_exactly_its_impulse(backend):
    p = cloud(spacing=SPACING)
    p.volume[:] = 1e-9  # no stress
    loaded(backend, scene(spacing=SPACING, gravity=(0.5, -1.0, -9.81)), p).step(0.01)
    gained = backend.ledger().momentum - p.mass @ p.velocity
    np.testing.assert_allclose(gained, 0.01 * p.mass.sum() * np.array([0.5, -1.0, -9.81]), rtol=1e-11)


@pytest.mark.parametrize(("narrow", "tolerance"), [(False, 1e-13), (True, 2e-6)])
def test_affine_velocity_field_is_returned_as_it_was(backend, narrow, tolerance):
    p = cloud(spacing=SPACING)
    a, gradient = np.array([1.0, -2.0, 0.5]), np.array([[0.3, -0.2, 0.1], [0.4, 0.0, -0.5], [0.2, 0.6, -0.1]])
    centre = np.array([30.0, 30.0, -3.0])
    p.velocity[:] = a + (p.position(np.array(SPACING)) - centre) @ gradient.T
    p.affine[:] = gradient
    s = scene(spacing=SPACING, gravity=(0, 0, 0))
    if narrow:  # by the code that other tests compile; the ground is out of reach, and nothing is stressed before the step
        s = single_precision(scene(plane(height=-60.0), SPACING, (SAND,), gravity=(0, 0, 0)))
    loaded(backend, s, p).step(1e-4)
    q = backend.particles()
    single = narrow and type(backend).__name__ != "ReferenceBackend"
    limit = tolerance if single else 1e-13
    np.testing.assert_allclose(q.velocity, p.velocity, atol=limit * 5)
    # the packed form loses up to 1/h of a velocity's rounding
    np.testing.assert_allclose(q.affine, np.broadcast_to(gradient, q.affine.shape), atol=limit * 50)


@pytest.mark.parametrize(("cells", "tolerance"), [((4, -8, -1000), 0.0), ((3, -2, -7), 1e-13)])
def test_shift_by_whole_blocks_changes_no_bit_and_by_whole_cells_only_the_order_of_sums(backend, cells, tolerance):
    results = []
    for shift in (np.zeros(3, np.int32), np.array(cells, np.int32)):
        p = box((10.3, 12.2, 0.1), (2.0, 2.0, 2.0), (1.0, 1.0, 1.0))
        p.velocity[:] = np.random.default_rng(1).normal(size=p.velocity.shape)
        p.node += shift
        loaded(backend, scene(), p)
        for _ in range(20):
            backend.step(2e-3)
        results.append(backend.particles())
        np.testing.assert_array_equal(results[-1].node - shift, results[0].node)
    for name in ("offset", "velocity", "affine", "strain"):
        np.testing.assert_allclose(getattr(results[1], name), getattr(results[0], name), rtol=0, atol=10 * tolerance)


def test_particles_at_the_origin_reach_negative_nodes(backend):
    """A body around local (0.5, 0.5, 0) m sees nodes -1 on every axis and still falls freely."""
    p = box((0.1, 0.1, -0.6), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    assert p.node.min() == -1 or p.node.min() == -2
    loaded(backend, scene(), p).step(0.01)
    np.testing.assert_allclose(backend.particles().velocity, np.broadcast_to((0, 0, -0.0981), (8, 3)), atol=1e-15)


def test_single_particle_flies_straight_and_keeps_its_velocity(backend):
    p = at([(30.1, 30.2, -2.9)], SPACING)
    p.velocity[:] = (1.0, -2.0, 0.5)
    loaded(backend, scene(spacing=SPACING, gravity=(0, 0, 0)), p)
    for _ in range(50):
        backend.step(0.01)
    q = backend.particles()
    np.testing.assert_allclose(q.velocity, p.velocity, atol=1e-13)
    np.testing.assert_allclose(q.position(np.array(SPACING)), p.position(np.array(SPACING)) + 0.5 * p.velocity, atol=1e-12)


def test_particle_exactly_on_a_node_and_half_way_stays_finite(backend):
    p = box((10.0, 10.0, 1.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0), per_cell=1)
    p = type(p).concatenate([p, p])
    p.offset[1] = 1.0
    loaded(backend, scene(), p).step(0.01)
    q = backend.particles()
    np.testing.assert_allclose(q.velocity, np.broadcast_to((0, 0, -0.0981), (2, 3)), atol=1e-15)
    assert np.isfinite(q.affine).all()


def test_empty_scene_steps_and_reports_nothing(backend):
    loaded(backend, scene(), cloud(5).take(np.zeros(0, int)))
    assert backend.stable_step() == pytest.approx(CFL / ROCK.wave_speed)
    backend.step(0.01)
    row = backend.ledger()
    assert (row.mass, row.kinetic_energy, row.max_speed, row.active_blocks) == (0.0, 0.0, 0.0, 0)
    assert len(backend.particles()) == 0
    assert backend.columns().mass.sum() == 0.0


def test_load_leaves_the_given_particles_alone_and_starts_anew(backend):
    p = box((30.0, 30.0, 1.0), (2.0, 2.0, 2.0), (1.0, 1.0, 1.0))
    copy = p.take(np.arange(len(p)))
    ends = []
    for _ in range(2):
        loaded(backend, scene(), p)
        for _ in range(5):
            backend.step(0.01)
        ends.append(backend.particles())
        np.testing.assert_array_equal(p.offset, copy.offset)
        np.testing.assert_array_equal(p.velocity, copy.velocity)
        assert backend.counters.steps == 5
        assert backend.counters.particle_steps == 5 * len(p)
    np.testing.assert_array_equal(ends[0].offset, ends[1].offset)


def test_particles_come_back_in_the_order_of_their_identity(backend):
    p = cloud(200)
    p.identity[:] = np.random.default_rng(2).permutation(200) * 7 + 3
    loaded(backend, scene(spacing=SPACING), p).step(1e-3)
    q = backend.particles()
    order = np.argsort(p.identity)
    np.testing.assert_array_equal(q.identity, p.identity[order])
    np.testing.assert_allclose(q.mass, p.mass[order], rtol=1e-15)
