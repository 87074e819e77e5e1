"""The hash backend on the CPU gives what the dense one gives, whatever the order of its sums and the size of its batches."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import warp as wp
from scenes import (
    IN_ORDER,
    SAND,
    assert_close_bulk,
    assert_same,
    assert_same_numbers,
    box,
    loaded,
    on_cpu,
    plane,
    scene,
    single_precision,
)
from test_sparse_equals_dense import CASES, CLAY, bodies_on, moved_by_the_reference, rough, run, run_with_changing_step, two_bodies

from runout.backends.protocol import get_backend
from runout.materials.granular_flow import GranularFlow
from runout.model.particles import Particles

GRAINS = GranularFlow(
    density=2000.0, youngs_modulus=1e6, poisson_ratio=0.3, static_friction=0.3, dynamic_friction=0.8, grain_size=0.5
)


@pytest.mark.parametrize("deterministic", [False, True])
@pytest.mark.parametrize(("steps", "tolerance"), [(1, 2e-13), (100, 1e-10)])
@pytest.mark.parametrize("name", CASES)
def test_hash_equals_reference_in_float64(name, steps, tolerance, deterministic):
    s, p = bodies_on(name)
    found = run(on_cpu(deterministic=deterministic), s, p, steps, 2e-3)
    assert_same(moved_by_the_reference(name, steps), found, tolerance, s.spacing)
    if s.surface is not None:
        assert found[1].contact_particles > 0


@pytest.mark.parametrize("deterministic", [False, True])
def test_lanes_of_a_block_share_their_tile_without_conflict(monkeypatch, deterministic):
    """As on a GPU: 64 lanes own the cells of a block, 128 its particles; warp runs them as fibers on the CPU."""
    config = wp.config
    monkeypatch.setattr(config, "enable_cpu_blocks", True)
    s, p = bodies_on("rough ground")
    found = run(on_cpu(deterministic=deterministic), s, p, 100, 2e-3)
    assert_same(moved_by_the_reference("rough ground", 100), found, 1e-10, s.spacing)
    assert found[1].contact_particles > 0


@cache
def crowded_on_the_reference():
    """Scene and particles of many in a block, and state, ledger and columns after three steps, once for all ways of hash."""
    surface = plane(0.1, 0.05)
    s = scene(surface, (1.0, 1.0, 1.0), (SAND,), (0.4,))
    p = box((4.5, 4.5, 0.0), (4.0, 4.0, 1.0), s.spacing, per_cell=5, surface=surface)  # over one block
    return s, p, run(get_backend("reference"), s, p, 3, 2e-3)


@pytest.mark.parametrize("deterministic", [False, True])
@pytest.mark.parametrize("shared", [False, True], ids=["one lane", "lanes of a GPU"])
def test_more_particles_may_touch_in_a_block_than_are_held_at_once(monkeypatch, shared, deterministic):
    """Contact of a block goes in rounds: each loads the same velocities, and its impulses add to those of the others."""
    monkeypatch.setattr(wp.config, "enable_cpu_blocks", shared)
    from runout.backends.hash.contact_solution import HELD

    s, p, expected = crowded_on_the_reference()
    found = run(on_cpu(deterministic=deterministic), s, p, 3, 2e-3)
    assert_same(expected, found, 1e-12, s.spacing)
    blocks = 2  # above each other, at most: the plane falls by less than a block
    assert found[1].contact_particles > 2 * blocks * HELD


def test_hash_in_float32_stays_close_to_the_reference():
    """After 100 steps the bulk agrees to 1e-4 of a cell and 1e-4 of the energy."""
    s, p = bodies_on("bowl")
    found = run(on_cpu(), single_precision(s), p, 100, 2e-3)
    assert_close_bulk(moved_by_the_reference("bowl", 100), found, s.spacing)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_batch_of_steps_gives_the_bits_of_single_steps(precision):
    surface, spacing = CASES["bowl"]
    s = replace(scene(surface, spacing, (SAND, CLAY), (0.4, 0.25)), precision=precision)
    p = two_bodies(surface, spacing)
    single, batch = (on_cpu(deterministic=IN_ORDER) for _ in range(2))
    a, row_a, columns_a = run(single, s, p, 60, 2e-3)
    batch.load(s, p)
    batch.steps(2e-3, 60)
    b, row_b, columns_b = batch.particles(), batch.ledger(), batch.columns()
    assert_same_numbers(a, b)
    assert_same_numbers(row_a, row_b)
    np.testing.assert_array_equal(columns_a.momentum, columns_b.momentum)
    assert batch.counters.steps == single.counters.steps == 60
    assert batch.counters.particle_steps == 60 * len(p)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_deterministic_run_repeats_its_bits(precision):
    surface, spacing = CASES["bowl"]
    s = replace(scene(surface, spacing, (SAND, CLAY), (0.4, 0.25)), precision=precision)
    p = two_bodies(surface, spacing)
    (a, row_a, columns_a), (b, row_b, columns_b) = (run(on_cpu(deterministic=True), s, p, 40, 2e-3) for _ in range(2))
    assert_same_numbers(a, b)
    assert_same_numbers(row_a, row_b)
    np.testing.assert_array_equal(columns_a.mass, columns_b.mass)


def test_release_that_alone_has_particles_takes_its_own_friction():
    """Numbers of releases are read only where there are several; that of the only one need not be the first."""
    surface, spacing = CASES["bowl"]
    s = scene(surface, spacing, (SAND, CLAY), (0.4, 0.1))
    p = two_bodies(surface, spacing)
    p.release[:] = 1
    expected, found = (run(backend, s, p, 100, 2e-3) for backend in (get_backend("reference"), on_cpu()))
    assert_same(expected, found, 1e-10, spacing)
    assert found[1].contact_particles > 0


def test_time_step_that_changes_gives_what_the_reference_gives():
    surface, spacing = CASES["bowl"]
    s = scene(surface, spacing, (SAND, CLAY), (0.4, 0.25))
    p = two_bodies(surface, spacing)
    ends = [run_with_changing_step(backend, s, p) for backend in (get_backend("reference"), on_cpu())]
    assert_same(*ends, 1e-11, spacing)


def test_flow_whose_friction_grows_with_the_rate_gives_what_the_reference_gives_while_the_time_step_changes():
    surface, spacing = CASES["bowl"]
    s = scene(surface, spacing, (GRAINS,), (0.3,))
    p = two_bodies(surface, spacing)
    p.release[:] = 0
    expected = run_with_changing_step(get_backend("reference"), s, p)
    assert expected[1].plastic_dissipation > 0
    scan, hashed = get_backend("scan"), on_cpu(deterministic=True)  # as test_every_law and test_hash_batch compile this law
    for backend, a_scene in ((scan, replace(s, substeps=1)), (hashed, s)):
        found = run_with_changing_step(backend, a_scene, p)
        assert_same(expected, found, 1e-11, spacing, other_index=backend is scan)


def same_contacts(a_scene, particles, steps):
    """The reference and the hash backend touch the ground with as many particles in each step; ledger of the one, and the other."""
    engines = loaded(get_backend("reference"), a_scene, particles), loaded(on_cpu(deterministic=IN_ORDER), a_scene, particles)
    for _ in range(steps):
        dt = 0.5 * engines[0].stable_step()
        for engine in engines:
            engine.step(dt)
        a, b = (engine.ledger() for engine in engines)
        assert a.contact_particles == b.contact_particles
    np.testing.assert_allclose(b.basal_impulse, a.basal_impulse, rtol=0, atol=1e-9 * np.abs(a.basal_impulse).max())
    return a, engines[1]


def test_contact_looks_as_far_as_the_fastest_around_a_block_and_misses_none_that_falls_onto_it():
    """A mass that rests, one that falls fast upon it, and one far away: bounds of speed differ, results do not."""
    ground, spacing = plane(0.1), np.ones(3)
    rest, fall, far = (
        box((x, 30.0, up), (4.0, 4.0, 2.0), spacing, surface=ground) for x, up in ((24.0, 0.05), (29.0, 0.4), (60.0, 0.05))
    )
    fall.velocity[:] = (-20.0, 0.0, -30.0)
    p = Particles.concatenate([rest, fall, far])
    a_scene = scene(ground, materials=(SAND,))
    a, backend = same_contacts(a_scene, p, 30)
    assert a.contact_particles > 32
    approach_speeds, q = backend.parts.nodes.approach_speeds.numpy(), backend.particles()
    slow = np.linalg.norm(q.velocity[q.identity >= len(rest) + len(fall)], axis=1).max()
    assert slow < 0.2 * a.max_speed
    assert ((approach_speeds > 0) & (approach_speeds <= 1.001 * slow)).any()  # blocks of the slow mass, not of the scene's fastest


@pytest.mark.parametrize(("ground", "level"), [(plane(0.3, -0.1), True), (rough(), False)], ids=["plane", "rough"])
def test_what_slides_fast_along_the_ground_bounds_contact_by_its_speed_towards_it(ground, level):
    """On a plane that bound is far below the speed itself; on rough ground it is not, and none is missed either."""
    p = box((30.0, 30.0, 0.02), (6.0, 4.0, 3.0), np.ones(3), surface=ground)
    p.velocity[:] = 20.0 * np.array((1.0, 0.5, 0.3 - 0.5 * 0.1)) + np.random.default_rng(3).normal(scale=0.1, size=(len(p), 3))
    a_scene = scene(ground, materials=(SAND,), friction=(0.1,))
    a, backend = same_contacts(a_scene, p, 20)
    assert (backend.parts.nodes.approach_speeds.numpy().max() < 0.2 * a.max_speed) == level
