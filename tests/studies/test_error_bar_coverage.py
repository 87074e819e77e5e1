"""Error bars hold the values of finer grids: in the study, small, and in its record."""

import json
from pathlib import Path

import numpy as np
import pytest

from docs.pages.error_bars import coverage, page
from runout.forecast.numerical_error import MAP
from runout.studies.convergence import Run, plan
from tests.benchmarks import error_bar_coverage as study

RECORD = Path(__file__).parents[1] / "benchmarks" / "records" / "error_bars.json"


def run(ratio, cell, front, field):
    maps = {"flow_thickness": field, "speed": field}
    return Run(ratio, {"f99": front, "centre_of_mass_runout": np.nan}, maps, 0.0, 1)


def ladder(cells, seed, noise=0.003):
    """Runs of a case and its true ones: front 1000 (1 - 0.04 h), a map of waves with an error of 0.1 h, and noise of both."""
    rng, h, x = np.random.default_rng(seed), 1.0 / cells, np.linspace(0.0, 20.0, 400)

    def made(ratio, size):
        front = 1000.0 * (1.0 - 0.04 * size + noise * size * rng.standard_normal())
        waves = 1.0 + 0.5 * np.sin(x)
        return run(ratio, size, front, waves * (1.0 - 0.1 * size) + noise * size * rng.standard_normal(x.shape))

    return [made(ratio, ratio * h) for ratio, *_ in plan()], None, [made(1.0, 1.0 / study.TRUTH) for _ in range(study.TRUTHS)]


def test_made_up_cases_of_first_order_are_held_by_bars_that_are_not_wide():
    cases = [case for seed in range(60) for case in study.judged(*ladder(1.5, seed))]
    assert {case["quantity"] for case in cases} == {"f99", MAP}  # a run-out that is not known is left out
    found = coverage(cases)
    assert found["holds"] >= 0.95
    assert found["ratio"] <= 3.0


def test_a_difference_beyond_the_bar_counts_as_missed():
    runs, pair, true = ladder(1.5, 0)
    far = [run(1.0, 0.1, 1300.0, one.maps["flow_thickness"]) for one in true]
    held = {case["quantity"]: case["holds"] for case in study.judged(runs, pair, far)}
    assert held == {"f99": False, MAP: True}


def test_bars_are_judged_again_by_the_true_values_of_an_earlier_record():
    runs, pair, true = ladder(1.5, 0)
    first = list(study.judged(runs, pair, true))
    again = list(study.judged_again(runs, pair, first))
    assert [case["quantity"] for case in again] == [case["quantity"] for case in first]
    assert [case["difference"] for case in again] == pytest.approx([case["difference"] for case in first])
    missed = list(study.judged_again(runs, pair, [{**case, "truth": 2000.0} for case in first if case["truth"]]))
    assert [case["holds"] for case in missed] == [False]


def test_expected_errors_are_medians_of_the_bars_at_one_cell_through_the_thickness():
    bars = [(name, cells, bar) for name in ("f99", MAP) for cells in (1.0, 2.0) for bar in (0.05, 0.1, 0.4)]
    cases = [{"quantity": name, "cells": cells, "relative_error": bar / cells} for name, cells, bar in bars]
    assert study.expected_errors(cases) == pytest.approx({"f99": 0.1, MAP: 0.1})


def test_cases_share_no_shift_and_the_true_value_has_runs_of_its_own():
    found = study.tasks(("jacksboro:15,20", "made:18"), (1.0, 1.5), 3.0, end_time=1.0, backend="scan", device="cpu")
    assert len(found) == 3 * 3
    names = [task.path for each in found.values() for task in each]
    assert len(names) == len(set(names))
    fine = [each[-1].shift % 1.0 for (_, _, cells), each in found.items() if cells != 3.0]
    assert len({round(shift, 6) for shift in fine}) == len(fine)
    for (site, _, cells), each in found.items():
        assert len(each) == (study.TRUTHS if cells == 3.0 else len(plan()) + (study.ground(site, cells).other is not None))
        assert cells == 3.0 or each[-1].fine_relief == each[1].fine_relief


def test_small_study_writes_its_record_and_goes_on_where_it_stopped(tmp_path, capsys):
    content = study.main(["--out", str(tmp_path), "--small", "--processes", "1", "--end-time", "20", "--cells", "0.6"])
    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").glob("*.npz")}
    assert len(made) == len(plan()) + (study.ground("jacksboro", 0.6).other is not None) + study.TRUTHS
    assert {case["quantity"] for case in content["cases"]} >= {"f99", MAP, "peak_speed", "area_above_1_m"}
    assert all(0.0 < case["relative_error"] < 2.0 for case in content["cases"])
    assert content["coverage"]["holds"] >= 0.75
    stored = json.loads((tmp_path / "error_bars.json").read_text())
    assert "bars hold" in page(stored).text
    first = next(iter(made))
    first.unlink()
    again = study.main(["--out", str(tmp_path), "--small", "--processes", "1", "--end-time", "20", "--cells", "0.6"])
    changed = [path for path in made if path.stat().st_mtime_ns != made[path]]
    assert changed == [first]
    assert again["cases"] == content["cases"]


def test_recorded_bars_are_true_and_tight():
    """Nine of ten bars hold or more, and not all do; the median bar is at most three times the median difference."""
    record = json.loads(RECORD.read_text())
    cases = record["cases"]
    assert {"jacksboro", "frank_slide", "cascades_2021", "made", "avakot"} == {case["site"] for case in cases}
    outside = [case for case in cases if case["held_out"]]
    assert record["coverage_held_out"] == pytest.approx(coverage(outside))
    assert coverage(outside)["holds"] >= 0.90
    assert [case["holds"] for case in cases] == [case["difference"] * abs(case["fine"] or 1.0) <= case["error"] for case in cases]
    found = coverage(cases)
    assert record["coverage"] == pytest.approx(found)
    for some in (cases, outside, *([case for case in cases if case["cells"] == cells] for cells in study.CELLS)):
        assert 0.90 <= coverage(some)["holds"] <= 0.97
        assert coverage(some)["ratio"] <= 3.0
    text = page(record).text
    assert f"{sum(case['holds'] for case in cases)} of {len(cases)} bars hold" in text
    assert "With one site left out" in text
    assert "Speed of thin flows" in text


def test_recorded_bars_of_each_quantity_hold_but_those_of_the_peak_speed_on_frank_slide():
    """The page says why: the peak speed is that of a tail that thin grids slow down, all of them alike."""
    cases = json.loads(RECORD.read_text())["cases"]
    shares = {name: coverage([c for c in cases if c["quantity"] == name])["holds"] for name in {c["quantity"] for c in cases}}
    assert {name for name, share in shares.items() if share < 0.90} == {"peak_speed"}
    assert {case["site"] for case in cases if case["quantity"] == "peak_speed" and not case["holds"]} == {"frank_slide"}


def test_a_site_that_is_left_out_has_the_constants_that_the_others_choose():
    """The tightest that hold 9 of 10 bars elsewhere, whether or not they hold on the site itself."""

    def cases(site, bar):
        return [{"site": site, "difference": 0.1, "relative_error": bar, "holds": bar >= 0.1} for _ in range(4)]

    tried = [({"SHARE": share}, cases("a", 0.9 * share) + cases("b", 0.3 * share)) for share in (0.1, 0.2, 0.4, 0.8)]
    first, second = study.left_out_sites(tried)
    assert (first["site"], first["SHARE"], first["holds"]) == ("a", 0.4, 1.0)
    assert (second["site"], second["SHARE"], second["holds"]) == ("b", 0.2, 0.0)


def test_bias_is_split_by_the_thickness_on_the_fine_grid():
    """Speeds of 4, 4 and 0 where the fine grid has 5, 4 and 1, in flows of 30, 3 and 0.2 m: -10 % of the first and the last."""
    maps = {"flow_thickness": np.array([[30.0, 3.0, 0.2]]), "speed": np.array([[5.0, 4.0, 1.0]])}
    true = Run(1.0, {}, {**maps, "pressure": maps["speed"]}, 0.0, 1)
    coarse = np.array([[4.0, 4.0, 0.0]])
    layers = study.bias_by_thickness(Run(1.0, {}, {**maps, "speed": coarse, "pressure": coarse}, 0.0, 1), true)
    found = {layer["least"]: (layer["cells"], layer["both"], round(layer["speed"], 9)) for layer in layers}
    assert found[20.0] == (1, 1, -0.1)
    assert found[2.0] == (1, 1, 0.0)
    assert found[0.0] == (1, 0, -0.1)
    assert found[5.0] == (0, 0, 0.0)
    assert layers[-1]["bias_where_both"] == pytest.approx(-0.2)
