"""Transfers besides the packed one, and F-bar, on hash: what its launches, batches and checkpoints do with them."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scenes import (
    HASH_DEVICE,
    IN_ORDER,
    SAND,
    assert_close_bulk,
    assert_same,
    assert_same_numbers,
    box,
    loaded,
    plane,
    scene,
    single_precision,
)
from test_hash_batch import DT, STEPS, alone, batch, three_scenes
from test_other_transfers import WAYS, sandy
from test_sparse_equals_dense import CASES, run, two_bodies

from runout.backends.hash import backend as hash_backend
from runout.backends.hash import index, layout
from runout.backends.protocol import get_backend
from runout.errors import ConfigError

EVERYTHING = WAYS["aflip with F-bar"]
SURFACE, SPACING = CASES["rough ground"]


def rough_scene(**way):
    return sandy(SURFACE, SPACING, (0.4, 0.25), **way)


def test_lanes_of_a_block_share_their_tiles_without_conflict_in_fixed_order(monkeypatch):
    """As on a GPU: warp runs the threads of a block as fibers on the CPU."""
    config = wp.config
    monkeypatch.setattr(config, "enable_cpu_blocks", True)
    p, expected, found = two_bodies(SURFACE, SPACING), [], []
    for way in (EVERYTHING, WAYS["packed with F-bar"]):
        expected.append(run(get_backend("reference"), rough_scene(**way), p, 60, 2e-3))
        found.append(run(get_backend("hash", HASH_DEVICE, deterministic=True), rough_scene(**way), p, 60, 2e-3))
    for wanted, given in zip(expected, found, strict=True):
        assert_same(wanted, given, 1e-10, SPACING)


def test_in_float32_the_bulk_stays_close_to_the_reference():
    """After 100 steps to 1e-4 of a cell and 1e-4 of the energy, as with the packed form."""
    s, p = rough_scene(**EVERYTHING), two_bodies(SURFACE, SPACING)
    expected = run(get_backend("reference"), s, p, 100, 2e-3)
    found = run(get_backend("hash", HASH_DEVICE), single_precision(s), p, 100, 2e-3)
    assert_close_bulk(expected, found, SPACING)


@pytest.mark.parametrize("way", ["aflip with F-bar", "packed with F-bar"])
def test_a_restored_run_and_one_of_many_steps_at_once_go_on_bit_by_bit(way, monkeypatch):
    """Over sorts, while the time step changes."""
    monkeypatch.setattr(batch, "STEPS_PER_SORT", 10)
    s, p = rough_scene(**WAYS[way]), two_bodies(SURFACE, SPACING)
    single, many, again = (get_backend("hash", HASH_DEVICE, deterministic=IN_ORDER) for _ in range(3))
    single.load(s, p), many.load(s, p)
    for dt in (2e-3, 1.5e-3):
        many.steps(dt, 18)
        for _ in range(18):
            single.step(dt)
        if dt == 2e-3:
            again.restore(s, {name: values.copy() for name, values in many.checkpoint().items()})
    again.steps(1.5e-3, 18)
    assert single.counters.rebuilds > 2
    for other in (many, again):
        assert_same_numbers(single.particles(), other.particles())
        assert_same_numbers(single.ledger(), other.ledger())


def test_a_time_step_that_changes_gives_what_the_reference_gives():
    s, p, ends = rough_scene(**WAYS["aflip"]), two_bodies(SURFACE, SPACING), []
    for engine in (get_backend("reference"), get_backend("hash", HASH_DEVICE)):
        engine.load(s, p)
        for n in range(30):
            engine.step(2e-3 * (1 + 0.3 * (n % 3)))
        ends.append((engine.particles(), engine.ledger(), engine.columns()))
    assert_same(*ends, 1e-11, SPACING)


def test_members_of_a_batch_with_their_own_materials_and_flip_ratios_end_as_in_their_own_runs():
    ratios = (0.95, 0.5, 0.0)
    scenes = [(replace(s, transfer="aflip", f_bar=True, flip_ratio=r), p) for (s, p), r in zip(three_scenes(), ratios, strict=True)]
    together = batch.Batch(scenes, HASH_DEVICE, IN_ORDER)
    together.advance(DT, STEPS)
    for n, (s, p) in enumerate(scenes):
        a, b = alone(s, p, DT[n], STEPS[n], IN_ORDER).particles_of(0), together.particles_of(n)
        assert_same_numbers(a, b, f"of scene {n}")
    with pytest.raises(ConfigError, match="must share transfer"):
        batch.Batch([scenes[0], (replace(scenes[1][0], transfer="apic"), scenes[1][1])])


def test_mass_that_spreads_into_new_blocks_makes_every_array_grow_and_loses_nothing(monkeypatch):
    """The nodes that particles alone gave to, and those that average, grow with the grid."""
    monkeypatch.setattr(index, "SMALLEST_TABLE", 64)
    p = box((38.0, 36.0, 0.0), (2.0, 2.0, 2.0), (1.0, 1.0, 1.0))
    p.velocity[:] = 20.0 * (p.position(np.ones(3)) - np.array([39.0, 37.0, 1.0]))
    p.volume[:] = 1e-9
    backend = loaded(get_backend("hash", HASH_DEVICE), sandy(gravity=(0.0, 0.0, 0.0), **EVERYTHING), p)
    blocks, nodes = backend.parts.index.nall, len(backend.parts.nodes.grid)
    backend.steps(7e-3, 150)
    row = backend.ledger()
    assert backend.parts.index.nall > 4 * blocks
    assert len(backend.parts.nodes.grid) == 128 * backend.parts.index.capacity > 4 * nodes
    assert len(backend.parts.nodes.dilated) == 64 * backend.parts.index.capacity
    assert row.mass + row.escaped_mass == pytest.approx(p.mass.sum(), rel=1e-15)
    np.testing.assert_allclose(row.momentum, p.mass @ p.velocity, atol=1e-9 * p.mass.sum())


@pytest.mark.parametrize("way", ["apic", "aflip with F-bar", "packed with F-bar"])
@pytest.mark.parametrize("deterministic", [False, True])
def test_forecast_of_the_memory_is_within_two_percent(way, deterministic):
    p = box((20.0, 20.0, 0.0), (16.0, 16.0, 4.0), (1.0, 1.0, 1.0))
    s = scene(plane(), materials=(SAND,), **WAYS[way])
    backend = loaded(get_backend("hash", HASH_DEVICE, deterministic=deterministic), s, p)
    near = int((backend.parts.nodes.grounded.numpy() >= 0).sum())
    needed = hash_backend.bytes_needed(len(p), backend.parts.index.nall, "float64", deterministic, near, s.transfer, s.f_bar)
    assert needed == pytest.approx(backend.bytes_used() - layout.bytes_of(backend.parts.ground), rel=0.02)
