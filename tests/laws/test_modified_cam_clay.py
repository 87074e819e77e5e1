"""Modified Cam-clay: element tests against closed forms, the return over random states, start and opening."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_point import pressed, record
from scipy.optimize import brentq
from scipy.special import lambertw

from runout.backends.compile import numba_binding
from runout.errors import MaterialError
from runout.materials import modified_cam_clay as cam_clay
from runout.materials.modified_cam_clay import ModifiedCamClay
from runout.model.laws import LAWS
from runout.physics import elastic
from runout.physics.tensors import trace

LAW = LAWS.find("modified_cam_clay")
M, COMPRESSION, SWELLING, P_C = 0.9, 0.1, 0.02, 100e3
CLAY = ModifiedCamClay(
    density=1800.0, youngs_modulus=6e6, poisson_ratio=0.3, critical_state_slope=M, compression_slope=COMPRESSION,
    swelling_slope=SWELLING, preconsolidation_pressure=P_C,
)  # fmt: skip
MAT = record(CLAY)
SLOPE = COMPRESSION - SWELLING
SET = -1e-12  # history of material whose preconsolidation pressure is p_c0


def invariants(h, mat=MAT):
    return elastic.pressure(h, mat), elastic.deviatoric_stress(h, mat)


def moved(B, history, rates):
    """B, Hencky strain and history after velocity gradients times dt of the diagonal ``rates`` (3,)."""
    x, y, z = rates
    B, h, history, lost = LAW.step(B, (x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z), history, MAT)
    assert lost >= -1e-9 * P_C
    return B, h, history


def test_isotropic_compression_follows_the_swelling_and_the_virgin_line_and_swells_back():
    """Log volume lost is p/K, and (lambda - kappa) ln(p/p_c0) more beyond the preconsolidation pressure."""
    B, history, step, pressures = (0.0,) * 6, 0.0, math.expm1(-5e-4), []
    for count in range(1, 101):
        B, h, history = moved(B, history, (step, step, step))
        p, q = invariants(h)
        pressures.append(p)
        expected = p / MAT.bulk + (SLOPE * math.log(p / P_C) if p > P_C else 0.0)
        assert count * 1.5e-3 == pytest.approx(expected, rel=1e-9)
        assert q == pytest.approx(0.0, abs=1e-6)
    assert pressures[-1] > 2 * P_C
    B, h, history = moved(B, history, (math.expm1(5e-4),) * 3)
    assert elastic.pressure(h, MAT) == pytest.approx(pressures[-1] - 1.5e-3 * MAT.bulk, rel=1e-9)


@pytest.mark.parametrize("pressure", [40e3, 100e3], ids=["overconsolidated", "normally consolidated"])
def test_drained_triaxial_compression_ends_at_the_critical_state(pressure):
    """q/p rises with q = 3 (p - p_0) until q = M p: p = 3 p_0/(3 - M)."""
    B, history, volumes = pressed(MAT, pressure), SET, []
    for _ in range(400):

        def lateral_excess(d, B=B, history=history):
            h = LAW.step(B, (d, 0.0, 0.0, 0.0, d, 0.0, 0.0, 0.0, -4e-3), history, MAT)[1]
            return -elastic.kirchhoff_stress(h, MAT)[0] - pressure

        d = brentq(lateral_excess, -1e-2, 1e-2, xtol=1e-15)
        B, h, history = moved(B, history, (d, d, -4e-3))
        volumes.append(2 * math.log1p(d) + math.log1p(-4e-3))
    p, q = invariants(h)
    assert q == pytest.approx(3 * (p - pressure), rel=1e-6)
    assert q / p == pytest.approx(M, rel=2e-3)
    assert p == pytest.approx(3 * pressure / (3 - M), rel=2e-3)
    assert abs(volumes[-1]) < 0.01 * max(map(abs, volumes))
    assert cam_clay.consolidation(history, MAT) == pytest.approx(2 * p, rel=5e-3)


@pytest.mark.parametrize("pressure", [20e3, 50e3, 100e3], ids=["dilates", "neither", "contracts"])
def test_undrained_shear_ends_at_the_critical_state_of_its_volume(pressure):
    """No volume changes: p_0 - p = K x and p_c = p_c0 exp(x/(lambda - kappa)) = 2 p at the end."""
    B, history = pressed(MAT, pressure), SET
    for _ in range(3000):
        B, h, history, lost = LAW.step(B, (0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), history, MAT)
        assert lost >= 0.0
    p, q = invariants(h)
    a = 0.5 * P_C * math.exp(pressure / (MAT.bulk * SLOPE))  # p = a exp(-p/(K (lambda - kappa)))
    expected = MAT.bulk * SLOPE * lambertw(a / (MAT.bulk * SLOPE)).real
    assert p == pytest.approx(expected, rel=1e-6)
    assert q == pytest.approx(M * p, rel=1e-6)


@pytest.mark.parametrize(("real", "surface", "flow"), [(np.float64, 1e-10, 1e-6), (np.float32, 2e-5, 1e-4)])
def test_return_of_random_states_lies_on_the_ellipse_and_follows_the_flow_rule(real, surface, flow):
    """200,000 states of clays from very soft to hard, of which half yield, on both sides of the critical state."""
    rng, n = np.random.default_rng(1), 200_000
    modulus, nu = 10 ** rng.uniform(5, 9, n), rng.uniform(0, 0.49, n)
    table = np.zeros(n, [(name, real) for name in LAW.fields])
    plastic, p_c = 10 ** rng.uniform(-3, -0.3, n), 10 ** rng.uniform(2, 8, n)
    lame, shear = elastic.lame_lambda(modulus, nu), elastic.shear_modulus(modulus, nu)
    values = lame, shear, rng.uniform(0.1, 2, n), plastic, p_c, np.ones(n)
    for name, value in zip(LAW.fields, values, strict=True):
        table[name] = value
    history, bulk = plastic * rng.normal(size=n) * 3, lame + 2 * shear / 3
    size = np.minimum(p_c * np.exp(-history / plastic) / bulk * 10 ** rng.uniform(-3, 2, n), 0.1)
    h = rng.normal(size=(n, 6)) * (size * 10 ** rng.uniform(-2, 0, n))[:, None]
    h[:, :3] -= (rng.uniform(-0.5, 2, n) * size / 3)[:, None]
    h, history, update = h.astype(real), history.astype(real), numba_binding(real, False).law(LAW).update

    @numba.njit(error_model="numpy")
    def run(h, history, table, out):
        for i in range(len(h)):
            new, left, _ = update((h[i, 0], h[i, 1], h[i, 2], h[i, 3], h[i, 4], h[i, 5]), history[i], table[i])
            for k in range(6):
                out[i, k] = new[k]
            out[i, 6] = left

    out = np.empty((n, 7), real)
    run(h, history, table, out)
    assert np.isfinite(out).all()
    mat = SimpleNamespace(**{name: table[name].astype(float) for name in LAW.fields})
    p_trial, q_trial, p, q = *stresses(h, mat), *stresses(out[:, :6], mat)
    p_before, p_after = (mat.preconsolidation_pressure * np.exp(-x.astype(float) / mat.plastic_slope) for x in (history, out[:, 6]))
    slope, unit = mat.critical_state_slope, np.abs(p_trial) + q_trial + p_before
    yields = (q_trial / slope) ** 2 + p_trial * (p_trial - p_before) > 0
    assert 0.4 < yields.mean() < 0.6
    assert np.abs(((q / slope) ** 2 + p * (p - p_after)) / unit**2)[yields].max() < surface
    d, x = 2 * p - p_after, (p_trial - p) / (mat.lame_lambda + 2 * mat.shear_modulus / 3)
    residual = (q * (slope**2 * d + 6 * mat.shear_modulus * x) - slope**2 * d * q_trial) / unit**2
    assert np.quantile(np.abs(residual[yields]), 0.999) < flow
    assert 0.3 < (d > 0)[yields].mean() < 0.7
    np.testing.assert_array_equal(out[~yields, :6], h[~yields])


def stresses(h, mat):
    """p and q (n,) [Pa] of Hencky strains (n, 6)."""
    h = h.astype(float)
    volume = h[:, :3].sum(axis=1)
    square = ((h[:, :3] - volume[:, None] / 3) ** 2).sum(axis=1) + 2 * (h[:, 3:] ** 2).sum(axis=1)
    return -(mat.lame_lambda + 2 * mat.shear_modulus / 3) * volume, np.sqrt(6 * square) * mat.shear_modulus


@settings(max_examples=300)
@given(
    st.tuples(*[st.floats(-0.03, 0.03)] * 6), st.floats(-6.0, 6.0), st.floats(0.1, 2.0), st.floats(1e-3, 0.4), st.floats(1e2, 1e7)
)
def test_what_is_left_is_admissible_and_dissipates(h, logarithm, slope, plastic, p_c):
    clay = replace(
        CLAY, critical_state_slope=slope, compression_slope=plastic + 1e-3, swelling_slope=1e-3, preconsolidation_pressure=p_c
    )
    mat, history = record(clay), plastic * logarithm or SET
    new, left, lost = cam_clay.update(h, history, mat, 1.0)
    (p, q), (p_trial, q_trial) = invariants(new, mat), invariants(h, mat)
    unit = abs(p_trial) + q_trial + cam_clay.consolidation(history, mat)
    assert (q / slope) ** 2 + p * (p - cam_clay.consolidation(left, mat)) <= 1e-9 * unit * unit
    assert q <= q_trial * (1 + 1e-9)
    assert trace(new) + left == pytest.approx(trace(h) + history, abs=1e-9)
    assert lost >= -1e-7 * unit * max(1e-3, *map(abs, h))


def test_first_step_takes_the_consolidation_from_the_stress_and_the_ratio():
    h = (-0.01, -0.01, -0.02, 0.003, 0.0, 0.0)
    p, q = invariants(h)
    wanted = p + q * q / (M * M * p)
    assert wanted > P_C
    for ratio in (1.0, 3.0):
        new, history, lost = cam_clay.update(h, 0.0, record(replace(CLAY, overconsolidation_ratio=ratio)), 1.0)
        assert (new, lost) == (h, 0.0)
        assert cam_clay.consolidation(history, MAT) == pytest.approx(ratio * wanted, rel=1e-12)
    _, history, _ = cam_clay.update((-1e-4, -1e-4, -1e-4, 0.0, 0.0, 0.0), 0.0, MAT, 1.0)
    assert history == SET


def test_opened_soil_carries_load_only_after_it_closed_up():
    """Opening is plastic; on the way back the soil is on the virgin line of its volume, at most at its former consolidation."""
    B, history = pressed(MAT, 80e3), SET
    for _ in range(40):
        B, h, history = moved(B, history, (5e-3,) * 3)
    assert 0.0 <= elastic.pressure(h, MAT) < 0.2 * P_C
    opened = 40 * 3 * math.log1p(5e-3)
    back = math.expm1(-opened / 120)
    for _ in range(40):
        B, h, history = moved(B, history, (back,) * 3)
    p = elastic.pressure(h, MAT)
    lost = 80e3 / MAT.bulk  # log volume below that of no stress, as at the start
    assert p == pytest.approx(cam_clay.consolidation(history, MAT), rel=1e-9)
    assert p <= P_C
    assert lost == pytest.approx(p / MAT.bulk - history, rel=1e-9)


def test_chosen_stiffness_is_at_least_that_of_swelling():
    auto = replace(CLAY, youngs_modulus="auto")
    assert auto.chosen(1.0, 0.5, 9.81).modulus == pytest.approx(3 * (1 - 0.6) * P_C / SWELLING)
    fast = auto.chosen(100.0, 20.0, 9.81).modulus
    assert fast == replace(auto, preconsolidation_pressure=100.0).chosen(100.0, 20.0, 9.81).modulus > 1e7
    assert CLAY.chosen(100.0, 20.0, 9.81) == CLAY


def test_swelling_is_flatter_than_compression():
    with pytest.raises(MaterialError, match=r"swelling_slope is 0\.1, not below compression_slope 0\.1"):
        replace(CLAY, swelling_slope=0.1)
