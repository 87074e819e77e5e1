"""Friction laws against the formulas of their papers, in plain Python: shear stress of a contact, numbers, limits of parameters."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from runout import Coulomb, VelocityWeakening, Voellmy, VoellmyBase
from runout.errors import ConfigError
from runout.model.basal_friction import USUAL_ANGLE, MassAbove
from runout.model.friction_laws import FRICTIONS, friction_law_of
from runout.model.parameters import parameters_of

DENSITY, GRAVITY, STRENGTH = 300.0, 9.81, 0.7
AREA, STEP = 2.5, 0.02  # [m2], [s]
RANGES = {  # smallest and largest value, unit, and a usual value of each parameter
    Coulomb: {"friction_angle": (0.0, 60.0, "deg", USUAL_ANGLE)},
    VelocityWeakening: {
        "static_friction": (0.0, 2.0, "", 0.84),
        "dynamic_friction": (0.0, 2.0, "", 0.11),
        "weakening_speed": (1e-9, 1000.0, "m/s", 4.0),
    },
    Voellmy: {
        "mu": (0.0, 2.0, "", 0.2),
        "xi": (1.0, 1e6, "m/s2", 1000.0),
        "cohesion": (0.0, 1e6, "Pa", 0.0),
        "minimum_shear_stress": (0.0, 1e6, "Pa", 0.0),
        "forest_drag": (0.0, 10.0, "", 0.0),
    },
}
RANGES[VoellmyBase] = RANGES[Voellmy]
EACH = [(law, name) for law, limits in RANGES.items() for name in limits]


def shear_stress(friction, normal_stress, speed):
    """Shear stress [Pa] of a contact, steady part and drag, before what the mass passes on limits it."""
    law = friction_law_of(friction)
    record = friction.acting(friction.numbers(), MassAbove(STRENGTH, DENSITY, GRAVITY))
    steady, drag = law.resistance(normal_stress * AREA * STEP, speed, AREA, STEP, SimpleNamespace(**record))
    return steady / (AREA * STEP) + drag * speed**2 / AREA


@pytest.mark.parametrize("speed", [0.0, 3.0, 40.0])
def test_coulomb_shear_stress_is_the_tangent_of_the_angle_times_the_normal_stress(speed):
    friction = Coulomb(friction_angle=25.0)
    assert shear_stress(friction, 4e3, speed) == pytest.approx(4e3 * math.tan(math.radians(25.0)))
    assert (friction.at_rest, friction.least) == pytest.approx((math.tan(math.radians(25.0)),) * 2)


def test_coulomb_friction_is_at_most_the_strength_of_the_mass_of_each_row():
    numbers = {"friction": np.array([0.2, 0.9, 0.9])}
    acting = Coulomb.acting(numbers, MassAbove(np.array([0.5, 0.5, 1.0]), DENSITY, GRAVITY))
    np.testing.assert_array_equal(acting["friction"], [0.2, 0.5, 0.9])
    assert set(acting) == {"friction"}, "contact does not compare the strength again"


@pytest.mark.parametrize("speed", [0.0, 1.0, 4.0, 60.0])
def test_velocity_weakening_follows_equation_1_of_lucas(speed):
    friction = VelocityWeakening(static_friction=0.6, dynamic_friction=0.1, weakening_speed=4.0)
    mu = 0.1 + (0.6 - 0.1) / (1.0 + speed / 4.0)
    assert shear_stress(friction, 4e3, speed) == pytest.approx(4e3 * mu)
    assert (friction.at_rest, friction.least) == (0.6, 0.1)


@pytest.mark.parametrize("law", [Voellmy, VoellmyBase])
@pytest.mark.parametrize(("normal_stress", "speed"), [(0.0, 0.0), (4e3, 0.0), (4e3, 5.0), (400.0, 30.0)])
def test_voellmy_shear_stress_is_the_sum_of_its_published_terms(law, normal_stress, speed):
    friction = law(mu=0.25, xi=800.0, cohesion=150.0, minimum_shear_stress=70.0, forest_drag=0.02)
    cohesion = (1.0 - 0.25) * 150.0 * (1.0 - math.exp(-normal_stress / 150.0))
    turbulence = DENSITY * speed**2 * (GRAVITY / 800.0 + 0.02)
    assert shear_stress(friction, normal_stress, speed) == pytest.approx(0.25 * normal_stress + cohesion + 70.0 + turbulence)


def test_voellmy_without_cohesion_has_the_two_terms_of_voellmy():
    assert shear_stress(Voellmy(mu=0.2, xi=1000.0), 4e3, 10.0) == pytest.approx(0.2 * 4e3 + DENSITY * GRAVITY * 100.0 / 1000.0)
    assert shear_stress(Voellmy(mu=0.2, xi=1000.0, cohesion=0.5), 0.3, 0.0) == pytest.approx(0.06 + 0.4 * (1.0 - math.exp(-0.6)))


def test_cohesion_vanishes_where_the_friction_coefficient_passes_one():
    for mu in (1.0, 1.5):
        assert shear_stress(Voellmy(mu=mu, xi=1000.0, cohesion=150.0), 4e3, 0.0) == pytest.approx(mu * 4e3)


def test_drag_acts_on_the_column_or_at_the_base():
    law, at_base = (FRICTIONS.find(name) for name in ("voellmy", "voellmy_base"))
    assert (law.uses_area, at_base.uses_area) == (True, True)
    assert (law.drags_column, at_base.drags_column) == (True, False)
    assert (law.drags, at_base.drags) == (True, True)
    others = [FRICTIONS.find(name) for name in ("coulomb", "velocity_weakening")]
    assert not any(other.uses_area or other.drags_column or other.drags for other in others)


def test_inverse_of_the_turbulence_coefficient_is_what_zones_average():
    assert Voellmy(mu=0.2, xi=400.0).numbers()["inverse_xi"] == 0.0025


@pytest.mark.parametrize(("law", "name"), EACH, ids=lambda value: value if isinstance(value, str) else value.law)
def test_parameters_have_a_unit_a_range_and_a_usual_value_and_ensembles_sample_them(law, name):
    low, high, unit, usual = RANGES[law][name]
    declared = {p.name: p for p in parameters_of(law)}[name]
    others = {p.name: p.typical for p in parameters_of(law) if p.name != name}
    assert (declared.valid.unit, declared.typical, declared.sampled) == (unit, usual, True)
    assert [getattr(law(**others, **{name: end}), name) for end in (low, high)] == [low, high]
    for beyond in (low - 1e-6, high + 1e-3):
        with pytest.raises(ConfigError, match=rf"{name} is .* it must be "):
            law(**others, **{name: beyond})


def test_parameters_that_may_be_left_out():
    assert VelocityWeakening() == VelocityWeakening(static_friction=0.84, dynamic_friction=0.11, weakening_speed=4.0)
    plain = Voellmy(mu=0.2, xi=1000.0)
    assert (plain.cohesion, plain.minimum_shear_stress, plain.forest_drag) == (0.0, 0.0, 0.0)
    for law, stated in ((Voellmy, {"mu": 0.2}), (Voellmy, {"xi": 1e3}), (Coulomb, {})):
        with pytest.raises(TypeError, match="missing 1 required keyword-only argument"):
            law(**stated)
