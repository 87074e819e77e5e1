"""Error bars hold the values of grids twice as fine: on made-up ladders, and in the record of the study."""

import json
from pathlib import Path

import numpy as np
import pytest

from runout.studies import error_bar_coverage as study

RECORD = Path(__file__).parents[2] / "tests" / "benchmarks" / "records" / "error_bars.json"


def made_up(order, noise, seed):
    """Runs whose front is 1000 - 2 h^order, and an area above a threshold, each with noise that falls with the cells."""
    rng = np.random.default_rng(seed)

    def run(h, shift, number):
        front = 1000.0 - 2.0 * h**order + noise * h * rng.normal()
        return {"front": front, "area": 1e4 + 30.0 * h**order + 10 * noise * h * rng.normal()}

    return run


@pytest.mark.parametrize("order", [0.4, 0.7, 1.0, 1.5, 2.0, 2.5])
@pytest.mark.parametrize("noise", [0.0, 0.05, 0.5])
def test_nine_of_ten_bars_hold_whatever_the_order_and_the_noise(order, noise):
    cases = [case for seed in range(20) for case in study.cases_of(study.ladder(made_up(order, noise, seed), 40.0, 5))]
    held, count = study.coverage(cases)["all"]
    assert count == 20 * 2 * study.CASES
    assert held >= 0.9 * count


def test_bars_are_not_wider_than_the_whole_range_where_a_clear_order_is_seen():
    for case in study.cases_of(study.ladder(made_up(1.8, 0.0, 0), 40.0, 2)):
        assert case["error"] <= 1.0001 * abs(case["fine"] - case["coarse"])


def test_a_ladder_runs_each_grid_once_and_shifts_those_that_are_compared():
    calls = []

    def run(h, shift, number):
        calls.append((round(h, 3), shift))
        return {"front": h}

    found = study.ladder(run, 80.0, 5)
    assert [len(level) for level in found] == [5, 5, 5, 5, 1, 1, 1]
    assert len(calls) == len(set(calls))
    assert min(calls)[0] == pytest.approx(10.0)


def bar(case):
    """Error of a recorded case by its means and spread."""
    means = (case[key] for key in ("coarse", "middle", "fine", "spread"))
    return study.GridIndex.of_means(*means, study.RATIO).error


def test_recorded_bars_of_thirty_cases_hold_nine_of_ten_values():
    record = json.loads(RECORD.read_text())
    ladders = {(case["site"], case["friction"], case["rung"]) for case in record["cases"]}
    assert len(ladders) == 30
    anew = [{**case, "holds": abs(case["truth"] - case["fine"]) <= bar(case)} for case in record["cases"]]
    assert [case["holds"] for case in anew] == [case["holds"] for case in record["cases"]]
    held, count = study.coverage(anew)["all"]
    assert held >= 0.9 * count
    assert record["coverage"]["all"] == [held, count]
