"""Structures on scan: what reference finds, the same bits on any threads and after a checkpoint, nothing where there are none."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import Box, between, field_of_boxes
from scenes import HARD, SAND, box, engine_of, loaded, plane, scene

from runout.backends.protocol import get_backend
from runout.backends.scan.kernels import kernels_for
from runout.errors import ConfigError

CUBES = (1.0, 1.0, 1.0)
SLOPE = plane(slope_x=-0.3)
FIELD = field_of_boxes([Box((38.0, 30.0, -6.0), (1.5, 6.0, 12.0), 0.3, 0.3), between((37, 22, -14), (42, 25, -6))], 0.5, 2.5)
STEPS = 60


def slide(engine, a_scene, steps=STEPS):
    """Sand that slides into two structures; the engine after so many steps."""
    particles = box((31, 25, 0), (5, 7, 3), CUBES, density=SAND.density, surface=SLOPE)
    particles.velocity[:] = (8.0, 0.0, -2.4)
    loaded(engine, a_scene, particles)
    return step(engine, steps)


def step(engine, steps):
    engine.time = getattr(engine, "time", 0.0)
    for _ in range(steps):
        dt = engine.stable_step()
        engine.step(dt)
        engine.time += dt
    return engine


SCENE = scene(SLOPE, structures=FIELD, friction=(0.2,), materials=(SAND,))


@pytest.fixture(scope="module")
def scanned():
    return slide(engine_of("scan"), SCENE)


def test_scan_finds_the_impulses_of_reference(scanned):
    reference = slide(engine_of("reference"), SCENE)
    expected, found = reference.structure_impulses(), scanned.structure_impulses()
    assert len(np.unique(FIELD.patches.facade[np.abs(expected).sum(axis=1) > 0])) >= 2
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    a, b = reference.ledger(), scanned.ledger()
    assert b.structure_dissipation == pytest.approx(a.structure_dissipation, rel=1e-10)
    np.testing.assert_allclose(scanned.particles().velocity, reference.particles().velocity, atol=1e-9)


def test_any_number_of_threads_gives_the_same_bits(scanned):
    two = slide(get_backend("scan", threads=2), SCENE)
    np.testing.assert_array_equal(two.structure_impulses(), scanned.structure_impulses())
    np.testing.assert_array_equal(two.particles().velocity, scanned.particles().velocity)


@pytest.mark.parametrize("name", ["scan", "reference"])
def test_a_checkpoint_continues_to_the_same_bits(name, scanned):
    half = slide(engine_of(name), SCENE, STEPS // 2)
    state = {key: np.array(values) for key, values in half.checkpoint().items()}
    whole = scanned if name == "scan" else step(half, STEPS - STEPS // 2)
    resumed = engine_of(name)
    resumed.restore(SCENE, state)
    step(resumed, STEPS - STEPS // 2)
    np.testing.assert_array_equal(resumed.structure_impulses(), whole.structure_impulses())
    np.testing.assert_array_equal(resumed.particles().velocity, whole.particles().velocity)
    assert resumed.ledger().structure_dissipation == whole.ledger().structure_dissipation


def test_a_scene_without_structures_has_nothing_of_them():
    bare = replace(SCENE, structures=None)
    engine = slide(engine_of("scan"), bare, 1)
    assert engine.structures is None
    assert not [name for name in vars(kernels_for(bare)) if "structure" in name]
    assert [name for name in vars(kernels_for(SCENE)) if "structure" in name]
    assert engine.structure_impulses().shape == (0, 3)
    assert engine.ledger().structure_dissipation == 0.0


def test_no_kernel_of_structures_is_compiled_in_the_process_that_runs_it():
    slide(engine_of("scan"), SCENE, 5)
    kernels = vars(kernels_for(SCENE))
    loaded_here = {name for name, kernel in kernels.items() if sum(kernel.stats.cache_hits.values())}
    assert {"find_structure_contacts", "push_from_structures"} <= loaded_here
    assert not [name for name, kernel in kernels.items() if sum(kernel.stats.cache_misses.values())]


def test_structures_out_of_reach_change_no_bit(scanned):
    far = field_of_boxes([between((70, 5, 0), (74, 9, 8))], 0.5, 2.5)
    alone, beside = (slide(engine_of("scan"), replace(SCENE, structures=s), 20) for s in (None, far))
    np.testing.assert_array_equal(beside.particles().velocity, alone.particles().velocity)
    assert not beside.structure_impulses().any()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"spacing": 0.6}, "cells of 0.6 m"),
        ({"band": 1.5}, "within 1.5 m"),
    ],
)
def test_a_field_that_does_not_resolve_contact_is_refused(change, said):
    with pytest.raises(ConfigError, match=said):
        scene(SLOPE, structures=replace(FIELD, **change))


def test_a_patch_that_is_not_there_is_refused():
    with pytest.raises(ConfigError, match="patches"):
        replace(FIELD, patch=FIELD.patch + len(FIELD.patches.area))


def test_particles_that_start_inside_do_no_harm():
    """They are refused where structures are made; here they stay, and gain no energy."""
    wall = field_of_boxes([between((34, 26, -2), (38, 34, 6))], 0.5, 2.5)
    particles = box((33, 28, 0), (4, 4, 3), CUBES, density=HARD.density)
    engine = loaded(engine_of("scan"), scene(plane(), structures=wall, friction=(0.5,), materials=(HARD,)), particles)
    start = engine.ledger()
    step(engine, 100)
    row = engine.ledger()
    gained = row.kinetic_energy + row.potential_energy + row.elastic_energy - start.potential_energy
    assert gained < 1e-3 * start.potential_energy


@pytest.mark.parametrize("name", ["scan", "hash"])
def test_a_step_after_a_very_short_one_presses_no_harder_on_any_backend(name):
    """Forces of structures are limited as those of the ground: with a step of 1e-4 the largest speed hardly changes."""
    found, expected, usual = (
        slide(engine_of(backend), SCENE, STEPS - 15) for backend in (name, "reference", "scan")
    )  # fmt: skip
    dt = 0.5 * usual.stable_step()
    for engine, short in ((found, 1e-4), (expected, 1e-4), (usual, 1.0)):
        for k in range(15):
            engine.step(dt * (short if k == 7 else 1.0))
    impulses = expected.structure_impulses()
    np.testing.assert_allclose(found.structure_impulses(), impulses, rtol=0, atol=1e-9 * np.abs(impulses).max())
    np.testing.assert_allclose(found.particles().velocity, expected.particles().velocity, rtol=0, atol=1e-8)
    assert found.max_speed == pytest.approx(usual.max_speed, rel=0.05)
