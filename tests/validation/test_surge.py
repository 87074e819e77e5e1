"""Pressure along a flow over the hydrostatic one, its length, and friction of the whole column."""

from types import SimpleNamespace

import numpy as np
import pytest

from docs.pages.iseesnow_terms import stretch
from runout import DruckerPrager, Terrain
from runout.studies.validation_cases.iseesnow import pressures_along
from tests.benchmarks import whole_column

SNOW, MODULUS, ANGLE, THICKNESS = DruckerPrager(density=200.0, friction_angle=30.0), 1e6, np.radians(34.0), 2.0


def layer(along):
    """A layer of particles on a plane that falls to the east, with a pressure [Pa] along it and none across or through it."""
    terrain = Terrain(np.broadcast_to(500.0 - np.tan(ANGLE) * (np.arange(40) + 0.5) * 5.0, (20, 40)), (5.0, 5.0))
    east, north = (n.ravel() + 0.5 for n in np.meshgrid(np.arange(200.0), np.arange(100.0)))
    poisson = SNOW.poisson_ratio
    direction = np.array([np.cos(ANGLE), 0.0, -np.sin(ANGLE)])
    line = np.outer(direction, direction)
    small = -along / MODULUS * ((1 + poisson) * line - poisson * np.eye(3))
    strain = 2 * np.array([small[0, 0], small[1, 1], small[2, 2], small[0, 1], small[1, 2], small[2, 0]])
    state = SimpleNamespace(strain=np.tile(strain, (len(east), 1)), mass=np.full(len(east), SNOW.density * THICKNESS))
    particles = {"easting": SimpleNamespace(values=east), "northing": SimpleNamespace(values=north)}
    return SimpleNamespace(state=state, particles=particles, terrain=terrain, start={"youngs_modulus": (MODULUS,)})


def test_pressure_along_a_plane_is_that_of_the_strain_over_that_of_the_depth():
    hydrostatic = SNOW.density * 9.80665 * THICKNESS * np.cos(ANGLE) ** 2 / 2
    found = pressures_along(layer(0.7 * hydrostatic), SNOW, np.full((20, 40), ANGLE))
    assert found == pytest.approx((0.7, 0.7), rel=1e-2)


def test_length_holds_nine_tenths_of_the_volume():
    thickness = np.ones((3, 100))
    thickness[:, 60:] = 0.0
    assert stretch(thickness, np.arange(100.0)) == pytest.approx(0.9 * 60.0)


def test_friction_of_the_whole_column_resists_as_voellmy_friction_does():
    normal, slip, area, dt, basal = 50.0, 10.0, 2.0, 0.01, SimpleNamespace(mu=0.4, drag=1.5)
    steady, drag = whole_column.resistance(normal, slip, area, dt, basal)
    assert steady == 0.0
    assert drag * slip**2 * dt == pytest.approx(basal.mu * normal + area * basal.drag * slip**2 * dt)
