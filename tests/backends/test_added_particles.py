"""Particles that join a running backend, and a ground that is lowered meanwhile."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import SAND, assert_close_states, box, engine_of, plane, scene

from runout import PorePressure
from runout.backends.protocol import BACKENDS
from runout.model.particles import Particles

SPACING = (1.0, 1.0, 1.0)
EACH = pytest.mark.parametrize("name", BACKENDS)
OTHERS = pytest.mark.parametrize("name", [name for name in BACKENDS if name != "reference"])
DT = 2e-3


def sloped(**choices):
    """A slope whose ground may be lowered."""
    a_scene = scene(plane(-0.3), materials=(SAND,), **choices)
    return replace(a_scene, surface=a_scene.ground.with_room((0, 0), (80, 80)))


def mass(corner=(20.0, 30.0, 0.0), size=(5.0, 6.0, 2.0), first=0, speed=0.0):
    """A box on the slope; its numbers begin with ``first``."""
    p = box(corner, size, SPACING, SAND.density, surface=plane(-0.3))
    p.identity += first
    p.velocity[:] = (speed, 0.0, -0.3 * speed)
    return p


def in_motion(p, seed=7):
    """The same with numbers in all arrays."""
    rng = np.random.default_rng(seed)
    for name, scale in {"velocity": 0.3, "affine": 0.1, "strain": 1e-5, "ground_force": 10.0}.items():
        getattr(p, name)[:] += rng.normal(0.0, scale, getattr(p, name).shape)
    return p


def running(engine, a_scene, particles, steps, substeps=1, dt=DT):
    """The engine after some steps."""
    engine.load(a_scene, particles)
    return go_on(engine, steps, substeps, dt)


def go_on(engine, steps, substeps=1, dt=DT):
    for _ in range(steps):
        engine.step(dt, substeps)
    return engine


@EACH
def test_others_keep_every_bit_and_sums_go_on(name):
    engine, more = engine_of(name), in_motion(mass((24.0, 33.0, 1.5), (4.0, 4.0, 1.0), 10_000))
    running(engine, sloped(), mass(speed=2.0), 20)
    before, row, counters = engine.particles(), engine.ledger(), vars(engine.counters).copy()
    engine.add(more)
    after, now = engine.particles(), engine.ledger()
    assert after.identity.tolist() == [*before.identity, *more.identity]
    old, new = slice(0, len(before)), slice(len(before), None)
    for field, values in vars(before).items():
        if name == "hash" and field in ("affine", "velocity"):  # for now it packs all records anew
            np.testing.assert_allclose(getattr(after, field)[old], values, rtol=1e-12, atol=1e-12, err_msg=field)
        else:
            np.testing.assert_array_equal(getattr(after, field)[old], values, err_msg=field)
    for field, values in vars(more).items():
        np.testing.assert_allclose(getattr(after, field)[new], values, rtol=1e-12, atol=1e-12, err_msg=field)
    assert now.mass == pytest.approx(row.mass + more.mass.sum(), rel=1e-14)
    for field in ("escaped_mass", "basal_dissipation", "plastic_dissipation", "escaped_energy", "contact_particles"):
        assert getattr(now, field) == pytest.approx(getattr(row, field), rel=1e-14), field
    np.testing.assert_allclose(now.basal_impulse, row.basal_impulse, rtol=1e-14)
    assert row.basal_dissipation > 0.0
    assert engine.max_speed == pytest.approx(np.linalg.norm(after.velocity, axis=1).max(), rel=1e-6)
    for field in ("steps", "transfers", "particle_steps"):
        assert getattr(engine.counters, field) == counters[field], field
    columns = engine.columns()
    assert columns.mass.sum() == pytest.approx(now.mass, rel=1e-12)


def wall():
    """A wall north of the slope's mass."""
    from runout.backends.scan.warm_up import side_wall

    return replace(side_wall(), origin=(16.0, 26.0, -16.0))


CASES = {
    "plain": {},
    "wet": {"pore_pressure": (PorePressure(ratio=0.5, decay_time=1.0),)},
    "two materials": {"materials": (SAND, replace(SAND, density=2100.0, friction_angle=35.0)), "friction": (0.5, 0.3)},
    "substeps": {"substeps": 3},
    "structures": {"structures": wall()},
}


def scene_of(case):
    """Scene of a case, and how many substeps its transfers have."""
    choices = CASES[case]
    a_scene = scene(plane(-0.3), **{"materials": (SAND,), **choices})
    return replace(a_scene, surface=a_scene.ground.with_room((0, 0), (80, 80))), choices.get("substeps", 1)


def both_of(case):
    """Mass of the start, and mass that joins."""
    early, late = mass(speed=1.0), in_motion(mass((23.0, 32.0, 2.0), (4.0, 4.0, 1.0), 10_000, 2.0))
    for p, ratio in ((early, 0.5), (late, 0.8)):
        if case == "wet":
            p.pore_excess[:], p.pore_left[:] = ratio, 1.0
    if case == "two materials":
        late.release[:] = 1
        late.mass[:] *= 2100.0 / SAND.density
    late.radius[:] *= 1.2
    return early, late


def state_of(engine):
    return engine.particles(), engine.ledger(), engine.structure_impulses()


def assert_near(expected, found, tolerance):
    """States and rows after the same steps."""
    (p, row, impulses), (q, other, pushes) = expected, found
    np.testing.assert_array_equal(q.identity, p.identity)
    assert_close_states(p, q, tolerance, SPACING)
    np.testing.assert_allclose(q.pore_left, p.pore_left, rtol=0, atol=1e-9)
    for field in ("mass", "kinetic_energy", "basal_dissipation", "plastic_dissipation", "structure_dissipation"):
        x = getattr(row, field)
        assert getattr(other, field) == pytest.approx(x, rel=1e-6, abs=1e-6 * row.kinetic_energy), field
    np.testing.assert_allclose(pushes, impulses, rtol=1e-6, atol=1e-6)


@EACH
@pytest.mark.parametrize("case", CASES)
def test_particles_that_join_at_the_start_are_as_good_as_loaded(name, case):
    (a_scene, substeps), (early, late) = scene_of(case), both_of(case)
    whole, joined = engine_of(name), engine_of(name)
    running(whole, a_scene, early.joined(late), 12, substeps)
    joined.load(a_scene, early)
    joined.add(late)
    go_on(joined, 12, substeps)
    if case == "structures":
        assert np.abs(whole.structure_impulses()).max() > 0.0
    assert_near(state_of(whole), state_of(joined), 1e-9)


@OTHERS
@pytest.mark.parametrize("case", CASES)
def test_particles_that_join_later_move_as_on_the_reference(name, case):
    expected, found = (in_turn(engine_of(each), case, [0, 9, 18]) for each in ("reference", name))
    assert_near(expected, found, 1e-8)


def in_turn(engine, case, times):
    """State after mass has joined and the ground has been lowered after some numbers of steps."""
    (a_scene, substeps), (early, late) = scene_of(case), both_of(case)
    engine.load(a_scene, early)
    for turn, _ in enumerate(times):
        part = late.take(slice(turn, None, len(times)))
        engine.lower((21 + turn, 30), np.full((3, 4), 0.05))
        engine.add(part)
        go_on(engine, 9, substeps)
    return state_of(engine)


@EACH
def test_particles_join_an_empty_run(name):
    (a_scene, _), (early, _) = scene_of("plain"), both_of("plain")
    engine, whole = engine_of(name), engine_of(name)
    engine.load(a_scene, Particles.zeros(0))
    engine.step(DT)
    engine.add(early)
    go_on(engine, 8)
    running(whole, a_scene, early, 8)
    assert_near(state_of(whole), state_of(engine), 1e-9)
    assert engine.counters.transfers == 9


@EACH
def test_ground_that_is_lowered_is_as_good_as_one_that_was_low(name):
    """The gap of every particle grows by what the ground falls."""
    low, fallen = sloped(), sloped()
    low.ground.lower((20, 30), np.full((8, 9), 0.2))
    expected = running(engine_of(name), low, mass(), 30)
    engine = engine_of(name)
    engine.load(fallen, mass())
    engine.lower((20, 30), np.full((5, 9), 0.2))
    engine.lower((25, 30), np.full((3, 9), 0.2))
    go_on(engine, 30)
    np.testing.assert_allclose(fallen.ground.change, low.ground.change, atol=1e-15)
    assert_near(state_of(expected), state_of(engine), 1e-10)
    assert engine.ledger().contact_particles == expected.ledger().contact_particles
