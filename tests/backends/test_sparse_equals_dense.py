"""The sparse backend gives what the dense one gives; and the same bits on one thread and on two."""

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scenes import SAND, assert_close_bulk, assert_same, assert_same_numbers, bowl, box, plane, scene, single_precision

from runout.backends.protocol import get_backend
from runout.backends.scan import workers
from runout.model.particles import Particles
from runout.model.surface import Surface

CLAY = replace(SAND, density=1600.0, cohesion=3e3, friction_angle=20.0)


def two_bodies(surface, spacing):
    """Sand and clay that slide towards each other and have just begun to turn."""
    east = box((44.3, 36.1, 0.0), (4.0, 3.0, 2.0), spacing, SAND.density, surface=surface)
    west = box((37.2, 35.6, 0.4), (3.0, 3.0, 1.5), spacing, CLAY.density, surface=surface)
    west.release[:] = 1
    p = Particles.concatenate([east, west])
    rng = np.random.default_rng(8)
    p.velocity[:] = np.where(p.release[:, None] == 0, (-4.0, 0.5, 0.0), (4.0, -0.3, -1.0)) + 0.1 * rng.normal(size=(len(p), 3))
    p.affine[:] = rng.normal(size=p.affine.shape)
    return p


def rough(seed=9):
    """A rough surface on a lattice that is not the grid's."""
    z = np.random.default_rng(seed).normal(0.0, 0.4, (51, 41))
    return Surface.through(z + 0.1 * np.arange(51)[:, None], (2.0, 2.5), (-10.0, -12.5))


def run(backend, a_scene, particles, steps, dt):
    backend.load(a_scene, particles)
    for _ in range(steps):
        backend.step(dt)
    return backend.particles(), backend.ledger(), backend.columns()


def run_with_changing_step(backend, a_scene, particles):
    """State, ledger and columns after 30 steps of three lengths."""
    backend.load(a_scene, particles)
    for n in range(30):
        backend.step(2e-3 * (1 + 0.3 * (n % 3)))
    return backend.particles(), backend.ledger(), backend.columns()


CASES = {
    "bowl": (bowl(radius=15.0), (1.0, 1.0, 1.0)),
    "tilted plane, flat cells": (plane(-0.3, 0.2, 30.0), (1.0, 0.9, 0.5)),
    "no ground": (None, (1.0, 1.0, 1.0)),
    "rough ground": (rough(), (1.0, 1.0, 0.8)),
}


def bodies_on(name):
    """Scene and particles of two bodies of two materials on the ground of a case."""
    surface, spacing = CASES[name]
    return scene(surface, spacing, (SAND, CLAY), (0.4, 0.25)), two_bodies(surface or plane(), spacing)


@cache
def moved_by_the_reference(name, steps):
    """State, ledger and columns of two bodies after steps, once for all backends."""
    return run(get_backend("reference"), *bodies_on(name), steps, 2e-3)


@pytest.mark.parametrize(("steps", "tolerance"), [(1, 2e-13), (100, 1e-10)])
@pytest.mark.parametrize("name", CASES)
def test_scan_equals_reference_in_float64(name, steps, tolerance):
    s, p = bodies_on(name)
    expected, found = moved_by_the_reference(name, steps), run(get_backend("scan", threads=1), s, p, steps, 2e-3)
    assert_same(expected, found, tolerance, s.spacing, other_index=True)
    if s.surface is not None:
        assert expected[1].contact_particles > 0


def test_scan_in_float32_stays_close_to_the_reference():
    """After 100 steps the bulk agrees to 1e-4 of a cell and 1e-4 of the energy."""
    s, p = bodies_on("bowl")
    found = run(get_backend("scan", threads=1), single_precision(s), p, 100, 2e-3)
    assert_close_bulk(moved_by_the_reference("bowl", 100), found, s.spacing)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_one_and_two_threads_give_the_same_bits(monkeypatch, precision):
    monkeypatch.setattr(workers, "PARTICLES_PER_THREAD", 50)
    surface, spacing = CASES["bowl"]
    s = replace(scene(surface, spacing, (SAND, CLAY), (0.4, 0.25)), precision=precision)
    p = two_bodies(surface, spacing)
    backends = [get_backend("scan", threads=n) for n in (1, 2)]
    (a, row_a, _), (b, row_b, _) = (run(one, s, p, 60, 2e-3) for one in backends)
    assert [one.threads for one in backends] == [1, min(2, backends[1].allowed)]
    assert_same_numbers(a, b)
    assert_same_numbers(row_a, row_b)


def test_four_threads_give_the_bits_of_one():
    """In a process of its own: more threads than processors must be asked for before numba starts."""
    program = """if True:
        import os
        os.sched_getaffinity = lambda process: range(4)
        from scenes import assert_same_numbers
        from test_sparse_equals_dense import SAND, CASES, CLAY, get_backend, run, scene, single_precision, two_bodies
        from runout.backends.scan import workers
        workers.PARTICLES_PER_THREAD = 50
        surface, spacing = CASES["bowl"]
        s, p = single_precision(scene(surface, spacing, (SAND, CLAY), (0.4, 0.25))), two_bodies(surface, spacing)
        one, four = (get_backend("scan", threads=n) for n in (1, 4))
        states = [run(engine, s, p, 30, 2e-3) for engine in (one, four)]
        assert (one.threads, four.threads) == (1, 4)
        for a, b in zip(states[0][:2], states[1][:2]):
            assert_same_numbers(a, b)
    """
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    settings = {**os.environ, "NUMBA_NUM_THREADS": "4", "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", program], env=settings, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_index_is_rebuilt_only_when_its_margin_is_used_up():
    surface, spacing = CASES["bowl"]
    backend = get_backend("scan", threads=1)
    p = two_bodies(surface, spacing)
    p.velocity[:] = (3.0, 0.0, 0.0)
    backend.load(scene(None, spacing, (SAND, CLAY), (0.4, 0.25), gravity=(0, 0, 0)), p)
    for _ in range(100):
        backend.step(0.01)  # three cells in all
    assert 1 <= backend.counters.rebuilds <= 3
