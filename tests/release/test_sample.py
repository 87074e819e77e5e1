"""Particles of releases: mass, place and layering."""

import subprocess
import sys
import time

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from runout.backends.resting_particles import sample_particles
from runout.errors import ConfigError, ReleaseError
from runout.materials.drucker_prager import DruckerPrager
from runout.model.release import Release
from runout.model.surface import Surface
from runout.model.terrain import Terrain
from runout.release.columns import Columns, column_thickness
from runout.release.sample import particles_per_axis

TRIANGLE = shapely.Polygon([(31.3, 22.7), (131.3, 22.7), (72.9, 122.7)])
RING = shapely.box(40.0, 40.0, 140.0, 120.0).difference(shapely.box(61.7, 58.3, 99.1, 101.9))


def slope(terrain, east=0.3, north=-0.2):
    """Surface of an inclined plane."""
    x, y = np.arange(61) * 5.0, np.arange(41) * 5.0
    return Surface.through(10.0 + east * x[:, None] + north * y, (5.0, 5.0))


def of_polygon(polygon, terrain, thickness):
    """Release of a polygon in local metres."""
    from runout.release.read import _on_cells

    outline = shapely.transform(polygon, terrain.frame.to_map)
    return Release(_on_cells(np.array([outline]), np.array([thickness]), terrain), terrain, outline)


@pytest.mark.parametrize("outline", [TRIANGLE, RING], ids=["triangle", "ring"])
@pytest.mark.parametrize("size", [(1.0, 1.0), (3.7, 2.3), (5.0, 5.0), (23.0, 17.0)])
def test_column_thickness_is_exact_in_the_outline(terrain, outline, size):
    edges = np.arange(-1, 305.0 / size[0] + 2) * size[0], np.arange(-1, 205.0 / size[1] + 2) * size[1]
    release = of_polygon(outline, terrain, 7.0)
    columns = column_thickness(release, *edges)
    area = np.outer(np.diff(edges[0]), np.diff(edges[1]))
    assert (columns * area).sum() == pytest.approx(release.volume, rel=1e-12)
    west, south = np.meshgrid(edges[0][:-1], edges[1][:-1], indexing="ij")
    exact = 7.0 * shapely.area(shapely.intersection(shapely.box(west, south, west + size[0], south + size[1]), outline)) / area
    np.testing.assert_allclose(columns, exact, atol=1e-6)  # the outline itself is rounded at 4 000 000 m


def test_column_thickness_of_an_array_is_that_of_its_cells(terrain):
    values = np.zeros(terrain.shape)
    values[10, 20] = 6.0  # local 100 to 105 m east, 145 to 150 m north
    release = Release(values, terrain)
    fine = column_thickness(release, np.arange(97.5, 110.1, 2.5), np.arange(142.5, 155.1, 2.5))
    expected = np.zeros((5, 5))
    expected[1:3, 1:3] = 6.0
    np.testing.assert_allclose(fine, expected, atol=1e-12)
    whole = column_thickness(release, np.array([90.0, 110.0]), np.array([140.0, 160.0]))
    assert whole[0, 0] == pytest.approx(6.0 * 25.0 / 400.0, rel=1e-12)


def test_particles_of_columns_hold_the_volume_and_films_get_none(terrain):
    values = np.zeros(terrain.shape)
    values[10, 20:24] = (
        6.0,
        9.0,
        1.3e-6,
        0.9e-6,
    )  # columns of two by one cells: that of the row below is thinner than a millionth of a layer
    values[12, 20:22] = 0.99e-6
    columns = Columns.of(Release(values, terrain), (10.0, 5.0), 1.0)
    assert len(columns) == 2
    assert columns.thickness == pytest.approx([7.5, 1.1e-6])
    assert columns.rows.tolist() == [8, 1]
    assert columns.volumes == pytest.approx([7.5 * 50.0 / 8, 55e-6])
    with pytest.raises(ReleaseError, match=r"is thinner than 0.001 m everywhere; check the unit"):
        Columns.of(Release(np.minimum(values, 9e-4), terrain), (10.0, 5.0), 1e3)


def test_lattice_that_misses_a_part_of_the_release_is_refused(terrain):
    release = of_polygon(TRIANGLE, terrain, 2.0)
    with pytest.raises(ReleaseError, match=r"the lattice holds .* make the lattice larger"):
        column_thickness(release, np.arange(60.0, 200.0, 5.0), np.arange(0.0, 200.0, 5.0))


@given(
    st.floats(0.05, 60.0), st.floats(2.0, 15.0), st.floats(2.0, 15.0), st.floats(0.5, 15.0), st.integers(1, 27), st.floats(0.0, 0.5)
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_mass_and_volume_are_exact_for_any_grid(thickness, dx, dy, dz, per_cell, jitter):
    terrain = Terrain(np.full((40, 60), 100.0), (5.0, 5.0))
    release = of_polygon(TRIANGLE, terrain, thickness)
    material = DruckerPrager(density=1873.0, youngs_modulus=1e6, friction_angle=30.0)
    particles = sample_particles([release], [material], slope(terrain), (dx, dy, dz), per_cell, seed=3, jitter=jitter)
    assert particles.volume.sum() == pytest.approx(release.volume, rel=1e-12)
    assert particles.mass.sum() == pytest.approx(1873.0 * 5000.0 * thickness, rel=1e-12)
    assert particles.volume.min() > 0
    plan = particles.position((dx, dy, dz))[:, :2]
    assert shapely.dwithin(TRIANGLE, shapely.points(plan), 1e-6).all()


def test_particles_stay_out_of_the_hole_and_keep_the_mass_centre(terrain, material):
    release = of_polygon(RING, terrain, 5.0)
    particles = sample_particles([release], [material], slope(terrain), (4.0, 4.0, 4.0), 8, seed=1, jitter=0.0)
    plan = particles.position((4.0, 4.0, 4.0))[:, :2]
    assert shapely.dwithin(RING, shapely.points(plan), 1e-6).all()
    centre = (plan * particles.volume[:, None]).sum(0) / particles.volume.sum()
    assert centre == pytest.approx(RING.centroid.coords[0], abs=1e-5)


def test_rows_follow_the_surface_and_share_the_thickness_evenly(terrain, material):
    release = of_polygon(shapely.box(50.0, 50.0, 100.0, 100.0), terrain, 9.0)
    surface = slope(terrain)
    spacing = np.array([5.0, 5.0, 4.0])
    particles = sample_particles([release], [material], surface, tuple(spacing), (2, 2, 2), seed=1)
    x, y, z = particles.position(spacing).T
    ground = surface.elevation(x, y)
    assert len(particles) == 20 * 20 * 5  # 4.5 layers: half goes up
    levels = (np.arange(20) + 0.5) / 4  # four in each layer
    found, count = np.unique(np.round((z - ground) / 9.0 * 5, 6), return_counts=True)
    np.testing.assert_allclose(found, levels)
    assert (count == 100).all()
    np.testing.assert_allclose(particles.radius, 0.225 / np.sqrt(1 + 0.3**2 + 0.2**2), rtol=1e-9)
    np.testing.assert_allclose(particles.volume, 2.5 * 2.5 * 9.0 / 5, rtol=1e-9)
    assert not particles.velocity.any()
    assert not particles.strain.any()


def test_thin_release_has_one_particle_a_column(terrain, material):
    release = of_polygon(shapely.box(50.0, 50.0, 100.0, 100.0), terrain, 0.3)
    particles = sample_particles([release], [material], slope(terrain), (5.0, 5.0, 5.0), 8)
    assert len(particles) == 20 * 20
    np.testing.assert_allclose(particles.radius, 0.0375 / np.sqrt(1.13), rtol=1e-9)


@pytest.mark.parametrize("per_cell", [4, 8, (2, 2, 4), (1, 1, 8)])
@pytest.mark.parametrize("thickness", [0.7, 3.0, 9.3])
def test_staggered_columns_keep_the_height_of_the_mass_and_the_lowest_touches_the_ground(terrain, material, per_cell, thickness):
    release = of_polygon(shapely.box(40.0, 40.0, 120.0, 120.0), terrain, thickness)
    surface, spacing = slope(terrain), np.array([5.0, 5.0, 2.0])
    particles = sample_particles([release], [material], surface, tuple(spacing), per_cell, jitter=0.0)
    x, y, z = particles.position(spacing).T
    above = z - surface.elevation(x, y)
    assert (above * particles.volume).sum() / particles.volume.sum() == pytest.approx(thickness / 2, rel=1e-9)
    gap = above / np.sqrt(1.13) - particles.radius
    assert gap.min() == pytest.approx(0.0, abs=1e-9)
    at_ground = np.unique(np.floor(np.column_stack((x, y)) / spacing[:2] / 2)[gap < 1e-9], axis=0)  # boxes of two by two cells
    assert len(at_ground) == 64


def test_seed_decides_the_jitter_and_nothing_else(terrain, material):
    release, surface, spacing = of_polygon(TRIANGLE, terrain, 5.0), slope(terrain), (4.0, 4.0, 4.0)
    first, again, other = (sample_particles([release], [material], surface, spacing, 8, seed=s) for s in (5, 5, 6))
    np.testing.assert_array_equal(first.position(spacing), again.position(spacing))
    assert not np.array_equal(first.offset, other.offset)
    np.testing.assert_array_equal(first.mass, other.mass)


def test_jitter_moves_no_particle_farther_than_stated(terrain, material):
    release, surface, spacing = of_polygon(shapely.box(40, 40, 120, 120), terrain, 5.0), slope(terrain), (4.0, 4.0, 4.0)
    still = sample_particles([release], [material], surface, spacing, 8, jitter=0.0).position(spacing)
    moved = sample_particles([release], [material], surface, spacing, 8, jitter=0.25).position(spacing)
    shift = np.abs(moved - still)[:, :2]
    assert 0.49 < shift.max() <= 0.5 + 1e-9
    assert shift.mean() == pytest.approx(0.25, rel=0.05)


def test_several_releases_keep_their_density_and_index(terrain, material):
    light = DruckerPrager(density=1000.0, youngs_modulus=5e6, friction_angle=30.0)
    pair = [of_polygon(shapely.box(10, 10, 60, 60), terrain, 4.0), of_polygon(shapely.box(60, 10, 87.3, 60), terrain, 8.0)]
    particles = sample_particles(pair, [material, light], slope(terrain), (5.0, 5.0, 5.0))
    masses = np.bincount(particles.release, particles.mass)
    assert masses == pytest.approx([2000.0 * 50 * 50 * 4.0, 1000.0 * 27.3 * 50 * 8.0], rel=1e-9)
    np.testing.assert_array_equal(particles.identity, np.arange(len(particles)))


def test_releases_that_overlap_are_refused(terrain, material):
    square = of_polygon(shapely.box(10, 10, 60, 60), terrain, 4.0)
    shifted = of_polygon(shapely.box(50, 10, 100, 60), terrain, 4.0)
    with pytest.raises(ReleaseError, match="overlap by 500 m2"):
        sample_particles([square, shifted], [material] * 2, slope(terrain), (5.0, 5.0, 5.0))
    cells = Release(shifted.thickness, terrain, name="pile")
    for pair in ([square, cells], [cells, square], [cells, cells]):
        with pytest.raises(ReleaseError, match="overlap by"):
            sample_particles(pair, [material] * 2, slope(terrain), (5.0, 5.0, 5.0))


def test_cell_larger_than_the_release_is_refused_with_one_that_would_do(terrain, material):
    release = of_polygon(shapely.box(50.0, 50.0, 62.0, 62.0), terrain, 2.0)
    with pytest.raises(ReleaseError, match=r"covers 144 m2, less than one grid cell of 20 m x 20 m.*cell_size of 3 m or less"):
        sample_particles([release], [material], slope(terrain), (20.0, 20.0, 20.0))
    assert len(sample_particles([release], [material], slope(terrain), (3.0, 3.0, 3.0))) > 50


@pytest.mark.parametrize(
    ("number", "axes"), [(1, (1, 1, 1)), (2, (1, 1, 2)), (4, (2, 2, 1)), (8, (2, 2, 2)), (12, (2, 2, 3)), (27, (3, 3, 3))]
)
def test_particles_per_cell_are_factorised_evenly(number, axes):
    assert particles_per_axis(number) == axes


@pytest.mark.parametrize("wrong", [0, -8, (2, 2), (2, 0, 2)])
def test_unusable_particles_per_cell_are_refused(wrong):
    with pytest.raises(ConfigError, match="particles_per_cell"):
        particles_per_axis(wrong)


def test_half_a_million_particles_take_seconds(terrain, material):
    release = of_polygon(RING, terrain, 20.0)
    start = time.process_time()
    particles = sample_particles([release], [material], slope(terrain), (1.3, 1.3, 1.0), 8)
    assert len(particles) > 500_000
    assert time.process_time() - start < 5.0


def test_release_thinner_than_any_particle_is_refused(terrain, material):
    release = of_polygon(TRIANGLE, terrain, 1e-4)
    with pytest.raises(ReleaseError, match="check the unit"):
        sample_particles([release], [material], slope(terrain), (5.0, 5.0, 400.0))


def test_sampling_an_array_needs_no_library_of_the_edges():
    code = (
        "import sys, numpy as np; from runout.model.terrain import Terrain; from runout.model.release import Release; "
        "from runout.model.surface import Surface; from runout.materials.elastic import Elastic; "
        "from runout.backends.resting_particles import sample_particles; "
        "r = Release(np.ones((4, 4)), Terrain(np.ones((4, 4)), (5.0, 5.0))); s = Surface.through(np.zeros((5, 5)), (5.0, 5.0)); "
        "assert len(sample_particles([r], [Elastic(density=1e3, youngs_modulus=1e6)], s, (5.0, 5.0, 1.0))) == 128; "
        "print([m for m in ('shapely', 'geopandas', 'rasterio', 'pyproj', 'pandas') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


@pytest.mark.parametrize(("thickness", "rows"), [(0.4, 1), (2.9, 1), (3.0, 2), (4.9, 2), (5.0, 3), (9.0, 5)])
def test_particles_of_a_column_stand_as_far_apart_as_they_are_high(terrain, material, thickness, rows):
    """Cells of 4 m with two layers: half a layer of 2 m more makes another row, and rows share the thickness evenly."""
    release, spacing = of_polygon(shapely.box(50.0, 50.0, 60.0, 60.0), terrain, thickness), (5.0, 5.0, 4.0)
    particles = sample_particles([release], [material], slope(terrain, 0.0, 0.0), spacing, (2, 2, 2), jitter=0.0)
    x, y, z = particles.position(spacing).T
    columns = [np.sort(z[(x == east) & (y == north)]) - 10.0 for east, north in np.unique(np.column_stack((x, y)), axis=0)]
    assert {len(column) for column in columns} == {rows}
    for column in columns:
        np.testing.assert_allclose(np.diff(column), thickness / rows, rtol=1e-6)
        assert 0.0 < column[0] < thickness / rows
        assert column[-1] < thickness


def test_a_column_of_a_millionth_of_a_layer_gets_no_particle_and_the_others_its_volume(terrain, material):
    """Layers of 2 m: 3 micrometres are filled, 1.5 are not."""
    for trace, filled in ((3.0e-6, 2), (1.5e-6, 1)):
        thickness = np.zeros(terrain.shape)
        thickness[20, 30], thickness[20, 31] = 6.0, trace
        release = Release(thickness, terrain)
        particles = sample_particles([release], [material], slope(terrain), (5.0, 5.0, 4.0), (1, 1, 2))
        assert len(np.unique(particles.position((5.0, 5.0, 4.0))[:, 0] // 5.0)) == filled
        assert particles.volume.sum() == pytest.approx(release.volume, rel=1e-12)


def test_pressing_gets_the_depth_below_the_top_of_its_release_and_the_number(terrain, material):
    pair = [of_polygon(shapely.box(10, 10, 60, 60), terrain, 4.0), of_polygon(shapely.box(70, 10, 120, 60), terrain, 8.0)]
    pressed = []
    level = slope(terrain, 0.0, 0.0)
    sample_particles(pair, [material] * 2, level, (5.0, 5.0, 5.0), press=lambda *given: pressed.append(given))
    assert [number for _, _, number in pressed] == [0, 1]
    for (particles, depth, _), thickness in zip(pressed, (4.0, 8.0), strict=True):
        np.testing.assert_allclose(depth, 10.0 + thickness - particles.position((5.0, 5.0, 5.0))[:, 2], rtol=1e-6)


@pytest.mark.parametrize(
    ("changed", "says"),
    [({"jitter": -0.01}, "jitter"), ({"jitter": 0.51}, "jitter"), ({"seed": -1}, "seed"), ({"seed": 0.5}, "seed")]
    + [({"particles_per_cell": n}, "particles_per_cell") for n in (0, 1001, (2, 2), (2, 0, 2), (2, 2.0, 2))],
)
def test_sampling_refuses_what_it_cannot_do(terrain, material, changed, says):
    release = of_polygon(TRIANGLE, terrain, 5.0)
    with pytest.raises(ConfigError, match=says):
        sample_particles([release], [material], slope(terrain), (5.0, 5.0, 5.0), **changed)
    with pytest.raises(ConfigError, match="2 materials for 1 releases"):
        sample_particles([release], [material] * 2, slope(terrain), (5.0, 5.0, 5.0))


@pytest.mark.parametrize("spacing", [(20.0, 5.0, 2.0), (5.0, 20.0, 2.0)])
def test_a_release_as_large_as_a_cell_that_is_not_square_is_sampled_and_a_smaller_one_refused(terrain, material, spacing):
    enough, short = (of_polygon(shapely.box(50.0, 50.0, 60.0, north), terrain, 2.0) for north in (60.1, 59.5))
    assert len(sample_particles([enough], [material], slope(terrain), spacing)) > 0
    with pytest.raises(ReleaseError, match="covers 95 m2, less than one grid cell"):
        sample_particles([short], [material], slope(terrain), spacing)
