"""What the grid resolves: numbers of the formulas of numerical viscosity, footprints and the smallest feature."""

import math

import pytest

from runout.physics import contact, timestep
from runout.physics import numerical_scales as resolution


def test_numerical_viscosity_falls_with_the_square_of_the_cells_a_wave():
    assert resolution.numerical_viscosity(2.0, 8.0, 0.01) == pytest.approx(0.95 * (2 / 8) ** 2 * 4 / 0.01)


def test_a_wave_decays_by_its_wave_number_squared():
    assert resolution.decay_time(0.5, 4.0) == pytest.approx(1 / (0.5 * (2 * math.pi / 4) ** 2))
    assert resolution.shear_wave_length(3.0) == 12.0


def test_a_footprint_grows_until_enough_particles_share_each_place_and_no_farther():
    assert resolution.footprint_area(2.0, 8.0, 9.0) == 4.0
    assert resolution.footprint_area(20.0, 8.0, 9.0) == 1.0
    assert resolution.footprint_area(0.1, 8.0, 9.0) == 9.0
    assert resolution.smoothed_area(3.0) == 10.0


def test_a_quarter_of_a_particle_covers_a_cell():
    assert resolution.covered_part(0.125, 1.0) == 0.5
    assert resolution.covered_part(0.25, 1.0) == resolution.covered_part(0.7, 1.0) == 1.0


def test_two_footprints_share_a_mass_so_that_its_mean_area_is_kept():
    part = resolution.part_beyond(5.0, 2.0, 8.0)
    assert part * 8.0 + (1 - part) * 2.0 == pytest.approx(5.0)
    assert resolution.part_beyond(1.0, 2.0, 8.0) == 0.0
    assert resolution.part_beyond(9.0, 2.0, 8.0) == 1.0


def test_four_particles_on_six_and_a_quarter_cells_are_a_flow_and_two_are_single_particles():
    parts = [resolution.flowing_part(count / 6.25, 4.0) for count in (0.0, 1.0, 2.0, 3.0, 4.0, 50.0)]
    assert parts == pytest.approx([0.0, 0.0, 0.0, 0.5, 1.0, 1.0])
    least = resolution.least_thickness(1000.0 / 16.0, 100.0, 4.0)  # 16 particles in a cube of 10 m
    assert least == pytest.approx(0.04 * 10.0)
    assert resolution.flowing_part(least * 100.0 / (1000.0 / 16.0), 4.0) == pytest.approx(1.0)


def test_shares_of_the_footprints_keep_volume_and_mass():
    assert resolution.extent_count(50.0, 1.0) == pytest.approx(2.0)
    assert resolution.depth_count(81.0, 0.5) == pytest.approx(2.0)
    for count in (0.5, 1.0, 2.0, 3.0, 50.0):
        one, three, five = resolution.extent_parts(3.0, count, 4.0, 1.0, 3.25, 7.25)
        assert one + 9 * three + 25 * five == pytest.approx(3.0)
        scales = resolution.depth_scales(count, 16.0, 3.25, 7.25, 21.25, 9.0, 20.0, 70.0)
        assert sum(scale * covered for scale, covered in zip(scales, (9.0, 20.0, 70.0), strict=True)) == pytest.approx(1.0)


def test_smallest_feature_is_two_cells_of_the_coarser_of_grid_and_raster():
    assert resolution.smallest_feature(2.0, 5.0) == 10.0
    assert resolution.smallest_feature(5.0, 2.0) == 10.0


@pytest.mark.parametrize("nu", [0.0, 0.2, 0.4])
def test_an_isolated_particle_is_stable_below_the_limit_of_its_own_oscillation(nu):
    lam, mu = nu / ((1 + nu) * (1 - 2 * nu)), 0.5 / (1 + nu)
    assert timestep.isolated_limit(lam, mu) == pytest.approx(math.sqrt((1 - nu) / (1 + nu)))


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.0, 1.5])
def test_a_zone_multiplies_friction_also_below_one_and_adds_its_own(factor):
    assert contact.zone_friction(0.4, factor, 0.0) == pytest.approx(0.4 * factor)
    assert contact.zone_friction(0.4, factor, 0.25) == pytest.approx(0.4 * factor + 0.25)


def test_beyond_its_reach_a_particle_is_not_in_contact_whatever_its_direction():
    radius, speed, dt, band = 0.5, 8.0, 0.01, 0.002
    reach = contact.reach(radius, speed, dt, band)
    assert not contact.in_contact(reach - radius, -speed, dt, band)
    assert reach == pytest.approx(radius + band + dt * speed, rel=1e-3)


def test_approach_speed_bounds_that_on_every_slope_within_the_range():
    assert contact.approach_speed((0.0, 0.0, -3.0), 0.5, 0.5, 0.0, 0.0) == 3.0
    assert contact.approach_speed((0.0, 0.0, 3.0), 0.5, 0.5, 0.1, 0.1) == 0.0
    assert contact.approach_speed((2.0, -1.0, -3.0), 0.5, 0.25, 0.1, 0.2) == pytest.approx(1.0 - 0.25 + 3.0 + 0.2 + 0.2)


def test_work_is_the_impulse_times_the_mean_velocity():
    push, begun, before, u = (1.0, 2.0, 3.0), (0.5, 0.25, 1.0), (0.1, -0.2, -0.3), (0.4, 0.5, -0.6)
    after = [a + 0.5 * (p - b) for a, p, b in zip(u, push, begun, strict=True)]
    exact = sum(p * (v + w) / 2 for p, v, w in zip(push, before, after, strict=True))
    assert contact.work(push, begun, before, u, 0.5) == pytest.approx(exact)
