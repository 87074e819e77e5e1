"""mu(I): the implicit return meets the flow curve, carries no tension, dissipates; materials and backends refuse what cannot be."""

import math
from types import SimpleNamespace

import pytest

from runout.errors import MaterialError
from runout.materials import granular_flow
from runout.materials.granular_flow import GranularFlow
from runout.physics import elastic

BEADS = {"density": 1500.0, "youngs_modulus": 1e7, "static_friction": 0.38, "dynamic_friction": 0.64, "grain_size": 1e-3}
MAT = SimpleNamespace(**{**GranularFlow(**BEADS).record(), "time_step": 1e-5})


@pytest.mark.parametrize("excess", [1e-3, 1.0, 1e3, 1e5])
@pytest.mark.parametrize("p", [1.0, 1e3, 1e5])
def test_plastic_shear_brings_the_stress_onto_the_flow_curve(excess, p):
    x = granular_flow.plastic_shear(excess, p, MAT)
    rate = x / MAT.time_step
    flowing = granular_flow.friction(rate * 1e-3 * math.sqrt(1500.0 / p), MAT)
    assert excess - MAT.shear_modulus * x == pytest.approx(p * (flowing - 0.38), rel=1e-9, abs=1e-9 * excess + 1e-15 * p)


def test_stress_below_static_friction_is_left_alone_and_above_it_is_between_the_two_frictions():
    pressed = (-1e-4, -1e-4, -1e-4, 0.0, 0.0, 0.0)
    weak, strong = (*pressed[:3], 3e-5, 0.0, 0.0), (*pressed[:3], 3e-3, 0.0, 0.0)
    assert granular_flow.return_to_flow(weak, MAT, 1.0) == weak
    h = granular_flow.return_to_flow(strong, MAT, 1.0)
    ratio = elastic.deviatoric_stress(h, MAT) / math.sqrt(3) / elastic.pressure(h, MAT)
    assert 0.38 < ratio < 0.64
    assert elastic.pressure(h, MAT) == pytest.approx(elastic.pressure(strong, MAT))


def test_what_comes_apart_carries_nothing_until_it_has_closed_up():
    apart = (1e-3, 1e-3, 1e-3, 2e-4, 0.0, 0.0)
    h, gained, lost = granular_flow.update(apart, 0.0, MAT, 1.0)
    assert h == (0.0,) * 6
    assert gained == pytest.approx(3e-3)
    assert lost == 0.0
    h, left, _ = granular_flow.update((-5e-4, -5e-4, -5e-4, 0.0, 0.0, 0.0), gained, MAT, 1.0)
    assert h == (0.0,) * 6
    assert left == pytest.approx(1.5e-3)


@pytest.mark.parametrize(
    ("changed", "word"), [({"dynamic_friction": 0.3}, "above static_friction"), ({"grain_size": 0.0}, "grain_size")]
)
def test_material_names_what_is_out_of_its_range(changed, word):
    with pytest.raises(MaterialError, match=word):
        GranularFlow(**{**BEADS, **changed})
