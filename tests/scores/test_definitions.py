"""The table of scores, and their numerical error bars."""

import math

import numpy as np
import pytest

import runout
from runout import scores
from runout.scores import scoring

BARS = scores.ErrorBars(
    {
        "quantities": {"f99": {"error": 12.0}, "area_above_0.5_m": {"error": 200.0}},
        "fields": [
            {"level": 2, "map": "flow_thickness", "critical_success_index": {"0.5": 0.5}},
            {"level": 1, "map": "flow_thickness", "critical_success_index": {"0.5": 0.9}},
        ],
    }
)
TABLE = scores.Contingency(hits=600.0, misses=200.0, false_alarms=400.0)


def test_scores_are_a_lazy_part_of_the_public_interface():
    assert runout.scores is scores
    assert "scores" in runout.__all__
    for name in scores.__all__:
        assert getattr(scores, name) is not None


def test_every_definition_holds_its_best_value_and_says_what_it_is():
    for name, one in scores.DEFINITIONS.items():
        assert one.low <= one.best <= one.high, name
        assert one.meaning
        assert one.title
        assert one.range


def test_scores_of_areas_carry_the_error_bars_of_the_site():
    found = {s.name: s for s in scoring.area_scores("outline", TABLE, BARS, "flow_thickness", 0.5)}
    assert found["csi"].value == 0.5
    assert found["csi"].numerical_error == pytest.approx(0.1 * 1000 / 1200)
    assert found["pod"].numerical_error == pytest.approx(0.1 * 1000 / 800)
    assert found["far"].numerical_error == pytest.approx(0.1)
    assert found["area_bias"].numerical_error == pytest.approx(200 / 800)
    assert {s.numerical_error for s in scoring.area_scores("outline", TABLE, BARS, "flow_thickness", 1.0)} == {None}
    assert {s.numerical_error for s in scoring.area_scores("outline", TABLE)} == {None}


def test_a_switch_of_cells_within_the_bar_moves_csi_by_no_more_than_it():
    rng = np.random.default_rng(1)
    one, observed = (rng.random((2, 40, 40)) < 0.4).astype(float)
    for share in (0.02, 0.1):
        other = np.where(rng.random(one.shape) < share, 1.0 - one, one)
        agreement = scores.contingency(other, one).critical_success_index
        bars = scores.ErrorBars({"fields": [{"level": 1, "map": "deposit", "critical_success_index": {"1": agreement}}]})
        table = scores.contingency(one, observed)
        (bar,) = [s.numerical_error for s in scoring.area_scores("", table, bars, "deposit", 1.0) if s.name == "csi"]
        moved = scores.contingency(other, observed).critical_success_index
        assert abs(moved - table.critical_success_index) <= 1.2 * bar


def test_front_and_energy_line_carry_the_error_of_the_front():
    errors = scores.ThalwegErrors(110.0, 100.0, 1.0, 0.0, 1.0, 50.0, 0)
    front = next(iter(scoring.thalweg_scores("flow", errors, BARS)))
    assert (front.value, front.numerical_error, front.units) == (10.0, 12.0, "m")
    line = scores.Thalweg(np.array([[0.0, 0.0], [200.0, 0.0]]))
    east = np.arange(200.0)
    ground = scoring.Ground(east, np.array([5.0, -5.0]), np.tile(100.0 - 0.5 * east, (2, 1)))
    start = scores.ReleasePoint(0.0, 0.0, 120.0)
    angle = scoring.energy_line_score("flow", errors, start, line, ground, BARS)
    expected = [math.degrees(math.atan((120 - (100 - 0.5 * s)) / s)) for s in (110.0, 100.0, 122.0)]
    assert angle.value == pytest.approx(expected[0] - expected[1], abs=0.02)
    assert angle.numerical_error == pytest.approx(abs(expected[2] - expected[0]), abs=0.02)


@pytest.mark.parametrize(
    "content", [{"quantities": 3, "fields": 4}, {"quantities": {"f99": {"error": "x"}}, "fields": [1, {"level": 1}]}]
)
def test_a_study_that_is_not_as_it_was_written_gives_no_bars(content):
    bars = scores.ErrorBars(content)
    assert bars.front() is None
    assert set(bars.of_contingency(TABLE, "flow_thickness", 0.5).values()) == {None}


def test_stored_scores_hold_no_numbers_that_json_cannot():
    assert scores.Score("flow", "csi", math.nan).stored() == {"of": "flow", "name": "csi", "value": None, "units": "1"}
    assert scores.Score("flow", "rmse", 1.5, "m", 0.1).stored()["numerical_error"] == 0.1
