"""The index of the hash backend: its table grows, its blocks follow the particles, and nothing is lost on the way."""

import numpy as np
import pytest
import warp as wp
from scenes import (
    HARD,
    HASH_DEVICE,
    IN_ORDER,
    SAND,
    assert_close_states,
    assert_same_numbers,
    at,
    box,
    cloud,
    loaded,
    on_cpu,
    plane,
)
from scenes import scene as any_scene

from runout import Voellmy, VoellmyBase
from runout.backends.hash import backend as hash_backend
from runout.backends.hash import batch, index, layout, parts, readback, state
from runout.backends.protocol import get_backend
from runout.errors import CapacityError, ConfigError, DeviceError
from runout.model.particles import Particles

UNIT = (1.0, 1.0, 1.0)
WEIGHTLESS = (0.0, 0.0, 0.0)
COLUMN = Voellmy(mu=0.2, xi=1000.0)


def scene(surface=None, **choices):
    """A scene of one law, so that few kernels are compiled: the index knows no law."""
    return any_scene(surface, **{"materials": (HARD,), **choices})


def full(*_):
    """Fail as warp does on a device without memory."""
    raise RuntimeError("Failed to allocate 1234 bytes on device 'cuda:0'")


def scattered(n, reach, seed=3):
    """Single particles far from each other, also at negative nodes."""
    return at(np.random.default_rng(seed).uniform(-reach, reach, (n, 3)) + np.array([40.0, 37.0, 0.0]), UNIT)


@pytest.mark.parametrize("ranked", [0, 2**20])
def test_every_particle_finds_its_block_and_its_cell(monkeypatch, ranked):
    monkeypatch.setattr(index, "RANKED", ranked)  # keys are sorted, or counted
    p = scattered(300, 35.0)
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    q = backend.particles()
    np.testing.assert_array_equal(q.node, p.node)
    np.testing.assert_array_equal(q.offset, p.offset)
    i = backend.parts.index
    xyz = i.coordinates.numpy()[: i.nall]
    assert len(np.unique(xyz, axis=0)) == i.nall
    assert (np.lexsort((xyz[:, 2], xyz[:, 1], xyz[:, 0])) == np.arange(i.nall)).all()
    assert backend.ledger().active_blocks == len(np.unique(p.node >> 2, axis=0))


def test_neighbours_of_every_block_that_may_hold_particles_are_the_next_blocks():
    backend = loaded(on_cpu(deterministic=True), scene(), scattered(50, 20.0))
    i = backend.parts.index
    xyz, up, down = i.coordinates.numpy()[: i.nall], i.up.numpy()[: i.nall], i.down.numpy()[: i.nall]
    steps = np.array([(q >> 2, (q >> 1) & 1, q & 1) for q in range(8)])
    holds = up[:, 0] >= 0
    assert holds.sum() >= i.nown
    np.testing.assert_array_equal(xyz[up[holds]], xyz[holds][:, None] + steps)
    there = down >= 0
    np.testing.assert_array_equal(xyz[down][there], (xyz[:, None] - steps)[there])


def test_table_that_is_too_small_grows_until_it_is_at_most_half_full(monkeypatch):
    monkeypatch.setattr(index, "SMALLEST_TABLE", 8)
    p = scattered(200, 35.0)
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    assert backend.parts.index.table.shape[0] >= 2 * backend.parts.index.nall > 400
    backend.step(1e-3)
    np.testing.assert_array_equal(backend.particles().identity, p.identity)
    assert backend.ledger().mass == pytest.approx(p.mass.sum(), rel=1e-15)


def test_mass_that_spreads_into_new_blocks_makes_the_index_grow_and_loses_nothing(monkeypatch):
    monkeypatch.setattr(index, "SMALLEST_TABLE", 64)
    p = box((38.0, 36.0, 0.0), (2.0, 2.0, 2.0), UNIT)
    centre = np.array([39.0, 37.0, 1.0])
    p.velocity[:] = 20.0 * (p.position(np.array(UNIT)) - centre)
    p.volume[:] = 1e-9  # no stress: the cloud flies apart
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    blocks, entries = backend.parts.index.nall, backend.parts.index.table.shape[0]
    backend.steps(0.01, 150)
    row, q = backend.ledger(), backend.particles()
    assert backend.counters.steps == 150
    assert backend.counters.rebuilds > 3
    assert backend.parts.index.nall > 4 * blocks
    assert backend.parts.index.table.shape[0] > entries
    assert row.mass + row.escaped_mass == pytest.approx(p.mass.sum(), rel=1e-15)
    np.testing.assert_allclose(row.momentum, p.mass @ p.velocity, atol=1e-9 * p.mass.sum())
    np.testing.assert_array_equal(q.identity, p.identity)
    assert (q.offset >= 0.5).all()
    assert (q.offset < 1.5).all()


@pytest.mark.parametrize("deterministic", [IN_ORDER, True])
def test_restored_run_spreads_into_new_blocks_as_the_one_that_went_on(deterministic):
    p = box((38.0, 36.0, 0.0), (2.0, 2.0, 2.0), UNIT)
    p.velocity[:] = 20.0 * (p.position(np.array(UNIT)) - np.array([39.0, 37.0, 1.0]))
    one, other = on_cpu(deterministic=deterministic), on_cpu(deterministic=deterministic)
    a_scene = scene(plane(), gravity=WEIGHTLESS)
    loaded(one, a_scene, p).steps(0.01, 25)
    other.restore(a_scene, {name: values.copy() for name, values in one.checkpoint().items()})
    assert other.bytes_used() == pytest.approx(one.bytes_used(), rel=0.1)
    one.steps(0.01, 60), other.steps(0.01, 60)
    assert one.counters.rebuilds == other.counters.rebuilds > 3
    assert one.parts.index.nall == other.parts.index.nall
    assert_same_numbers(one.particles(), other.particles())
    assert one.ledger().basal_dissipation == other.ledger().basal_dissipation > 0


def test_dense_index_holds_the_whole_box_around_two_bodies_and_gives_what_the_sparse_one_gives():
    p = Particles.concatenate([box((x, 36.0, 0.0), (3.0, 3.0, 2.0), UNIT) for x in (30.0, 62.0)])
    p.velocity[:] = (2.0, 1.0, 0.0)
    sparse, dense = (loaded(on_cpu(index=kind), scene(plane()), p) for kind in ("sparse", "dense"))
    low, high = p.node.min(0) >> 2, p.node.max(0) >> 2
    assert dense.parts.index.nall == np.prod(high - low + 4)  # a block more on each side, and one upwards for their nodes
    assert dense.parts.index.nall > 3 * sparse.parts.index.nall
    for backend in (sparse, dense):
        backend.steps(2e-3, 300)
        assert backend.counters.rebuilds > 1
    assert dense.parts.index.nall == np.prod(high - low + 4)
    if HASH_DEVICE == "cpu":
        assert_same_numbers(sparse.particles(), dense.particles())
    else:  # atomic sums have no fixed order there
        assert_close_states(sparse.particles(), dense.particles(), 1e-9)


def test_unknown_index_is_refused_with_the_names():
    with pytest.raises(ConfigError, match="'loose'; choose one of sparse, dense"):
        on_cpu(index="loose")


def test_index_stays_while_the_particles_stay_in_its_blocks():
    p = box((30.0, 30.0, 1.0), (2.0, 2.0, 2.0), UNIT)
    p.velocity[:] = (3.0, 0.0, 0.0)
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    backend.steps(0.01, 30)  # 0.9 cells, within the margin
    assert backend.counters.rebuilds == 0
    backend.steps(0.01, 200)
    assert 6 <= backend.counters.rebuilds <= 9


def test_particles_are_sorted_by_cell_in_memory_after_so_many_steps(monkeypatch):
    monkeypatch.setattr(batch, "STEPS_PER_SORT", 10)
    p = cloud(300, spacing=UNIT)
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    backend.steps(1e-3, 35)
    assert backend.counters.rebuilds == 3
    backend.steps(1e-3, 6)
    key = backend.parts.store.key.numpy()
    assert backend.counters.rebuilds == 4
    assert np.mean(np.diff(key) >= 0) > 0.9


def test_body_far_beyond_the_origin_moves_as_one_near_it():
    """20-bit block coordinates: 4 million cells from the origin."""
    ends = []
    for shift in (0, 4_000_000):
        p = box((10.1, 10.2, 1.0), (2.0, 2.0, 2.0), UNIT)
        p.node += np.array([0, 0, shift], np.int32)
        p.velocity[:] = np.random.default_rng(4).normal(size=p.velocity.shape)
        backend = loaded(on_cpu(deterministic=IN_ORDER), scene(gravity=WEIGHTLESS), p)
        backend.steps(2e-3, 10)
        ends.append(backend.particles())
    np.testing.assert_array_equal(ends[0].offset, ends[1].offset)
    np.testing.assert_array_equal(ends[0].velocity, ends[1].velocity)


def test_particle_beyond_the_range_of_the_keys_is_refused_with_the_range():
    p = at([(10.0, 10.0, 0.0)], UNIT)
    p.node[:] = 4 * 2**20
    with pytest.raises(CapacityError, match="index range"):
        loaded(on_cpu(), scene(), p)


def test_escaped_mass_is_booked_once_also_over_a_sort(monkeypatch):
    monkeypatch.setattr(batch, "STEPS_PER_SORT", 7)
    p = box((0.1, 30.0, 1.0), (4.0, 2.0, 2.0), UNIT)
    p.velocity[:, 0] = -20.0
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    for _ in range(10):
        backend.steps(0.01, 3)
        row = backend.ledger()
        assert row.mass + row.escaped_mass == pytest.approx(p.mass.sum(), rel=1e-14)
        assert row.mass == pytest.approx(backend.particles().mass.sum(), rel=1e-14, abs=1e-12)
        assert backend.columns().mass.sum() == pytest.approx(row.mass, rel=1e-12, abs=1e-9)
    assert row.mass == 0.0
    assert row.escaped_energy == pytest.approx(0.5 * p.mass.sum() * 400, rel=1e-9)


@pytest.mark.skipif(wp.is_cuda_available(), reason="the report is told that arrays of the CPU lie on a card, which a card refuses")
@pytest.mark.parametrize("lanes", [3, 2**11])
def test_threads_of_a_gpu_share_the_sums_over_particles_that_have_gone(monkeypatch, lanes):
    """Each thread looks at four keys at once, the last ones perhaps beyond the end."""
    monkeypatch.setattr(readback, "ROW_LANES", lanes)
    monkeypatch.setattr(readback, "FEWEST_LANES", lanes)
    p = scattered(301, 35.0)
    p.velocity[:, 0] = 20.0
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    backend.report = readback.Report(backend.parts.k.groups, 1, is_cuda=True)
    backend.steps(0.01, 150)
    row = backend.ledger()
    assert 0.0 < row.escaped_mass < p.mass.sum()
    assert row.mass + row.escaped_mass == pytest.approx(p.mass.sum(), rel=1e-14)
    assert row.mass == pytest.approx(backend.particles().mass.sum(), rel=1e-14)


def test_two_particles_at_one_place_and_hundreds_in_one_cell_are_summed():
    p = at(np.full((400, 3), 10.25), UNIT)
    p.velocity[:] = np.random.default_rng(5).normal(size=p.velocity.shape)
    p.volume[:] = 1e-9
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    backend.step(1e-3)
    # all at one place: everyone gets the mean velocity
    np.testing.assert_allclose(backend.particles().velocity, np.broadcast_to(p.velocity.mean(0), (400, 3)), atol=1e-13)


def test_friction_and_law_hold_with_more_releases_than_blocks():
    materials = (SAND,) * 12
    p = box((30.0, 30.0, 5.0), (2.0, 2.0, 1.0), UNIT, density=SAND.density)
    p.radius[:] = 0.25
    p.release[:] = np.arange(len(p)) % 12
    backend = loaded(on_cpu(), scene(plane(height=5.0), materials=materials, friction=tuple(0.1 * np.arange(12))), p)
    backend.steps(1e-3, 5)
    np.testing.assert_array_equal(backend.particles().release, p.release)


def test_memory_keeps_to_147_bytes_a_particle_and_100_bytes_a_node_in_float32(monkeypatch):
    """10.7 million particles, 512 a block and half as many blocks again around them, stay below 2 GiB; 300 million below 80 GB."""
    monkeypatch.setattr(state, "FEW", 0)
    backend = loaded(on_cpu(), scene(plane(), precision="float32"), box((20.0, 20.0, 0.0), (16.0, 16.0, 8.0), UNIT))
    s, i = backend.parts.store, backend.parts.index
    assert layout.bytes_of(s) / s.size <= 147
    by_block = layout.bytes_of(i, backend.parts.nodes) - 20 * i.table.shape[0]
    assert by_block / (64 * i.capacity) <= 100
    needed = hash_backend.bytes_needed
    assert needed(10_700_000, 3 * 10_700_000 // 1024) < 2 * 2**30
    assert needed(300_000_000, 3 * 300_000_000 // 1024) < 80e9
    # a layer of 400 x 400 x 8 cells on a plane, as the benchmark runs it: blocks that exist, and those that the ground may push
    assert needed(10_240_000, 63_401, near=46_473) / 10_240_000 <= 147


def test_memory_of_a_layer_on_a_plane_is_what_its_forecast_says_and_all_of_it_counts(monkeypatch):
    """Particles 130 bytes; the rest are blocks, 80 bytes a node of a block that holds any where the layer is two blocks thick.

    Without the room to spread of a small flow.
    """
    monkeypatch.setattr(state, "FEW", 0)
    monkeypatch.setattr(layout, "AMPLE", 0)
    monkeypatch.setattr(index, "SMALLEST_TABLE", 1024)
    p = box((20.0, 20.0, 0.1), (32.0, 32.0, 8.0), UNIT)
    backend = loaded(on_cpu(), scene(plane(), precision="float32", substeps=1), p)
    assert layout.bytes_of(backend.parts.store) == 130 * len(p)
    blocks = backend.bytes_used() - layout.bytes_of(backend.parts.store) - layout.bytes_of(backend.parts.ground)
    assert blocks / (64 * backend.ledger().active_blocks) <= 100


@pytest.mark.parametrize("deterministic", [IN_ORDER, True])
def test_sort_that_moves_all_rows_at_once_gives_the_bits_of_one_that_moves_single_rows(monkeypatch, deterministic):
    ends = []
    for few in (0, 2**20):
        monkeypatch.setattr(state, "FEW", few)
        p = box((20.0, 20.0, 0.0), (6.0, 5.0, 4.0), UNIT)
        p.velocity[:] = np.random.default_rng(3).normal(0.0, 2.0, p.velocity.shape)
        backend = loaded(on_cpu(deterministic=deterministic), scene(plane()), p)
        backend.steps(2e-3, 200)
        assert backend.counters.rebuilds > 2  # both ways
        assert (backend.parts.store.spare > 0) == (few > 0)
        ends.append(backend.particles())
    for name in vars(ends[0]):
        np.testing.assert_array_equal(getattr(ends[0], name), getattr(ends[1], name), err_msg=name)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("deterministic", [False, True])
def test_forecast_of_the_memory_is_within_two_percent(precision, deterministic):
    p = box((20.0, 20.0, 0.0), (16.0, 16.0, 4.0), UNIT)
    backend = loaded(on_cpu(deterministic=deterministic), scene(plane(), precision=precision), p)
    near = int((backend.parts.nodes.grounded.numpy() >= 0).sum())
    forecast = hash_backend.bytes_needed(len(p), backend.parts.index.nall, precision, deterministic, near, substeps=4)
    assert forecast == pytest.approx(backend.bytes_used() - layout.bytes_of(backend.parts.ground), rel=0.02)


@pytest.mark.parametrize(
    ("friction", "precision"),
    [((COLUMN,), "float32"), ((VoellmyBase(mu=0.2, xi=1000.0),), "float64"), ((COLUMN, Voellmy(mu=0.3, xi=500.0)), "float32")],
)
def test_forecast_of_the_memory_counts_ground_areas_and_drag_within_two_percent(friction, precision):
    p = box((20.0, 20.0, 0.0), (16.0, 16.0, 4.0), UNIT)
    backend = loaded(on_cpu(), scene(plane(), materials=(SAND,) * len(friction), precision=precision, friction=friction), p)
    near = int((backend.parts.nodes.grounded.numpy() >= 0).sum())
    blocks, law = backend.parts.index.nall, {"friction": friction[0], "mixed": len(friction)}
    forecast = hash_backend.bytes_needed(len(p), blocks, precision, near=near, substeps=4, **law)
    assert forecast == pytest.approx(backend.bytes_used() - layout.bytes_of(backend.parts.ground), rel=0.02)


def test_device_without_memory_is_reported_with_particles_and_what_is_held(monkeypatch):
    backend = on_cpu()
    monkeypatch.setattr(parts, "NodeArrays", full)
    with pytest.raises(CapacityError, match=r"1234 bytes.*for 64 particles.*GiB so far"):
        backend.load(scene(), box((20.0, 20.0, 0.0), (2.0, 2.0, 2.0), UNIT))


def test_device_that_is_full_when_the_index_must_grow_is_reported_with_numbers(monkeypatch):
    p = box((38.0, 36.0, 0.0), (2.0, 2.0, 2.0), UNIT)
    p.velocity[:] = 20.0 * (p.position(np.array(UNIT)) - np.array([39.0, 37.0, 1.0]))
    p.volume[:] = 1e-9
    backend = loaded(on_cpu(), scene(gravity=WEIGHTLESS), p)
    room = backend.parts.index.capacity
    monkeypatch.setattr(parts, "NodeArrays", full)
    with pytest.raises(CapacityError, match=r"1234 bytes.*for 64 particles.*GiB so far; use larger cells"):
        backend.steps(0.01, 150)
    assert backend.parts.index.capacity > room


@pytest.mark.parametrize("device", ["cuda:7", "cuda:99"])
def test_device_that_is_not_there_is_refused_in_one_line_that_names_what_is(device):
    with pytest.raises(DeviceError) as refusal:
        get_backend("hash", device)
    message = str(refusal.value)
    assert device in message
    assert message.endswith("cpu")
    assert "\n" not in message


def test_auto_takes_the_cpu_backend_on_a_machine_without_a_gpu(monkeypatch):
    monkeypatch.setattr(hash_backend, "cuda_devices", lambda: ())
    assert type(get_backend("auto")).__name__ == "ScanBackend"
    assert type(get_backend("auto", "cpu")).__name__ == "ScanBackend"
    assert type(get_backend("hash")).__name__ == "HashBackend"
    with pytest.raises(DeviceError, match="has cpu"):
        get_backend("auto", "cuda:0")


def test_empty_batch_and_empty_scene_do_nothing():
    backend = loaded(on_cpu(), scene(), cloud(5).take(np.zeros(0, int)))
    backend.steps(0.01, 5)
    assert backend.counters.steps == 5
    assert backend.ledger().mass == 0.0
