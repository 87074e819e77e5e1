"""Pore pressure: closure of consolidation, effective stress in the mass and at the ground."""

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


@pytest.mark.parametrize("name", ["drucker_prager", "granular_flow", "herschel_bulkley"])
def test_a_law_sees_the_effective_strain_and_gained_volume(name):
    law = LAWS.find(name)
    mat = SimpleNamespace(**{**law.example.record(), "time_step": 1e-3})
    for strain, gained, share in zip(*(a.tolist() for a in states(2)), strict=True):
        new, left, lost = law.effective_return(tuple(strain), gained, mat, share)
        grains, left_of_grains, _ = law.update(plastic.with_trace(tuple(strain), share), share * gained, mat)
        np.testing.assert_allclose(plastic.with_trace(new, share), grains, rtol=0, atol=1e-15)
        assert left * share == pytest.approx(left_of_grains, abs=1e-16)
        if gained == 0.0:  # flow and stress of the whole mass
            assert lost == pytest.approx(plastic.dissipated_energy(tuple(strain), new, mat), rel=1e-9, abs=1e-9)


def test_the_flatter_cone_gives_what_the_scaled_trace_gives():
    """Drucker-Prager has a return of its own by effective stress: strain, gained volume and energy are those of the general one."""
    law, mat = law_of(SOIL), SimpleNamespace(**SOIL.record())
    general = calling(plastic.effective_return, law_return=law.update, history_share=plastic.volume_share)
    for strain, gained, share in zip(*(a.tolist() for a in states(5)), strict=True):
        found, left, lost = law.effective_return(tuple(strain), gained, mat, share)
        new, expected_left, expected_lost = general(tuple(strain), gained, mat, share)
        np.testing.assert_allclose(found, new, rtol=1e-12, atol=1e-14)
        assert left == pytest.approx(expected_left, rel=1e-12, abs=1e-14)
        assert lost == pytest.approx(expected_lost, rel=1e-9, abs=1e-7)


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


def test_softened_part_of_a_wet_mass_is_that_of_its_grains():
    """Its history is no volume below 0: the softening goes on from what the law itself has noted."""
    law = LAWS.find("cohesion_softening")
    mat = SimpleNamespace(**{**law.example.record(), "cell_size": 2.0})
    rng = np.random.default_rng(3)
    for strain, share in zip(states(4)[0].tolist(), rng.uniform(0.03, 1.0, STATES).tolist(), strict=True):
        softened = -rng.uniform(0.0, 0.9)
        _, left, _ = law.effective_return(tuple(strain), softened, mat, share)
        _, of_grains, _ = law.update(plastic.with_trace(tuple(strain), share), softened, mat)
        assert left == (of_grains if of_grains < 0.0 else pytest.approx(of_grains / share, rel=1e-12))


def test_laws_say_whether_their_history_is_a_volume():
    assert {law.name for law in LAWS.of_runout() if law.material.history_is_volume} == {
        "drucker_prager", "granular_flow", "herschel_bulkley", "cohesion_softening"
    }  # fmt: skip
