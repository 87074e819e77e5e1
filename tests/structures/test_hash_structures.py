"""Contact with structures on the hash backend: batches, lanes of a GPU, bits that repeat, growth, checkpoints, memory."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from boxes import Box, field_of_boxes
from scenes import (
    HASH_DEVICE,
    IN_ORDER,
    SAND,
    assert_close_states,
    assert_same_numbers,
    box,
    loaded,
    on_cpu,
    plane,
    scene,
)

from runout import Voellmy
from runout.backends.hash import backend as hash_backend
from runout.backends.hash import batch, layout
from runout.backends.protocol import get_backend

GROUND, SPACING, DT = plane(0.05, 0.02), (1.0, 0.9, 0.8), 2e-3


def wall(x=24.0, angle=0.3, friction=0.4):
    """Field of a wall across the flow with one along it, which meet in a concave edge; faces are oblique to the grid."""
    along = Box((x - 2.5, 16.1, 2.0), (3.0, 0.7, 4.0), angle - 0.25, friction)
    return field_of_boxes([Box((x, 20.0, 2.0), (1.5, 4.0, 4.0), angle, friction), along], 0.37, 3.0)


def flow(field, **choices):
    """A box of sand that slides against structures; its particles lie where no rounding decides between patches."""
    p = box((19.013, 17.021, 0.013), (3.0, 5.4, 3.2), SPACING, SAND.density, surface=GROUND)
    p.velocity[:, 0] = 8.0
    return replace(scene(GROUND, SPACING, (SAND,), (0.4,)), structures=field, **choices), p


def after(backend, a_scene, p, steps):
    loaded(backend, a_scene, p).steps(DT, steps)
    return backend


def assert_same_run(a, b, tolerance):
    """States, impulses on patches and energy that structures take agree within ``tolerance`` of their scale."""
    assert_close_states(a.particles(), b.particles(), tolerance, SPACING)
    x, y = a.structure_impulses(), b.structure_impulses()
    np.testing.assert_allclose(y, x, rtol=0, atol=tolerance * np.abs(x).max())
    taken = [backend.ledger().structure_dissipation for backend in (a, b)]
    assert taken[1] == pytest.approx(taken[0], rel=10 * tolerance)


@pytest.mark.parametrize("shared", [False, True], ids=["one lane", "lanes of a GPU"])
@pytest.mark.parametrize("deterministic", [False, True])
def test_flow_against_a_wall_is_that_of_the_reference(monkeypatch, deterministic, shared):
    monkeypatch.setattr(wp.config, "enable_cpu_blocks", shared)
    a_scene, p = flow(wall())
    reference = loaded(get_backend("reference"), a_scene, p)
    for _ in range(60):
        reference.step(DT)
    assert np.abs(reference.structure_impulses()).sum() > 1e5
    assert_same_run(reference, after(on_cpu(deterministic=deterministic), a_scene, p, 60), 1e-11)


@pytest.mark.parametrize("shared", [False, True], ids=["one lane", "lanes of a GPU"])
def test_columns_that_drag_slows_meet_structures_as_in_the_reference(monkeypatch, shared):
    monkeypatch.setattr(wp.config, "enable_cpu_blocks", shared)
    a_scene, p = flow(wall(), friction=(Voellmy(mu=0.2, xi=60.0),))
    reference = loaded(get_backend("reference"), a_scene, p)
    for _ in range(40):
        reference.step(DT)
    assert np.abs(reference.structure_impulses()).sum() > 1e5
    assert_same_run(reference, after(on_cpu(), a_scene, p, 40), 1e-11)


def test_members_of_a_batch_meet_their_own_structures_or_none_as_in_their_own_runs():
    field = wall()
    members = [flow(field), flow(None), flow(wall(23.5, -0.2, 0.1)), flow(field)]
    together = batch.Batch(members, HASH_DEVICE, True)
    together.advance([DT] * 4, [30] * 4)
    together.advance([DT] * 4, [20, 20, 10, 30])
    rows = together.ledgers()
    for s, steps in enumerate((50, 50, 40, 60)):
        alone = after(on_cpu(deterministic=True), *members[s], steps)
        assert_same_numbers(alone.particles(), together.particles_of(s), f"of member {s}")
        np.testing.assert_array_equal(together.structure_impulses_of(s), alone.structure_impulses(), err_msg=f"of member {s}")
        assert rows[s].structure_dissipation == alone.ledger().structure_dissipation
    assert together.structure_impulses_of(1).shape == (0, 3)
    assert rows[1].structure_dissipation == 0.0 < rows[2].structure_dissipation
    assert len(together.parts.structures.rows) == sum(m[0].structures.blocks.size for m in (members[0], members[2]))


def test_single_precision_comes_close_and_repeats_its_bits():
    wide, p = flow(wall())
    narrow = replace(wide, precision="float32")
    exact, one, other = (after(on_cpu(deterministic=IN_ORDER), s, p, 60) for s in (wide, narrow, narrow))
    found = one.structure_impulses()
    np.testing.assert_allclose(found, exact.structure_impulses(), rtol=0, atol=1e-3 * np.abs(found).max())
    np.testing.assert_array_equal(other.structure_impulses(), found)
    assert one.ledger().structure_dissipation == other.ledger().structure_dissipation


def launches_of_a_step(monkeypatch, a_scene, p, **choices):
    """Names of the kernels of one step behind the first."""
    backend, names = loaded(on_cpu(**choices), a_scene, p), []
    for name in ("launch", "launch_tiled"):
        given = getattr(wp, name)
        monkeypatch.setattr(wp, name, lambda kernel, *a, _given=given, **k: names.append(kernel.key) or _given(kernel, *a, **k))
    backend.steps(DT, 1), names.clear(), backend.steps(DT, 1)
    monkeypatch.undo()
    return names


@pytest.mark.parametrize(("choices", "more"), [({}, 7), ({"deterministic": True}, 11)])
def test_structures_take_no_launch_where_there_are_none_or_no_mass_is_near(monkeypatch, choices, more):
    beside, afar, none = (launches_of_a_step(monkeypatch, *flow(field), **choices) for field in (wall(), wall(60.0), None))
    assert afar == none
    assert not any("struct" in name or "settle" in name for name in none)
    assert len(beside) == len(none) + more


def test_flow_that_comes_to_a_wall_from_afar_makes_room_and_gives_what_the_reference_gives(monkeypatch):
    """No block is beside a structure at first, so nothing of its contact is launched."""
    monkeypatch.setattr(layout, "AMPLE", 0)
    a_scene, p = flow(wall(35.0))
    p.velocity[:, 0] = 20.0
    reference, backend = (loaded(engine, a_scene, p) for engine in (get_backend("reference"), on_cpu(deterministic=IN_ORDER)))
    assert (backend.parts.structures.places, backend.parts.structures.slots) == (0, 0)
    for _ in range(9):
        for _ in range(30):
            reference.step(DT)
        backend.steps(DT, 30)
    assert backend.parts.structures.generation > 2
    assert_same_run(reference, backend, 1e-9)


def test_run_with_structures_goes_on_from_its_checkpoint_bit_by_bit():
    a_scene, p = flow(wall())
    backend = after(on_cpu(deterministic=IN_ORDER), a_scene, p, 40)
    state = {name: values.copy() for name, values in backend.checkpoint().items()}
    other = on_cpu(deterministic=IN_ORDER)
    other.restore(a_scene, state)
    np.testing.assert_array_equal(other.structure_impulses(), backend.structure_impulses())
    for engine in (backend, other):
        engine.steps(DT, 100)
    assert_same_numbers(backend.particles(), other.particles())
    assert_same_numbers(backend.ledger(), other.ledger())
    np.testing.assert_array_equal(other.structure_impulses(), backend.structure_impulses())


@pytest.mark.parametrize("choices", [{}, {"precision": "float32"}], ids=str)
def test_forecast_of_the_memory_counts_structures_within_two_percent(choices):
    a_scene, p = flow(wall(), **choices)
    backend = loaded(on_cpu(), a_scene, p)
    near, beside = (int((a.numpy() >= 0).sum()) for a in (backend.parts.nodes.grounded, backend.parts.structures.grounded))
    ways = a_scene.precision, False, near, a_scene.structures, beside
    said = hash_backend.bytes_needed(len(p), backend.parts.index.nall, *ways, substeps=a_scene.substeps)
    ground = layout.bytes_of(backend.parts.ground)
    assert said == pytest.approx(backend.bytes_used() - ground, rel=0.02)
