"""Coarse runs beside experiments and an observed event: columns, Cascades 2021."""

import numpy as np
import pytest

import runout
from runout.studies.validation_cases import cascades_2021, columns


def test_rods_end_near_the_measured_surface_and_failure_line(results):
    """Cells of 10 mm: 3.7 mm and 9.9 mm RMS."""
    found = results("columns")["rods"][0]
    assert found["surface_rms"] < 5e-3
    assert found["failure_rms"][1] < 12e-3
    assert 0.3 < found["front"] < 0.42


def test_fewer_rods_count_as_unmoved_if_less_motion_counts(results):
    found = results("columns")["rods"][0]
    assert np.all(np.diff(found["failure_bias"]) > 0)


def test_stronger_sand_runs_out_less_far(results):
    rows = results("columns")["sand"]
    runouts = [row["runout"] for row in rows]
    assert [row["friction_angle_deg"] for row in rows] == list(columns.ANGLES)
    assert runouts[0] > 1.5 * runouts[1] > 1.5 * runouts[2]
    assert rows[0]["low"] < runouts[0] < 1.06 * rows[0]["high"]  # weaker than sand is


def test_landslide_reaches_the_place_and_moves_the_volume_of_the_event(results):
    """12 deg and cells of 5 m; nothing is fitted, and the water and the eroded bed of the event are not modelled."""
    found = results("cascades_2021")
    run, observed = found["runs"][0], found["observed"]
    assert observed["erosion_volume"] == pytest.approx(26_407, rel=0.01)
    assert observed["deposition_volume"] == pytest.approx(22_543, rel=0.01)
    assert run["erosion_volume"] == pytest.approx(run["deposition_volume"], rel=0.1)
    assert run["deposition_volume"] == pytest.approx(observed["deposition_volume"], rel=0.25)
    assert run["reach"] == pytest.approx(observed["reach"], rel=0.25)
    assert run["erosion_csi"] > 0.25
    assert run["deposition_csi"] > 0.08


def test_a_bed_adds_to_the_eroded_volume_and_reaches_hold_all_of_the_survey(results):
    """14 deg, cells of 5 m, a bed of 1.2 m; without it the source alone is lowered, by 19 300 m3."""
    found = results("cascades_2021")
    (run,), observed = found["beds"], found["observed"]
    assert run["bed"] == 1.2
    assert 2000.0 < run["entrained_volume"] < 20_000.0
    assert 20_000.0 < run["erosion_volume"] < 1.1 * observed["erosion_volume"]
    assert run["csi"] > 0.4
    assert run["agreement"] > 0.7
    assert observed["reach_volumes"] == pytest.approx([-19952, -532, 4748, 6811, -1413, 6475], abs=1.0)
    assert run["reach_error"] == pytest.approx(np.abs(np.subtract(run["reach_volumes"], observed["reach_volumes"])).sum())


def test_reach_and_fall_of_a_deposit_that_moved_by_two_cells():
    terrain = runout.Terrain.from_array(np.tile(np.arange(5.0, 0.0, -1.0), (5, 1)), 10.0)
    release = np.zeros((5, 5))
    release[2, 1] = 2.0
    event = cascades_2021.Event(terrain, runout.Release.from_array(release, terrain, placement="on_surface"), np.zeros((5, 5)))
    assert cascades_2021.fall(event, release) == pytest.approx(0.0)
    moved = np.roll(release, 2, axis=1)
    assert cascades_2021.fall(event, moved) == pytest.approx(2.0)
    assert cascades_2021.reach(event, moved) == pytest.approx(20.0)
