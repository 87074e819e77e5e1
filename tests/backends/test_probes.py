"""Series at points and cross-sections against the columns, the maps and the mass balance of the same run."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from scenes import HASH_DEVICE, SAND, at, engine_of, scene

from runout import ConfigError, Probes, Release, Terrain, simulate
from runout.model.numerics import Numerics
from runout.model.scene import Raster
from runout.quantities import peak_quantities
from runout.simulation.run import Run, RunControl
from runout.simulation.scenario import build_scene

CELL, ROWS, COLUMNS = 5.0, 14, 36
EAST = (np.arange(COLUMNS) + 0.5) * CELL
TERRAIN = Terrain(np.tile(np.maximum(0.0, 45.0 - 0.5 * EAST), (ROWS, 1)), (CELL, CELL), west=1000.0, south=2000.0)
THICKNESS = np.zeros(TERRAIN.shape)
THICKNESS[5:9, 2:8] = 4.0
RELEASE = Release(THICKNESS, TERRAIN, placement="on_surface")
PLACES = {"upper": 56.0, "lower": 91.0, "deposit": 111.0}
TOLERANCE = 0.003  # of the volume that passes, in parts of the release
OF_MAPS = {"upper": 0.003, "lower": 0.003, "deposit": 0.005}  # a map spreads the deposit at the line
LINES = {name: [(1000.0 + x, 2000.5), (1000.0 + x, 2069.5)] for name, x in PLACES.items()}
PROBES = Probes({"slope": (1047.0, 2034.0), "foot": (1096.0, 2031.0), "dry": (1178.0, 2004.0)}, LINES, interval=0.25)
FRICTION, END = 18.0, 14.0
ACROSS = {
    "straight": [(80.0, 1.0), (80.0, 118.0)], "bent": [(95.0, 10.0), (75.0, 70.0), (90.0, 118.0)],
    "turned": [(80.0, 118.0), (80.0, 1.0)],
}  # fmt: skip


@pytest.fixture
def finished(backend):
    """A run over a ramp with probes, its boxes at the start, and the columns of each observation on the whole raster."""
    numerics = Numerics(cell_size=CELL, particles_per_cell=(2, 2, 3), precision="float64")
    made, particles = build_scene(TERRAIN, [RELEASE], SAND, FRICTION, numerics)
    control = RunControl(END, stop=False, probes=PROBES.on(TERRAIN))
    run, seen = Run(backend, made, control, None, None), []
    note = run._note

    def watched(time, columns):
        whole = np.zeros((5, ROWS, COLUMNS))
        whole[:, *columns.window] = np.stack([columns.depth_volume, columns.mass, *np.moveaxis(columns.momentum, -1, 0)])
        seen.append((time, whole))
        note(time, columns)

    run._note = watched
    run.start(particles)
    boxes = run._columns().boxes
    run.go()
    return run, run.result(TERRAIN, len(particles), 0.0), boxes, seen


def upstream(thickness, x):
    """Volume [m3] west of local easting ``x`` [m]."""
    return float((thickness * np.clip((x - EAST) / CELL + 0.5, 0.0, 1.0)).sum()) * CELL**2


def upstream_of_boxes(boxes, x):
    """The same of boxes, linear between the cells of a lattice of half grid cells."""
    cell = 0.5 * CELL
    apart = np.clip((x - (np.arange(boxes.sums.shape[2]) + boxes.column + 0.5) * cell) / cell, -1.0, 1.0)
    return float((boxes.sums[0].sum(axis=0) * (0.5 + apart - 0.5 * apart * abs(apart))).sum())


def test_volume_through_a_line_is_that_upstream_at_the_start_less_that_at_the_end(finished):
    run, result, start, _ = finished
    end, passed = run._columns().boxes, result.probes.cross_sections["passed_volume"][:, -1]
    for k, line in enumerate(result.probes.probes.cross_sections):
        x = PLACES[line.name]
        change = upstream_of_boxes(start, x) - upstream_of_boxes(end, x)
        assert passed[k] == pytest.approx(change, abs=TOLERANCE * RELEASE.volume), line.name
        of_maps = upstream(THICKNESS, x) - upstream(result.fields["deposit_thickness"], x)
        assert passed[k] == pytest.approx(of_maps, abs=OF_MAPS[line.name] * RELEASE.volume), line.name
    assert upstream_of_boxes(end, PLACES["deposit"]) > 0.1 * RELEASE.volume  # some of it stays before that line


def test_series_agree_with_columns_and_maps(finished):
    run, result, _, seen = finished
    recorder = run.probes
    series = result.probes
    passed = series.cross_sections["passed_volume"]
    np.testing.assert_allclose(np.cumsum(series.cross_sections["discharge"][:, 1:] * np.diff(series.time), axis=1), passed[:, 1:])
    depth = np.array([row[:3] for row in recorder.rows])
    columns = np.array([[whole[0, r, c] / CELL**2 for r, c in ((7, 9), (7, 19), (13, 35))] for _, whole in seen])
    np.testing.assert_allclose(depth, columns, rtol=1e-12, atol=1e-15)
    assert recorder.times == [time for time, _ in seen]
    peak = result.fields["max_flow_thickness"][[7, 7, 13], [9, 19, 35]]
    np.testing.assert_allclose(depth.max(axis=0), peak, rtol=1e-12)
    for quantity in peak_quantities():
        largest = series.points[quantity.stem].max(axis=1)
        assert (largest <= series.peaks[quantity.member_map] * (1 + 1e-9)).all(), quantity.name
        assert (largest[:2] > 0.8 * series.peaks[quantity.member_map][:2]).all(), quantity.name
    assert series.points["flow_thickness"][2].max() == 0.0
    assert np.isnan(series.peaks["arrival_time"][2])
    width = series.cross_sections["flow_width"]
    assert 15.0 < width[0].max() <= width.max() <= 69.0 + 1e-9


def test_a_line_of_any_direction_is_passed_by_all_that_flies_over_it(backend):
    """On a raster coarser than the grid, on one that needs footprints, and on one whose peaks stay on the lattice."""
    for size in (8.0, 3.0, 1.0):
        x = np.random.default_rng(2).uniform((40.0, 40.0, 0.0), (60.0, 60.0, 10.0), (500, 3))
        p = at(x, (5.0, 5.0, 5.0), volume=8.0)
        p.velocity[:] = (20.0, 5.0, 0.0)
        shape = round(120 / size), round(160 / size)
        made = replace(scene(spacing=(5.0, 5.0, 5.0), gravity=(0.0, 0.0, -0.1)), raster=Raster(*shape, (size, size)))
        level = Terrain(np.zeros(shape), (size, size))
        control = RunControl(2.5, stop=False, probes=Probes({}, ACROSS).on(level))
        run = Run(engine_of(type(backend).__module__.split(".")[2]), made, control, None, None)
        run.start(p)
        run.go()
        passed = run.result(level, len(p), 0.0).probes.cross_sections["passed_volume"][:, -1]
        np.testing.assert_allclose(passed, np.array([-1.0, -1.0, 1.0]) * 4000.0, rtol=1e-3, err_msg=f"cells of {size} m")


def test_discharge_is_positive_downhill_whichever_way_a_line_is_drawn():
    drawn = {"up": LINES["lower"], "down": LINES["lower"][::-1], "on_the_plain": [(1150.0, 2069.0), (1150.0, 2001.0)]}
    lines = Probes({}, drawn).on(TERRAIN).cross_sections
    assert len(lines) == len(drawn)
    for line in lines:
        assert line.vertices[0][1] > line.vertices[-1][1], line.name  # the east, which is lower, is on the left


def test_an_interrupted_run_continues_its_series(tmp_path, caplog):
    arguments = {
        "terrain": TERRAIN, "release": RELEASE, "material": SAND, "basal_friction_angle": FRICTION, "cell_size": CELL,
        "particles_per_cell": (2, 2, 3), "end_time": 4.0, "probes": PROBES, "threads": 1, "stop": False,
    }  # fmt: skip

    def stop(fraction):
        if fraction > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(**arguments, checkpoint=tmp_path / "run.npz", checkpoint_every=0.0, progress=stop)
    with caplog.at_level(logging.INFO):
        found = simulate(**arguments, checkpoint=tmp_path / "run.npz").probes
    assert "continues from a checkpoint" in caplog.text
    whole = simulate(**arguments).probes
    for kind in ("points", "cross_sections", "peaks", "section_peaks"):
        for name, values in getattr(whole, kind).items():
            np.testing.assert_array_equal(getattr(found, kind)[name], values, err_msg=name)


def test_a_scenario_of_a_batch_has_the_series_of_its_own_run():
    from runout.simulation.batch import simulate_batch

    arguments = {
        "terrain": TERRAIN, "release": RELEASE, "material": SAND, "basal_friction_angle": FRICTION, "cell_size": CELL,
        "particles_per_cell": (2, 2, 3), "end_time": 4.0, "precision": "float64", "probes": PROBES,
    }  # fmt: skip
    ((_, found),) = simulate_batch([arguments], device=HASH_DEVICE)
    alone = simulate(**arguments, backend="hash", device=HASH_DEVICE).probes
    assert alone.cross_sections["passed_volume"].max() > 0.0
    for kind in ("points", "cross_sections", "peaks", "section_peaks"):
        for name, values in getattr(alone, kind).items():
            tolerance = 0.0 if HASH_DEVICE == "cpu" else 1e-9  # a GPU adds in no fixed order
            np.testing.assert_allclose(getattr(found.probes, kind)[name], values, tolerance, err_msg=name)


def test_all_problems_of_probes_are_named_at_once():
    with pytest.raises(ConfigError) as error:
        Probes({"": (1.0, 2.0)}, {"one": [(1.0, 2.0), (1.0, 2.0)], "odd": [(1.0, np.nan), (3.0, 4.0)]}, interval=0.0)
    text = str(error.value)
    for said in ("'' cannot be a name", "one: the line has 1 different vertex", "odd: a coordinate is not finite", "interval: 0 s"):
        assert said in text
    assert len(error.value.problems) == 4
    with pytest.raises(ConfigError, match="neither a point nor a cross-section"):
        Probes()
    outside = Probes({"far": (0.0, 0.0)}, {"long": [(1100.0, 2010.0), (1100.0, 2300.0)]})
    with pytest.raises(ConfigError, match=r"'far' at easting 0, northing 0 lies outside of .*\n.*of the length of line 'long'"):
        outside.on(TERRAIN)
