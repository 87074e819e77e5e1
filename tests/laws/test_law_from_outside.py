"""A law in another package: its flow curve, what it admits, one source for all backends, a run."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import quadratic_flow
from callers import plain, through_numba, through_warp
from hypothesis import given, settings
from hypothesis import strategies as st
from parity_cases import law_cases
from quadratic_flow import QuadraticFlow
from scenes import box, engine_of, plane, scene

from runout.errors import StabilityError
from runout.model.laws import LAWS
from runout.physics import elastic

LAW = LAWS.find("quadratic_flow")
MUD = QuadraticFlow(density=1800.0, youngs_modulus=5e6, yield_stress=2e3, viscosity=500.0, collisions=20.0)


def record(material, dt=1e-3):
    return SimpleNamespace(**material.record() | {"time_step": dt})


def shear_stress(h, mat):
    return elastic.deviatoric_stress(h, mat) / math.sqrt(3.0)


@pytest.mark.parametrize("rate", [0.01, 1.0, 30.0])
def test_steady_shear_has_the_stress_of_the_flow_curve(rate):
    dt = min(1e-3, 1e-3 / rate)
    mat, B, history = record(MUD, dt), elastic.strain_of_log((-1e-3, -1e-3, -1e-3, 0.0, 0.0, 0.0)), 0.0
    for _ in range(int(0.3 / (rate * dt))):  # far beyond the elastic strain, which is at most 0.02
        B, h, history, lost = LAW.step(B, (0.0, rate * dt, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), history, mat)
    expected = 2e3 + 500.0 * rate + 20.0 * rate * rate
    assert shear_stress(h, mat) == pytest.approx(expected, rel=1e-2)
    assert lost == pytest.approx(expected * rate * dt, rel=0.02)


strains = st.tuples(*[st.floats(-0.02, 0.02)] * 6)


@settings(max_examples=200)
@given(strains, st.floats(0.0, 0.02), st.floats(1.0, 1e5), st.floats(0.0, 1e4), st.floats(0.0, 1e3))
def test_what_is_left_is_admissible_and_nothing_is_gained(h, history, yield_stress, viscosity, collisions):
    mat = record(replace(MUD, yield_stress=yield_stress, viscosity=viscosity, collisions=collisions))
    new, left, lost = quadratic_flow.update(h, history, mat)
    s, trial = shear_stress(new, mat), shear_stress(h, mat)
    assert s <= trial * (1 + 1e-9)
    assert s <= yield_stress * (1 + 1e-9) or (s < trial and viscosity + collisions > 0)
    assert elastic.pressure(new, mat) >= -1e-9
    assert left >= 0.0
    assert lost >= -1e-9 * elastic.energy_density(h, mat)


@pytest.mark.parametrize("compiled", [through_numba, through_warp])
@pytest.mark.parametrize("case", law_cases(LAW), ids=lambda case: case.name)
def test_compilers_read_the_law_as_plain_python_does(case, compiled):
    arguments = case.sample()
    expected = plain(case, arguments)
    np.testing.assert_allclose(compiled(case, arguments, np.float64), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["scan", "hash"])
def test_backends_move_a_slab_of_mud_alike(name):
    def moved(engine):
        a_scene = scene(plane(-0.4, 0.0, 30.0), materials=(MUD,), friction=(0.3,), precision="float64", substeps=1)
        engine.load(a_scene, box((40.0, 36.0, 0.0), (4.0, 3.0, 2.0), (1.0, 1.0, 1.0), MUD.density, surface=a_scene.surface))
        for _ in range(100):
            engine.step(2e-3)
        return engine.particles()

    expected, found = moved(engine_of("reference")), moved(engine_of(name))
    order = np.argsort(found.identity)
    speed = np.linalg.norm(expected.velocity, axis=1).max()
    assert speed > 0.1
    np.testing.assert_allclose(found.velocity[order], expected.velocity, atol=1e-2 * speed)
    np.testing.assert_allclose(found.strain[order], expected.strain, atol=1e-2 * np.abs(expected.strain).max())


def test_steps_keep_to_the_courant_number_of_a_law():
    class Brittle(QuadraticFlow):
        largest_cfl = 0.2

    quick, slow = (scene(materials=(m,)) for m in (MUD, Brittle(**{p.name: getattr(MUD, p.name) for p in LAW.parameters})))
    assert slow.stable_step(0.0) == pytest.approx(quick.stable_step(0.0) * 0.2 / quick.cfl)
    with pytest.raises(StabilityError, match=r"0\.2 cells of 1 m"):
        slow.require_stable(quick.stable_step(0.0), 0.0, 1)
