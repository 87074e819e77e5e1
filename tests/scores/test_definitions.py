"""The table of scores, and their numerical error bars."""

import math

import numpy as np
import pytest

import runout
from runout import scores
from runout.scores import assessment
from runout.scores.assessment import Assessment, Setting, add_areas
from runout.scores.definitions import Pair
from runout.scores.grid import Grid
from runout.studies.convergence import compared

BARS = scores.ErrorBars(
    {
        "quantities": {"f99": {"error": 12.0}, "area_above_0.5_m": {"error": 200.0}},
        "fields": [
            {"map": "flow_thickness", "critical_success_index": {"0.5": 0.9}},
        ],
    }
)
TABLE = scores.Contingency(hits=600.0, misses=200.0, false_alarms=400.0)


def test_scores_are_a_lazy_part_of_the_public_interface():
    assert runout.scores is scores
    assert "scores" in runout.__all__
    for name in scores.__all__:
        assert getattr(scores, name) is not None


SHARES = {"csi", "pod", "far", "brier", "erosion_csi", "deposition_csi", "change_csi", "agreement"}
RATIOS = {"area_bias", "width_bias", "volume_bias", "erosion_volume_bias", "deposition_volume_bias"}
DIFFERENCES = {"bias", "front_error", "lateral_shift", "energy_line_error_deg", "arrival_bias"}
MAGNITUDES = {"rmse", "relative_l1", "lateral_error", "arrival_rmse", "missed_arrivals", "reach_error"}
RANGES = dict.fromkeys(SHARES, "0 to 1") | dict.fromkeys(RATIOS | MAGNITUDES, "0 or more") | dict.fromkeys(DIFFERENCES, "any")


def test_every_score_has_the_range_of_its_kind_and_says_what_it_is():
    assert {name: one.range for name, one in scores.DEFINITIONS.items()} == RANGES
    for name, one in scores.DEFINITIONS.items():
        assert one.best == (1.0 if name in RATIOS or name.endswith(("csi", "pod", "agreement")) else 0.0), name
        assert one.meaning
        assert one.undefined
        assert one.title


def test_a_table_of_members_has_one_score_of_each_kind_of_evidence():
    headlines = {name for name, one in scores.DEFINITIONS.items() if one.is_headline}
    of_changes = {"erosion_volume_bias", "deposition_volume_bias", "deposition_csi"}
    assert headlines == {"csi", "volume_bias", "rmse", "front_error", "arrival_bias", "reach_error", *of_changes}


def evidence_of(modelled, observed):
    """All kinds of evidence that two maps (rows, columns) give, by their names."""
    line, places = scores.Thalweg(np.array([[0.0, 45.0], [300.0, 45.0]])), 10.0 * np.arange(max(modelled.shape)) + 5.0
    axes = places[: modelled.shape[1]], places[: modelled.shape[0]][::-1]
    errors = scores.field_errors(modelled, observed, 100.0)
    return {
        "area": scores.contingency(modelled > 0, observed > 0, 100.0),
        "field": errors,
        "volume": errors,
        "maps": Pair(modelled, observed, 100.0),
        "thalweg": scores.thalweg_errors(line, *axes, modelled > 0, observed > 0),
        "arrival": scores.arrival_errors(modelled.ravel(), observed.ravel()),
        "points": scores.point_errors(modelled.ravel(), observed.ravel()),
        "change": scores.change_errors(
            *(values - 0.5 * (np.roll(values, 6, 1) > 0) for values in (modelled, observed)), 100.0, 0.1
        ),
        "reaches": scores.reach_errors(
            modelled, observed, scores.Reaches.of(line, 3, Grid(0.0, 0.0, (10.0, 10.0), modelled.shape))
        ),
    }


def test_a_perfect_model_has_the_best_value_of_every_score_and_another_one_has_not():
    rng = np.random.default_rng(4)
    observed, other = np.zeros((2, 9, 20))
    observed[3:7, 2:12], other[4:9, 2:15] = rng.random((4, 10)), 2.0 + rng.random((5, 13))
    other[3, 2] = math.inf  # never reached
    perfect, wrong = evidence_of(observed, observed), evidence_of(np.where(np.isinf(other), 0.0, other), observed)
    wrong["arrival"] = scores.arrival_errors(other.ravel(), observed.ravel())
    for kind, evidence in perfect.items():
        found = list(assessment.scores_of(kind, "flow", evidence, "m"))
        assert bool(found) == (kind != "maps")
        for score, less in zip(found, assessment.scores_of(kind, "flow", wrong[kind], "m"), strict=True):
            definition = score.definition
            assert score.value == pytest.approx(definition.best, abs=1e-12), (kind, score.name)
            assert definition.low <= less.value <= definition.high, (kind, score.name)
            assert abs(less.value - definition.best) > 0.01, (kind, score.name)


def test_scores_of_areas_carry_the_error_bars_of_the_site():
    found = {
        s.name: s for s in assessment.scores_of("area", "outline", TABLE, bars=BARS.of_contingency(TABLE, "flow_thickness", 0.5))
    }
    assert found["csi"].value == 0.5
    assert found["csi"].numerical_error == pytest.approx(0.1 * 1000 / 1200)
    assert found["pod"].numerical_error == pytest.approx(0.1 * 1000 / 800)
    assert found["far"].numerical_error == pytest.approx(0.1)
    assert found["area_bias"].numerical_error == pytest.approx(200 / 800)
    other = BARS.of_contingency(TABLE, "flow_thickness", 1.0)
    assert {s.numerical_error for s in assessment.scores_of("area", "outline", TABLE, bars=other)} == {None}
    assert {s.numerical_error for s in assessment.scores_of("area", "outline", TABLE)} == {None}


def test_a_switch_of_cells_within_the_bar_moves_csi_by_no_more_than_it():
    rng = np.random.default_rng(1)
    one, observed = (rng.random((2, 40, 40)) < 0.4).astype(float)
    for share in (0.02, 0.1):
        other = np.where(rng.random(one.shape) < share, 1.0 - one, one)
        agreement = scores.contingency(other, one).critical_success_index
        bars = scores.ErrorBars({"fields": [{"map": "deposit", "critical_success_index": {"1": agreement}}]})
        table = scores.contingency(one, observed)
        bar = bars.of_contingency(table, "deposit", 1.0)["csi"]
        moved = scores.contingency(other, observed).critical_success_index
        assert abs(moved - table.critical_success_index) <= 1.2 * bar


def test_front_and_energy_line_carry_the_error_of_the_front():
    errors = scores.ThalwegErrors(110.0, 100.0, 1.0, 0.0, 1.0, 50.0, 0)
    front = next(assessment.scores_of("thalweg", "flow", errors, bars=BARS.of_thalweg(errors, None, "flow_thickness", 0.0)))
    assert (front.value, front.numerical_error, front.units) == (10.0, 12.0, "m")
    line = scores.Thalweg(np.array([[0.0, 0.0], [200.0, 0.0]]))
    east = np.arange(200.0)
    ground = assessment.Ground(east, np.array([5.0, -5.0]), np.tile(100.0 - 0.5 * east, (2, 1)))
    start = scores.ReleasePoint(0.0, 0.0, 120.0)
    angle = assessment.energy_line_score("flow", errors, start, line, ground, BARS)
    expected = [math.degrees(math.atan((120 - (100 - 0.5 * s)) / s)) for s in (110.0, 100.0, 122.0)]
    assert angle.value == pytest.approx(expected[0] - expected[1], abs=0.02)
    assert angle.numerical_error == pytest.approx(abs(expected[2] - expected[0]), abs=0.02)


def test_the_error_of_the_front_of_the_flow_is_no_error_of_the_front_of_a_deposit():
    grid = scores.Grid(0.0, 0.0, (10.0, 10.0), (9, 20))
    modelled, observed = np.zeros((2, 9, 20))
    modelled[3:6, 2:15], observed[3:6, 2:12] = 1.0, 1.0
    line = scores.Thalweg(np.array([[0.0, 45.0], [200.0, 45.0]]))
    ground = np.tile(200.0 - 0.5 * grid.easting, (9, 1))
    setting = Setting([0.5], BARS, line, scores.ReleasePoint(5.0, 45.0, 197.5), ground)
    known = {}
    for quantity in ("thickness", "deposit"):
        assessment = Assessment()
        add_areas(assessment, quantity, grid, modelled, observed, quantity, 0.5, setting)
        known[quantity] = {s.name for s in assessment.scores if s.numerical_error is not None}
        assert len(assessment.scores) == 10
    assert {"front_error", "energy_line_error_deg", "csi"} <= known["thickness"]
    assert known["deposit"] == set()


@pytest.mark.parametrize(
    "content", [{"quantities": 3, "fields": 4}, {"quantities": {"f99": {"error": "x"}}, "fields": [1, {"map": 1}]}]
)
def test_a_study_that_is_not_as_it_was_written_gives_no_bars(content):
    bars = scores.ErrorBars(content)
    assert bars.front() is None
    assert set(bars.of_contingency(TABLE, "flow_thickness", 0.5).values()) == {None}


def test_stored_scores_hold_no_numbers_that_json_cannot():
    missing = {"of": "flow", "name": "csi", "value": None, "units": "1", "undefined": "neither reaches a known cell"}
    assert scores.Score("flow", "csi", math.nan).stored() == missing
    assert scores.Score("flow", "rmse", 1.5, "m", 0.1).stored()["numerical_error"] == 0.1


def rough_bars(one, other, cell_area, name):
    """Error bars of a study whose two finest grids gave these maps."""
    found = compared(other, one, (0.5,), cell_area)
    return scores.ErrorBars({"fields": [{"map": name, **found}]})


def test_scores_of_a_map_move_by_no_more_than_their_bars():
    rng = np.random.default_rng(2)
    one, observed = rng.random((2, 30, 30))
    other = np.maximum(one + 0.1 * rng.standard_normal(one.shape), 0.0)
    bars = rough_bars(one, other, 25.0, "deposit")
    before, after = (list(_of_map(values, observed, bars)) for values in (one, other))
    assert [s.name for s in before] == ["volume_bias", "bias", "rmse", "relative_l1"]
    for first, second in zip(before, after, strict=True):
        assert abs(first.value - second.value) <= 1.02 * first.numerical_error, first.name
        assert first.numerical_error < 0.2


def _of_map(values, observed, bars):
    return assessment.field_scores("deposit", scores.field_errors(values, observed, 25.0), "m", True, bars, "deposit")


def test_scores_of_a_change_move_by_no_more_than_their_bars():
    rng = np.random.default_rng(3)
    one, observed = rng.standard_normal((2, 30, 30))
    other = one + 0.1 * rng.standard_normal(one.shape)
    parts = {"deposit": (one, other), "erosion": (-one, -other), "deposition": (one, other)}
    fields = []
    for name, pair in parts.items():
        maps = pair if name == "deposit" else [np.where(values < 0.5, 0.0, values) for values in pair]
        fields.append({"map": name, **compared(maps[1], maps[0], (0.5,), 25.0)})
    bars = scores.ErrorBars({"fields": fields})
    errors = (scores.change_errors(values, observed, 25.0, 0.5) for values in (one, other))
    before, after = (list(assessment.scores_of("change", "change", found, "m", bars.of_change(found, 0.5))) for found in errors)
    barred = [pair for pair in zip(before, after, strict=True) if pair[0].name not in ("change_csi", "agreement")]
    assert len(barred) == 6
    for first, second in barred:
        assert abs(first.value - second.value) <= 1.2 * first.numerical_error, first.name
        assert first.numerical_error < 0.2


def test_differences_of_two_grids_grow_to_the_error_of_the_map():
    """An error of three differences: areas and sums three times as large, their squares nine times, no index below zero."""
    difference = {
        "map": "deposit",
        "net_sum": -2.0,
        "absolute_sum": 3.0,
        "squared_sum": 4.0,
        "critical_success_index": {"1": 0.9, "2": 0.5},
    }
    one, three = (scores.ErrorBars({"fields": [{**difference, "error_over_difference": factor}]}) for factor in (1.0, 3.0))
    errors = scores.field_errors(np.ones((2, 2)), np.full((2, 2), 2.0), 25.0)
    for name, bar in one.of_field(errors, "deposit").items():
        assert three.of_field(errors, "deposit")[name] == pytest.approx(3.0 * bar), name
    for threshold, factor in ((1.0, 3.0), (2.0, 2.0)):
        before, after = (bars.of_contingency(TABLE, "deposit", threshold)["csi"] for bars in (one, three))
        assert after == pytest.approx(factor * before)


def test_sides_arrivals_and_points_carry_the_differences_of_the_study():
    errors = scores.ThalwegErrors(110.0, 100.0, 1.0, 0.5, 1.1, 50.0, 0, 20.0)
    half = BARS.of_thalweg(errors, TABLE, "flow_thickness", 0.5)
    found = {s.name: s.numerical_error for s in assessment.scores_of("thalweg", "flow", errors, bars=half)}
    changed = 0.1 * TABLE.modelled
    assert found == {
        "front_error": 12.0,
        "lateral_error": pytest.approx(changed / 100.0),
        "lateral_shift": pytest.approx(changed / 100.0),
        "width_bias": pytest.approx(changed / (50.0 * 20.0)),
    }
    fields = [
        {"map": "arrival", "mean": -0.4, "root_mean_square": 0.9, "alone": 0.1},
        {"map": "speed", "squared_sum": 400.0, "reached_area": 100.0},
    ]
    bars = scores.ErrorBars({"fields": fields})
    errors = scores.arrival_errors([1.0, 2.0, np.inf], [1.0, 3.0, 4.0])
    arrivals = assessment.scores_of("arrival", "gauges", errors, bars=bars.of_arrival(3))
    assert [s.numerical_error for s in arrivals] == [0.4, 0.9, pytest.approx(0.3)]  # of three arrivals
    speeds = assessment.scores_of("points", "gauges", scores.point_errors([1.0], [2.0]), "m s-1", bars.at_points("speed"))
    assert [s.numerical_error for s in speeds] == [2.0, 2.0]
