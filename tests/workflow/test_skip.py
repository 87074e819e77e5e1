"""What a run skips changes nothing where it must not, and little where it may."""

import json
from dataclasses import replace

import numpy as np
import pytest
from ramp_site import CELL, ramp

from docs.pages.skip import page
from runout import DruckerPrager, Release, Terrain
from runout.backends.protocol import get_backend
from runout.model.numerics import Numerics
from runout.simulation.run import RunControl
from runout.simulation.scenario import build_scene
from tests.benchmarks import skip

SAND = DruckerPrager(density=2000.0, youngs_modulus=2e6, friction_angle=30.0)
BY_NAME = {switch.name: switch for switch in skip.SWITCHES}


def slab_on_a_ramp(columns=slice(None), end_time=14.0):
    """A slab that slides down a ramp and along a plain; ``columns`` cut from the raster may let it leave."""
    elevation = ramp()[:, columns]
    thickness = np.zeros(elevation.shape)
    thickness[9:15, 5:11] = 8.0
    terrain = Terrain(elevation, (CELL, CELL))
    release = Release(thickness, terrain, placement="on_surface")
    scene, particles = build_scene(
        terrain, release, SAND, 18.0, Numerics(cell_size=10.0, cfl=0.4)
    )  # steps short enough to leave some out
    return scene, particles, RunControl(end_time)


@pytest.fixture(scope="module")
def ramp_run():
    return slab_on_a_ramp()


def row(made, name):
    return skip.compared(*made, BY_NAME[name], 1)


def test_observing_only_the_flow_changes_no_bit_of_any_map(ramp_run):
    found = row(ramp_run, "crop")
    assert found["same_bits"]
    assert set(found["difference"].values()) == {0.0}
    assert found["steps"][0] == found["steps"][1] > 100
    assert found["observations"][0] == found["observations"][1]


def test_cropping_makes_no_edge_and_leaves_the_edge_of_the_domain_where_it_is():
    made = slab_on_a_ramp(columns=slice(0, 19), end_time=10.0)  # the flow leaves over the eastern edge
    scene, particles, control = made
    found = row(made, "crop")
    assert found["same_bits"]
    ends = [skip.follow(scene, particles, c).maps["deposit_thickness"].sum() for c in (control, replace(control, crop=False))]
    assert ends[0] == ends[1] < 0.9 * particles.volume.sum() / CELL**2
    assert skip.follow(scene, particles, control).maps["max_flow_thickness"][:, -1].max() > 0.1


def test_window_of_the_flow_holds_what_the_whole_raster_holds(ramp_run):
    scene, particles, _ = ramp_run
    results = []
    for threads in (1, 2):
        engine = get_backend("scan", threads=threads)
        engine.load(scene, particles)
        for _ in range(200):
            engine.step(engine.stable_step())
        whole, window = engine.columns(), engine.flow_columns()
        for name in ("volume", "mass", "momentum"):
            inside = np.zeros_like(getattr(whole, name))
            inside[window.window] = getattr(window, name)
            assert inside.tobytes() == getattr(whole, name).tobytes()
        assert window.mass.size < 0.5 * whole.mass.size
        results.append(whole.momentum.tobytes())
    assert results[0] == results[1]


def test_every_second_stripe_added_at_once_gives_the_sums_of_the_reference(ramp_run):
    """Many more stripes than one: a body long in both axes, on a raster finer and coarser than its blocks."""
    from runout.model.scene import Raster

    scene, particles, _ = ramp_run
    for cells in (3.0, 47.0):
        raster = Raster(int(240 // cells), int(500 // cells), (cells, cells))
        sums = []
        for name in ("scan", "reference"):
            engine = get_backend(name, threads=2)
            engine.load(replace(scene, raster=raster, surface=None), particles)
            sums.append(engine.columns())
        np.testing.assert_allclose(sums[0].mass, sums[1].mass, rtol=1e-5, atol=1e-6 * sums[1].mass.max())
        assert sums[0].mass.sum() == pytest.approx(particles.mass.sum(), rel=1e-6)


def test_cadence_and_stop_rule_change_maps_little_and_save_work(ramp_run):
    """With one substep: a transfer of four is as long as the flow may go between two observations."""
    single = replace(ramp_run[0], substeps=1), *ramp_run[1:]
    cadence, rest = row(single, "cadence"), row((*ramp_run[:2], RunControl(40.0)), "stop rule")
    assert cadence["observations"][0] < 0.75 * cadence["observations"][1]
    assert cadence["difference"]["max_flow_thickness"] < 0.02
    assert cadence["difference"]["deposit_thickness"] == 0.0  # at the same end
    assert rest["steps"][0] < rest["steps"][1]
    assert rest["difference"]["deposit_thickness"] < 0.02
    assert rest["difference"]["max_speed"] < 1e-3


def test_record_of_the_study_has_a_row_for_each_switch(tmp_path, monkeypatch):
    monkeypatch.setattr(skip, "jacksboro", lambda *choices: slab_on_a_ramp(end_time=1.0))
    record = json.loads(skip.study(tmp_path, repeats=1, checkpointed=20_000).read_text())
    text = page(record).text
    assert [line.split(" | ")[0].strip("| ") for line in text.splitlines() if line.startswith("| ")][2:] == [
        switch.name for switch in skip.SWITCHES
    ]
    assert "| yes (must) |" in text
    cost = record["checkpoint"]
    assert 100 < cost["bytes_per_particle"] < 300
    assert cost["steps"] > 0


def test_window_of_a_flow_that_is_gone_is_empty(ramp_run):
    scene, particles, _ = ramp_run
    engine = get_backend("scan", threads=1)
    engine.load(scene, particles.take(np.zeros(0, np.int64)))
    assert engine.flow_columns().mass.shape == (0, 0)
    assert engine.columns().mass.sum() == 0.0
