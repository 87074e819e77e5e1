"""Cohesion that softens: the line from peak to residual, brittle steps, tension, cells."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_point import pressed, record, sheared
from scenes import plane, scene

from runout.errors import MaterialError
from runout.materials import cohesion_softening, drucker_prager
from runout.materials.cohesion_softening import CohesionSoftening
from runout.materials.drucker_prager import DruckerPrager
from runout.model.laws import LAWS
from runout.physics import elastic

LAW = LAWS.find("cohesion_softening")
SOIL = CohesionSoftening(
    density=1900.0, youngs_modulus=2e7, friction_angle=25.0, cohesion=10e3, residual_cohesion=2e3, softening_slip=0.1
)
PRESSURE = 50e3


def strength(mat, cohesion, p=PRESSURE):
    """q [Pa] at yield for a cohesion [Pa]."""
    return mat.cone_slope * p + mat.cone_intercept * cohesion / 10e3


@pytest.mark.parametrize("cell", [0.5, 2.0])
def test_cohesion_falls_in_a_line_with_the_slip_whatever_the_cell(cell):
    mat = record(SOIL, cell_size=cell)
    states = sheared(SOIL, mat, pressed(mat, PRESSURE), 0.3 / cell, 3000)
    q = np.array([elastic.deviatoric_stress(h, mat) for h, _, _ in states])
    assert q.max() == pytest.approx(strength(mat, 10e3), rel=1e-3)
    assert q[-1] == pytest.approx(strength(mat, 2e3), rel=1e-6)
    slip = np.arange(1, 3001) * 1e-4 - q / (math.sqrt(3.0) * mat.shear_modulus) * cell  # plastic, across a cell
    half = int(np.argmin(np.abs(slip - 0.05)))
    assert q[half] == pytest.approx(strength(mat, 6e3), rel=2e-3)
    assert states[half][1] == pytest.approx(-0.5, abs=0.01)
    assert states[-1][1] > 0.0


def test_the_energy_of_softening_is_that_of_the_line():
    mat = record(SOIL, cell_size=1.0)
    states = sheared(SOIL, mat, pressed(mat, PRESSURE), 0.2, 4000)
    lost = sum(state[2] for state in states)
    peak, residual = (strength(mat, c) / math.sqrt(3.0) for c in (10e3, 2e3))
    assert lost == pytest.approx(0.1 * (peak + residual) / 2 + (0.1 - residual / mat.shear_modulus) * residual, rel=3e-3)


def test_a_step_across_the_whole_softening_ends_at_the_residual():
    brittle = record(replace(SOIL, softening_slip=1e-4), cell_size=5.0)
    h, history, _ = sheared(SOIL, brittle, pressed(brittle, PRESSURE), 0.1, 10)[-1]
    assert elastic.deviatoric_stress(h, brittle) == pytest.approx(strength(brittle, 2e3), rel=1e-6)
    assert history > 0.0


def test_before_it_yields_and_without_loss_it_is_drucker_prager():
    plain = DruckerPrager(density=1900.0, youngs_modulus=2e7, friction_angle=25.0, cohesion=10e3)
    lasting = replace(SOIL, residual_cohesion=10e3)
    mats = record(lasting), record(plain)
    both = [sheared(m, mat, pressed(mat, PRESSURE), 0.1, 200) for m, mat in zip((lasting, plain), mats, strict=True)]
    for (h, _, lost), (expected, _, work) in zip(*both, strict=True):
        np.testing.assert_allclose(h, expected, rtol=1e-12, atol=1e-18)
        assert lost == pytest.approx(work, abs=1e-9)


def test_what_comes_apart_has_lost_its_bonds_and_must_close_up():
    mat = record(SOIL)
    new, history, _ = cohesion_softening.update((5e-3, 5e-3, 5e-3, 0.0, 0.0, 0.0), 0.0, mat, 1.0)
    apex = drucker_prager.apex(mat.residual_intercept, mat.cone_slope, mat)
    assert new == apex
    assert history == pytest.approx(15e-3 - 3 * apex[0])
    closing = (apex[0] - 1e-3,) * 3 + (0.0, 0.0, 0.0)
    new, left, _ = cohesion_softening.update(closing, history, mat, 1.0)
    assert new == apex
    assert left == pytest.approx(history - 3e-3)


@given(st.tuples(*[st.floats(-0.02, 0.02)] * 6), st.floats(-1.0, 0.02), st.floats(0.1, 10.0))
def test_what_is_left_is_admissible_and_softening_never_heals(h, history, cell):
    mat = record(SOIL, cell_size=cell)
    new, left, _ = cohesion_softening.update(h, history, mat, 1.0)
    part = 1.0 if left > 0 else -left
    assert part >= min(1.0, -history if history <= 0 else 1.0)
    intercept = mat.cone_intercept + part * (mat.residual_intercept - mat.cone_intercept)
    excess = elastic.deviatoric_stress(new, mat) - mat.cone_slope * elastic.pressure(new, mat) - intercept
    assert excess <= 1e-9 * (mat.cone_intercept + abs(elastic.pressure(new, mat)))


def test_backends_give_the_law_the_cell_of_the_scene():
    a_scene = scene(plane(-0.4, 0.0, 30.0), materials=(SOIL,), friction=(0.3,))
    assert LAW.table(a_scene.materials, cell_size=min(a_scene.spacing))["cell_size"] == min(a_scene.spacing)
    assert LAW.table((SOIL,), np.float32, 0.25)["cell_size"] == np.float32(0.25)


def test_friction_of_the_ground_is_limited_by_what_is_left():
    residual = replace(SOIL, cohesion=2e3)
    assert SOIL.shear_strength(20e3) == pytest.approx(residual.shear_strength(20e3))
    assert SOIL.yield_cone == DruckerPrager(friction_angle=25.0, cohesion=10e3).yield_cone


@pytest.mark.parametrize(
    ("changed", "said"),
    [({"residual_cohesion": 11e3}, "above the cohesion"), ({"friction_angle": 0.0, "residual_cohesion": 0.0}, "both 0")],
)
def test_wrong_parameters_are_refused(changed, said):
    with pytest.raises(MaterialError, match=said):
        replace(SOIL, **changed)
