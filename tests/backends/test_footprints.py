"""Footprints of particles: mass exact, no holes between particles that have moved apart, bits that repeat."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import HARD, at, engine_of, loaded, scene
from test_columns import overlaps

from runout.backends import footprints
from runout.backends.footprints import AREAS, DEPTH, EXTENT, SHARING, lattice_cell, loops, on_raster, on_whole
from runout.backends.protocol import RasterSums
from runout.model.scene import Raster
from runout.physics.numerical_scales import footprint_area

COARSE = (6.0, 7.5, 1.0)  # grid cells on raster cells of 2 m x 2.5 m
LIGHT = replace(HARD, density=500.0)


def sheet(apart, volume=4.5, spacing=COARSE):
    """Particles ``apart`` grid cells from each other, off their places by up to a quarter of that."""
    h = np.array(spacing[:2])
    x = np.stack(np.meshgrid(*(np.arange(a, b, apart * d) for a, b, d in zip((15, 15), (65, 60), h, strict=True))), -1).reshape(
        -1, 2
    )
    x += np.random.default_rng(1).uniform(-0.25, 0.25, x.shape) * apart * h
    p = at(np.column_stack([x, np.zeros(len(x))]), spacing, volume=volume)
    p.velocity[:] = np.random.default_rng(2).normal(size=(len(x), 3))
    return p


def test_crowd_of_particles_covers_one_grid_cell(backend):
    """Forty at (42, 37.5), a corner of half cells: a box of 6 m x 7.5 m."""
    a = scene(spacing=COARSE)
    c = loaded(backend, a, at([(42.0, 37.5, 0.0)] * 40, COARSE)).columns()
    expected = 40 * 250.0 * np.outer(overlaps(np.array([37.5]), 7.5, 2.5, 30)[0][::-1], overlaps(np.array([42.0]), 6.0, 2.0, 40)[0])
    np.testing.assert_allclose(c.mass, expected, rtol=1e-9, atol=1e-9)


def test_lone_particle_spreads_over_less_than_four_cells_and_keeps_its_mass(backend):
    c = loaded(backend, scene(spacing=COARSE), at([(41.3, 36.1, 0.0)], COARSE)).columns()
    rows, columns = np.nonzero(c.mass)
    assert c.mass.sum() == pytest.approx(250.0, rel=1e-14)
    assert 3 * 6.0 <= 2.0 * (np.ptp(columns) + 1) <= 4 * 6.0
    assert 3 * 7.5 <= 2.5 * (np.ptp(rows) + 1) <= 4 * 7.5


def test_sheet_of_scattered_particles_has_no_holes(backend):
    """Particles one and a half cells apart: boxes of one cell would leave half of the raster dry."""
    p = sheet(1.5)
    c = loaded(backend, scene(spacing=COARSE), p).columns()
    inner = c.volume[9:20, 12:28] / 5.0
    mean = p.volume.mean() / (1.5**2 * 6.0 * 7.5)
    assert inner.min() > 0.4 * mean
    assert inner.std() < 0.35 * mean
    assert c.volume.sum() == pytest.approx(p.volume.sum(), rel=1e-13)


def test_backends_agree_on_footprints_of_two_materials(backend):
    p = sheet(0.9)
    p.release[::2] = 1
    a = scene(spacing=COARSE, materials=(HARD, LIGHT), friction=(0.5, 0.5))
    found, expected = (loaded(engine, a, p).columns() for engine in (backend, engine_of("reference")))
    for name in ("volume", "mass", "momentum"):
        scale = np.abs(getattr(expected, name)).max()
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-9 * scale)


def test_what_hangs_over_the_edge_comes_back_without_a_spike(backend):
    p = at([(0.1, 0.1, 0.0), (79.9, 74.9, 0.0), (40.0, 74.0, 0.0)], COARSE)
    c = loaded(backend, scene(spacing=COARSE), p).columns()
    assert c.mass.sum() == pytest.approx(750.0, rel=1e-13)
    assert c.boxes.mass.sum() == pytest.approx(750.0, rel=1e-13)
    rows, columns = c.boxes.mass.shape
    assert 0 <= c.boxes.row <= c.boxes.row + rows <= 20  # half cells of 3 m x 3.75 m
    assert 0 <= c.boxes.column <= c.boxes.column + columns <= 27
    assert c.mass.max() < 8 * 250.0 / (2.5**2 * 9.0)  # four times the middle of a footprint, more where the edge cuts a half cell
    assert c.mass.min() >= 0.0


@pytest.mark.parametrize("name", ["scan", "hash"])
def test_window_of_the_flow_holds_the_bits_of_the_whole(name):
    engine = loaded(engine_of(name), scene(spacing=COARSE), sheet(0.7))
    whole, window = engine.columns(), engine.flow_columns()
    assert (whole.mass[window.window] == window.mass).all()
    assert whole.mass.sum() == pytest.approx(window.mass.sum(), rel=1e-15)


@pytest.mark.parametrize("edge", [0.0, 30.0])
def test_sums_on_the_lattice_brought_to_the_raster_are_those_of_the_raster(backend, edge):
    """In the middle, and where footprints hang over two edges of the raster."""
    p, a = sheet(0.9), scene(spacing=COARSE)
    p.node[:, :2] -= round(edge / 6.0)
    engine = loaded(backend, a, p)
    whole, found = engine.columns(), engine.lattice_columns()
    assert found.mass.sum() == pytest.approx(p.mass.sum(), rel=1e-13)
    assert found.row >= 0
    assert found.column >= 0
    shared = on_whole(on_raster(found, a.raster, lattice_cell(a)), a.raster)
    np.testing.assert_allclose(shared.momentum, whole.momentum, rtol=0, atol=1e-9 * np.abs(whole.momentum).max())
    by_parts = on_raster(replace(found, lanes=None), a.raster, lattice_cell(a))
    for name in ("volume", "mass", "momentum", "depth_volume"):
        np.testing.assert_allclose(getattr(by_parts, name), getattr(shared, name)[by_parts.window], rtol=1e-14)


def mean_over_squares(values, width):
    """Means over squares of ``width`` cells; nothing lies beyond the array."""
    padded = np.pad(values, width // 2)
    return sum(np.roll(padded, (i, j), (0, 1)) for i in range(width) for j in range(width))[width - 1 :, width - 1 :] / width**2


def spread_plainly(sums, one):
    """What the compiled loops of a band make of ``sums``, in whole arrays, as docs/guide/maps.md states it."""
    covered = np.ones(sums.shape[1:])
    flowing = np.clip(2.0 * 6.25 * mean_over_squares(sums[0], 5) / one / EXTENT.sharing - 1.0, 0.0, 1.0)
    for footprint in (EXTENT, DEPTH):
        widths, areas = footprint.widths, footprint.areas
        around = mean_over_squares(sums[0], widths[-1])
        area = np.clip(footprint.sharing * one / np.maximum(around, 1e-300), 1.0, areas[-1])
        beyond = [
            np.ones_like(area),
            *(np.clip((area - a) / (b - a), 0.0, 1.0) for a, b in itertools.pairwise(areas)),
            0.0,
        ]
        total = np.zeros_like(sums)
        for n, width in enumerate(widths):
            part = (beyond[n] - beyond[n + 1]) * sums / np.maximum(mean_over_squares(covered, width), 1e-300)
            total = total + covered * np.array([mean_over_squares(lane, width) for lane in part])
        if footprint is EXTENT:
            covered = np.minimum(4.0 * total[0] / one, 1.0)
    return np.concatenate([total, [total[0] * flowing]])


def test_bands_of_rows_spread_as_whole_arrays_do():
    """A mound of few particles over four bands: deep in its middle, scattered at its rim."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:170, :90]
    count = rng.poisson(3.0 * np.maximum(0.0, 1.0 - ((x - 45) / 32) ** 2 - ((y - 85) / 75) ** 2))
    boxes = mean_over_squares(count.astype(float), 3)
    sums = np.array([2.0 * boxes, *(boxes * rng.normal(size=(3, *boxes.shape)))])
    found = np.empty((5, *boxes.shape))
    loops().spread_bands(sums, 0.5, SHARING, AREAS, found)
    np.testing.assert_allclose(found, spread_plainly(sums, 0.5), rtol=0, atol=1e-13 * sums.max())
    assert found[0].sum() == pytest.approx(sums[0].sum(), rel=1e-13)


def test_sums_have_the_same_bits_for_any_number_of_threads():
    from runout.backends.protocol import get_backend

    one, two = (loaded(get_backend("scan", "cpu", threads=n), scene(spacing=COARSE), sheet(0.1)).flow_columns() for n in (1, 2))
    assert (one.momentum == two.momentum).all()


def test_single_particles_have_mass_but_no_thickness_and_four_that_share_a_place_have_one(backend):
    """Squares of 2.5 grid cells: one and two particles are spray, three are half of a flow, four are a flow."""
    parts = []
    for count in (1, 2, 3, 4):
        c = loaded(backend, scene(spacing=COARSE), at([(41.3, 36.1, 0.0)] * count, COARSE)).columns()
        assert c.mass.sum() == pytest.approx(250.0 * count, rel=1e-13)
        parts.append(c.depth_volume[29 - 14, 20] / c.volume[29 - 14, 20])
    assert parts == pytest.approx([0.0, 0.0, 0.5, 1.0], abs=1e-12)


def test_footprint_is_shared_by_as_many_particles_between_its_bounds():
    areas = [footprint_area(count, 4.0, 7.25) for count in (100.0, 4.0, 2.0, 1.0, 0.01)]
    assert areas == pytest.approx([1.0, 1.0, 2.0, 4.0, 7.25])
    assert EXTENT.areas[-1] == 7.25
    assert DEPTH.areas[-1] == 21.25


def test_sheet_of_few_particles_is_smooth_and_ends_where_its_particles_do(backend):
    """One particle a grid cell at random: boxes alone scatter by more than the mean; the rim is no farther out than a cell."""
    h, rng = np.array(COARSE[:2]), np.random.default_rng(3)
    x = rng.uniform((20.0, 15.0), (62.0, 60.0), (42, 2))
    c = loaded(backend, scene(spacing=COARSE), at(np.column_stack([x, np.zeros(len(x))]), COARSE, volume=4.5)).columns()
    inner = c.volume[10:20, 14:27]
    assert inner.std() < 0.25 * inner.mean()  # 0.43 where four share a place, 0.71 with boxes
    columns = np.nonzero(c.volume > 0.1 * inner.mean())[1]
    assert 2.0 * columns.min() > x[:, 0].min() - 1.5 * h[0]
    assert 2.0 * (columns.max() + 1) < x[:, 0].max() + 1.5 * h[0]
    assert c.volume.sum() == pytest.approx(42 * 4.5, rel=1e-13)


def ellipse(east, north):
    """Thickness [m] of a smooth mound of 1.5 km x 0.5 km, 2 m in its middle."""
    return np.maximum(0.0, 2.0 * (1.0 - ((east - 1000) / 750) ** 2 - ((north - 1000) / 250) ** 2))


def perimeter(inside):
    """Edges of the cells at the border of an area, over the root of their number."""
    inside = np.pad(inside, 1)
    return sum(np.diff(inside, axis=axis).sum() for axis in (0, 1)) / np.sqrt(inside.sum())


def test_drawn_outline_keeps_area_and_place_of_a_smooth_shape_but_is_too_long():
    """Particles at random, raster of 5 m: perimeter 1.3 to 1.8 times the exact one, more with finer cells (maps.md)."""
    middle, found = 5.0 * (np.arange(400) + 0.5), []
    exact = ellipse(middle, middle[::-1, None]) > 0.5
    for h in (27.0, 12.0):
        volume, rng = h**3 / 16, np.random.default_rng(0)
        count = round(np.pi * 750 * 250 / volume)
        x = rng.uniform(0.0, 2000.0, (24 * count, 2))
        x = x[rng.uniform(0.0, 2.0, len(x)) < ellipse(*x.T)][:count]
        a = replace(scene(spacing=(h, h, h)), raster=Raster(400, 400, (5.0, 5.0)))
        c = loaded(engine_of("scan"), a, at(np.column_stack([x, np.zeros(count)]), (h, h, h), volume=volume)).columns()
        drawn = c.volume / 25.0 > 0.5
        assert drawn.sum() == pytest.approx(exact.sum(), rel=0.06)
        assert (drawn & exact).sum() / (drawn | exact).sum() > 0.83
        found.append(perimeter(drawn))
    assert 1.2 * perimeter(exact) < found[0] < found[1] < 1.9 * perimeter(exact)


@pytest.mark.parametrize(("cells", "threads"), [(1600, 1), (2**16, 2)])
def test_loop_over_a_small_window_starts_no_threads(monkeypatch, cells, threads):
    import numba

    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only")
    seen, before = [], numba.get_num_threads()
    monkeypatch.setattr(footprints, "loops", lambda: SimpleNamespace(share=lambda: seen.append(numba.get_num_threads())))
    numba.set_num_threads(2)
    try:
        footprints.loop("share", cells)
        assert (seen, numba.get_num_threads()) == ([threads], 2)
    finally:
        numba.set_num_threads(before)


def test_columns_over_the_part_with_mass_are_the_same_on_the_raster_bit_by_bit():
    rng, raster = np.random.default_rng(4), Raster(30, 40, (10.0, 10.0))
    total = np.zeros((6, 24, 30))
    total[:, 7:15, 9:21] = rng.random((6, 8, 12))
    window = footprints.Lattice((6, 8), (30, 24), (7.0, 7.0))
    wide = footprints.placed(total, lambda: total[:5], window, raster)
    narrow = footprints.with_mass(wide)
    assert narrow.mass.shape == (8, 12)
    assert (narrow.row, narrow.column) == (wide.row + 7, wide.column + 9)
    one, other = (footprints.on_whole(footprints.on_raster(c, raster, window.cell), raster) for c in (wide, narrow))
    assert one.mass.sum() == pytest.approx(total[4].sum())
    for name in ("volume", "mass", "momentum", "depth_volume"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    empty = footprints.placed(np.zeros((6, 24, 30)), lambda: total[:5], window, raster)
    assert footprints.with_mass(empty) is empty


@pytest.mark.parametrize("shape", [(5, 7), (64, 200), (300, 65), (129, 128)])
def test_window_of_the_mass_ends_at_its_first_and_last_cell_however_far_inside(shape):
    rng = np.random.default_rng(7)
    for count in (1, 2, 40):
        cells = rng.integers(0, shape, (count, 2))
        mass = np.zeros(shape)
        mass[tuple(cells.T)] = 1.0
        narrow = footprints.with_mass(RasterSums(mass, mass, np.zeros((*shape, 3)), 3, 4, mass))
        assert (narrow.row, narrow.column) == tuple(cells.min(0) + np.array((3, 4)))
        assert narrow.mass.shape == tuple(np.ptp(cells, axis=0) + 1)
        assert narrow.mass.sum() == mass.sum()


def test_a_large_window_keeps_whole_rows_and_gives_the_raster_the_bits_of_a_small_one(monkeypatch):
    rng, raster = np.random.default_rng(5), Raster(30, 40, (10.0, 10.0))
    total = np.zeros((6, 90, 80))
    total[:, 7:75, 9:71] = rng.random((6, 68, 62))
    columns = footprints.placed(total, lambda: total[:5], footprints.Lattice((6, 8), (80, 90), (3.0, 3.0)), raster)
    found = {}
    for large in (2**17, 2**10):
        monkeypatch.setattr(footprints, "LARGE", large)
        narrow = footprints.with_mass(columns)
        found[narrow.mass.shape] = footprints.on_whole(footprints.on_raster(narrow, raster, (3.0, 3.0)), raster)
    assert list(found) == [(68, 62), (68, 80)]
    assert narrow.volume.flags.c_contiguous
    small, whole = found.values()
    assert small.mass.sum() == pytest.approx(total[4].sum())
    for name in ("volume", "mass", "momentum", "depth_volume"):
        np.testing.assert_array_equal(getattr(small, name), getattr(whole, name))
