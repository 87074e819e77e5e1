"""Transfers of several substeps on the hash backend: what the reference gives, batches, looks, early sorts, memory."""

import sys
from collections import Counter
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from scenes import (
    HARD,
    HASH_DEVICE,
    IN_ORDER,
    SAND,
    assert_close_bulk,
    assert_close_states,
    assert_same,
    assert_same_numbers,
    box,
    loaded,
    on_cpu,
    plane,
    scene,
    single_precision,
)
from test_friction_zones import random_zones
from test_hash_equals_reference import GRAINS
from test_sparse_equals_dense import CLAY, rough

from runout import Voellmy, VoellmyBase
from runout.backends.hash import backend as hash_backend
from runout.backends.hash import batch, step, substeps
from runout.backends.protocol import get_backend
from runout.errors import ConfigError
from runout.studies.verification_cases.bar import vibration

sys.path[:0] = [str(Path(__file__).parents[1] / "structures")]

from boxes import Box, field_of_boxes  # noqa: E402

UNIT, DT = (1.0, 1.0, 1.0), 4e-3
TRANSFERS = (4, 4, 1, 2, 4, 3, *(4,) * 14)  # substeps of each
FRICTIONS = {
    "coulomb": (0.4, 0.25),
    "one drag": (Voellmy(mu=0.2, xi=300.0),) * 2,
    "own drags": (Voellmy(mu=0.3, xi=500.0), Voellmy(mu=0.2, xi=300.0)),
    "drag at the base": (VoellmyBase(mu=0.3, xi=500.0), VoellmyBase(mu=0.2, xi=300.0)),
}

# whether sums have a fixed order, on lanes as on a GPU: each way for ground areas and for drag, whose kernels differ
ON_LANES = [("coulomb", False, True), *product(("own drags", "drag at the base"), (False, True), (True,))]


def collapse(surface=None, friction=(0.4, 0.25), **choices):
    """Two columns of two materials beside each other, one above the other's foot, which collapse and slide on rough ground."""
    surface = rough() if surface is None else surface
    a, b = (box((x, 30.0, 0.05), (3.0, 4.0, up), UNIT, m.density, surface=surface) for x, up, m in ((24, 4, SAND), (27, 2, CLAY)))
    b.release[:], b.identity[:] = 1, len(a) + np.arange(len(b))
    p = type(a).concatenate([a, b])
    p.velocity[:] = (6.0, 1.0, -1.0)
    return scene(surface, UNIT, friction=friction, **{"materials": (SAND, CLAY), "substeps": 4, **choices}), p


def after(engine, a_scene, p, transfers=TRANSFERS, dt=DT):
    """State, ledger and columns after transfers of so many substeps each."""
    loaded(engine, a_scene, p)
    for number in transfers:
        engine.step(dt, number)
    return engine.particles(), engine.ledger(), engine.columns()


@cache
def collapsed_on_the_reference(friction):
    """State, ledger and columns of a collapse, once for all ways of hash."""
    return after(get_backend("reference"), *collapse(friction=FRICTIONS[friction]))


@pytest.mark.parametrize(("friction", "deterministic", "shared"), [*product(FRICTIONS, (False, True), (False,)), *ON_LANES])
def test_a_collapse_is_that_of_the_reference(monkeypatch, friction, deterministic, shared):
    """Where lanes are shared, they run as on a GPU."""
    monkeypatch.setattr(wp.config, "enable_cpu_blocks", shared)
    a_scene, p = collapse(friction=FRICTIONS[friction])
    expected = collapsed_on_the_reference(friction)
    engine = on_cpu(deterministic=deterministic)
    found = after(engine, a_scene, p)
    if shared and not deterministic and friction != "coulomb":  # warp's lanes of a CPU book the work of two blocks of nodes on one
        assert_close_states(expected[0], found[0], 1e-10, UNIT)
    else:
        assert_same(expected, found, 1e-10, UNIT)
    assert expected[1].contact_particles > 40
    assert expected[1].plastic_dissipation > 0 < expected[1].basal_dissipation
    assert engine.counters.steps == sum(TRANSFERS)
    assert engine.counters.transfers == len(TRANSFERS)
    assert engine.counters.particle_steps == sum(TRANSFERS) * len(p)


@pytest.mark.parametrize("deterministic", [False, True])
def test_zones_and_a_law_that_depends_on_the_rate_are_those_of_the_reference(deterministic):
    a_scene, p = collapse(friction=(0.4, 0.25), friction_zones=random_zones(), materials=(GRAINS, GRAINS))
    expected, found = (after(engine, a_scene, p) for engine in (get_backend("reference"), on_cpu(deterministic=deterministic)))
    assert_same(expected, found, 1e-10, UNIT)


def wall_scene(**choices):
    """A box of sand that slides against two walls, which meet in a concave edge."""
    ground, h = plane(0.05, 0.02), (1.0, 0.9, 0.8)
    along = Box((21.5, 16.1, 2.0), (3.0, 0.7, 4.0), 0.05, 0.4)
    field = field_of_boxes([Box((24.0, 20.0, 2.0), (1.5, 4.0, 4.0), 0.3, 0.4), along], 0.37, 3.0)
    p = box((19.013, 17.021, 0.013), (3.0, 5.4, 3.2), h, SAND.density, surface=ground)
    p.velocity[:, 0] = 8.0
    return scene(ground, h, (SAND,), **{"friction": (0.4,), "structures": field, "substeps": 4, **choices}), p


@cache
def stopped_by_walls_on_the_reference(friction):
    """State, ledger and columns of the box, and the impulses on the walls, once for all ways of hash."""
    engine = get_backend("reference")
    return after(engine, *wall_scene(friction=(friction,)), dt=2e-3), engine.structure_impulses()


@pytest.mark.parametrize("deterministic", [False, True])
@pytest.mark.parametrize("friction", [0.4, Voellmy(mu=0.2, xi=60.0)], ids=["coulomb", "drag"])
def test_structures_and_their_forces_are_those_of_the_reference(friction, deterministic):
    a_scene, p = wall_scene(friction=(friction,))
    (expected, x), other = stopped_by_walls_on_the_reference(friction), on_cpu(deterministic=deterministic)
    found = after(other, a_scene, p, dt=2e-3)
    assert_same(expected, found, 1e-10, a_scene.spacing)
    y = other.structure_impulses()
    assert np.abs(x).sum() > 1e5
    np.testing.assert_allclose(y, x, rtol=0, atol=1e-10 * np.abs(x).max())
    assert found[1].structure_dissipation > 0


def test_more_particles_lie_in_a_block_than_are_strained_at_once():
    surface = plane(0.1, 0.05)
    p = box((4.5, 4.5, 0.0), (4.0, 4.0, 3.0), UNIT, per_cell=4, surface=surface)  # over two blocks
    a_scene = scene(surface, UNIT, (SAND,), (0.4,), substeps=4)
    _, in_block = np.unique(p.node >> 2, axis=0, return_counts=True)
    assert in_block.max() > 2 * substeps.MANY
    expected, found = (after(engine, a_scene, p, (4, 4), 2e-3) for engine in (get_backend("reference"), on_cpu()))
    assert_same(expected, found, 1e-12, UNIT)


@pytest.mark.parametrize("number", [4, 16])
def test_a_bar_keeps_more_of_its_vibration_with_substeps_as_on_the_reference(number):
    way = {"cfl": 0.1, "transfer": {"substeps": number, "precision": "float64"}, "periods": 3}
    (period, left), expected = vibration(8, **way, backend="hash"), vibration(8, **way, backend="reference")
    assert (period, left) == pytest.approx(expected, abs=1e-9)
    assert left > 1 - 0.6 * (
        1 - vibration(8, cfl=0.1, periods=3, transfer={"substeps": 1, "precision": "float64"}, backend="hash")[1]
    )


def test_a_block_that_friction_holds_comes_to_rest_as_with_one_substep():
    """Dropped without stress on a slope of 0.1 with friction 0.6: after 3.2 s it hardly trembles."""
    ground = plane(0.1)
    p = box((24.0, 30.0, 0.0), (6.0, 6.0, 2.0), UNIT, HARD.density, surface=ground)
    for number in (1, 4):
        _, row, _ = after(on_cpu(), scene(ground, UNIT, (HARD,), (0.6,), substeps=4), p, (number,) * (800 // number), 4e-3)
        assert row.max_speed < 0.02
        assert row.contact_particles == len(p) // 4
        assert row.mass == pytest.approx(p.mass.sum(), rel=1e-14)


def test_single_precision_comes_close():
    a_scene, p = collapse()
    expected, found = after(get_backend("reference"), a_scene, p), after(on_cpu(), single_precision(a_scene), p)
    assert_close_bulk(expected, found, UNIT)


def test_a_scene_that_may_have_substeps_gives_the_bits_of_one_that_may_not_where_it_has_one():
    a_scene, p = collapse(friction=FRICTIONS["own drags"])
    one, other = (after(on_cpu(deterministic=IN_ORDER), s, p, (1,) * 20) for s in (a_scene, replace(a_scene, substeps=1)))
    assert_same_numbers(one[0], other[0])
    assert_same_numbers(one[1], other[1])


def launches_of(monkeypatch, a_scene, p, deterministic, number):
    """Launches of each kernel in a transfer of so many substeps."""
    engine, found = after_one(a_scene, p, deterministic), Counter()

    def counting(launch):
        return lambda kernel, *arguments: found.update([kernel.key]) or launch(kernel, *arguments)

    with monkeypatch.context() as patched:
        for name in ("run", "run_each", "run_blocks"):
            patched.setattr(step, name, counting(getattr(step, name)))
        engine.step(DT, number)
    return found


def after_one(a_scene, p, deterministic):
    """An engine after one transfer."""
    engine = loaded(on_cpu(deterministic=deterministic), a_scene, p)
    engine.step(DT, 4)
    return engine


@pytest.mark.parametrize("deterministic", [False, True])
@pytest.mark.parametrize(("friction", "more"), [("coulomb", ()), ("drag at the base", ()), ("own drags", ("sum_columns",))])
def test_a_further_substep_finds_no_contacts_and_launches_few_kernels(monkeypatch, friction, more, deterministic):
    a_scene, p = collapse(friction=FRICTIONS[friction])
    three, four = (launches_of(monkeypatch, a_scene, p, deterministic, number) for number in (3, 4))
    ordered = ("resume_nodes", "sum_contacts", *(["slow_columns"] if more else [])) if deterministic else ()
    assert four - three == Counter(("strain_in_place", "solve_contacts", "end_substep", *more, *ordered))
    assert three["find_contacts"] == four["find_contacts"] == 1


def members(precision):
    """Scenes of a batch, and the substeps of their transfers; with drag in double precision."""
    friction = FRICTIONS["own drags" if precision == "float64" else "coulomb"]
    grounds, speeds = (rough(), plane(0.2), plane(0.1, 0.1), rough()), (6.0, 2.0, 4.0, 1.0)
    found = []
    for ground, speed in zip(grounds, speeds, strict=True):
        a_scene, p = collapse(ground, friction, precision=precision)
        p.velocity[:, 0] = speed
        found.append((a_scene, p))
    return found, (4, 1, 2, 3)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_scenes_of_a_batch_have_their_own_numbers_of_substeps(precision):
    """Those that have fewer wait: each gives the bits of its own run."""
    (scenes, numbers), dt, counts = members(precision), (4e-3, 3e-3, 4e-3, 2e-3), (20, 12, 25, 20)
    together = batch.Batch(scenes, HASH_DEVICE, True)
    together.advance(dt, [10] * 4, substeps=numbers)
    together.advance(dt, [n - 10 for n in counts], substeps=numbers)
    rows = together.ledgers()
    assert together.counters.particle_steps == sum(n * k * len(p) for n, k, (_, p) in zip(counts, numbers, scenes, strict=True))
    for n, (a_scene, p) in enumerate(scenes):
        single = batch.Batch([(a_scene, p)], HASH_DEVICE, True)
        single.advance(dt[n : n + 1], [10], substeps=[numbers[n]])
        single.advance(dt[n : n + 1], [counts[n] - 10], substeps=[numbers[n]])
        assert_same_numbers(single.particles_of(0), together.particles_of(n), f"of scene {n}")
        row, expected = rows[n], single.ledgers()[0]
        for name in vars(row):
            np.testing.assert_allclose(getattr(row, name), getattr(expected, name), rtol=1e-12, atol=1e-6, err_msg=name)


def test_members_beside_structures_have_their_own_numbers_of_substeps():
    (a, p), (b, q) = wall_scene(), wall_scene(structures=None)
    together = batch.Batch([(a, p), (b, q), (a, p)], HASH_DEVICE, True)
    together.advance([2e-3] * 3, [12] * 3, substeps=[4, 2, 1])
    for n, (of, k) in enumerate(((a, 4), (b, 2), (a, 1))):
        single = loaded(on_cpu(deterministic=True), of, p)
        single.steps(2e-3, 12, substeps=k)
        assert_same_numbers(single.particles(), together.particles_of(n), f"of member {n}")
        np.testing.assert_array_equal(together.structure_impulses_of(n), single.structure_impulses())


def test_looks_are_at_finished_transfers_and_change_nothing():
    a_scene, p = collapse()
    looked, alone = (loaded(on_cpu(deterministic=IN_ORDER), a_scene, p) for _ in range(2))
    seen = {}
    looked.steps(DT, 6, (2, 5), lambda n, columns: seen.setdefault(n, columns), substeps=3)
    looked.steps(DT, 5, (1,), lambda n, columns: seen.setdefault(6 + n, columns), substeps=4)
    for n, k in enumerate((3,) * 6 + (4,) * 5, 1):
        alone.step(DT, k)
        if n in seen:
            assert seen.pop(n).mass.sum() == pytest.approx(alone.lattice_columns().mass.sum(), rel=1e-14)
            expected = alone.ledger()
    assert not seen
    assert expected.mass == pytest.approx(p.mass.sum(), rel=1e-15)
    assert_same_numbers(alone.particles(), looked.particles())


def test_a_checkpoint_goes_on_to_the_same_bits():
    for a_scene, p in (collapse(friction=FRICTIONS["own drags"]), wall_scene()):
        whole, half = (loaded(on_cpu(deterministic=IN_ORDER), a_scene, p) for _ in range(2))
        whole.steps(2e-3, 12, substeps=4)
        half.steps(2e-3, 5, substeps=4)
        resumed = on_cpu(deterministic=IN_ORDER)
        resumed.restore(a_scene, {name: np.array(values) for name, values in half.checkpoint().items()})
        resumed.steps(2e-3, 7, substeps=4)
        assert_same_numbers(whole.particles(), resumed.particles())
        assert_same_numbers(whole.ledger(), resumed.ledger())


def test_mass_that_leaves_the_index_early_is_sorted_and_goes_on_as_in_the_reference():
    """Transfers of nearly half a cell: more than one block is left before a sort is due."""
    a_scene, p = collapse(plane(), (0.1, 0.1))
    p.velocity[:] = (25.0, 0.0, 0.0)
    one, other = get_backend("reference"), on_cpu(deterministic=IN_ORDER)
    dt = 0.42 / 4 / 25.0
    loaded(one, a_scene, p), loaded(other, a_scene, p)
    for _ in range(16):
        one.step(dt, 4)
    other.steps(dt, 16, substeps=4)
    assert_close_states(one.particles(), other.particles(), 1e-10, UNIT)
    assert other.counters.rebuilds >= 3


def test_more_substeps_than_the_scene_has_are_refused():
    a_scene, p = collapse(substeps=2)
    engine = loaded(on_cpu(), a_scene, p)
    with pytest.raises(ConfigError, match="4 substeps; the scene has 2"):
        engine.step(DT, 4)


@pytest.mark.parametrize("deterministic", [False, True])
def test_forecast_of_the_memory_is_that_of_the_arrays(deterministic):
    a_scene, p = collapse()
    sizes, said = {}, {}
    for most in (1, 4):
        engine = loaded(on_cpu(deterministic=deterministic), replace(a_scene, substeps=most), p)
        index = engine.parts.index
        sizes[most] = engine.bytes_used()
        near = int((engine.parts.nodes.grounded.numpy() >= 0).sum())
        said[most] = hash_backend.bytes_needed(len(p), index.nall, "float64", deterministic, near, substeps=most)
    assert said[4] - said[1] == pytest.approx(sizes[4] - sizes[1], rel=0.02)
