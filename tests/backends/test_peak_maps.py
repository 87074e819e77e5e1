"""Peaks over the columns of a flow: on the raster, or on the lattice of footprints where the raster is much finer."""

import time as clock
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from scenes import at, engine_of, scene

from runout.backends import footprints
from runout.backends.protocol import RasterSums
from runout.model.scene import Raster
from runout.simulation.observers import PeakMaps
from runout.simulation.run import Run, RunControl

COARSE = (5.0, 5.0, 5.0)
FINE = replace(scene(spacing=COARSE), raster=Raster(120, 200, (1.0, 1.0)))  # a lattice of 2.5 m
LATTICE = footprints.lattice_cell(FINE)
DENSITY = 2000.0
BIAS_OF_SHEET = 0.09


def mound(time):
    """Columns on the lattice of a mound that moves 10 m/s east and 3 m/s north and becomes flatter, in cells of 2.5 m."""
    y, x = (np.mgrid[:48, :80] + 0.5) * 2.5
    thickness = (3.0 - 0.2 * time) * np.maximum(0.0, 1 - ((x - 40 - 10 * time) ** 2 + (y - 40 - 3 * time) ** 2) / 30**2)
    mass = DENSITY * thickness * 6.25
    return RasterSums(mass / DENSITY, mass, mass[..., None] * np.array((10.0, 3.0, 0.0)))


def on_raster(columns):
    return footprints.on_raster(columns, FINE.raster, LATTICE)


@pytest.fixture(scope="module")
def both():
    """Maps of the mound over 6 s: kept on the lattice every 0.25 s, and on the raster every 0.05 s."""
    lattice, raster = PeakMaps(FINE, 0.1, on_lattice=True), PeakMaps(FINE, 0.1)
    for time in np.arange(0.0, 6.01, 0.05):
        raster.observe(time, on_raster(mound(time)))
        if round(time / 0.05) % 5 == 0:
            lattice.observe(time, mound(time))
    return lattice, raster


def difference(found, expected):
    return np.nansum(np.abs(found - expected)) / np.nansum(np.abs(expected))


def test_peaks_on_the_lattice_are_those_of_the_raster_within_one_percent(both):
    found, expected = (peaks.maps() for peaks in both)
    assert difference(found["max_flow_thickness"], expected["max_flow_thickness"]) < 0.01
    assert difference(found["max_speed"], expected["max_speed"]) < 0.01
    assert difference(found["max_pressure"], expected["max_pressure"]) < 0.01
    reached = [np.isfinite(maps["arrival_time"]) for maps in (found, expected)]
    assert (reached[0] & reached[1]).sum() > 0.995 * (reached[0] | reached[1]).sum()
    came = reached[0] & reached[1]
    assert np.abs(found["arrival_time"] - expected["arrival_time"])[came].mean() < 0.06  # a cell of the lattice takes 0.24 s


def test_deposit_kept_on_the_lattice_is_that_of_the_raster_to_rounding(both):
    found, expected = (peaks.maps()["deposit_thickness"] for peaks in both)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
    assert found.sum() == pytest.approx(mound(6.0).volume.sum(), rel=1e-12)


def test_cells_count_as_reached_where_the_peak_is_thick_enough(both):
    for peaks in both:
        maps = peaks.maps()
        assert (np.isfinite(maps["arrival_time"]) == (maps["max_flow_thickness"] >= 0.1)).all()
        assert ((maps["max_speed"] > 0) == np.isfinite(maps["arrival_time"])).all()
        assert (maps["max_flow_thickness"] >= maps["deposit_thickness"] * (1 - 1e-12)).all()


@pytest.mark.parametrize("name", ["scan", "reference"])
def test_time_of_every_look_counts_as_that_of_the_observers(name, monkeypatch):
    engine, columns, seconds = engine_of(name), type(engine_of(name)).flow_columns, []

    def slow(self):
        seconds.append(0.01)
        clock.sleep(seconds[-1])
        return columns(self)

    monkeypatch.setattr(type(engine), "flow_columns", slow)
    run = Run(engine, scene(), RunControl(0.05, stop=False, crossing=0.0), None, None)
    run.start(at([(40.0, 30.0, 5.0)], (1.0, 1.0, 1.0)))
    run.go()
    assert len(seconds) > 2
    assert run.observing > sum(seconds[1:])


def test_flow_arrives_when_its_thickness_passes_the_threshold_between_two_looks():
    peaks, area = PeakMaps(scene(), 0.5), 5.0
    for time, thickness in ((0.0, 0.1), (2.0, 0.2), (6.0, 1.0), (8.0, 0.2), (9.0, 3.0)):
        peaks.observe(time, RasterSums(np.full((1, 1), thickness * area), np.ones((1, 1)), np.ones((1, 1, 3)), 4, 7))
    assert peaks.maps()["arrival_time"][4, 7] == pytest.approx(2.0 + 4.0 * 0.3 / 0.8)
    assert np.isfinite(peaks.arrival).sum() == 1


def test_cells_that_the_window_leaves_hold_no_thickness():
    peaks, rng = PeakMaps(scene(), 0.5), np.random.default_rng(0)
    for time in range(20):
        row, column, rows, columns = rng.integers(0, (20, 25, 10, 15))
        volume = rng.uniform(1.0, 2.0, (rows, columns))
        peaks.observe(float(time), RasterSums(volume, volume, np.ones((rows, columns, 3)), row, column))
        assert peaks.maps()["deposit_thickness"].sum() == pytest.approx(volume.sum() / 5.0)


def test_lattice_keeps_peaks_only_under_rasters_four_times_finer_than_the_grid():
    assert footprints.keep_peaks(FINE)
    assert footprints.keep_peaks(replace(FINE, raster=Raster(96, 160, (1.25, 1.25))))
    assert not footprints.keep_peaks(replace(FINE, raster=Raster(60, 100, (1.3, 1.3))))


def sheared_sheet(time):
    """A sheet of four columns of four particles a grid cell, 3 m thick, whose rows slide past each other at 15 to 25 m/s."""
    rng = np.random.default_rng(4)
    place = (np.stack(np.meshgrid(np.arange(52), np.arange(20), indexing="ij"), -1) + rng.uniform(0.1, 0.9, (52, 20, 2))) * 2.5
    place[..., 0] += rng.uniform(15.0, 25.0, 20) * time - 20.0
    x = np.repeat(np.concatenate([place + np.array((0.0, 25.0)), np.zeros((52, 20, 1))], axis=2).reshape(-1, 3), 4, axis=0)
    return at(x[x[:, 0] > 2.5], COARSE, volume=3.0 * 25.0 / 16.0)


@pytest.mark.parametrize("cell", [5.0, 2.5, 3.7], ids=["as the grid", "half of it", "askew"])
def test_largest_thickness_of_a_uniform_sheet_that_shears_is_not_that_of_its_noise(cell):
    """The sheet is 3 m thick. Boxes of one grid cell give 3.5 to 3.7 m, these footprints 3.2 m."""
    made = replace(scene(spacing=COARSE), raster=Raster(round(100 / cell), round(160 / cell), (cell, cell)))
    peaks, engine = PeakMaps(made, 0.1), engine_of("scan")
    for time in np.arange(0.0, 2.0, 0.1):
        engine.load(made, sheared_sheet(time))
        peaks.observe(time, engine.flow_columns())
    middle, rows = (np.arange(n) + 0.5 for n in (made.raster.columns, made.raster.rows))
    inside = np.ix_((rows[::-1] * cell > 35) & (rows[::-1] * cell < 65), (middle * cell > 60) & (middle * cell < 90))
    found = peaks.maps()["max_flow_thickness"][inside]
    assert found.mean() == pytest.approx(3.0, rel=BIAS_OF_SHEET)


def test_spray_reaches_no_cell_but_its_deposit_is_complete():
    """Single particles ten cells apart that fly over a raster: no peak, no arrival; where they end, their volume is the deposit."""
    made, engine = scene(spacing=COARSE), engine_of("scan")
    peaks, x = PeakMaps(made, 0.1), np.array([(15.0, 20.0, 0.0), (15.0, 60.0, 0.0)])
    for time in (0.0, 0.5, 1.0):
        engine.load(made, at(x + np.array((40.0 * time, 0.0, 0.0)), COARSE, volume=8.0))
        peaks.observe(time, engine.flow_columns())
    maps = peaks.maps()
    assert maps["deposit_thickness"].sum() * 5.0 == pytest.approx(16.0, rel=1e-12)
    assert (maps["max_flow_thickness"] == maps["deposit_thickness"]).all()
    assert not maps["max_speed"].any()
    assert np.isnan(maps["arrival_time"]).all()


def sliding():
    """Particles that fly east over a raster of 1 m, without ground."""
    x = np.random.default_rng(2).uniform((40.0, 40.0, 0.0), (70.0, 70.0, 10.0), (600, 3))
    p = at(x, COARSE, volume=8.0)
    p.velocity[:] = (20.0, 5.0, 0.0)
    return replace(FINE, gravity=(0.0, 0.0, -0.1)), p


def test_all_backends_find_the_maps_of_the_reference(backend):
    """Over 2 s in float64; particles move alike, so that maps differ by rounding."""
    found = []
    for engine in (backend, engine_of("reference")):
        a_scene, particles = sliding()
        run = Run(engine, a_scene, RunControl(2.0, stop=False), None, None)
        run.start(particles)
        run.go()
        assert run.peaks.on_lattice
        assert run.peaks.observations > 20
        found.append(run.peaks.maps())
    for name, expected in found[1].items():
        np.testing.assert_allclose(found[0][name], expected, rtol=0, atol=1e-6 * np.nanmax(expected), err_msg=name)


def assert_same_columns(found, expected, where, tolerance=1e-9):
    """Equal mass and momentum over the whole, whichever window each has."""
    for name in ("mass", "momentum"):
        whole = np.zeros((2, 70, 110, *getattr(expected, name).shape[2:]))
        whole[0][found.window], whole[1][expected.window] = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(whole[0], whole[1], rtol=0, atol=tolerance * whole.max(), err_msg=f"{name} {where}")


@pytest.mark.parametrize("raster", [FINE.raster, Raster(24, 40, (5.0, 5.0))], ids=["lattice", "raster"])
def test_columns_between_the_steps_of_a_series_are_those_of_steps_made_one_by_one(raster):
    """Particles fly ten cells, so that the index is made anew on the way and the window of the looks is found anew."""
    looks, found, wanted = [1, 6, 7, 25, 40], {}, {}
    a_scene, particles = sliding()
    a_scene = replace(a_scene, raster=raster)
    series, single = engine_of("hash"), engine_of("hash")
    for engine in (series, single):
        engine.load(a_scene, particles)
    for begin in (0, 20):
        there = [n - begin for n in looks if 0 < n - begin <= 20]
        series.steps(0.06, 20, there, lambda step, columns, begin=begin: found.update({begin + step: deepcopy(columns)}))
    for step in range(1, 41):
        single.step(0.06)
        if step in looks:
            wanted[step] = single.lattice_columns()
    assert list(found) == looks
    for step, columns in wanted.items():
        assert_same_columns(found[step], columns, f"after {step}")
    assert series.counters.rebuilds > 2


@pytest.mark.parametrize("raster", [FINE.raster, Raster(24, 40, (5.0, 5.0))], ids=["lattice", "raster"])
def test_window_of_a_look_holds_the_mass_that_moved_while_nobody_looked(raster):
    """Particles fly several times the margin of the window, as a member of a batch does while other members are looked at."""
    a_scene, particles = sliding()
    a_scene = replace(a_scene, raster=raster)
    engine, found = engine_of("hash"), {}
    engine.load(a_scene, particles)
    for looks in ([1], *[[]] * 10, [5]):
        engine.steps(0.06, 5, looks, lambda step, columns: found.update({step: deepcopy(columns)}))
    fresh = engine.lattice_columns()
    assert found[5].mass.sum() == pytest.approx(particles.mass.sum(), rel=1e-12)
    assert_same_columns(found[5], fresh, "in the last look", tolerance=0.0)  # the window of the look is wider
