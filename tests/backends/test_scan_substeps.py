"""Transfers of several substeps on scan: what reference finds, and the bits and the memory of steps.

Those with drag, zones and structures are in tests/structures/test_scan_substeps_with_structures.py.
"""

from dataclasses import replace

import numpy as np
import pytest
from scenes import SAND, assert_same, assert_same_numbers, engine_of, loaded, scene, single_precision
from test_sparse_equals_dense import CASES, CLAY, two_bodies

from runout.backends.protocol import get_backend
from runout.backends.scan import workers

SURFACE, SPACING = CASES["rough ground"]
SCENE = scene(SURFACE, SPACING, (SAND, CLAY), (0.4, 0.25), substeps=8)
BODIES = two_bodies(SURFACE, SPACING)


def after(engine, a_scene, transfers, number):
    """The engine after transfers of three time steps, some of them with one substep."""
    return go_on(loaded(engine, a_scene, BODIES), range(transfers), number)


def go_on(engine, transfers, number):
    for n in transfers:
        engine.step(2e-3 * (1 + 0.3 * (n % 3)), number if n % 5 else 1)
    return engine


def results_of(engine):
    return engine.particles(), engine.ledger(), engine.columns()


@pytest.mark.parametrize("number", [2, 4])
def test_scan_equals_reference(number):
    expected, found = (after(engine_of(name), SCENE, 30, number) for name in ("reference", "scan"))
    assert_same(results_of(expected), results_of(found), 1e-10, SPACING, other_index=True)
    assert expected.ledger().contact_particles > 0
    assert (found.counters.transfers, found.counters.steps) == (30, 6 + 24 * number)
    assert found.counters.particle_steps == found.counters.steps * len(BODIES)


def test_single_precision_stays_close():
    expected, found = (after(engine_of("scan"), s, 20, 4).ledger() for s in (SCENE, single_precision(SCENE)))
    assert found.basal_dissipation == pytest.approx(expected.basal_dissipation, rel=1e-3)
    assert found.plastic_dissipation == pytest.approx(expected.plastic_dissipation, rel=1e-3)
    np.testing.assert_allclose(found.momentum, expected.momentum, rtol=0, atol=1e-4 * np.abs(expected.momentum).max())


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_threads_and_checkpoints_change_no_bit(monkeypatch, precision):
    monkeypatch.setattr(workers, "PARTICLES_PER_THREAD", 50)
    a_scene = replace(SCENE, precision=precision)
    expected = after(get_backend("scan", threads=1), a_scene, 20, 4)
    half = after(get_backend("scan", threads=2), a_scene, 11, 4)
    assert half.workspace.schedule.waits == (half.threads > 1)
    resumed = get_backend("scan", threads=2)
    resumed.restore(a_scene, {name: np.array(values) for name, values in half.checkpoint().items()})
    for found in (half, resumed):
        go_on(found, range(11, 20), 4)
        assert_same_numbers(expected.particles(), found.particles())
        assert_same_numbers(expected.ledger(), found.ledger())


def test_substeps_take_no_memory():
    one, several = (after(engine_of("scan"), replace(SCENE, substeps=n), 3, n) for n in (1, 8))
    assert several.memory() == one.memory()
