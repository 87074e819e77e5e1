"""Several scenes in one launch: each gives what its own run gives, whatever its terrain, material, time step and end."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import HASH_DEVICE, IN_ORDER, SAND, assert_same_numbers, bowl, plane, scene
from test_hash_equals_reference import GRAINS
from test_sparse_equals_dense import CLAY, two_bodies

from runout.backends import footprints
from runout.backends.hash import batch
from runout.errors import ConfigError

UNIT = (1.0, 1.0, 1.0)
STEPS = (60, 35, 80)
DT = (2e-3, 1.5e-3, 2e-3)


def three_scenes(precision="float64"):
    """Different ground, materials, friction and size of the domain."""
    grounds = (plane(), bowl(), plane(np.radians(12.0)))
    materials = ((SAND, CLAY), (CLAY, SAND), (SAND, SAND))
    frictions = ((0.4, 0.25), (0.3, 0.3), (0.1, 0.6))
    scenes = []
    for ground, kinds, friction in zip(grounds, materials, frictions, strict=True):
        s = replace(scene(ground, UNIT, kinds, friction), precision=precision)
        scenes.append((s, two_bodies(ground, UNIT)))
    return scenes


def alone(s, p, dt, steps, deterministic):
    single = batch.Batch([(s, p)], HASH_DEVICE, deterministic)
    single.advance([dt], [steps])
    return single


@pytest.mark.parametrize(("precision", "deterministic"), [("float64", True), ("float32", IN_ORDER)])
def test_scene_of_a_batch_ends_as_in_its_own_run(precision, deterministic):
    scenes = three_scenes(precision)
    together = batch.Batch(scenes, HASH_DEVICE, deterministic)
    together.advance(DT, [20, 20, 20])
    together.advance(DT, [n - 20 for n in STEPS])
    rows = together.ledgers()
    together.look_at([0, 1, 2])
    assert together.counters.particle_steps == sum(n * len(p) for n, (_, p) in zip(STEPS, scenes, strict=True))
    for n, (s, p) in enumerate(scenes):
        single = alone(s, p, DT[n], STEPS[n], deterministic)
        a, b = single.particles_of(0), together.particles_of(n)
        assert_same_numbers(a, b, f"of scene {n}")
        row, expected = rows[n], single.ledgers()[0]
        assert row.contact_particles == expected.contact_particles > 0
        for name in vars(row):
            np.testing.assert_allclose(getattr(row, name), getattr(expected, name), rtol=1e-12, atol=1e-6, err_msg=name)
        columns, wanted = together.columns_of(n), single.columns_of(0)
        np.testing.assert_allclose(columns.mass, wanted.mass, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(columns.momentum, wanted.momentum, rtol=1e-9, atol=1e-9)
        window = together.flow_columns_of(n)  # of all scenes at once
        np.testing.assert_array_equal(window.mass, columns.mass[window.window])
        assert window.mass.sum() == pytest.approx(columns.mass.sum(), rel=1e-14)
        assert window.mass.size < columns.mass.size


def test_scenes_whose_friction_depends_on_the_rate_each_find_their_own_time_step():
    first, second = ((replace(s, materials=(GRAINS,), friction=s.friction[:1]), p) for s, p in three_scenes()[:2])
    for _, p in (first, second):
        p.release[:] = 0
    together = batch.Batch([first, second], HASH_DEVICE, True)
    together.advance(DT[:2], STEPS[:2])
    for n, (s, p) in enumerate((first, second)):
        a, b = alone(s, p, DT[n], STEPS[n], True).particles_of(0), together.particles_of(n)
        assert_same_numbers(a, b, f"of scene {n}")


def test_scene_that_is_done_leaves_and_the_others_go_on_unchanged():
    scenes = three_scenes()
    together = batch.Batch(scenes, HASH_DEVICE, True)
    together.advance(DT, [10, 10, 10])
    together.leave([1])
    together.advance(DT, [70, 70, 70])
    assert together.parts.store.n == len(scenes[0][1]) + len(scenes[2][1])
    for n in (0, 2):
        single = alone(*scenes[n], DT[n], 80, True)
        np.testing.assert_array_equal(together.particles_of(n).velocity, single.particles_of(0).velocity)
    assert together.ledgers()[1].mass == 0.0


def test_scene_that_becomes_unstable_is_recorded_with_its_reason_and_ends_nothing_else():
    scenes = three_scenes()
    scenes[1][1].velocity[3] = (0.0, 0.0, 900.0)
    together = batch.Batch(scenes, HASH_DEVICE, True)
    together.advance(DT, [40, 40, 40])
    assert "a particle of 900 m/s would cross" in together.accounts[1].failure
    assert [a.failure == "" for a in together.accounts] == [True, False, True]
    np.testing.assert_array_equal(together.particles_of(2).velocity, alone(*scenes[2], DT[2], 40, True).particles_of(0).velocity)


def test_scenes_that_differ_in_what_they_must_share_are_refused_with_its_name():
    (a, p), (b, q), _ = three_scenes()
    with pytest.raises(ConfigError, match="spacing"):
        batch.Batch([(a, p), (replace(b, spacing=(2.0, 2.0, 2.0)), q)])


def test_columns_of_a_window_around_the_flow_are_those_of_the_whole_raster_bit_by_bit():
    together = batch.Batch(three_scenes(), HASH_DEVICE)
    together.advance(DT, [10, 10, 10])
    for n in range(3):
        whole, flow = together.columns_of(n), together.flow_columns_of(n)
        assert flow.mass.size < whole.mass.size / 4
        for name in ("volume", "mass", "momentum"):
            found = np.zeros_like(getattr(whole, name))
            found[flow.window] = getattr(flow, name)
            np.testing.assert_array_equal(found, getattr(whole, name))


def test_columns_are_taken_behind_the_launches_of_the_next_steps_and_are_those_of_their_own_step(monkeypatch):
    """Ten steps in launches of 4, 4 and 2: the host takes the columns of a launch once the next is under way, the last at once."""
    (s, p), events, masses = three_scenes()[0], [], []
    launch = batch.Batch._batch
    monkeypatch.setattr(batch.Batch, "_steps_per_sort", lambda self, left: 4)
    monkeypatch.setattr(batch.Batch, "_batch", lambda self, *counts: (events.append("launch"), launch(self, *counts))[1])

    def take(scene, step, columns):
        events.append(step)
        masses.append(on_whole_raster(columns, s))

    batch.Batch([(s, p)], HASH_DEVICE, IN_ORDER).advance(DT[:1], [10], {0: [2, 6, 7, 10]}, take)
    assert events == ["launch", "launch", 2, "launch", 6, 7, 10]
    for step, mass in zip((2, 6, 7, 10), masses, strict=True):
        expected = on_whole_raster(alone(s, p, DT[0], step, IN_ORDER).lattice_columns_of(0), s)
        assert expected.sum() == pytest.approx(p.mass.sum())
        np.testing.assert_allclose(mass, expected, rtol=1e-9, atol=1e-6)
    assert np.abs(masses[0] - masses[3]).max() > 1.0  # the mass has moved between


def on_whole_raster(columns, s):
    """Mass (rows, columns) [kg] on the raster of columns on the lattice."""
    cell = footprints.lattice_cell(s)
    return footprints.on_whole(footprints.on_raster(columns, s.raster, cell), s.raster).mass
