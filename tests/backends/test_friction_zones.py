"""Zones of the ground: friction that the mass meets there, in the right place, and alike on every backend that has them."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import GRAVITY, HARD, SAND, assert_close_states, at, engine_of, loaded, plane, scene
from test_sparse_equals_dense import CASES, CLAY, run, two_bodies

from runout.backends.protocol import get_backend
from runout.errors import ConfigError
from runout.model.friction import FrictionZones
from runout.simulation.checkpoint import run_key

UNIT = (1.0, 1.0, 1.0)
CELLS = (40, 30)
SIZE = (2.0, 2.5)  # of the cells of the raster of all scenes here


def zones(factor=1.0, coefficient=0.0, where=None):
    """Zones on the cells ``where`` (nx, ny) is true, all by default."""
    inside = np.ones(CELLS, bool) if where is None else where
    return FrictionZones(np.where(inside, factor, 1.0), np.where(inside, coefficient, 0.0), SIZE)


def slid(backend, places, friction, found, steps=40):
    """Speeds (n,) [m/s] of single particles that start at rest on a plane of slope 0.8 that falls to the east."""
    surface = plane(-0.8, 0.0, 60.0)
    x = np.array(places, float)
    up = 0.25 * np.hypot(1.0, 0.8)
    p = at(np.column_stack([x, surface.elevation(x[:, 0], x[:, 1]) + up]), UNIT)
    p.radius[:] = 0.25
    loaded(backend, scene(surface, materials=(HARD,), friction=(friction,), friction_zones=found), p)
    for _ in range(steps):
        backend.step(5e-3)
    return np.linalg.norm(backend.particles().velocity, axis=1)


@pytest.mark.parametrize(("found", "same_as"), [(zones(factor=1.5), 1.5 * 0.4), (zones(factor=0.0, coefficient=0.3), 0.3)])
def test_a_zone_multiplies_or_replaces_the_friction_of_the_mass(backend, found, same_as):
    places = [(20.3, 20.4), (41.0, 50.2)]
    np.testing.assert_array_equal(slid(backend, places, 0.4, found), slid(backend, places, same_as, None))


def test_only_the_cells_of_a_zone_count_wherever_they_lie(backend):
    """One cell of an oblong raster: from 24 to 26 m east and 55 to 57.5 m north."""
    where = np.zeros(CELLS, bool)
    where[12, 22] = True
    places = [(24.3, 56.0), (23.2, 56.0), (24.3, 54.0), (24.3, 58.5), (55.0, 24.3)]  # in it, west, south, north, swapped
    found = zones(0.0, 0.5, where)
    speed = [slid(backend, [place], 0.3, found, steps=20)[0] for place in places]  # alone: no nodes are shared
    angle = np.arctan(0.8)
    free, slowed = (GRAVITY * (np.sin(angle) - mu * np.cos(angle)) * 0.1 for mu in (0.3, 0.5))
    np.testing.assert_allclose(speed, [slowed, free, free, free, free], rtol=1e-10)


def test_a_mass_that_enters_rough_ground_comes_to_rest_there_where_energy_says(backend):
    """Friction 0.2 for the first metres on a slope of 0.3, then 1.0: all work is the friction's."""
    surface, edge = plane(-0.3, 0.0, 40.0), 26.0
    where = np.arange(CELLS[0])[:, None] * SIZE[0] + 0.0 * np.arange(CELLS[1]) >= edge
    p = at([(22.0, 30.3, surface.elevation(22.0, 30.3) + 0.25 * np.hypot(1.0, 0.3))], UNIT)
    p.radius[:] = 0.25
    p.velocity[:] = 3.0 * np.array([1.0, 0.0, -0.3]) / np.hypot(1.0, 0.3)
    loaded(backend, scene(surface, materials=(HARD,), friction=(0.2,), friction_zones=zones(0.0, 1.0, where)), p)
    for _ in range(1500):
        backend.step(2e-3)
    east, cos = float(backend.particles().position(np.ones(3))[0, 0]), 1.0 / np.hypot(1.0, 0.3)
    before = 0.5 * 3.0**2 + GRAVITY * (0.3 - 0.2) * (edge - 22.0)  # energy at the edge [J/kg]; slopes and friction by plan distance
    assert east == pytest.approx(edge + before / (GRAVITY * (1.0 - 0.3)), abs=0.01)
    assert np.linalg.norm(backend.particles().velocity) < 1e-9
    assert backend.ledger().basal_impulse[2] == pytest.approx(p.mass[0] * (GRAVITY * 3.0 + 3.0 * 0.3 * cos), rel=1e-6)


def random_zones(seed=4):
    rng = np.random.default_rng(seed)
    return FrictionZones(rng.uniform(0.0, 2.0, CELLS), rng.uniform(0.0, 0.3, CELLS), SIZE)


@pytest.mark.parametrize(("steps", "tolerance"), [(1, 1e-13), (100, 1e-10)])
@pytest.mark.parametrize("sparse", ["scan", "hash"])
def test_sparse_backends_equal_the_reference_in_zones(sparse, steps, tolerance):
    surface, spacing = CASES["bowl"]
    p = two_bodies(surface, spacing)
    s = scene(surface, spacing, (SAND, CLAY), (0.4, 0.25), friction_zones=random_zones(), strength=(0.45, 0.3))
    engines = [engine_of(name) for name in ("reference", sparse)]
    (a, row_a, _), (b, row_b, _) = (run(one, s, p, steps, 2e-3) for one in engines)
    assert_close_states(a, b, tolerance)
    assert row_b.basal_dissipation == pytest.approx(row_a.basal_dissipation, abs=20 * tolerance * row_a.kinetic_energy)
    assert row_b.contact_particles == row_a.contact_particles > 0


def test_zones_that_change_nothing_change_no_bit():
    surface, spacing = CASES["bowl"]
    s, p = scene(surface, spacing, (SAND, CLAY), (0.4, 0.25)), two_bodies(surface, spacing)
    (a, *_), (b, *_) = (run(get_backend("scan", threads=1), one, p, 30, 2e-3) for one in (s, replace(s, friction_zones=zones())))
    np.testing.assert_array_equal(a.velocity, b.velocity)


def test_a_checkpoint_of_other_zones_is_not_taken_for_that_of_a_run():
    s, p = scene(plane()), at([(20.0, 20.0, 1.0)], UNIT)
    keys = {run_key(replace(s, friction_zones=found), p) for found in (None, zones(1.5), zones(1.6), zones(1.5, 0.1))}
    assert len(keys) == 4


def test_zones_of_another_raster_and_negative_ones_are_refused():
    with pytest.raises(ConfigError, match="read them on the same terrain"):
        scene(plane(), friction_zones=FrictionZones(np.ones((30, 40)), np.zeros((30, 40)), SIZE))
    with pytest.raises(ConfigError, match=r"factor of a friction zone is -0.5; .* 0 or more"):
        zones(factor=-0.5)
    with pytest.raises(ConfigError, match="coefficient"):
        zones(coefficient=np.nan)
