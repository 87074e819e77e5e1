"""A transfer of several substeps: every backend gives what the reference gives, and the flow what physics says."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import SAND, assert_same, box, engine_of, loaded, plane, scene
from test_same_steps import run
from test_sparse_equals_dense import CASES, CLAY, two_bodies

from runout import Voellmy
from runout.errors import ConfigError
from runout.physics import substeps
from runout.studies.verification_cases.bar import vibration
from runout.studies.verification_cases.flow import TransferLoss

DT = 2e-3


def transfers(engine, a_scene, particles, count, number, dt=DT):
    """State, ledger and columns after ``count`` transfers of ``number`` substeps."""
    loaded(engine, a_scene, particles)
    for _ in range(count):
        engine.step(dt, number)
    return engine.particles(), engine.ledger(), engine.columns()


def slump(surface, spacing=(1.0, 1.0, 1.0)):
    return box((20.0, 30.0, 0.0), (6.0, 4.0, 3.0), spacing, SAND.density, surface=surface)


def test_one_substep_is_a_step():
    surface, spacing = CASES["tilted plane, flat cells"]
    particles = two_bodies(surface, spacing)
    one = scene(surface, spacing, (SAND, CLAY), (0.4, 0.25))
    expected = transfers(engine_of("reference"), one, particles, 20, 1)
    found = transfers(engine_of("reference"), replace(one, substeps=8), particles, 20, 1)
    assert_same(expected, found, 0.0, spacing)


@pytest.mark.parametrize("number", [2, 4, 16])
def test_free_fall_of_a_transfer_is_that_of_its_substeps(number):
    a_scene = scene(materials=(SAND,), substeps=number)
    particles = box((20.0, 30.0, 10.0), (2.0, 2.0, 2.0), a_scene.spacing, SAND.density)
    state, row, _ = transfers(engine_of("reference"), a_scene, particles, 5, number)
    n = 5 * number
    np.testing.assert_allclose(state.velocity, np.tile((0.0, 0.0, -9.81 * n * DT), (len(state), 1)), atol=1e-12)
    fallen = particles.position(np.ones(3)) - state.position(np.ones(3))
    np.testing.assert_allclose(fallen[:, 2], 9.81 * DT**2 * n * (n + 1) / 2, rtol=1e-10)
    np.testing.assert_allclose(state.strain, 0.0, atol=1e-12)
    assert row.mass == pytest.approx(particles.mass.sum(), rel=1e-14)


def test_a_bar_keeps_more_of_its_vibration_with_fewer_transfers():
    """Small steps damp with each transfer (U6): four substeps of the same size lose less than half."""
    lost = [1 - vibration(8, 0.1, periods=3, transfer={"substeps": number}, backend="reference")[1] for number in (1, 4)]
    assert 0 < lost[1] < 0.5 * lost[0]


def test_a_transfer_of_more_substeps_than_the_scene_has_is_refused():
    a_scene = scene(plane(), materials=(SAND,), substeps=4)
    engine = loaded(engine_of("reference"), a_scene, slump(a_scene.surface))
    with pytest.raises(ConfigError, match="a transfer of 5 substeps; the scene has 4 at most"):
        engine.step(DT, 5)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"substeps": 0}, "substeps is 0"),
        ({"substeps": 65}, "substeps is 65"),
        ({"substeps": 2.5}, "whole number"),
        ({"substeps": 4.0}, "whole number"),
        ({"substeps": True}, "substeps is True"),
    ],
)
def test_substeps_that_do_nothing_sensible_are_refused(choices, message):
    with pytest.raises(ConfigError, match=message):
        scene(plane(), **choices)


def test_number_of_substeps_follows_the_speed():
    a_scene = scene(plane(), materials=(SAND,), substeps=4)
    dt = a_scene.stable_step(0.0)
    assert a_scene.substep_count(dt, 0.0) == 1
    assert a_scene.substep_count(dt, 2 * substeps.SLOWEST / dt) == 4
    assert a_scene.substep_count(dt, 0.2 / dt) == 2
    assert a_scene.substep_count(dt, 0.4 / dt) == 1
    assert replace(a_scene, substeps=1).substep_count(dt, 2 * substeps.SLOWEST / dt) == 1


@pytest.fixture(scope="module")
def substepped():
    """Runs of a slide down a ramp with up to four substeps, by backend."""
    return {name: run(name, 4e6, substeps=4) for name in ("reference", "scan", "hash")}


@pytest.mark.parametrize("name", ["scan", "hash"])
def test_a_run_with_substeps_is_that_of_the_reference(substepped, name):
    expected, found = substepped["reference"], substepped[name]
    assert found.steps == expected.steps
    for field in ("max_flow_thickness", "max_speed", "deposit_thickness"):
        scale = np.nanmax(expected.fields[field])
        np.testing.assert_allclose(found.fields[field], expected.fields[field], rtol=0, atol=2e-3 * scale, err_msg=field)


@pytest.mark.parametrize("name", ["reference", "scan", "hash"])
def test_a_run_with_substeps_keeps_mass_and_energy_in_the_ledger(substepped, name):
    """The work of all substeps is booked: what is left for the transfers is a loss, as small as with one substep."""
    lost = []
    for result in (run(name, 4e6), substepped[name]):
        series = result.series
        np.testing.assert_allclose(series["mass"] + series["escaped_mass"], series["mass"][0], rtol=1e-6)
        freed = series["potential_energy"][0] - series["potential_energy"][-1]
        lost.append(series["numerical_dissipation"][-1] / freed)
    assert 0.0 < lost[1] < 1.2 * lost[0] < 0.03


def unexplained(name, friction, number, dt):
    """Shares of the freed potential energy in 0.64 s: what ledger and transfers leave open, the ground's work that is not booked.

    A mass falls on a slope and slides. Reference takes every transfer too, and says what it loses.
    """
    ground = plane(-0.4)
    a_scene = scene(ground, materials=(SAND,), friction=(friction,), substeps=4)
    p = slump(ground)
    p.velocity[:] = (4.0, 0.0, 0.0)
    engine, losses, lost = loaded(engine_of(name), a_scene, p), TransferLoss(), np.zeros(2)
    start = engine.ledger()
    for _ in range(round(0.64 / (number * dt))):
        lost += number * dt * np.array(losses.rates(a_scene, engine.particles(), dt, number))
        engine.step(dt, number)
    end = engine.ledger()
    names = ("potential_energy", "kinetic_energy", "elastic_energy", "basal_dissipation", "plastic_dissipation")
    changes = [getattr(end, one) - getattr(start, one) for one in names]
    return -(sum(changes) + lost.sum()) / -changes[0], lost[1] / -changes[0]


@pytest.mark.parametrize("friction", [0.3, Voellmy(mu=0.2, xi=300.0)], ids=["coulomb", "voellmy"])
@pytest.mark.parametrize("name", ["scan", "hash"])
def test_ledger_closes_with_the_work_of_every_substep(name, friction):
    """Velocities belong to half a step before places: the error of the sum is of first order in the step, whatever the substeps."""
    (one, _), (four, unbooked), (half, _) = (unexplained(name, friction, k, dt) for k, dt in ((1, DT), (4, DT), (4, DT / 2)))
    assert abs(four) < 1.3 * abs(one) < 0.004
    assert abs(half) < 0.65 * abs(four)
    assert abs(unbooked) < 0.002
