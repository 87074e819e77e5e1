"""The sparse backend gives what the dense one gives; and the same bits on one thread and on two."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import SAND, bowl, box, plane, scene, single_precision, total_energy

from runout.backends.protocol import get_backend
from runout.model.particles import Particles
from runout.model.surface import Surface

scan = pytest.importorskip("runout.backends.scan.backend")
STATE = ("velocity", "affine", "strain", "history")
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


def on_nodes(surface, spacing):
    """The surface as the sparse backend sees it: resampled to the nodes of the grid."""
    first, count = -12, 120
    return surface.resampled(tuple(spacing[:2]), (first * spacing[0], first * spacing[1]), (count, count))


def run(backend, a_scene, particles, steps, dt):
    backend.load(a_scene, particles)
    for _ in range(steps):
        backend.step(dt)
    return backend.particles(), backend.ledger(), backend.columns()


CASES = {
    "bowl": (bowl(radius=15.0), (1.0, 1.0, 1.0)),
    "tilted plane, flat cells": (plane(-0.3, 0.2, 30.0), (1.0, 0.9, 0.5)),
    "no ground": (None, (1.0, 1.0, 1.0)),
    "rough ground": (rough(), (1.0, 1.0, 0.8)),
}


@pytest.mark.parametrize(("steps", "tolerance"), [(1, 1e-13), (100, 1e-10)])
@pytest.mark.parametrize("name", CASES)
def test_scan_equals_reference_in_float64(name, steps, tolerance):
    surface, spacing = CASES[name]
    s = scene(surface, spacing, (SAND, CLAY), (0.4, 0.25))
    p = two_bodies(surface or plane(), spacing)
    dense = replace(s, surface=on_nodes(surface, spacing)) if name == "rough ground" else s
    (a, row_a, columns_a), (b, row_b, columns_b) = (
        run(get_backend(which, threads=1), one, p, steps, 2e-3) for which, one in (("reference", dense), ("scan", s))
    )
    np.testing.assert_array_equal(a.identity, b.identity)
    for name in STATE:
        x, y = getattr(a, name), getattr(b, name)
        np.testing.assert_allclose(y, x, rtol=0, atol=tolerance * max(np.abs(x).max(), 1e-3), err_msg=name)
    np.testing.assert_allclose(b.position(np.array(spacing)), a.position(np.array(spacing)), rtol=0, atol=50 * tolerance)
    for name in set(vars(row_a)) - {"active_blocks"}:  # counted from another corner
        x, y = getattr(row_a, name), getattr(row_b, name)
        scale = np.abs(x).max() if np.ndim(x) else max(abs(x), row_a.kinetic_energy * (name != "max_speed"))
        np.testing.assert_allclose(y, x, rtol=0, atol=10 * tolerance * scale, err_msg=name)
    for name in ("volume", "mass", "momentum"):
        x, y = getattr(columns_a, name), getattr(columns_b, name)
        np.testing.assert_allclose(y, x, rtol=0, atol=10 * tolerance * np.abs(x).max(), err_msg=name)
    if surface is not None:
        assert row_a.contact_particles > 0


def test_scan_in_float32_stays_close_to_the_reference():
    """After 100 steps the bulk agrees to 1e-4 of a cell and 1e-4 of the energy."""
    surface, spacing = CASES["bowl"]
    s = scene(surface, spacing, (SAND, CLAY), (0.4, 0.25))
    p = two_bodies(surface, spacing)
    a, row_a, _ = run(get_backend("reference"), s, p, 100, 2e-3)
    b, row_b, _ = run(get_backend("scan", threads=1), single_precision(s), p, 100, 2e-3)
    shift = np.average(b.position(np.array(spacing)) - a.position(np.array(spacing)), axis=0, weights=a.mass)
    assert np.abs(shift).max() < 1e-4
    assert total_energy(row_b) == pytest.approx(total_energy(row_a), rel=1e-4)
    assert row_b.kinetic_energy == pytest.approx(row_a.kinetic_energy, rel=1e-3)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_one_and_two_threads_give_the_same_bits(monkeypatch, precision):
    monkeypatch.setattr(scan, "PARTICLES_PER_THREAD", 50)
    surface, spacing = CASES["bowl"]
    s = replace(scene(surface, spacing, (SAND, CLAY), (0.4, 0.25)), precision=precision)
    p = two_bodies(surface, spacing)
    backends = [get_backend("scan", threads=n) for n in (1, 2)]
    (a, row_a, _), (b, row_b, _) = (run(one, s, p, 60, 2e-3) for one in backends)
    assert [one.threads for one in backends] == [1, min(2, backends[1].allowed)]
    for name in vars(a):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for name in vars(row_a):
        np.testing.assert_array_equal(getattr(row_a, name), getattr(row_b, name))


def test_four_threads_give_the_bits_of_one():
    """In a process of its own: more threads than processors must be asked for before numba starts."""
    program = """if True:
        import os
        os.sched_getaffinity = lambda process: range(4)
        from test_sparse_equals_dense import SAND, CASES, CLAY, get_backend, np, run, scan, scene, single_precision, two_bodies
        scan.PARTICLES_PER_THREAD = 50
        surface, spacing = CASES["bowl"]
        s, p = single_precision(scene(surface, spacing, (SAND, CLAY), (0.4, 0.25))), two_bodies(surface, spacing)
        one, four = (get_backend("scan", threads=n) for n in (1, 4))
        states = [run(engine, s, p, 30, 2e-3) for engine in (one, four)]
        assert (one.threads, four.threads) == (1, 4)
        for a, b in zip(states[0][:2], states[1][:2]):
            for name in vars(a):
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
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
