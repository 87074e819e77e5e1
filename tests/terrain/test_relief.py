"""Relief that a grid cannot carry: what the filter takes out, what it leaves, and that no answer turns on the grid."""

from dataclasses import replace

import numpy as np
import pytest

from runout import DruckerPrager, Release, Terrain, simulate
from runout.errors import InputError
from runout.model import surface
from runout.terrain import relief, sdf

CELL = 5.0


def rough(noise, shape=(120, 160), seed=3):
    """Elevation (rows, columns) [m] of a slope with relief at all wave lengths, and an oscillation of two cells on top."""
    random = np.random.default_rng(seed)
    row, column = np.indices(shape)
    f = np.hypot(np.fft.fftfreq(shape[0], CELL)[:, None], np.fft.fftfreq(shape[1], CELL)[None, :])
    f[0, 0] = 1.0
    waves = np.fft.ifft2(np.fft.fft2(random.standard_normal(shape)) * np.where(f < 1 / 400, 0.0, f**-1.6)).real
    z = 300.0 * np.exp(-column * CELL / 350.0) + 20.0 * ((row - shape[0] / 2) * CELL / 250.0) ** 2
    return z + 2.0 * waves / waves.std() + noise * np.where((row + column) % 2, 1, -1) * random.uniform(0.5, 1.5, shape)


@pytest.mark.parametrize("half_width", [0.05, 0.7, 1.0, 1.41, 2.6, 8.0])
@pytest.mark.parametrize("phase", [0.0, 0.3, 0.5])
def test_planes_pass_the_filter_and_waves_of_two_cells_do_not(half_width, phase):
    """On the cells and on nodes between them; a step gets no lip."""
    n = 60
    places = np.arange(12.0, 40.0) + phase
    plane = 3.0 + 0.7 * np.arange(n)[:, None]
    np.testing.assert_allclose(relief.filtered(plane, half_width, places)[:, 0], 3.0 + 0.7 * places, rtol=0, atol=1e-11)
    wave = np.where(np.arange(n) % 2, 1.0, -1.0)[:, None]
    np.testing.assert_allclose(relief.filtered(wave, half_width, places), 0.0, rtol=0, atol=1e-11)
    step = np.where(np.arange(n) < 25, 0.0, 30.0)[:, None]
    found = relief.filtered(step, half_width, places)[:, 0]
    assert found.min() >= 0.0
    assert found.max() <= 30.0 + 1e-12
    assert (np.diff(found) >= -1e-12).all()


def test_the_filter_goes_on_beyond_the_rim_as_a_plane_does():
    plane = np.arange(20.0)[:, None]
    places = np.array([-3.5, -1.0, 0.0, 19.0, 21.2])
    np.testing.assert_allclose(relief.filtered(plane, 3.0, places)[:, 0], places, rtol=0, atol=1e-11)


@pytest.mark.parametrize("turned", [False, True])
def test_a_straight_channel_is_as_smooth_as_its_section(turned):
    """Plane across its floor, a parabola along it: beyond the window the high bank counts no more."""
    x, row = np.arange(90.0), np.arange(70.0)[:, None]
    channel = 700.0 + 0.0052 * (row - 90.0) ** 2 + np.where(x < 20.0, 35.7 * (20.0 - x), 0.0)
    share = relief.two_cell_share(channel.T if turned else channel)
    share = share.T if turned else share
    assert share[8:-8, 20 + relief.AROUND :].max() < 1e-6
    assert share[:, 18:23].min() > 0.3


@pytest.mark.parametrize("averaged", [(1, 1), (2, 3)])
def test_blocks_of_a_raster_and_shortcuts_on_smooth_ground_change_no_bit(averaged, monkeypatch):
    x = np.arange(330.0)
    hills = 20.0 * np.sin(x[:, None] / 9.0) * np.cos(x[:190] / 11.0)
    for z in (hills, np.round(hills), hills[::-1].T):
        found = []
        for block, many in ((10_000, 0.0), (48, 1.0)):
            monkeypatch.setattr(surface, "BLOCK", block)
            monkeypatch.setattr(surface, "MANY", many)
            ground = surface.Surface.through(z, (5.0, 5.0), averaged=averaged)
            found.append(
                (ground.coefficients, relief.two_cell_share(z), ground.on_nodes((3.0, 4.0), (-1, -1), (150, 140)).coefficients)
            )
        for one, other in zip(*found, strict=True):
            np.testing.assert_array_equal(one, other)


def test_weights_of_both_axes_are_those_of_each(monkeypatch):
    monkeypatch.setattr(relief, "STRIP", 40)
    z = np.random.default_rng(5).normal(size=(23, 17))
    rows, columns = relief.filter_weights(23, 1.7, np.linspace(-2.0, 24.0, 31)), relief.mean_weights(17, 4)
    np.testing.assert_allclose(relief.along_both(rows, z, columns), rows.toarray() @ z @ columns.toarray().T, rtol=0, atol=1e-13)
    np.testing.assert_allclose(columns.toarray()[-1] @ np.arange(17.0), 17.5, rtol=1e-14)  # a plane goes on beyond the rim
    places = np.array([-3.0, 0.0, 4.25, 22.0, 25.0]), np.array([0.5, 16.0])
    expected = 0.75 * z[4] + 0.25 * z[5]
    np.testing.assert_allclose(relief.between(z, places)[2], [0.5 * (expected[0] + expected[1]), expected[16]], rtol=1e-13)
    np.testing.assert_allclose(relief.between(z, places)[[0, 4], 1], z[[0, -1], 16], rtol=1e-14)


def test_sums_over_a_window_repeat_the_outermost_values():
    values = np.random.default_rng(6).normal(size=(9, 3))
    for width in (1, 3, 11):
        rows = np.clip(np.arange(9)[:, None] + np.arange(width) - width // 2, 0, 8)
        np.testing.assert_allclose(relief.window_sums(values, width), values[rows].sum(axis=1), rtol=1e-12, atol=1e-13)


def test_smooth_ground_stays_and_rough_ground_is_filtered():
    x = np.arange(60.0)
    hills = 10 * np.sin(2 * np.pi * x / 20)[:, None] * np.cos(2 * np.pi * x / 16)
    noise = np.random.default_rng(2).normal(0.0, 1.0, hills.shape)
    for resolved in (relief.resolved_in((ratio, ratio), (1.0, 1.0)) for ratio in (0.3, 1.0, 3.0)):
        assert relief.stays(relief.two_cell_share(hills), resolved)[6:-6, 6:-6].min() == 1.0
        assert relief.stays(relief.two_cell_share(hills + 0.8 * noise), resolved)[8:-8, 8:-8].max() < 0.5
        assert relief.stays(relief.two_cell_share(noise), resolved).max() == 0.0


def test_relief_that_the_grid_resolves_stays_where_it_is_that_of_terrain():
    """Waves whose amplitude is the square of their length, as most terrain has; rougher relief is filtered on any grid."""
    random, n = np.random.default_rng(4), 128
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n)))
    f[0, 0] = 1.0
    waves = np.fft.fft2(random.standard_normal((n, n)))
    terrain, rough = (np.fft.ifft2(waves * np.where(f < 0.02, 0.0, f**-power)).real for power in (2.4, 1.0))
    for ratio, least in ((0.5, 0.9), (0.25, 0.9)):
        resolved = relief.resolved_in((ratio, ratio), (1.0, 1.0))
        assert np.mean(relief.stays(relief.two_cell_share(terrain), resolved)) > least
        assert np.mean(relief.stays(relief.two_cell_share(rough), resolved)) < 0.1
    for ratio in (0.7, 1.0, 3.0):
        assert np.mean(relief.stays(relief.two_cell_share(terrain), relief.resolved_in((ratio, 0.1), (1.0, 1.0)))) < 0.2


def test_ground_of_a_coarse_grid_can_keep_the_relief_of_a_fine_one():
    """Natural waves of two cells come back with ``fine_relief``; a grid that resolves them has the same ground either way."""
    natural = np.random.default_rng(4).normal(size=(64, 64)).cumsum(0).cumsum(1)
    terrain = Terrain.from_array(natural, CELL)
    kept, coarse, fine = replace(terrain, fine_relief=1.0), (1.2 * CELL, 1.2 * CELL), (0.5 * CELL, 0.5 * CELL)
    grounds = [sdf.raster_surface(one, None, coarse).coefficients for one in (terrain, replace(terrain, fine_relief=0.0), kept)]
    np.testing.assert_array_equal(grounds[0], grounds[1])
    assert np.abs(grounds[2] - grounds[0]).max() > 0.1
    np.testing.assert_array_equal(*(sdf.sliding_surface(one, None, fine).surface.coefficients for one in (terrain, kept)))


def test_relief_of_the_ground_does_not_turn_on_the_ratio_of_cell_and_raster():
    """Root mean square slope of the relief below 8 cells, on grids of 0.7 to 4 cells: it falls with the cell, a tenth at most."""
    terrain = Terrain.from_array(rough(1.0), CELL)
    places = np.random.default_rng(1).uniform(100, 500, (2, 4000))
    slopes = []
    for ratio in np.geomspace(4.0, 0.7, 19):
        surface = sdf.sliding_surface(terrain, None, (ratio * CELL, ratio * CELL))
        _, east, north = surface.evaluate(*places)
        _, even_east, even_north = sdf.sliding_surface(terrain, None, (8 * CELL, 8 * CELL)).evaluate(*places)
        slopes.append(np.sqrt(np.mean((east - even_east) ** 2 + (north - even_north) ** 2)))
    growth = np.diff(np.log(slopes))
    assert growth.min() > -0.01
    assert growth.max() < 0.12


@pytest.mark.parametrize("ratio", [1.0, 1.6, 3.3])
def test_relief_of_the_ground_does_not_turn_on_the_place_of_the_grid(ratio):
    z, places = rough(1.0), np.random.default_rng(1).uniform(150, 450, (2, 4000))
    slopes = []
    for offset in range(4):  # columns and rows that the raster has more, west and south
        terrain = Terrain.from_array(z[: z.shape[0] - offset, offset:], CELL)
        surface = sdf.sliding_surface(terrain, None, (ratio * CELL, ratio * CELL))
        slopes.append(np.std(surface.evaluate(*(places - offset * CELL))[1]))
    assert np.ptp(slopes) < 0.01 * np.mean(slopes)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_run_out_does_not_turn_on_the_ratio_of_cell_and_raster(noise):
    """Centre of the deposit from the release on, cells of 4 to 1.4 raster cells. With whole raster cells averaged it halves."""
    terrain = Terrain.from_array(rough(noise), CELL)
    thickness = np.zeros(terrain.shape)
    thickness[48:72, 10:34] = 12.0
    release = Release.from_array(thickness, terrain, placement="on_surface")
    sand, x, found = DruckerPrager(density=2000.0, friction_angle=32.0), (np.arange(160) + 0.5) * CELL, []
    for ratio in (4.0, 3.4, 2.83, 2.4, 2.0, 1.7, 1.4):
        run = {"basal_friction_angle": 18.0, "cell_size": ratio * CELL, "end_time": 40.0, "threads": 1}
        deposit = np.nan_to_num(simulate(terrain, release, sand, **run).maps.deposit_thickness.values)
        found.append((deposit.sum(0) * x).sum() / deposit.sum() - 110.0)
    ratio = np.array(found[1:]) / found[:-1]
    assert ratio.min() > 0.95
    assert ratio.max() < 1.03


@pytest.mark.parametrize("cell", [5.0, (5.0, 8.0)])
def test_smoothing_keeps_planes_and_unknown_cells(cell):
    """An unknown cell stays one, takes no other with it, and its neighbours do not know of it."""
    row, column = np.indices((40, 50))
    plane = 900.0 - 2.0 * column + 1.3 * row
    plane[18:22, 30:33] = plane[0, :7] = np.nan
    smooth = Terrain.from_array(plane, cell).smoothed(22.0)
    np.testing.assert_allclose(smooth.elevation, plane, rtol=0, atol=1e-9)
    assert smooth.changes == ("averaged over a triangle of half-width 22 m along both axes (smoothing)",)


def test_smoothing_keeps_the_volume_of_a_hill_and_takes_waves_of_two_cells_out():
    z = np.zeros((41, 61))
    z[20, 30] = 8.0
    hill = Terrain.from_array(z, 5.0).smoothed(20.0).elevation
    assert hill.sum() == pytest.approx(8.0)
    assert hill.max() < 0.6
    smooth = Terrain.from_array(rough(1.0), CELL).smoothed(CELL)
    even = Terrain.from_array(rough(0.0), CELL).smoothed(CELL)
    assert np.std(smooth.elevation - even.elevation) < 0.2


@pytest.mark.parametrize(
    ("length", "said"), [(2.5, "averages nothing"), (210.0, "more than a third"), (-1.0, "above 0"), (np.nan, "nan")]
)
def test_smoothing_refuses_other_lengths(length, said):
    with pytest.raises(InputError, match=said):
        Terrain.from_array(rough(0.0), CELL).smoothed(length)
