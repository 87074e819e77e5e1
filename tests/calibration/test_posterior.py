"""Posteriors of analytical models: they cover the truth, name what trades, what is not known and what leans on its range."""

import numpy as np
import pytest

from runout.calibration import posterior as module
from runout.calibration.emulator import Emulator
from runout.calibration.posterior import Likelihood, grid_error, left_out, sampled_posterior
from runout.calibration.prior import Prior
from runout.config.distributions import Uniform
from runout.ensemble.design import sobol_points

PRIOR = Prior(
    {
        "friction": Uniform(distribution="uniform", low=10.0, high=22.0),
        "factor": Uniform(distribution="uniform", low=0.5, high=1.5),
    }
)
CELL = 5.0  # noise of the run-out [m]


def model(values, seed):
    """Run-out [m] by an energy line of the friction angle, and area [m2] by the volume; both with noise."""
    random = np.random.default_rng(seed)
    length = 300.0 * values[:, 1] ** 0.2 / np.tan(np.radians(values[:, 0]))
    area = 20.0 * length**1.2 * values[:, 1] ** 0.66
    return np.stack(
        [length + CELL * random.standard_normal(len(values)), area * (1.0 + 0.01 * random.standard_normal(len(values)))]
    )


def likelihood(seed=0, members=32, shift=0.0):
    """Likelihood without observed values, from members of one design; their friction acts as if it were larger by ``shift``."""
    points = sobol_points(members, 2, seed)
    scalars = model(PRIOR.values(points) + np.array([shift, 0.0]), seed)
    return Likelihood(PRIOR, tuple(Emulator.fit(points, one) for one in scalars), np.zeros(2), np.ones(2))


def observing(without, truth, seed, share=0.05):
    """The likelihood of what is observed of a truth (1, 2), with errors of two cells and a share of the area."""
    exact = model(truth, seed)[:, 0]
    errors = np.array([2.0 * CELL, share * exact[1]])
    observed = exact + errors * np.random.default_rng([seed, 1]).standard_normal(2)
    return Likelihood(PRIOR, without.emulators, observed, errors, without.grid_error)


@pytest.fixture
def short_chains(monkeypatch):
    monkeypatch.setattr(module, "WALKERS", 128)
    monkeypatch.setattr(module, "STEPS", 240)
    monkeypatch.setattr(module, "LENGTHS", 5.0)


def test_interval_of_90_percent_covers_the_truth_of_20_events(short_chains):
    """18 of 20 are expected; 16 to 20 have a probability of 96 %."""
    designs = [likelihood(seed) for seed in range(2)]
    hits = np.zeros(2)
    for seed in range(20):
        truth = PRIOR.values(np.random.default_rng([seed, 2]).uniform(0.1, 0.9, (1, 2)))
        rows = sampled_posterior(observing(designs[seed % 2], truth, 100 + seed), seed).summary().values()
        hits += [row["p5"] <= value <= row["p95"] for row, value in zip(rows, truth[0], strict=True)]
    assert (hits >= 16).all(), hits


def test_run_out_alone_leaves_a_line_of_friction_and_volume(short_chains):
    both = observing(likelihood(), np.array([[15.0, 1.0]]), 7)
    one = sampled_posterior(both.only([0]))
    said = list(one.statements())
    assert one.correlation[0, 1] > 0.7
    assert said[0].startswith("friction and factor trade: a line, not a point; friction rises with factor (correlation 0.")
    assert any(text.startswith("factor is not identifiable alone: its spread is ") for text in said)
    deviations, axes = one.directions()
    assert deviations[0] < 0.1 < 0.7 < deviations[1]
    np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-12)


def test_a_parameter_without_effect_keeps_its_prior(short_chains):
    points = sobol_points(32, 2, 1)
    emulator = Emulator.fit(points, 10.0 * points[:, 0])
    found = sampled_posterior(Likelihood(PRIOR, (emulator,), np.array([5.0]), np.array([0.2])))
    assert found.narrowing[1] == pytest.approx(1.0, abs=0.08)
    assert found.narrowing[0] < 0.1
    assert [text.partition(":")[0] for text in found.statements()] == ["factor is not identifiable"]
    assert found.summary()["friction"]["mean"] == pytest.approx(16.0, abs=0.1)


def test_a_truth_beyond_the_range_leans_on_it(short_chains):
    points = sobol_points(32, 2, 1)
    emulator = Emulator.fit(points, 10.0 * points[:, 0])
    found = sampled_posterior(Likelihood(PRIOR, (emulator,), np.array([11.0]), np.array([0.5])))
    (said,) = [text for text in found.statements() if "leans" in text]
    assert said.startswith("the posterior of friction leans on the range")
    assert "its upper end (22)" in said


def test_normal_posterior_of_a_linear_model_is_the_closed_form(short_chains):
    """y = 10 u, observed 4 with a standard error of 0.5: mean 0.4 and deviation 0.05 of the side of the cube."""
    points = sobol_points(32, 2, 1)
    emulator = Emulator.fit(points, 10.0 * points[:, 0])
    found = sampled_posterior(Likelihood(PRIOR, (emulator,), np.array([4.0]), np.array([0.5])))
    assert found.points[:, 0].mean() == pytest.approx(0.4, abs=0.006)
    assert found.points[:, 0].std() == pytest.approx(0.05, rel=0.1)
    assert found.values[:, 0].std() == pytest.approx(0.6, rel=0.1)


def test_pairs_of_runs_find_the_offset_of_a_grid_and_take_it_off(short_chains):
    """Coarse runs act as if the friction were 0.6 degrees larger: without pairs the posterior is low by so much."""
    coarse, points = likelihood(shift=0.6), sobol_points(16, 2, 9) * 0.6 + 0.2
    values, truth = PRIOR.values(points), np.array([[15.0, 1.0]])
    seen = observing(coarse, truth, 3, share=0.02)
    error = grid_error(seen, points, model(values + np.array([0.6, 0.0]), 50).T, model(values, 51).T)
    assert error.offset[0] * 12.0 == pytest.approx(-0.6, abs=0.2)
    assert np.sqrt(error.covariance[0, 0]) < 4.0 * CELL
    biased, repaired = (
        sampled_posterior(Likelihood(PRIOR, seen.emulators, seen.observed, seen.errors, one)) for one in (None, error)
    )
    assert repaired.values[:, 0].mean() - biased.values[:, 0].mean() == pytest.approx(0.6, abs=0.25)
    assert repaired.narrowing[0] > biased.narrowing[0]


def test_an_observation_that_is_left_out_is_predicted_by_the_others(short_chains):
    points = sobol_points(32, 2, 1)
    emulators = tuple(Emulator.fit(points, factor * points[:, 0]) for factor in (10.0, 20.0))
    agreeing = Likelihood(PRIOR, emulators, np.array([4.0, 8.0]), np.array([0.5, 1.0]))
    (mean, spread) = left_out(agreeing, ["outline", "deposit"])["deposit"]
    assert mean[0] == pytest.approx(8.0, abs=0.2)
    assert spread[0] == pytest.approx(np.hypot(1.0, 1.0), rel=0.15)


def test_points_of_a_round_lie_in_the_posterior(short_chains):
    found = sampled_posterior(observing(likelihood(), np.array([[15.0, 1.0]]), 7))
    chosen = found.spread_points(8)
    assert chosen.shape == (8, 2)
    assert len(np.unique(chosen.round(6), axis=0)) == 8
    assert (np.abs(chosen - found.points.mean(axis=0)) < 4.0 * found.points.std(axis=0)).all()
    assert found.subset(64).shape == (64, 2)
