"""Pore pressure: closure of consolidation, effective stress in the mass and at the ground."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from runout import DruckerPrager
from runout.model.friction_laws import FRICTIONS
from runout.model.laws import LAWS, law_of
from runout.model.pore_pressure import FIELDS, PorePressure
from runout.model.registered_law import calling
from runout.physics import elastic, plastic, pore_pressure

SOIL = DruckerPrager(density=2000.0, youngs_modulus=5e6, friction_angle=32.0, cohesion=500.0)
STATES = 400


def record_of(pore, density=2000.0):
    return SimpleNamespace(**dict(zip(FIELDS, pore.record(density), strict=True)))


def states(seed=1):
    """Hencky strains (n, 6) of mostly compressed material, log volumes gained, and shares that grains carry."""
    rng = np.random.default_rng(seed)
    h = rng.normal(0.0, 0.004, (STATES, 6))
    h[:, :3] -= rng.uniform(-0.002, 0.02, (STATES, 1))
    return h, np.maximum(rng.uniform(-0.01, 0.01, STATES), 0.0), rng.uniform(0.03, 1.0, STATES)


def terzaghi(time):
    """Base pressure over that at the start of a layer that drains at its top, at time D t/H^2: the whole series."""
    k = 2.0 * np.arange(2000) + 1.0
    return float(np.sum(4.0 / np.pi / k * (-1.0) ** np.arange(2000) * np.exp(-((k * np.pi / 2.0) ** 2) * time)))


@pytest.mark.parametrize(("time", "most"), [(0.05, 0.011), (0.1, 0.049), (0.2, 0.01), (0.5, 0.01), (1.0, 0.01), (2.0, 0.01)])
def test_excess_pressure_at_the_base_is_that_of_terzaghi(time, most):
    pore = record_of(PorePressure(ratio=0.8, diffusivity=0.02, saturation=0.5))
    thickness, steps = 1.7, 100
    dt = time * thickness**2 / 0.02 / steps
    left = 1.0
    for _ in range(steps):
        left *= pore_pressure.remaining_share(thickness, dt, pore)
    excess = 0.8 - 0.25
    found = (pore_pressure.pore_ratio(excess, left, pore) - 0.25) / excess
    assert found == pytest.approx(terzaghi(time), abs=most)


def test_a_decay_time_is_that_of_the_excess_whatever_the_thickness():
    pore = record_of(PorePressure(ratio=0.9, decay_time=4.0))
    shares = [pore_pressure.remaining_share(thickness, 4.0, pore) for thickness in (0.0, 0.1, 10.0)]
    assert shares == pytest.approx([np.exp(-1.0)] * 3, rel=1e-14)


def test_scaled_trace_is_a_cone_of_reduced_slope():
    law, h, (_, _, shares) = law_of(SOIL), states()[0], states()
    for strain, share in zip(map(tuple, h.tolist()), shares.tolist(), strict=True):
        stated = SOIL.record()
        reduced = SimpleNamespace(**{**stated, "cone_slope": share * stated["cone_slope"]})
        if elastic.pressure(strain, reduced) <= 0.0:
            continue  # of the apex
        found, _, _ = law.effective_return(strain, 0.0, SimpleNamespace(**stated), share)
        expected, _, _ = law.update(strain, 0.0, reduced)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def histories(law, gained):
    """Histories (n,) that states of a law may have, and the factor [1] of one where the strain has that of the trace."""
    if law.name == "modified_cam_clay":
        return np.where(gained > 0.0, -0.05 * gained, 0.0), plastic.history_share
    if law.name == "cohesion_softening":
        return np.where(gained > 0.0, gained, np.linspace(-0.9, 0.0, len(gained))), plastic.volume_share
    return gained, plastic.volume_share


@pytest.mark.parametrize("law", [law for law in LAWS.of_runout() if law.update], ids=lambda law: law.name)
def test_a_return_by_effective_stress_is_that_of_the_strain_with_a_scaled_trace(law):
    """Strain, history and energy are those that the general return makes of the law without pore pressure."""
    mat = SimpleNamespace(**{**law.example.record(), "time_step": 1e-3})
    strains, gained, shares = states(5)
    of_states, scaling = histories(law, gained)
    general = calling(plastic.effective_return, law_return=law.update, history_share=scaling)
    flowed = 0
    for strain, history, share in zip(map(tuple, strains.tolist()), of_states.tolist(), shares.tolist(), strict=True):
        found, left, lost = law.effective_return(strain, history, mat, share)
        new, expected_left, expected_lost = general(strain, history, mat, share)
        np.testing.assert_allclose(found, new, rtol=1e-12, atol=1e-14)
        assert left == pytest.approx(expected_left, rel=1e-12, abs=1e-10)
        assert lost == pytest.approx(expected_lost, rel=1e-9, abs=1e-7)
        flowed += found != strain
    assert flowed > STATES // 20


def test_a_law_without_effective_stress_gets_a_strain_with_a_scaled_trace(monkeypatch):
    """A law of one's own: with the whole gained volume where its history is one, else with its history as it is."""
    law = law_of(SOIL)
    for is_volume in (True, False):
        monkeypatch.setattr(DruckerPrager, "history_is_volume", is_volume)
        found = replace(law, effective_update=None).effective_return
        mat, share, gained = SimpleNamespace(**SOIL.record()), 0.4, 0.004
        new, left, _ = found(strain := (-0.02, -0.01, -0.01, 0.02, 0.0, 0.0), gained, mat, share)
        grains, of_grains, _ = law.update(plastic.with_trace(strain, share), gained * (share if is_volume else 1.0), mat)
        np.testing.assert_allclose(plastic.with_trace(new, share), grains, rtol=0, atol=1e-15)
        assert left == pytest.approx(of_grains / (share if is_volume else 1.0), abs=1e-16)


def test_an_elastic_state_keeps_its_bits():
    law, mat = law_of(SOIL), SimpleNamespace(**SOIL.record())
    strain = (-0.01, -0.0101, -0.0099, 1e-5, 2e-5, -1e-5)
    assert law.effective_return(strain, 0.0, mat, 0.7)[0] == strain


@pytest.mark.parametrize("law", FRICTIONS.of_runout(), ids=lambda law: law.name)
def test_friction_at_the_ground_acts_on_what_grains_carry(law):
    """A particle that is pressed and slides: resistance of the reduced normal impulse, the whole of it upwards."""
    record = SimpleNamespace(**{name: float(v) for name, v in zip(law.fields, acting(law), strict=True)})
    given, n, dt = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.01
    for share in (1.0, 0.3):
        push = law.effective_impulse((8.0, 0.0, -1.0), n, 0.0, 0.05, record, dt, given, 0.0, share)
        steady, drag = law.at_base(share * push[2], 8.0, 0.0, dt, record)
        assert push[2] == pytest.approx(20.0)
        assert drag == 0.0
        assert -push[0] == pytest.approx(steady, rel=1e-12)


def acting(law):
    from runout.model.basal_friction import MassAbove

    return law.friction.acting(law.example.numbers(), MassAbove(0.6, 2000.0, 9.81)).values()
