"""Blocks at rest sleep: they keep their place, cost nothing, and wake when something moves beside them. On the backend scan."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import GRAVITY, SAND, box, plane, scene

from runout.backends.protocol import get_backend
from runout.backends.scan.backend import ScanBackend
from runout.errors import ConfigError
from runout.model.particles import Particles

SLOW = 0.1  # [m/s]
CLAY = replace(SAND, cohesion=2e4)  # its edges stand
CELLS = (1.0, 1.0, 1.0)


def bed(precision="float64", sleep_speed=SLOW):
    """A layer of clay, 2 m thick and stressed by its weight, on level ground."""
    ground = plane(height=2.0)
    p = box((10.0, 10.0, 0.0), (40.0, 12.0, 2.0), CELLS, CLAY.density, surface=ground)
    above = 4.0 - p.position(CELLS)[:, 2]
    p.strain[:, 2] = np.expm1(-2 * CLAY.density * GRAVITY * above / (CLAY.lame_lambda + 2 * CLAY.shear_modulus))
    return scene(ground, CELLS, (CLAY,), precision=precision, sleep_speed=sleep_speed, cfl=0.4), p


def hit_bed(**choices):
    """The same with a lump of clay that falls on its western end."""
    a_scene, p = bed(**choices)
    lump = box((12.0, 14.0, 13.0), (4.0, 4.0, 4.0), CELLS, CLAY.density)
    lump.velocity[:] = (2.0, 0.0, -6.0)
    both = Particles(*(np.concatenate([getattr(p, name), getattr(lump, name)]) for name in vars(p)))
    both.identity[:] = np.arange(len(both))
    return a_scene, both


def run(a_scene, particles, steps, engine=None):
    if engine is None:
        engine = ScanBackend()
        engine.load(a_scene, particles)
    dt = 0.9 * a_scene.stable_step(12.0)
    for _ in range(steps):
        engine.step(dt)
    return engine


def test_a_bed_at_rest_falls_asleep_and_stays_where_it_is():
    a_scene, p = bed()
    engine = run(a_scene, p, 160)
    row = engine.ledger()
    assert engine.totals.sleepers == row.active_blocks
    assert row.kinetic_energy < 1e-20
    np.testing.assert_allclose(row.momentum, 0.0, atol=1e-9)
    before = engine.particles()
    run(a_scene, None, 40, engine)
    after = engine.particles()
    np.testing.assert_array_equal(after.position(CELLS), before.position(CELLS))
    np.testing.assert_array_equal(after.strain, before.strain)
    assert np.abs(after.position(CELLS) - p.position(CELLS)).max() < 0.02


def test_momentum_of_a_bed_that_sleeps_is_that_of_gravity_and_the_ground():
    a_scene, p = bed()
    engine = run(a_scene, p, 200)
    row, time = engine.ledger(), 200 * 0.9 * a_scene.stable_step(12.0)
    weight = row.mass * GRAVITY * time
    np.testing.assert_allclose(row.basal_impulse, (0.0, 0.0, weight), atol=2e-3 * weight)
    energy = row.kinetic_energy + row.potential_energy + row.elastic_energy + row.basal_dissipation + row.plastic_dissipation
    start = ScanBackend()
    start.load(a_scene, p)
    first = start.ledger()
    stored = first.potential_energy + first.elastic_energy
    assert abs(energy - stored) < 1e-3 * first.potential_energy


@pytest.mark.parametrize(("precision", "tolerance"), [("float64", 1e-12), ("float32", 1e-6)])
def test_momentum_balance_closes_to_rounding_while_a_part_sleeps(precision, tolerance):
    """Sleeping blocks beside moving ones share nodes with them; some wake, and some fall asleep."""
    a_scene, p = hit_bed(precision=precision)
    start, engine, dt = p.mass @ p.velocity, None, 0.9 * a_scene.stable_step(12.0)
    for k in range(1, 4):
        engine = run(a_scene, p, 110, engine)
        row, time = engine.ledger(), 110 * k * dt
        assert 0 < engine.totals.sleepers < row.active_blocks
        received = np.array([0.0, 0.0, -row.mass * GRAVITY * time]) + row.basal_impulse
        np.testing.assert_allclose(row.momentum - start, received, rtol=0, atol=tolerance * row.mass * GRAVITY * time)


def test_a_fall_wakes_what_it_hits_and_what_lies_far_sleeps_on():
    a_scene, p = hit_bed()
    engine = run(a_scene, p, 110)
    lump = p.position(CELLS)[:, 2] > 6.0
    asleep_before = engine.totals.sleepers
    assert 0 < asleep_before < engine.ledger().active_blocks
    assert engine.particles().position(CELLS)[lump, 2].min() > 5.0  # it still falls
    run(a_scene, None, 120, engine)
    moved = np.linalg.norm(engine.particles().position(CELLS) - p.position(CELLS), axis=1)
    x = p.position(CELLS)[:, 0]
    bed_below = (p.position(CELLS)[:, 2] < 4.5) & (np.abs(x - 15.0) < 3.0)
    assert moved[bed_below].max() > 0.2
    assert 0 < engine.totals.sleepers < asleep_before
    far = x > 45.0
    assert moved[far].max() < 0.02


def test_what_moves_is_moved_as_if_nothing_slept():
    found = []
    for sleep_speed in (SLOW, 0.0):
        a_scene, p = hit_bed(sleep_speed=sleep_speed)
        columns = run(a_scene, p, 300).columns()
        found.append(columns.volume)
    difference = np.abs(found[0] - found[1]).sum() / found[1].sum()
    assert 0.0 < difference < 0.01
    assert found[0].sum() == pytest.approx(found[1].sum(), rel=1e-12)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_sleepers_go_on_from_a_checkpoint_with_the_same_bits(precision):
    a_scene, p = hit_bed(precision=precision)
    engine = run(a_scene, p, 130)
    assert engine.totals.sleepers > 0
    other = ScanBackend()
    other.restore(a_scene, {name: np.array(values) for name, values in engine.checkpoint().items()})
    rows = [run(a_scene, None, 40, e).ledger() for e in (engine, other)]
    np.testing.assert_array_equal(engine.particles().position(CELLS), other.particles().position(CELLS))
    assert rows[0].basal_dissipation == rows[1].basal_dissipation
    assert engine.totals.sleepers == other.totals.sleepers
    np.testing.assert_array_equal(rows[0].basal_impulse, rows[1].basal_impulse)


def test_nothing_is_compiled_where_sleepers_run():
    run(*bed(sleep_speed=0.0), 1)  # the same kernels but those of sleep
    a_scene, p = hit_bed()
    engine = run(a_scene, p, 80)
    assert [name for name, kernel in vars(engine.k).items() if sum(kernel.stats.cache_misses.values())] == []


@pytest.mark.parametrize("name", ["reference", "hash"])
def test_backends_without_sleep_refuse_it(name):
    a_scene, p = bed()
    with pytest.raises(ConfigError, match="sleep_speed works on scan"):
        get_backend(name).load(a_scene, p)


def test_sleep_is_refused_with_what_it_does_not_know():
    with pytest.raises(ConfigError, match="sleep_speed is -1 m/s"):
        scene(sleep_speed=-1.0)
    with pytest.raises(ConfigError, match="transfer mls"):
        scene(sleep_speed=0.1, transfer="apic")
