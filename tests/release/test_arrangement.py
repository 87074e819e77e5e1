"""Particles of a cell where none are stated: what thins gets four above each other, what level ground holds does not."""

from dataclasses import replace

import numpy as np
import pytest

from runout import Release, Terrain
from runout.backends.resting_particles import sample_particles
from runout.materials.drucker_prager import DruckerPrager
from runout.materials.elastic import Elastic
from runout.materials.granular_flow import GranularFlow
from runout.model.friction import FrictionZones
from runout.model.limits import PARTICLES_PER_CELL
from runout.model.surface import Surface
from runout.release.arrangement import LEVEL, default_particles, particles_for

SAND = DruckerPrager(density=2000.0, youngs_modulus=8e6, friction_angle=30.0)
CELL, SIDE, DEPTH = 2.0, 40, 10.0  # [m], cells of the raster, thickness of the mass [m]
ANGLE = np.radians(25.0)


def mass(ground: np.ndarray, placement: str = "on_surface") -> list[Release]:
    """A square mass of :data:`DEPTH` in the middle of a raster."""
    thickness = np.zeros((SIDE, SIDE))
    thickness[15:25, 15:25] = DEPTH
    return [Release.from_array(thickness, Terrain.from_array(ground, CELL), placement=placement)]


def sloping(slope: float) -> np.ndarray:
    return np.tile(np.arange(SIDE) * CELL * slope, (SIDE, 1))


LEVEL_MASS = mass(sloping(0.0))


@pytest.mark.parametrize(("height", "found"), [(0.5, LEVEL), (2.0, LEVEL), (2.5, PARTICLES_PER_CELL), (20.0, PARTICLES_PER_CELL)])
def test_five_cells_on_level_ground_are_thick(height, found):
    assert default_particles(LEVEL_MASS, SAND, ANGLE, height) == found


@pytest.mark.parametrize(("slope", "found"), [(0.2, LEVEL), (0.25, PARTICLES_PER_CELL), (-0.25, PARTICLES_PER_CELL)])
def test_friction_holds_what_lies_on_less_than_half_its_slope(slope, found):
    assert default_particles(mass(sloping(slope)), SAND, ANGLE, 1.0) == found


def test_ground_counts_where_the_mass_can_come():
    near, far = sloping(0.0), sloping(0.0)
    near[:, 30:] = -5.0  # 10 m beside it
    assert default_particles(mass(near), SAND, ANGLE, 1.0) == PARTICLES_PER_CELL
    far[:, 38:] = -5.0  # 26 m beside it, out of reach at 25 degrees from 10 m above
    assert default_particles(mass(far), SAND, ANGLE, 1.0) == LEVEL
    assert default_particles(mass(far), SAND, np.radians(15.0), 1.0) == PARTICLES_PER_CELL


def test_the_least_friction_counts_of_ground_zones_and_mass():
    slope = mass(sloping(0.1))
    weak = replace(SAND, friction_angle=10.0, cohesion=1e3)
    assert default_particles(slope, SAND, ANGLE, 1.0) == LEVEL
    assert default_particles(slope, weak, ANGLE, 1.0) == PARTICLES_PER_CELL
    assert default_particles([replace(slope[0], material=SAND)], weak, ANGLE, 1.0) == LEVEL
    assert default_particles([replace(slope[0], basal_friction_angle=0.1)], SAND, ANGLE, 1.0) == PARTICLES_PER_CELL
    ice = FrictionZones(np.ones((SIDE, SIDE)), np.zeros((SIDE, SIDE)), (CELL, CELL))
    ice.factor[0, 0] = 0.2
    assert default_particles(slope, SAND, ANGLE, 1.0, ice) == PARTICLES_PER_CELL
    elastic = Elastic(density=2000.0, youngs_modulus=8e6)
    assert default_particles(slope, elastic, ANGLE, 1.0) == LEVEL
    assert default_particles(LEVEL_MASS, elastic, 0.0, 1.0) == PARTICLES_PER_CELL  # nothing holds it
    creeping = GranularFlow(density=2000.0, youngs_modulus=8e6, static_friction=0.1, dynamic_friction=0.6, grain_size=1e-3)
    assert default_particles(slope, creeping, ANGLE, 1.0) == PARTICLES_PER_CELL


def test_a_hollow_that_the_mass_leaves_is_steep():
    assert default_particles(mass(sloping(0.0), "excavated"), SAND, ANGLE, 1.0) == PARTICLES_PER_CELL


def test_the_thinnest_release_counts():
    thin = replace(LEVEL_MASS[0], thickness=0.2 * LEVEL_MASS[0].thickness)
    assert default_particles([*LEVEL_MASS, thin], SAND, ANGLE, 1.0) == PARTICLES_PER_CELL


@pytest.mark.parametrize(("height", "levels"), [(20.0, 4), (21.0, 9), (40.0, 16), (1000.0, 32)])
def test_masses_thinner_than_half_a_cell_get_four_levels_through_their_thickness(height, levels):
    assert default_particles(LEVEL_MASS, SAND, ANGLE, height) == (2, 2, levels)  # of 10 m


def test_levels_in_a_thin_slab_are_filled_with_its_mass():
    """Four levels of particles lie in a slab of a third of a cell, with its exact mass."""
    slab = replace(LEVEL_MASS[0], thickness=0.1 * LEVEL_MASS[0].thickness)  # 1 m
    count = default_particles([slab], SAND, ANGLE, 3.0)
    level = Surface.through(np.zeros((SIDE, SIDE)), (CELL, CELL))
    found = sample_particles([slab], [SAND], level, spacing=(4.0, 4.0, 3.0), particles_per_cell=count)
    assert count == (2, 2, 12)
    assert found.mass.sum() == pytest.approx(SAND.density * slab.volume, rel=1e-12)
    column = np.unique(np.floor(found.position(np.array((4.0, 4.0, 3.0)))[:, :2] / 2.0), axis=0, return_counts=True)[1]
    assert np.median(column) == 4


def test_fluids_thin_on_any_ground():
    assert particles_for(20.0, 0.0, 0.0) == PARTICLES_PER_CELL
    assert particles_for(20.0, 0.0, 0.1) == LEVEL
