"""Sliding box (T1 of the suite): an elastic box, pre-stressed, on a plane with a friction angle of 15 degrees.

Case sliding-box of test_convergence measures further planes: 14 and 20 degrees at an azimuth of 37 degrees, 30 degrees at 63
degrees, and 16 degrees without coupling (Poisson's ratio 0) and with two moduli.
"""

import numpy as np
import pytest

from runout.errors import ConfigError
from runout.studies.verification_cases.sliding_box import Plane, slide, summary


def error(slope_deg, **choices):
    """Relative error of the displacement after one second against a rigid block."""
    return summary(Plane(slope_deg, **choices))["relative_displacement_error"]


@pytest.mark.parametrize("choices", [{"aligned": True}, {"azimuth_deg": 37.0, "offset": 0.85}])
def test_box_one_degree_below_its_friction_angle_stays_at_rest(choices):
    """14 degrees: 0.13 mm in the first second, 0.03 mm/s at its end; the usual contact at nodes creeps 25 to 111 mm."""
    found = slide(Plane(14.0, **choices))
    assert abs(found.moved) < 0.3e-3
    assert abs(found.speed) < 0.1e-3
    assert abs(found.gap) < 0.002


@pytest.mark.parametrize("choices", [{"aligned": True}, {"offset": 0.85}])
def test_box_at_20_degrees_slides_as_a_rigid_block(choices):
    """0.43 to 0.45 % too far after 1 s, with gravity inclined and with the plane inclined."""
    assert abs(error(20.0, **choices)) < 0.006


def test_box_one_degree_above_its_friction_angle_comes_at_most_a_tenth_too_far_since_it_vibrates():
    """Poisson's ratio is 0.3: friction excites vibrations, during which it does not act in full."""
    assert 0.0 < error(16.0, azimuth_deg=37.0) < 0.1


def test_box_at_25_degrees_slides_as_a_rigid_block():
    """0.08 % too far after 1 s."""
    assert abs(error(25.0)) < 0.0015


@pytest.mark.parametrize("choices", [{"aligned": True}, {"azimuth_deg": 217.0, "offset": 0.1}])
def test_box_at_30_degrees_slides_as_a_rigid_block(choices):
    """0.025 % too far after 1 s."""
    assert abs(error(30.0, **choices)) < 0.0005


def test_box_slides_as_far_in_single_precision():
    """0.45 % too far at 20 degrees, as in double precision."""
    assert abs(error(20.0, azimuth_deg=37.0, precision="float32")) < 0.006


def test_box_without_friction_falls_behind_nothing():
    """The negative control: a box with another friction is not the block that it is compared with."""
    found = slide(Plane(20.0, friction=0.0), time=0.2)
    assert found.moved == pytest.approx(0.5 * 9.81 * np.sin(np.radians(20.0)) * 0.2**2, rel=0.02)
    assert found.moved > 2 * slide(Plane(20.0), time=0.2).moved


@pytest.mark.parametrize(
    ("choice", "words"), [({"slope_deg": 70.0}, "slope is 70 deg"), ({"slope_deg": 20.0, "offset": 1.5}, "offset")]
)
def test_plane_out_of_range_is_refused_with_its_range(choice, words):
    with pytest.raises(ConfigError, match=words):
        Plane(**choice)
