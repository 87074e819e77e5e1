"""What is said of relief: its size, what it costs a flow, and whether the raster oscillates."""

import math

import numpy as np
import pytest
from scipy import ndimage

from runout import DruckerPrager, Release, Terrain, simulate
from runout.model.scene import STANDARD_GRAVITY
from runout.physics.numerical_scales import relief_friction
from runout.terrain import roughness

CELL = 5.0
REAL = {
    "frank_slide": "frank_slide_1903/Frankslide_topography.asc",
    "cascades_2021": "cascades_2021_landlab/pre_runout_DEM.asc",
    "avaKot": "avaframe/avaKot/Inputs/avaKot.asc",
    "avaPfa": "avaframe/avaPfa/Inputs/avaPfa.asc",
    "maipo": "maipo_debrisflow_runoptGPP/elev_12_5m.tif",
    "jacksboro": "matplotlib:jacksboro_fault_dem",
}


def waves(shape, exponent=1.6, seed=3):
    """Relief (rows, columns) [1] of unit variance at all wave lengths up to 60 cells."""
    f = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None, :])
    f[0, 0] = 1.0
    white = np.random.default_rng(seed).standard_normal(shape)
    found = np.fft.ifft2(np.fft.fft2(white) * np.where(f < 1 / 60, 0.0, f**-exponent)).real
    return found / found.std()


def slope(shape=(140, 160), tilt=0.4):
    """A plane (rows, columns) [m] of cells of 5 m that falls to the east."""
    return 900.0 - tilt * CELL * np.indices(shape)[1]


def oscillation(shape=(140, 160), seed=4):
    """An oscillation (rows, columns) [m] of two cells with an amplitude of about 1 m."""
    row, column = np.indices(shape)
    return np.where((row + column) % 2, 1.0, -1.0) * np.random.default_rng(seed).uniform(0.5, 1.5, shape)


def found(z, h=10.0, speed=20.0, reach=None):
    terrain = z if isinstance(z, Terrain) else Terrain.from_array(z, CELL)
    return roughness.of_ground(terrain, (h, h), np.ones(terrain.shape, bool) if reach is None else reach, speed)


def test_a_plane_costs_nothing():
    plane = found(slope())
    assert plane.friction < 1e-12
    assert plane.carried < 1e-9
    assert plane.removed < 1e-9
    assert plane.warning() == ""
    assert "less than 0.1 degrees of friction" in plane.statement()


def test_carried_and_removed_relief_are_those_of_a_single_wave():
    """Of three grid cells along the fall, amplitude 1 m: what the filter leaves and what it takes add up to the wave."""
    x = np.indices((140, 160))[1] * CELL
    one = found(slope() + np.sin(2 * np.pi * x / 30.0))
    kept = (np.sinc(10 / 30) * np.sinc(5 / 30) * np.cos(np.pi * 5 / 30)) ** 2  # triangle, linear raster, short pass
    assert one.carried == pytest.approx(kept / math.sqrt(2), rel=0.15)
    assert one.carried + one.removed == pytest.approx(1.0 / math.sqrt(2), rel=0.05)
    mean_slope = 4.0 * math.sqrt(2) * one.carried / 30.0
    assert one.friction == pytest.approx(relief_friction(mean_slope, 20.0, STANDARD_GRAVITY, 10.0), rel=0.2)


def test_waves_across_the_fall_cost_no_friction():
    """A channelled slope guides a mass; only waves along the fall are climbed."""
    y = np.indices((140, 160))[0] * CELL
    across = found(slope(tilt=0.6) + 0.3 * np.sin(2 * np.pi * y / 40.0))
    turned = found(slope(tilt=0.6) + 0.3 * np.sin(2 * np.pi * np.indices((140, 160))[1] * CELL / 40.0))
    assert across.carried == pytest.approx(turned.carried, rel=0.1)
    assert across.friction < 0.1 * turned.friction


def test_the_cost_grows_with_relief_and_speed_and_falls_with_smoothing():
    rough = slope() + 1.5 * waves((140, 160))
    costs = [found(z, speed=v).friction for z, v in ((slope() + 0.75 * waves((140, 160)), 20.0), (rough, 20.0), (rough, 40.0))]
    assert costs == sorted(costs)
    assert found(Terrain.from_array(rough, CELL).smoothed(30.0)).friction < 0.5 * costs[1]


def test_only_the_ground_in_reach_counts():
    z = slope()
    z[:, 90:] += 3.0 * waves((140, 160))[:, 90:]
    reach = np.zeros(z.shape, bool)
    reach[:, :60] = True
    assert found(z, reach=reach).friction < 1e-3 * found(z).friction
    z[70:, :] = np.nan
    assert found(z, reach=reach).friction < 1e-3 * found(z).friction
    assert found(z, reach=np.zeros(z.shape, bool)) is None
    assert found(z, reach=np.isnan(z)) is None


@pytest.mark.parametrize("name", REAL)
def test_real_rasters_do_not_oscillate(measured, name):
    """Their spectra fall towards waves of two cells, by a factor of three and more over each octave."""
    source = REAL[name]
    terrain = Terrain.from_raster(source if ":" in source else measured(source))
    assert found(terrain, 2 * terrain.cell_size[0]).wave == 0.0
    whole = Terrain.from_array(np.round(terrain.elevation), terrain.cell_size)  # metres, as older rasters have
    assert found(whole, 2 * terrain.cell_size[0]).wave == 0.0
    windows = [(terrain.elevation, np.isfinite(terrain.elevation))]
    width = np.array([1 / short - 1 / long for short, long in roughness.BANDS])
    for axis in (0, 1):
        power = roughness.spectrum(windows, axis) / width
        assert power[0] < 0.45 * power[3]


@pytest.mark.parametrize("part", ["all", "lake", "cliff", "unknown"])
def test_an_oscillation_of_two_cells_is_named_with_its_remedy(part):
    z = slope() + 2.0 * waves((140, 160))
    assert found(z).wave == 0.0
    z += oscillation()
    if part == "lake":
        z[:60] = 500.0
    if part == "cliff":
        z[:, 80:] -= 150.0
    if part == "unknown":
        z[40:60, 20:70] = np.nan
    named = found(z)
    assert named.wave == 2 * CELL
    assert "terrain.smoothing: 10 takes them out" in named.warning()
    assert found(Terrain.from_array(z, CELL).smoothed(named.wave)).wave == 0.0


def test_cliffs_and_lakes_alone_are_no_oscillation():
    z = slope() + 2.0 * waves((140, 160))
    z[:, 80:] -= 150.0
    z[100:] = 400.0
    assert found(z).wave == 0.0


@pytest.mark.parametrize("factor", [1.25, 1.5, 2.0, 3.0])
def test_rasters_resampled_by_the_nearest_cell_are_named(factor):
    """Steps as wide as the old cells: the spectrum rises at waves of so many new cells."""
    old = (slope() + 2.0 * waves((140, 160)))[:130, :130]
    places = np.meshgrid(*[np.arange(0, 120, 1 / factor)] * 2, indexing="ij")
    fine = ndimage.map_coordinates(old, places, order=0)
    named = found(Terrain.from_array(fine, CELL / factor))
    assert 2 * CELL / factor <= named.wave <= 6 * CELL / factor


@pytest.mark.parametrize("h", [5.0, 20.0])
def test_of_a_large_raster_windows_spread_over_the_reach_are_taken(h):
    terrain = Terrain.from_array(slope((900, 1100)), CELL)
    reach = np.zeros(terrain.shape, bool)
    reach[:, 300:] = True
    windows = list(roughness._windows(terrain, (h, h), reach))
    assert sum(part.elevation.size for part, _ in windows) <= roughness.CELLS
    west, south = np.array([(part.west, part.south) for part, _ in windows]).T
    assert min(west) >= 300 * CELL - windows[0][0].size[0]
    assert np.ptp(west) > 1800.0
    assert np.ptp(south) > 1800.0


def test_windows_that_the_flow_hardly_reaches_are_left_out():
    terrain, grid = Terrain.from_array(np.zeros((300, 300)), 5.0), (5.0, 5.0)
    squares = [inside.shape for _, inside in roughness._windows(terrain, grid, np.ones(terrain.shape, bool))]
    (rows, columns), count = squares[0], len(squares)
    assert count > 2
    first = (300 % rows) // 2, (300 % columns) // 2
    reach = np.zeros(terrain.shape, bool)
    reach[first[0] : first[0] + rows, first[1] : first[1] + columns] = True
    reach[first[0] : first[0] + rows // 5, first[1] + columns : first[1] + 2 * columns] = True  # a fifth of the next one
    (inside,) = [inside for _, inside in roughness._windows(terrain, grid, reach)]
    assert inside.all()


@pytest.mark.parametrize("shape", [(3, 3), (3, 80), (7, 5)])
@pytest.mark.parametrize("h", [1.0, 7.0, 100.0])
def test_small_rasters_and_grids_of_any_spacing_are_measured(shape, h):
    assert found(slope(shape), h).friction < 1e-9
    assert np.isfinite(found(slope(shape) + np.random.default_rng(0).normal(size=shape), h).friction)


def test_the_law_adds_up_slope_and_impact():
    s, v, g, h = 0.05, 20.0, 9.81, 10.0
    assert relief_friction(s, v, g, h) == pytest.approx(0.2 * s + 3.5 * s**2 + 0.7 * s**2 * v**2 / (g * h))
    assert relief_friction(0.0, v, g, h) == 0.0


def slide(relief, h=10.0):
    """Velocity down a plane of 30 deg (times,) [m/s] of a slab on a raster of h/2 with ``relief`` [m], at even times [s]."""
    d, angle, n = h / 2, math.radians(30.0), relief.shape
    row, column = np.indices(n)
    z = 2000.0 - math.tan(angle) * column * d + 30.0 * ((row - n[0] / 2) * d / 110.0) ** 2 + relief
    terrain, thickness = Terrain.from_array(z, d), np.zeros(n)
    thickness[12:-12, 10:58] = 30.0
    release, sand = (
        Release.from_array(thickness, terrain, placement="on_surface"),
        DruckerPrager(density=2000.0, friction_angle=32.0),
    )
    run = simulate(terrain, release, sand, basal_friction_angle=20.0, cell_size=h, end_time=18.0, threads=1).ledger
    velocity = (run.momentum_x * math.cos(angle) - run.momentum_z * math.sin(angle)) / run.mass
    return terrain, np.interp(np.linspace(4.0, 18.0, 50), run.time, velocity)


@pytest.mark.parametrize("height", [1.0, 2.0])
def test_a_slab_on_a_rough_plane_is_slowed_as_stated(height):
    """Against the same slab on the smooth plane: extra friction over that of the law within a factor of 1.6."""
    n, h, time = (44, 140), 10.0, np.linspace(4.0, 18.0, 50)
    _, smooth = slide(np.zeros(n))
    terrain, rough = slide(height * waves(n, exponent=1.2))
    weight = STANDARD_GRAVITY * math.cos(math.radians(30.0))
    measured = float(((smooth - rough) / weight) @ time / (time @ time))
    reach = np.zeros(n, bool)
    reach[8:-8, 12:] = True
    stated = roughness.of_ground(terrain, (h, h), reach, math.sqrt(np.mean(rough**2)))
    assert measured > 0.005
    assert 1 / 1.6 < stated.friction / measured < 1.6
