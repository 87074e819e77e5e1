"""Columns over the raster's cells: rows from the north, mass complete, a crowd of particles as wide as a grid cell."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import HARD, ROCK, at, box, loaded, scene

CROWD = 40  # particles at one place: they cover a box of one grid cell, no more


def columns_of(backend, particles, **choices):
    return loaded(backend, scene(**choices), particles).columns()


def test_first_row_is_the_north_and_first_column_the_west(backend):
    p = at([(1.0, 73.75, 0.0)] * CROWD, (1.0, 1.0, 1.0))  # centre of the north-west cell
    p.velocity[:] = (1.0, 2.0, 3.0)
    c = columns_of(backend, p)
    assert c.volume.shape == (30, 40)
    assert c.volume[0, 0] == pytest.approx(0.125 * CROWD)
    np.testing.assert_allclose(c.momentum[0, 0], 250.0 * CROWD * np.array([1.0, 2.0, 3.0]))
    assert c.mass.sum() == pytest.approx(250.0 * CROWD)
    assert np.count_nonzero(c.mass) == 1


def test_crowd_shares_its_mass_by_the_area_of_its_grid_cell(backend):
    """A box of 1 m x 2 m around (4, 8): half east of x = 4, 3/4 north of y = 7.5."""
    c = columns_of(backend, at([(4.0, 8.0, 0.0)] * CROWD, (1.0, 2.0, 1.0)), spacing=(1.0, 2.0, 1.0))
    expected = 250.0 * CROWD * np.array([[0.375, 0.375], [0.125, 0.125]])
    np.testing.assert_allclose(c.mass[26:28, 1:3], expected, rtol=1e-12)


@pytest.mark.parametrize("wide", [(1.3, 0.9), (1.9, 2.4), (3.1, 2.5)])
def test_boxes_that_lie_askew_to_the_raster_share_by_area(backend, wide):
    """Raster cells of 2 m x 2.5 m, grid cells ``wide`` [m]; crowds at corners of half cells, apart from each other."""
    places = np.stack(np.meshgrid(np.arange(20, 40, 11), np.arange(22, 42, 9)), -1).reshape(-1, 2) * np.array(wide) / 2
    x = np.repeat(np.column_stack([places, np.zeros(len(places))]), CROWD, axis=0)
    c = columns_of(backend, at(x, (*wide, 1.0)), spacing=(*wide, 1.0))
    across, along = (overlaps(x[:, d], wide[d], size, count) for d, size, count in ((0, 2.0, 40), (1, 2.5, 30)))
    expected = 250.0 * np.einsum("pi,pj->ij", along, across)[::-1]
    np.testing.assert_allclose(c.mass, expected, rtol=1e-9, atol=1e-6)
    assert c.mass.sum() == pytest.approx(250.0 * len(x), rel=1e-13)


def overlaps(x, width, size, count):
    """Shares (n, count) of intervals of ``width`` [m] around x (n,) [m] in cells of ``size`` [m]."""
    edge = size * np.arange(count)
    return np.maximum(np.minimum(x[:, None] + width / 2, edge + size) - np.maximum(x[:, None] - width / 2, edge), 0.0) / width


def test_uniform_layer_gives_its_thickness_inside(backend):
    p = box((10.0, 10.0, 0.0), (20.0, 20.0, 2.0), (1.0, 1.0, 1.0))
    c = columns_of(backend, p)
    thickness = c.volume / 5.0
    np.testing.assert_allclose(thickness[29 - 10 : 29 - 5, 6:14], 2.0, rtol=1e-12)
    assert c.volume.sum() == pytest.approx(800.0)
    np.testing.assert_allclose(c.mass, c.volume * ROCK.density, rtol=1e-12)


def test_what_hangs_over_the_edge_counts_in_the_edge_cell(backend):
    p = at([(0.0, 0.0, 0.0), (80.0, 75.0, 0.0)], (1.0, 1.0, 1.0))
    c = columns_of(backend, p)
    assert c.mass[29, 0] == pytest.approx(250.0)
    assert c.mass[0, 39] == pytest.approx(250.0)


def test_volume_is_mass_over_the_density_of_the_own_material(backend):
    light = replace(HARD, density=500.0)
    p = at([(5.0, 5.0, 0.0), (45.0, 45.0, 0.0)], (1.0, 1.0, 1.0))
    p.release[1] = 1
    c = columns_of(backend, p, materials=(HARD, light), friction=(0.5, 0.5))
    assert c.volume.sum() == pytest.approx(250 / 2000 + 250 / 500)


def test_ledger_counts_the_affine_part_of_the_kinetic_energy(backend):
    p = at([(20.0, 20.0, 3.0)], (1.0, 2.0, 0.5))
    p.velocity[:] = (1.0, 2.0, 2.0)
    p.affine[0, 0, 1] = 3.0
    row = loaded(backend, scene(spacing=(1.0, 2.0, 0.5)), p).ledger()
    assert row.kinetic_energy == pytest.approx(0.5 * 250 * (9 + 9.0 * 4 / 4))
    assert row.potential_energy == pytest.approx(250 * 9.81 * 3.0)
    assert row.max_speed == pytest.approx(3.0)
    assert row.active_blocks == 1
