"""Drag on mass in flight: closed form, rims, friction of several releases and zones, and parity of all backends."""

import math
from functools import cache

import numpy as np
import pytest
from scenes import SAND, box, engine_of, plane, scene

from runout import Voellmy, VoellmyBase
from runout.backends.protocol import get_backend
from runout.model.friction import FrictionZones
from runout.model.particles import Particles
from runout.physics.contact import covered_share

GRAVITY = 9.81
BACKENDS = pytest.mark.parametrize("name", ["reference", "scan", "hash"])
OTHERS = pytest.mark.parametrize("name", ["scan", "hash"])
DRAG = Voellmy(mu=0.2, xi=300.0)
STRONG = Voellmy(mu=0.3, xi=60.0, forest_drag=0.02)
FAST = (20.0, 5.0, 1.0)
STEP = 5e-3
FALL = np.array([0.0, 0.0, GRAVITY * STEP])  # speed that gravity takes from the upward one in a step


def lifted(corner=(10.0, 30.0, 6.0), size=(12.0, 12.0, 2.0), velocity=FAST):
    """A slab high above a plane at 0 m."""
    p = box(corner, size, (1.0, 1.0, 1.0), SAND.density)
    p.velocity[:] = velocity
    return p


def together(*parts):
    """Particles of several releases, numbered in their order."""
    whole = {name: np.concatenate([getattr(p, name) for p in parts]) for name in vars(parts[0])}
    p = Particles(**whole)
    p.release[:] = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    p.identity[:] = np.arange(len(p))
    return p


def moved(name, p, friction=(DRAG,), steps=4, engine=None, **choices):
    """Particles, by identity, and ledger after some steps."""
    choices = {"surface": plane(), **choices}
    engine = engine or engine_of(name)
    engine.load(scene(materials=(SAND,) * len(friction), friction=friction, **choices), p)
    for _ in range(steps):
        engine.step(STEP)
    found = engine.particles()
    return found.take(np.argsort(found.identity)), engine.ledger()


def in_flight(velocity, thickness, law, steps=4):
    """Velocity (3,) of a wide layer in flight: gravity, then s + k s^2 = s_0 with k = g dt / (xi H) + c dt / H, in each step."""
    v, k = np.array(velocity), STEP / thickness * (GRAVITY / law.xi + law.forest_drag)
    for _ in range(steps):
        v = v - FALL
        speed = np.linalg.norm(v)
        v = v * (math.sqrt(1.0 + 4.0 * k * speed) - 1.0) / (2.0 * k * speed)
    return v


@BACKENDS
@pytest.mark.parametrize("law", [DRAG, STRONG], ids=["xi", "forest"])
def test_layer_in_flight_slows_as_one_on_the_ground(name, law):
    p, _ = moved(name, lifted(), (law,))
    x = p.position(np.ones(3))
    centre = (x[:, :2].max(axis=0) + x[:, :2].min(axis=0)) / 2
    inside = (np.abs(x[:, :2] - centre) < 2.0).all(axis=1)
    np.testing.assert_allclose(p.velocity[inside].mean(axis=0), in_flight(FAST, 2.0, law), rtol=2e-4)


@BACKENDS
def test_no_part_of_a_mass_in_flight_stops_before_the_others(name):
    """The rim has the mass by area of its neighbours: what it loses is at most twice as much, where half a column is covered."""
    p, _ = moved(name, lifted(), (STRONG,), steps=20)
    lost = np.linalg.norm(FAST) - np.linalg.norm(p.velocity + 20 * FALL, axis=1)
    expected = np.linalg.norm(FAST) - np.linalg.norm(in_flight(FAST, 2.0, STRONG, 20) + 20 * FALL)
    assert lost.min() > 0.9 * expected
    assert lost.max() < 2.0 * expected


@BACKENDS
def test_flight_without_drag_over_the_column_is_free(name):
    p, row = moved(name, lifted(), (VoellmyBase(mu=0.2, xi=60.0),))
    np.testing.assert_allclose(p.velocity.mean(axis=0), np.array(FAST) - 4 * FALL, rtol=1e-9)
    assert row.basal_dissipation == 0.0


@BACKENDS
def test_flight_without_ground_is_free(name):
    p, _ = moved(name, lifted(), (STRONG,), surface=None)
    np.testing.assert_allclose(p.velocity.mean(axis=0), np.array(FAST) - 4 * FALL, rtol=1e-9)


@BACKENDS
def test_ledger_books_what_flight_loses(name):
    start = lifted()
    p, row = moved(name, start, steps=1)
    lost = (p.mass[:, None] * (p.velocity - start.velocity)).sum(axis=0) + p.mass.sum() * FALL
    np.testing.assert_allclose(row.basal_impulse, lost, rtol=1e-6)
    assert row.basal_dissipation == pytest.approx(-(lost @ FAST), rel=0.01)


@BACKENDS
def test_releases_far_apart_take_their_own_friction(name):
    """Each moves as if it were alone, whatever the friction of the other."""
    near, far = lifted((6.0, 6.0, 6.0), (5.0, 5.0, 2.0)), lifted((30.0, 60.0, 6.0), (5.0, 5.0, 2.0))
    p, _ = moved(name, together(near, far), (DRAG, STRONG))
    for part, law, release in ((near, DRAG, 0), (far, STRONG, 1)):
        alone, _ = moved(name, part, (law,))
        np.testing.assert_allclose(p.velocity[p.release == release], alone.velocity, rtol=1e-10)


@BACKENDS
def test_zone_below_sets_the_friction(name):
    """A zone of half of xi north of 30 m; each half moves as over ground of its own."""
    whole = np.zeros((40, 30))
    north = np.arange(30) * 2.5 >= 30.0
    kept, own = np.where(north, 0.0, 1.0) + whole, np.where(north, 1.0 / 150.0, 0.0) + whole
    zones = FrictionZones(np.ones((40, 30)), whole, (2.0, 2.5), replaced={"inverse_xi": (kept, own)})
    p = together(lifted((8.0, 5.0, 6.0), (5.0, 5.0, 2.0)), lifted((8.0, 50.0, 6.0), (5.0, 5.0, 2.0)))
    p.release[:] = 0
    found, _ = moved(name, p, friction_zones=zones)
    south = found.position(np.ones(3))[:, 1] < 30.0
    for mask, law in ((south, DRAG), (~south, Voellmy(mu=0.2, xi=150.0))):
        alone, _ = moved(name, p, (law,))
        np.testing.assert_allclose(found.velocity[mask], alone.velocity[mask], rtol=1e-10)


def spray():
    """Two masses that break up over a slope, and mix."""
    rng = np.random.default_rng(5)
    p = together(lifted((10.0, 30.0, 2.0), (6.0, 6.0, 2.0)), lifted((15.0, 33.0, 1.0), (5.0, 5.0, 3.0), (12.0, 0.0, -2.0)))
    p.velocity[:] += rng.normal(scale=4.0, size=p.velocity.shape)
    return p


@cache
def sprayed(name, friction):
    """Particles and ledger of the spray after 40 steps; of the reference once for all backends."""
    return moved(name, spray(), friction, 40, surface=plane(-0.4, 0.1, 2.0))


@OTHERS
@pytest.mark.parametrize("friction", [(DRAG, DRAG), (DRAG, STRONG)], ids=["alike", "mixed"])
def test_backends_move_a_spray_alike(name, friction):
    expected, book = sprayed("reference", friction)
    found, other = sprayed(name, friction)
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=1e-9 * np.abs(expected.velocity).max())
    assert other.basal_dissipation == pytest.approx(book.basal_dissipation, rel=1e-9)
    np.testing.assert_allclose(other.basal_impulse, book.basal_impulse, rtol=1e-8)


@pytest.mark.parametrize("ordered", [False, True])
def test_hash_slows_a_spray_over_zones(ordered):
    whole = np.zeros((40, 30))
    north = np.arange(30) * 2.5 >= 33.0
    kept, own = np.where(north, 0.0, 1.0) + whole, np.where(north, 1.0 / 60.0, 0.0) + whole
    zones = FrictionZones(np.ones((40, 30)), whole, (2.0, 2.5), replaced={"inverse_xi": (kept, own)})
    choices = {"surface": plane(-0.4, 0.1, 2.0), "friction_zones": zones}
    expected, book = moved("reference", spray(), (DRAG, STRONG), 20, **choices)
    engine = engine_of("hash", deterministic=ordered)
    found, other = moved("hash", spray(), (DRAG, STRONG), 20, engine, **choices)
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=1e-9 * np.abs(expected.velocity).max())
    assert other.basal_dissipation == pytest.approx(book.basal_dissipation, rel=1e-9)


def test_bits_of_mixed_releases_do_not_depend_on_the_number_of_threads():
    one, two = (get_backend("scan", threads=threads) for threads in (1, 2))
    two.workers.divide = lambda particles: setattr(two.workers, "threads", 2)  # however few the particles are
    friction, surface = (DRAG, STRONG), plane(-0.4, 0.1, 2.0)
    (a, _), (b, _) = (moved("scan", spray(), friction, 20, engine, surface=surface) for engine in (one, two))
    assert two.threads == 2
    np.testing.assert_array_equal(a.velocity, b.velocity)


def test_a_usual_column_covers_its_ground_and_a_light_one_a_part():
    assert covered_share(3.0, 27.0, 81.0) == 1.0  # all alike
    assert covered_share(1.0, 1.0, 1.0) == 1.0  # alone
    light = covered_share(0.3, 8 * 3.0 + 0.3, 8 * 9.0 + 0.09)
    assert light == pytest.approx(2 * 0.3 / 3.0, rel=0.02)
    assert covered_share(0.15, 8 * 3.0 + 0.15, 8 * 9.0 + 0.0225) == pytest.approx(light / 2, rel=0.01)
