"""First sentence of the report: which of parameters, grid and number of members decides, by hand-calculated bars."""

import dataclasses
import math

import numpy as np
import pytest

from runout.report.confidence import GRID, MEMBERS, PARAMETERS, parts, statement
from runout.report.html import write_report
from runout.report.study import read_study

SETTINGS = {"simulation": {"cell_size": 4.0}}  # 15 m of release: 3.75 cells


@pytest.fixture(scope="module")
def study(results):
    return read_study(results)


def with_runouts(study, runouts, **columns):
    """The study with other run-outs [m] of the seven valid members."""
    members = study.members.copy()
    members.loc[members["status"] == "valid", "runout_distance"] = runouts
    return dataclasses.replace(study, members=members.assign(**columns))


def shares(found):
    return {part.source: part.share for part in found}


def test_bars_are_those_of_hand_calculations(study):
    runouts = [900.0, 950.0, 1000.0, 1000.0, 1000.0, 1050.0, 1100.0]  # median 1000 m, variance 4166.7 m2
    found = shares(parts(with_runouts(study, runouts), SETTINGS))
    deviation = math.sqrt((2 * 100**2 + 2 * 50**2) / 6)
    assert found[PARAMETERS] == pytest.approx(1.645 * deviation / 1000)
    assert found[GRID] == pytest.approx(0.064 / 3.75)
    assert found[MEMBERS] == pytest.approx(1.645 * math.sqrt(math.pi / 2) * deviation / 1000 / math.sqrt(7))


def test_weights_count(study):
    runouts = [900.0, 900.0, 900.0, 1100.0, 1100.0, 1100.0, 1100.0]
    weight = np.where(np.arange(8) < 3, 1.0, 0.75)  # the failed member is number 5: 3 members of 1 and 4 of 0.75, equal sums
    found = shares(parts(with_runouts(study, runouts, weight=weight), SETTINGS))
    members = 6.0**2 / (3 + 4 * 0.75**2)
    deviation = 100.0 * math.sqrt(members / (members - 1))
    assert found[PARAMETERS] == pytest.approx(1.645 * deviation / 900)


def test_parameters_decide_where_the_spread_is_widest(study):
    changed = with_runouts(study, [700.0, 800.0, 900.0, 1000.0, 1100.0, 1200.0, 1300.0])
    said = statement(parts(changed, SETTINGS), changed)
    assert said.replace("\u202f", " ").startswith("The median run-out of 1 000 m is uncertain by ± 36 %")
    assert ": the sampled parameters decide; better knowledge of friction, volume and material would reduce it." in said


def test_the_grid_decides_where_members_agree(study):
    changed = with_runouts(study, [990.0, 1000.0, 1000.0, 1000.0, 1000.0, 1000.0, 1010.0])
    said = statement(parts(changed, {"simulation": {"cell_size": 15.0}}), changed)
    assert ": the grid decides; finer cells" in said
    assert "± 6.4" in said


def test_the_parameter_that_orders_the_run_outs_is_named(study):
    grown = study.members.iloc[[0, 1, 2, 3, 4, 6, 7, 0, 1]].reset_index(drop=True)
    grown["basal_friction_angle_deg"] = np.arange(12.0, 21.0)
    grown["runout_distance"] = 3000.0 - 100.0 * np.arange(9.0) ** 1.1
    changed = dataclasses.replace(study, members=grown)
    (first, *_) = parts(changed, SETTINGS)
    assert "rank correlation with basal friction angle -1.00" in first.basis
    assert "; a better known basal friction angle would reduce it." in statement(parts(changed, SETTINGS), changed)


def test_what_is_not_known_is_said(study):
    bare = study.members.drop(columns=["basal_friction_angle_deg", "release_volume_factor"])
    changed = dataclasses.replace(with_runouts(study, 1000.0 + np.arange(7.0)), members=bare.assign(runout_distance=1000.0))
    found = parts(changed, {"simulation": {"cell_size": 30.0}})
    assert shares(found)[PARAMETERS] is None
    assert shares(found)[GRID] is None
    said = statement(found, changed)
    assert said.endswith("The error of the sampled parameters and of the grid is not known and not in these numbers.")


def test_measured_error_of_the_grid_takes_the_place_of_the_expected_one(study):
    size = SETTINGS["simulation"]["cell_size"]
    for measured, error in ((size, 0.42), (2.0 * size, 0.21)):  # of the cells of this run, and of cells twice as large
        bars = {"quantities": {"f99": {"relative_error": 0.42}}, "levels": [{"cell_size": [measured] * 3}]}
        changed = dataclasses.replace(with_runouts(study, 1000.0 + np.arange(7.0)), convergence=bars)
        assert shares(parts(changed, SETTINGS))[GRID] == pytest.approx(error)


def test_the_report_begins_with_the_sentence(site, results):
    text = write_report(site, results).read_text(encoding="utf-8")
    main = text[text.index("<main") :]
    assert main.index("The median run-out of") < main.index('class="card"')
    assert "How sure the run-out is" in main
