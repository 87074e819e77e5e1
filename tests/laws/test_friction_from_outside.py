"""Friction that falls with the speed, and a law of another package with drag: closed forms, compilers, zones, limits."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from callers import plain, through_numba, through_warp
from drag_by_load import DragByLoad
from hypothesis import given, settings
from hypothesis import strategies as st
from parity_cases import law_cases
from scenes import ROCK, SAND, box, engine_of, plane, scene
from sliding_block import DT, GRAVITY, SLOPE, block, speed_of_rigid_block

from runout import FrictionZones, VelocityWeakening
from runout.errors import ConfigError
from runout.model.basal_friction import MassAbove
from runout.model.friction_laws import FRICTIONS
from runout.physics import contact

LAWS = [FRICTIONS.find(name) for name in ("velocity_weakening", "drag_by_load")]
WEAK = VelocityWeakening(static_friction=0.4, dynamic_friction=0.1, weakening_speed=0.5)
DRAG = DragByLoad(friction=0.2, drag=0.04)
LONG = pytest.mark.parametrize("name", ["scan", "hash"])  # the slab over zones compares them with the reference


def weakened(v):
    return 0.1 + 0.3 / (1.0 + v / 0.5)


@LONG
def test_block_runs_away_as_its_friction_weakens(name):
    """Half as fast with the friction at rest alone, 1.4 times as fast with that of high speed alone."""
    found, _ = block(engine_of(name), WEAK, 1.2, friction_zones=zones())
    assert found == pytest.approx(speed_of_rigid_block(weakened, 1.2), rel=0.02)
    assert speed_of_rigid_block(lambda v: 0.4, 1.2) < 0.5 * found


@LONG
def test_block_with_drag_comes_to_its_terminal_speed(name):
    a = GRAVITY * (math.sin(SLOPE) - 0.2 * math.cos(SLOPE))
    most = math.sqrt(a / (0.04 * GRAVITY * math.cos(SLOPE)))
    for time in (0.5, 2.0):
        found, engine = block(engine_of(name), DRAG, time, friction_zones=zones())
        assert found == pytest.approx(most * math.tanh(a * time / most), rel=0.01)
    assert engine.ledger().basal_dissipation > 0.0


def test_block_below_its_friction_at_rest_stays_there():
    """It shears by 2 mm and vibrates; with the coefficient 0.4 it would slide 0.3 m."""
    speed, engine = block(engine_of("scan"), replace(WEAK, static_friction=0.6), 1.0, friction_zones=zones())
    assert abs(engine.particles().position(np.ones(3))[:, 0].mean() - 7.5) < 5e-3
    assert abs(speed) < 0.02


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize("compiled", [through_numba, through_warp])
def test_compilers_read_a_law_as_plain_python_does(law, compiled):
    for case in law_cases(law):
        arguments = case.sample()
        expected = plain(case, arguments)
        np.testing.assert_allclose(compiled(case, arguments, np.float64), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


def zones(factor=1.0, **replaced):
    """Zones on the raster of :func:`scenes.scene`: the western part of the ground."""
    where = np.zeros((40, 30))
    where[:6], where[6] = 1.0, 0.4
    own = {name: (1.0 - where, where * value) for name, value in replaced.items()}
    return FrictionZones(1.0 + where * (factor - 1.0), np.zeros((40, 30)), (2.0, 2.5), source="test", replaced=own)


@cache
def slab_over_zones(name, friction):
    """Particles of a slab that has slid over zones; of the reference once for all backends."""
    ground = {"dynamic_friction": 0.3} if friction is WEAK else {"drag": 0.4}
    choices = {"friction_zones": zones(1.2, **ground), "strength": (0.5,), "precision": "float64"}
    a_scene, engine = scene(plane(-0.4, 0.0, 30.0), materials=(SAND,), friction=(friction,), **choices), engine_of(name)
    p = box((8.0, 36.0, 0.0), (6.0, 3.0, 2.0), (1.0, 1.0, 1.0), SAND.density, surface=a_scene.surface)
    p.velocity[:, 0] = 1.0
    engine.load(a_scene, p)
    for _ in range(60):
        engine.step(DT)
    return engine.particles()


@pytest.mark.parametrize("name", ["scan", "hash"])
@pytest.mark.parametrize("friction", [WEAK, DRAG], ids=["weakening", "drag"])
def test_backends_move_a_slab_over_zones_alike(name, friction):
    expected, found = slab_over_zones("reference", friction), slab_over_zones(name, friction)
    order = np.argsort(found.identity)
    np.testing.assert_allclose(found.velocity[order], expected.velocity, atol=1e-8 * np.abs(expected.velocity).max())


def test_a_law_that_drags_columns_uses_the_area_without_saying_so():
    """Columns are found with the areas of their contacts."""

    class OverColumns(type(DRAG)):
        drags_column = True

    assert OverColumns.uses_area
    assert not type(DRAG).uses_area


def test_zones_change_what_they_name():
    west, rim, east = (np.array([x]) for x in (5.0, 13.0, 40.0))
    a_scene = scene(plane(), friction=(WEAK,), friction_zones=zones(2.0, weakening_speed=2.0))
    table = a_scene.basal.table()
    rows = [table[a_scene.basal.rows(np.zeros(1, int), x, np.array([20.0]))[0]] for x in (west, rim, east)]
    assert [r["static_friction"] for r in rows] == pytest.approx([0.8, 0.56, 0.4])
    assert [r["dynamic_friction"] for r in rows] == pytest.approx([0.2, 0.14, 0.1])
    assert [r["weakening_speed"] for r in rows] == pytest.approx([2.0, 1.1, 0.5])
    assert zones(0.5).least_angle(WEAK) == pytest.approx(math.atan(0.05))


def test_zones_of_another_law_are_refused():
    angle = FrictionZones(np.ones((40, 30)), np.full((40, 30), 0.5), (2.0, 2.5), source="zones.gpkg")
    with pytest.raises(ConfigError, match=r"zones\.gpkg: a zone states a friction angle, and friction law velocity_weakening"):
        scene(plane(), friction=(WEAK,), friction_zones=angle)
    with pytest.raises(ConfigError, match="a zone replaces drag, and friction law velocity_weakening has static_friction"):
        scene(plane(), friction=(WEAK,), friction_zones=zones(drag=0.1))
    with pytest.raises(ConfigError, match="a zone replaces drag, and friction law coulomb has friction, and friction law velocity"):
        scene(plane(), materials=(ROCK, ROCK), friction=(0.3, WEAK), friction_zones=zones(drag=0.1))


def test_resistance_is_at_most_what_the_mass_passes_on():
    law = FRICTIONS.find("velocity_weakening")
    record = law.example.acting(law.example.numbers(), MassAbove(0.5, 2000.0, 9.81))
    assert "strength" in law.fields
    steady, drag = law.at_base(10.0, 0.1, 1.0, 1e-3, type("record", (), record))
    assert (steady, drag) == (5.0, 0.0)
    assert law.at_base(10.0, 1e9, 1.0, 1e-3, type("record", (), record))[0] == pytest.approx(1.1)


@settings(max_examples=200)
@given(st.floats(1e-3, 50.0), st.floats(0.0, 1e6))
def test_drag_slows_down_and_never_reverses(free, resistance):
    left = contact.slip_after(free, resistance)
    assert 0.0 <= left <= free
    assert left + resistance * left * left == pytest.approx(free)
