"""Crests of dams and beds of channels on the ground that contact takes: their elevation in every azimuth, wherever they lie."""

import numpy as np
import pytest

from runout import Terrain
from runout.model.surface import Surface
from runout.terrain import sdf
from runout.terrain.crests import Crests, with_crests

HEIGHT, SIZE, SPAN = 5.0, 64.0, 12.0
AZIMUTHS = (0.0, 20.0, 26.565, 45.0, 71.0)


def raster_of_dam(cell, width, azimuth, offset, averaged):
    """Elevations (nx, ny) of cells: the dam at the middle of each, or its mean over it."""
    n = 8 if averaged else 1
    x = (np.arange(round(SIZE / cell) * n) + 0.5) * cell / n
    across = (x[:, None] - SIZE / 2) * np.cos(azimuth) + (x - SIZE / 2) * np.sin(azimuth) - offset
    z = HEIGHT * (np.abs(across) <= width / 2 + 1e-9)
    return z.reshape(len(x) // n, n, -1, n).mean(axis=(1, 3))


def crest_over_raster(ground, z, cell, azimuth, offset, width):
    """Highest point of sections across the dam, over the highest cell that each section meets."""
    along, across = np.linspace(-SPAN, SPAN, 49), np.linspace(-width, width, 81)[:, None]
    x, y = (
        SIZE / 2 + (across + offset) * np.cos(azimuth) - along * np.sin(azimuth),
        SIZE / 2 + (across + offset) * np.sin(azimuth) + along * np.cos(azimuth),
    )
    middle = (np.arange(len(z)) + 0.5) * cell - SIZE / 2
    position = (middle * np.cos(azimuth) - middle[:, None] * np.sin(azimuth))[..., None]
    meets = np.abs(position - along) <= 0.5 * cell * (abs(np.cos(azimuth)) + abs(np.sin(azimuth))) + 1e-9
    return ground.elevation(x, y).max(axis=0) / np.where(meets, z[..., None], 0.0).max(axis=(0, 1))


def worst(h, cell, width, shifts=(0.0, 0.25, 0.7), sign=1.0, azimuths=AZIMUTHS, slope=0.0, dip=0.0, digits=12):
    found, (east, north) = [], slope * np.array([np.cos(np.radians(dip)), np.sin(np.radians(dip))])
    for azimuth in np.radians(azimuths):
        for averaged in (False, True):
            for shift in shifts:
                z = raster_of_dam(cell, width, azimuth, shift * cell, averaged)
                x = (np.arange(len(z)) + 0.5) * cell
                elevation = (z - east * x[:, None] - north * x).round(digits)
                terrain = Terrain.from_array(sign * elevation.T[::-1], (cell, cell))
                surface = sdf.sliding_surface(terrain, None, (h, h)).on_nodes((-2, -2), (round(SIZE / h) + 4,) * 2)
                lattice = surface.origin[0] + surface.spacing[0] * np.arange(len(surface.coefficients))
                ground = Surface(
                    sign * surface.coefficients + east * lattice[:, None] + north * lattice, surface.spacing, surface.origin
                )
                found.append(crest_over_raster(ground, z, cell, azimuth, shift * cell, width))
    return np.min(found), np.max(found)


@pytest.mark.parametrize(
    ("h", "cell", "width"), [(2.0, 2.0, 4.0), (1.5, 2.0, 4.0), (1.0, 2.0, 4.0), (2.0, 2.0, 6.0), (2.0, 1.0, 4.0)]
)
def test_crest_of_a_dam_has_the_elevation_of_the_raster_in_every_azimuth(h, cell, width):
    """Two cells of raster and grid wide, or more. Measured 0.986 to 1.017; before 0.77 to 1.04."""
    low, high = worst(h, cell, width)
    assert low > 0.98
    assert high < 1.02


@pytest.mark.parametrize(
    ("h", "degrees", "dip"), [(0.5, 35, 0), (0.9, 10, 200), (1.0, 20, 50), (1.5, 35, 130), (1.7, 30, 90), (2.0, 20, 0)]
)
def test_crest_of_a_dam_on_a_slope_stands_as_high_over_it_as_in_the_raster(h, degrees, dip):
    """Across the slope, down it and between. Measured 0.984 to 1.016; with crests of the untilted raster 0.92 to 1.10."""
    low, high = worst(
        h, 2.0, 4.0, shifts=(0.0, 0.25), azimuths=(0.0, 26.565, 71.0, 80.0), slope=np.tan(np.radians(degrees)), dip=dip
    )
    assert low > 0.98
    assert high < 1.02


@pytest.mark.parametrize(("width", "digits", "most"), [(4.0, 2, 1.02), (6.0, 12, 1.02), (8.0, 12, 1.03)])
def test_wider_dams_and_rounded_elevations_on_a_slope(width, digits, most):
    """Of 5 m, to 1 cm; two to four cells wide. Measured 0.984 to 1.027."""
    low, high = worst(1.5, 2.0, width, shifts=(0.0, 0.7), azimuths=(0.0, 20.0, 45.0), slope=0.5, dip=30.0, digits=digits)
    assert low > 0.98
    assert high < most


def test_end_of_a_slab_on_a_slope_is_no_crest():
    """It is the highest cell of its row, but the ground behind it falls no faster than the slope."""
    x = 2.0 * np.arange(40)
    slab = 5.0 * ((x > 30) & (x < 50)) - 0.4 * x
    found = Crests.of(slab[:, None] + np.zeros(20), (2.0, 2.0), 2.0)
    assert len(found.axis) == 0


def test_bed_of_a_channel_is_as_deep_as_the_raster():
    low, high = worst(2.0, 2.0, 4.0, shifts=(0.0, 0.4), sign=-1.0)
    assert low > 0.98
    assert high < 1.02


@pytest.mark.parametrize(("h", "least", "most"), [(3.0, 0.91, 1.04), (4.0, 0.44, 1.11)])
def test_grid_coarser_than_half_a_dam_holds_part_of_it(h, least, most):
    """Dam two cells of the raster wide. Measured 0.92 to 1.03 on nodes 1.5 cells apart, 0.46 to 1.08 on nodes two cells apart."""
    low, high = worst(h, 2.0, 4.0)
    assert least < low < 0.98
    assert high < most


def test_ground_without_crests_and_smooth_crests_stay_as_they_are():
    x = 5.0 * np.arange(40)
    hills, step = 20 * np.sin(x / 25)[:, None] * np.cos(x / 30), np.where(x[:, None] > 90, 0.0, 30.0) + 0 * x
    for z in (0.4 * x[:, None] - 0.2 * x, hills, step):
        surface = Surface.through(z, (5.0, 5.0))
        np.testing.assert_array_equal(with_crests(surface, Crests.of(z, (5.0, 5.0), 5.0)).coefficients, surface.coefficients)


def test_noise_beside_a_cliff_makes_no_lip_and_no_moat():
    """Noise of 5 cm (rms) on a face of 30 m: the ground leaves the level by 8 mm to 20 cm."""
    noise = np.random.default_rng(4).normal(0.0, 0.05, (60, 60))
    for cell, h in ((2.0, 2.0), (1.2, 2.0), (2.0, 1.5)):
        edge = 30 * cell
        x = (np.arange(60) + 0.5) * cell
        for azimuth in np.radians((0.0, 20.0, 45.0)):
            along = (x - edge) * np.cos(azimuth) + (x[::-1, None] - edge) * np.sin(azimuth)
            z = noise - np.clip(along * np.tan(np.radians(85.0)), 0.0, 30.0)
            ground = sdf.sliding_surface(Terrain.from_array(z, (cell, cell)), None, (h, h))
            places = np.random.default_rng(5).uniform(0.2 * edge, 1.8 * edge, (2, 8000))
            found = ground.elevation(*places)
            assert found.max() < 0.3
            assert found.min() > -30.3


def test_ground_under_a_mirrored_raster_is_the_mirrored_ground():
    """To 2 cm at a few places of noise of 1 m, where two crests are alike to rounding, and elsewhere to 1e-9 m."""
    z = np.random.default_rng(3).normal(0.0, 1.0, (24, 30)).round(1)
    one = sdf.sliding_surface(Terrain.from_array(z, (2.0, 2.0)), None, (2.0, 2.0))
    other = sdf.sliding_surface(Terrain.from_array(z[:, ::-1], (2.0, 2.0)), None, (2.0, 2.0))
    x, y = np.random.default_rng(4).uniform(4.0, 44.0, (2, 500))
    apart = np.abs(other.elevation(60.0 - x, y) - one.elevation(x, y))
    assert np.median(apart) < 1e-9
    assert apart.max() < 0.05


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_crests_are_the_same_at_any_scale_of_the_whole_geometry(scale):
    """A dam of 5 cm on cells of 2 cm is one of 5 m on cells of 2 m."""
    z = raster_of_dam(2.0, 4.0, np.radians(20.0), 0.6, averaged=True) + 0.1 * np.arange(32)[:, None]
    z[5, 5:9] -= 3.0  # a channel
    usual, scaled = (Crests.of(k * z, (2.0 * k, 2.0 * k), 1.5 * k, (10.0 * k, 0.0)) for k in (1.0, scale))
    assert len(usual.axis) > 40
    for name in ("along", "across", "elevation", "height", "cell"):
        np.testing.assert_allclose(getattr(scaled, name), scale * getattr(usual, name), rtol=1e-9, err_msg=name)
    for name in ("axis", "weight", "tilt", "trust", "is_lid"):
        np.testing.assert_allclose(getattr(scaled, name), getattr(usual, name), rtol=1e-9, atol=1e-12, err_msg=name)
