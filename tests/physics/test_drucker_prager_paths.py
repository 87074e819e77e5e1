"""Drucker-Prager on a single point, strain driven, against closed forms."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from parity_cases import law_cases
from scipy.optimize import brentq
from symmetric import components, flat, matrix, rotation

from runout import Cone, DruckerPrager
from runout.materials import drucker_prager as dp
from runout.model.laws import LAWS
from runout.physics import elastic
from runout.physics.tensors import trace
from runout.studies.verification_cases.element import pressed

LAW = LAWS.find("drucker_prager")
ZERO = (0.0,) * 6
PHI, COHESION = math.radians(30.0), 10.0e3


def material(cone=Cone.TRIAXIAL_COMPRESSION, cohesion=COHESION, volume_correction=True):
    m = DruckerPrager(
        density=2000.0,
        youngs_modulus=10e6,
        poisson_ratio=0.25,
        friction_angle=math.degrees(PHI),
        cohesion=cohesion,
        cone=cone,
        volume_correction=volume_correction,
    )
    return SimpleNamespace(**m.record(), bulk=m.lame_lambda + 2 * m.shear_modulus / 3)


def invariants(h, mat):
    return elastic.pressure(h, mat), elastic.deviatoric_stress(h, mat)


@pytest.mark.parametrize(
    ("cone", "slope", "intercept"),
    [  # Mohr-Coulomb of 30 degrees and c: sin = 1/2, cos = sqrt(3)/2, tan = 1/sqrt(3)
        (Cone.TRIAXIAL_COMPRESSION, 1.2, 1.2 * math.sqrt(3)),
        (Cone.TRIAXIAL_EXTENSION, 6 / 7, 6 / 7 * math.sqrt(3)),
        (Cone.PLANE_STRAIN, math.sqrt(3) / 2, 1.5),
        (Cone.PLANE_STRAIN_ASSOCIATED, 3 / math.sqrt(13), 3 * math.sqrt(3) / math.sqrt(13)),
    ],
)
def test_cone_has_its_closed_form_and_shears_to_its_plateau(cone, slope, intercept):
    mat, p0 = material(cone), 50e3
    assert mat.cone_slope == pytest.approx(slope, rel=1e-12)
    assert mat.cone_intercept == pytest.approx(intercept * COHESION, rel=1e-12)
    B, history, step = pressed(mat, p0), 0.0, (0.0, 1e-2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(500):  # constant-volume simple shear to gamma = 5
        B, h, history, _ = LAW.step(B, step, history, mat)
    p, q = invariants(h, mat)
    assert p == pytest.approx(p0, rel=1e-10)
    assert q == pytest.approx(slope * p0 + intercept * COHESION, rel=1e-10)


def test_triaxial_cone_recovers_mohr_coulomb_in_compression_and_extension():
    n = (1 + math.sin(PHI)) / (1 - math.sin(PHI))
    s3 = 100e3
    s1 = s3 * n + 2 * COHESION * math.sqrt(n)
    M, qc = dp.cone_triaxial_compression(PHI, COHESION)
    assert s1 - s3 == pytest.approx(M * (s1 + 2 * s3) / 3 + qc)
    M, qc = dp.cone_triaxial_extension(PHI, COHESION)
    assert s1 - s3 == pytest.approx(M * (2 * s1 + s3) / 3 + qc)


def test_plane_strain_cone_recovers_mohr_coulomb_when_the_middle_stress_is_the_mean():
    n = (1 + math.sin(PHI)) / (1 - math.sin(PHI))
    s3 = 100e3
    s1 = s3 * n + 2 * COHESION * math.sqrt(n)
    M, qc = dp.cone_plane_strain(PHI, COHESION)
    assert math.sqrt(3) * (s1 - s3) / 2 == pytest.approx(M * (s1 + s3) / 2 + qc)


def test_triaxial_compression_peaks_at_the_closed_form():
    mat, cell = material(), 100e3
    B, history, h = pressed(mat, cell), 0.0, None
    for _ in range(40):

        def lateral_pressure(d, B=B, history=history):
            rate = (d, 0.0, 0.0, 0.0, d, 0.0, 0.0, 0.0, -2e-3)
            return -elastic.kirchhoff_stress(LAW.step(B, rate, history, mat)[1], mat)[0] - cell

        d = brentq(lateral_pressure, -1e-2, 1e-2, xtol=1e-16)
        B, h, history, _ = LAW.step(B, (d, 0.0, 0.0, 0.0, d, 0.0, 0.0, 0.0, -2e-3), history, mat)
    M, qc = mat.cone_slope, mat.cone_intercept
    assert invariants(h, mat)[1] == pytest.approx(3 * (M * cell + qc) / (3 - M), rel=1e-9)


def test_extension_past_the_apex_holds_the_apex_tension_and_remembers_the_volume():
    mat = material()
    B, history, stretch = ZERO, 0.0, 0.0
    for _ in range(50):
        B, h, history, work = LAW.step(B, (1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3), history, mat)
        stretch += 3 * math.log1p(1e-3)
    tension = mat.cone_intercept / mat.cone_slope
    np.testing.assert_allclose(elastic.kirchhoff_stress(h, mat), (tension,) * 3 + (0, 0, 0), rtol=1e-10, atol=1e-6)
    assert history == pytest.approx(stretch - tension / mat.bulk, rel=1e-9)
    assert work == pytest.approx(tension * 3 * math.log1p(1e-3), rel=1e-9)


@pytest.mark.parametrize("correction", [True, False])
def test_expanded_material_carries_load_only_after_it_recompressed(correction):
    mat = material(cohesion=0.0, volume_correction=correction)
    B, history = ZERO, 0.0
    opened, closed = math.exp(0.02) - 1, math.exp(-0.01) - 1
    pressures = []
    for rate in (opened, closed, closed, closed):
        B, h, history, _ = LAW.step(B, (rate, 0, 0, 0, rate, 0, 0, 0, rate), history, mat)
        pressures.append(elastic.pressure(h, mat))
    load = mat.bulk * 0.03  # of a log volume of -0.03
    np.testing.assert_allclose(pressures, [0, 0, 0, load] if correction else [0, load, 2 * load, 3 * load], atol=1e-6 * load)


@given(st.tuples(*[st.floats(-0.05, 0.05)] * 6), st.floats(0.0, 30e3))
def test_returned_stress_is_admissible_and_the_cone_keeps_the_volume(h, cohesion):
    mat = material(cohesion=cohesion)
    new = dp.return_to_cone(h, mat.cone_slope, mat)
    p, q = invariants(new, mat)
    scale = abs(p) + mat.cone_intercept + 1.0
    assert q - mat.cone_slope * p - mat.cone_intercept <= 1e-10 * scale
    assert p >= -mat.cone_intercept / mat.cone_slope - 1e-10 * scale
    if mat.cone_slope * elastic.pressure(h, mat) + mat.cone_intercept > 0:
        assert trace(new) == pytest.approx(trace(h), abs=1e-15)


@given(st.lists(st.tuples(*[st.floats(-0.02, 0.02)] * 9), min_size=1, max_size=6))
def test_cohesionless_material_never_gives_back_dissipated_energy(path):
    mat = material(cohesion=0.0)
    B, history = pressed(mat, 20e3), 0.0
    for rate in path:
        B, h, history, work = LAW.step(B, rate, history, mat)
        assert work >= 0.0
        assert history >= 0.0
        np.testing.assert_allclose(elastic.log_strain(B), h, atol=1e-10)


def test_dissipation_of_shear_is_stress_times_plastic_strain():
    mat, p0, dgamma = material(cohesion=0.0, cone=Cone.PLANE_STRAIN), 50e3, 1e-4
    B, history, work = pressed(mat, p0), 0.0, 0.0
    for _ in range(3000):
        B, _, history, lost = LAW.step(B, (0, dgamma, 0, 0, 0, 0, 0, 0, 0), history, mat)
        work += lost
    q = mat.cone_slope * p0
    elastic_part = q / (math.sqrt(3) * mat.shear_modulus)
    # the shear stress on the plateau is q/sqrt(3) up to the small turn of the axes by the elastic strain
    assert work == pytest.approx(q / math.sqrt(3) * (3000 * dgamma - elastic_part), rel=3e-3)


@pytest.mark.parametrize("seed", range(8))
def test_law_turns_with_the_observer(seed):
    rng = np.random.default_rng(seed)
    mat, q = material(), rotation(rng)
    B, L, history = 0.01 * matrix(rng.normal(size=6)), 0.01 * rng.normal(size=(3, 3)), float(abs(rng.normal()) * 0.01)
    still = LAW.step(components(B), flat(L), history, mat)
    turned = LAW.step(components(q @ B @ q.T), flat(q @ L @ q.T), history, mat)
    for a, b in zip(still[:2], turned[:2], strict=True):
        np.testing.assert_allclose(matrix(b), q @ matrix(a) @ q.T, atol=1e-12)
    np.testing.assert_allclose(turned[2], still[2], atol=1e-12)
    np.testing.assert_allclose(turned[3], still[3], rtol=1e-9, atol=1e-9)


def test_parity_samples_reach_every_branch_of_the_law():
    case = next(c for c in law_cases(LAW) if c.function is LAW.step)
    mat = material(cohesion=1e3)
    kinds = {"elastic": 0, "cone": 0, "apex": 0, "recompression": 0}
    for B, L, history in zip(*case.sample(), strict=True):
        h = elastic.log_strain(elastic.trial_strain(tuple(B), tuple(L)))
        shifted = [*(np.array(h[:3]) + history[0] / 3), *h[3:]]
        p, q = invariants(shifted, mat)
        limit = mat.cone_slope * p + mat.cone_intercept
        kinds["apex" if limit <= 0 else "elastic" if q <= limit else "cone"] += 1
        kinds["recompression"] += history[0] > 0 and limit > 0
    assert min(kinds.values()) >= 10, kinds


def test_form_for_small_strain_gives_the_bits_of_the_law():
    case = next(c for c in law_cases(LAW) if c.function is LAW.step)
    mat = material(cohesion=1e3)
    small = 0
    for B, L, history in zip(*case.sample(), strict=True):
        arguments = (tuple(map(float, B)), tuple(map(float, L)), float(history[0]), mat)
        *result, size = LAW.step_small(*arguments)
        if elastic.is_small(size):
            small += 1
            assert tuple(result) == LAW.step(*arguments)
    assert small > 300
