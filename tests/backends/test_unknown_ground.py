"""Cells of the raster without elevation are an open edge: what comes into one is booked as escaped, alike on every backend."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import HARD, STATE, box, engine_of, loaded, plane, scene, total_energy

from runout.backends.state import part
from runout.errors import ConfigError
from runout.simulation.checkpoint import run_key

UNIT = (1.0, 1.0, 1.0)
DT = 5e-3


def holes():
    """A stretch of three cells by three and a single one of the 40 x 30 of all scenes, in the way of :func:`body`."""
    unknown = np.zeros((40, 30), bool)
    unknown[20:23, 13:16] = True
    unknown[17, 11] = True
    return unknown


def slope(**choices):
    surface = plane(-0.4, 0.1, 30.0)
    return surface, replace(scene(surface, UNIT, **{"friction": (0.2,), **choices}), unknown=holes())


def body(surface):
    """A box that slides east and slightly south, whose path leads into the holes."""
    p = box((33.0, 28.0, 0.0), (5.0, 7.0, 2.0), UNIT, surface=surface)
    p.velocity[:, 0] = 7.0
    return p


def after(engine, count):
    for _ in range(count):
        engine.step(DT)
    return engine.particles(), engine.ledger()


def test_mass_that_comes_into_unknown_ground_is_booked_as_escaped_and_nothing_else_is_lost(backend):
    surface, s = slope()
    p = body(surface)
    start = total_energy(loaded(backend, s, p).ledger())
    left, row = after(backend, 200)
    x, y, _ = left.position(np.array(UNIT)).T
    assert 0.1 < row.escaped_mass / p.mass.sum() < 0.9
    assert row.mass + row.escaped_mass == pytest.approx(p.mass.sum(), rel=1e-13)
    assert len(left) == round(row.mass / p.mass[0])
    assert s.holds(x, y).all()
    assert total_energy(row) < start + 1e-6 * abs(start)
    assert backend.columns().mass.sum() == pytest.approx(row.mass, rel=1e-12)


@pytest.mark.parametrize("sparse", ["scan", "hash"])
def test_sparse_backends_take_out_the_same_particles_as_the_reference(sparse):
    surface, s = slope()
    (a, row_a), (b, row_b) = (after(loaded(engine_of(name), s, body(surface)), 120) for name in ("reference", sparse))
    np.testing.assert_array_equal(b.identity, a.identity)
    for name in STATE:
        x, y = getattr(a, name), getattr(b, name)
        np.testing.assert_allclose(y, x, rtol=0, atol=1e-9 * max(np.abs(x).max(), 1e-3), err_msg=name)
    assert row_b.escaped_mass == pytest.approx(row_a.escaped_mass, rel=1e-12)
    assert row_a.escaped_mass > 0
    assert row_b.escaped_energy == pytest.approx(row_a.escaped_energy, rel=1e-9)


def test_a_run_goes_on_over_unknown_ground_as_if_it_had_not_been_broken_off(backend):
    surface, s = slope()
    whole, row = after(loaded(backend, s, body(surface)), 120)
    backend.load(s, body(surface))
    after(backend, 60)
    state = {name: np.array(values) for name, values in backend.checkpoint().items()}
    backend.load(s, body(surface))  # another state in between
    backend.restore(s, part({f"x.{name}": values for name, values in state.items()}, "x."))
    again, row_again = after(backend, 60)
    np.testing.assert_array_equal(again.velocity, whole.velocity)
    assert row_again.escaped_mass == row.escaped_mass > 0


def test_scenes_of_a_batch_have_each_their_own_unknown_cells():
    from runout.backends.hash import batch

    surface, s = slope(materials=(HARD,))
    scenes = [replace(s, unknown=None), s, replace(s, unknown=np.roll(holes(), 3, axis=0))]
    together = batch.Batch([(one, body(surface)) for one in scenes], "cpu", True)
    together.advance([DT] * 3, [120] * 3)
    alone = [after(loaded(engine_of("hash", deterministic=True), one, body(surface)), 120)[1] for one in scenes]
    found = [row.escaped_mass for row in together.ledgers()]
    np.testing.assert_allclose(found, [row.escaped_mass for row in alone], rtol=1e-12)
    assert found[0] == 0 < found[1] != found[2]


def test_a_checkpoint_of_other_unknown_cells_is_not_taken_for_that_of_a_run():
    surface, s = slope()
    p = body(surface)
    assert len({run_key(replace(s, unknown=cells), p) for cells in (None, holes(), ~holes())}) == 3


def test_unknown_cells_of_another_raster_are_refused():
    with pytest.raises(ConfigError, match=r"unknown cells have shape \(30, 40\)"):
        replace(scene(plane(), UNIT), unknown=holes().T)
