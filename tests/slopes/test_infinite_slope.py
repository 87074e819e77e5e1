"""Factor of safety of an infinite slope: closed forms, landlab's component, and probabilities with known answers."""

import math
import re

import numpy as np
import pytest

from runout import Terrain
from runout.errors import ConfigError
from runout.slopes.choices import Strength
from runout.slopes.drainage import Drainage
from runout.slopes.infinite_slope import factor_of_safety, resolved, stability


def of_plane(slope_deg, strength, area=1000.0):
    """Stability of an inner cell of a plane whose cells drain ``area`` [m2]."""
    z = -10.0 * math.tan(math.radians(slope_deg)) * np.broadcast_to(np.arange(6.0), (6, 6))
    terrain = Terrain.from_array(z, 10.0)
    drained = Drainage(terrain, terrain.elevation, np.full((6, 6), area), np.arange(36).reshape(6, 6))
    found = stability(drained, resolved(strength))
    return [float(m[3, 3]) for m in (found.slope, found.factor, found.probability, found.thickness)]


def test_factor_of_safety_has_its_closed_forms():
    slope, friction = math.radians(30.0), math.tan(math.radians(35.0))
    dry = factor_of_safety(slope, 0.0, friction, 2.0, 0.0, 2000.0)
    assert dry == pytest.approx(friction / math.tan(slope))
    assert factor_of_safety(slope, 0.0, friction, 2.0, 1.0, 2000.0) == pytest.approx(0.5 * dry)
    cohesive = 5000.0 / (2000.0 * 9.81 * 2.0 * math.sin(slope) * math.cos(slope))
    assert factor_of_safety(slope, 5000.0, friction, 2.0, 0.0, 2000.0) == pytest.approx(dry + cohesive)


def test_factor_of_safety_is_that_of_landlab():
    landlab, components = pytest.importorskip("landlab"), pytest.importorskip("landlab.components")
    slope = np.radians([15.0, 28.0, 41.0])
    grid = landlab.RasterModelGrid((3, 5), xy_spacing=10.0)
    fields = {
        "topographic__slope": np.tan(slope),
        "topographic__specific_contributing_area": np.array([50.0, 400.0, 900.0]),
        "soil__transmissivity": np.full(3, 10.0),
        "soil__saturated_hydraulic_conductivity": np.zeros(3),
        "soil__mode_total_cohesion": np.array([2000.0, 4000.0, 6000.0]),
        "soil__minimum_total_cohesion": np.array([1000.0, 2000.0, 3000.0]),
        "soil__maximum_total_cohesion": np.array([3000.0, 8000.0, 9000.0]),
        "soil__internal_friction_angle": np.array([30.0, 33.0, 38.0]),
        "soil__thickness": np.array([1.0, 1.5, 0.8]),
        "soil__density": np.full(3, 2000.0),
    }
    for name, values in fields.items():
        grid.add_full(name, 0.0, at="node")
        grid.at_node[name][6:9] = values
    model = components.LandslideProbability(grid, number_of_iterations=100, g=9.81, seed=3)
    for k, theta in enumerate(slope):
        model.calculate_factor_of_safety(6 + k)
        vertical = model._hs / math.cos(theta)
        ours = factor_of_safety(theta, model._C, np.tan(np.radians(model._phi)), vertical, model._rel_wetness, 2000.0)
        assert ours == pytest.approx(model._FS, rel=1e-5)
        assert (ours <= 1.0).mean() == pytest.approx(model._landslide__probability_of_failure)


def test_probability_is_the_share_of_friction_angles_that_fail():
    strength = Strength(cohesion=(0, 0), friction_angle=(30, 45), soil_thickness=(1, 3), saturation=(0, 0), samples=1024)
    slope, factor, probability, thickness = of_plane(36.0, strength)
    assert math.degrees(slope) == pytest.approx(36.0)
    assert probability == pytest.approx(6.0 / 15.0, abs=0.005)
    assert factor == pytest.approx(math.tan(math.radians(37.5)) / math.tan(math.radians(36.0)), rel=0.01)
    assert thickness == pytest.approx(2.0, rel=0.02)  # it does not matter without cohesion


def test_water_comes_from_drainage_area_and_recharge():
    wet = Strength(cohesion=(0, 0), friction_angle=(40, 40), transmissivity_recharge=(2000, 2000))
    _, dry, _, _ = of_plane(30.0, wet, area=0.0)
    _, half, _, _ = of_plane(30.0, wet, area=5000.0)  # a / (T/R sin) = 500 / (2000 x 0.5)
    _, full, _, _ = of_plane(30.0, wet, area=1e7)
    assert (half / dry, full / dry) == (pytest.approx(0.75, rel=1e-4), pytest.approx(0.5, rel=1e-4))


def test_level_ground_does_not_fail_and_unknown_ground_is_unknown():
    _, factor, probability, thickness = of_plane(0.0, Strength())
    assert (factor, probability, thickness) == (10.0, 0.0, 0.0)
    z = np.zeros((5, 5))
    z[0, 0] = np.nan
    terrain = Terrain.from_array(z, 10.0)
    found = stability(Drainage(terrain, z, np.full((5, 5), 100.0), np.arange(25).reshape(5, 5)), resolved())
    assert np.isnan(found.factor[0, 0])
    assert np.isnan(found.probability).sum() == 1


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"cohesion": (5.0, 1.0)}, "--cohesion: low (5) is not below high (1)"),
        ({"friction_angle": (0.5, 0.7)}, "--friction-angle: 0.7 deg is suspiciously small"),
        ({"soil_thickness": (0.0, 1.0)}, "--soil-thickness: it can give 0 m"),
        ({"saturation": (0.0, 2.0)}, "--saturation: it can give 2"),
        ({"samples": 100}, "--samples: 100 is no power of two"),
    ],
)
def test_values_out_of_range_are_refused(stated, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        resolved(Strength(**stated))
