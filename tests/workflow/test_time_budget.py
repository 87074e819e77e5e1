"""`--budget`: cells and members that fit into a time and leave the least error together."""

import json
import math

import numpy as np
import pytest
from ramp_site import SITE, write_site
from scipy.stats import qmc

from runout import cli
from runout.config.site import read_site
from runout.errors import BudgetError, ConfigError, ExitCode
from runout.forecast.accuracy import RUNOUT_ERROR
from runout.forecast.engine_notes import StepCost
from runout.forecast.sampling_error import BAR, median_error
from runout.workflow import plan
from runout.workflow.plan import forecast
from runout.workflow.time_budget import SMALL, TimeBudget, best, seconds_of

COST = StepCost(1e-2, 2e-6)


def budget_of(site, text, folder):
    return TimeBudget.of(site, text, folder, workers=1, cost_of=lambda _: COST)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return read_site(write_site(tmp_path_factory.mktemp("budget") / "ramp", SITE.replace("end_time: 20", "end_time: 3")))


@pytest.mark.parametrize(("text", "seconds"), [("90s", 90), ("30min", 1800), ("2h", 7200), ("1.5 h", 5400)])
def test_durations_are_read(text, seconds):
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["30", "min", "-2h", "0s", "2 days", "1e3s", ""])
def test_what_is_no_duration_is_refused(text):
    with pytest.raises(ConfigError, match="write a number with s, min or h"):
        seconds_of(text)


@pytest.mark.parametrize("members", [16, 64, 128])
@pytest.mark.parametrize("noise", [0.1, 0.2])
def test_error_of_a_median_is_that_of_scrambled_nets(members, noise):
    """Run-out that is linear in three parameters of different weight, with noise of the seeds: stated over true 0.8 to 1.5."""
    weights, random = np.sqrt([0.7, 0.2, 0.1]), np.random.default_rng(3)

    def runout(points):
        return np.sqrt(12 * (1 - noise)) * (points - 0.5) @ weights + np.sqrt(noise) * random.standard_normal(len(points))

    medians = [np.median(runout(qmc.Sobol(3, seed=seed).random(members))) for seed in range(300)]
    assert 0.8 < median_error(1.0, members) / BAR / np.std(medians) < 1.5


def test_error_of_a_median_of_independent_members_is_that_of_normal_values():
    medians = np.median(np.random.default_rng(1).standard_normal((20_000, 64)), axis=1)
    assert median_error(1.0, 64, net=False) / BAR == pytest.approx(np.std(medians), rel=0.03)


def test_every_choice_fits_and_the_one_of_the_least_error_is_taken(site, tmp_path):
    budget = budget_of(site, "60s", tmp_path)
    choices, spread = budget.choices(), budget.spread()
    assert len(choices) >= 3
    for one in choices:
        assert one.seconds <= 60
        assert one.members & (one.members - 1) == 0
        assert one.numerical == pytest.approx(RUNOUT_ERROR * one.cell_size[2] / 8.0)  # a slab of 8 m
        assert one.sampling == pytest.approx(median_error(spread, one.members))
        assert one.error == pytest.approx(math.sqrt(one.numerical**2 + one.sampling**2))
    for one in choices[-2:]:
        again = forecast(budget.changed(one.cell_size, one.members), range(one.members), workers=1, cost_of=lambda _: COST)
        assert again.seconds == pytest.approx(one.seconds)
        larger = forecast(budget.changed(one.cell_size, 2 * one.members), range(2 * one.members), workers=1, cost_of=lambda _: COST)
        assert larger.seconds > 60 or one.sampling <= SMALL * one.numerical
    taken = best(choices)
    assert taken.error == min(one.error for one in choices)
    assert best(budget_of(site, "20s", tmp_path).choices()).error > taken.error
    (line,) = [line for line in budget.lines(choices) if line.endswith("<- taken")]
    assert line.split()[0] == taken.cells


def test_spread_by_the_volume_is_that_of_its_cube_root(tmp_path):
    friction = "basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}"
    volume = "release_volume_factor: {distribution: discrete, values: [0.5, 1.5], frequencies: [1, 1]}"
    site = read_site(write_site(tmp_path / "ramp", SITE.replace(friction, volume)))
    roots = np.cbrt([0.5, 1.5] * 8)
    assert budget_of(site, "1h", tmp_path).spread() == pytest.approx(np.std(roots, ddof=1) / np.mean(roots), rel=1e-6)


def test_measured_error_of_the_site_counts(site, tmp_path):
    bars = {"f99": {"title": "run-out", "unit": "m", "fine": 200.0, "error": 40.0, "relative_error": 0.2}}
    (tmp_path / "convergence.json").write_text(json.dumps({"quantities": bars, "levels": [{"cell_size": [10.0, 10.0, 10.0]}]}))
    assert budget_of(site, "1min", tmp_path).numerical_error((5.0, 5.0, 5.0), 1.6) == pytest.approx(0.1)


def test_without_sampled_parameters_the_members_stay(tmp_path):
    text = SITE.split("  parameters:")[0].replace("members: 4", "members: 3") + "hazard: {percentiles: [50]}\n"
    choices = (budget := budget_of(read_site(write_site(tmp_path / "ramp", text)), "20s", tmp_path)).choices()
    assert {one.members for one in choices} == {3}
    assert best(choices) is choices[-1]
    assert "samples no parameter: their number stays" in list(budget.lines(choices))[-1]


def test_a_time_that_is_too_short_is_refused_with_one_that_fits(site, tmp_path):
    with pytest.raises(BudgetError, match="too short: 16 members on cells of 11 m, the coarsest whose error is known") as caught:
        budget_of(site, "0.1s", tmp_path).choices()
    fits = str(caught.value).split("--budget ")[1].split()[0]
    assert len(budget_of(site, fits, tmp_path).choices()) >= 1


def test_check_prints_the_choices_and_run_runs_the_one_that_is_taken(tmp_path, capsys, monkeypatch):
    folder, out = write_site(tmp_path / "ramp", SITE.replace("end_time: 20", "end_time: 1")), tmp_path / "out"
    monkeypatch.setattr(plan, "step_cost", lambda _: StepCost(0.13, 0.0))
    call = ["-q", "run", str(folder), "--workers", "1", "--budget", "35s", "--out", str(out)]
    assert cli.main(call) == ExitCode.OK
    record = json.loads((out / "run.json").read_text())
    assert record["set_by_command"] == json.loads((out / "budget.json").read_text())["settings"]
    chosen = dict(setting.split("=") for setting in record["set_by_command"])
    assert record["ensemble"]["members_valid"] == int(chosen["ensemble.members"]) >= 16
    assert record["configuration"]["simulation"]["cell_size"] == float(chosen["simulation.cell_size"])
    written = (out / "hazard.nc").stat().st_mtime_ns
    monkeypatch.setattr(plan, "step_cost", lambda _: StepCost(0.02, 0.0))  # finer cells would fit now
    assert cli.main(call) == ExitCode.OK
    assert (out / "hazard.nc").stat().st_mtime_ns == written
    capsys.readouterr()
    assert cli.main(["check", str(folder), "--budget", "35s", "--out", str(out)]) == ExitCode.OK
    assert "<- taken" in capsys.readouterr().out
    assert cli.main(["check", str(folder), "--budget", "35s", "--set", "ensemble.members=32"]) == ExitCode.CONFIGURATION
    assert "--budget chooses ensemble.members; remove --set ensemble.members=32" in capsys.readouterr().err.replace("\n", " ")
