"""Emulators predict members that they have not seen, and their Sobol indices are those of functions with known ones."""

import sys

import numpy as np
import pytest

from runout.calibration.emulator import Emulator, varies
from runout.calibration.prior import Prior
from runout.calibration.sobol_indices import FEWEST, sobol_indices, why_refused
from runout.config.distributions import Discrete, Normal, Triangular, Uniform
from runout.ensemble.design import sobol_points
from runout.errors import LibraryError
from runout.workflow.sensitivity import analysed, lines


def uniform(low, high):
    return Uniform(distribution="uniform", low=low, high=high)


UNIT = Prior({name: uniform(0.0, 1.0) for name in "abcd"})


def additive(values, seed=0):
    """4 a + 2 b + c with noise: shares 16, 4, 1, 0 of 21 parts, and the noise."""
    noise = 0.1 * np.random.default_rng(seed).standard_normal(len(values))
    return values @ [4.0, 2.0, 1.0, 0.0] + noise


@pytest.fixture(scope="module")
def additive_indices():
    points = sobol_points(FEWEST, 4, 3)
    emulator = Emulator.fit(points, additive(UNIT.values(points)))
    return emulator, sobol_indices(emulator, UNIT)


def test_indices_of_an_additive_function_lie_in_their_intervals(additive_indices):
    emulator, found = additive_indices
    exact = np.array([16.0, 4.0, 1.0, 0.0]) / 21.0
    assert emulator.q2 > 0.98
    for estimate, interval in ((found.first, found.first_interval), (found.total, found.total_interval)):
        np.testing.assert_allclose(estimate, exact, atol=0.02)
        assert (interval[0] - 1e-3 <= exact).all()
        assert (exact <= interval[1] + 1e-3).all()
        assert (interval[1] - interval[0] < 0.25).all()


def test_what_no_parameter_explains_is_the_noise(additive_indices):
    emulator, found = additive_indices
    assert emulator.noise == pytest.approx(0.1, rel=0.4)
    assert found.unexplained == pytest.approx(0.01 / (21.0 / 12.0 + 0.01), rel=0.8)


def test_an_interaction_is_in_the_total_indices_alone():
    """y = (2 a - 1) (2 b - 1): first-order indices are 0, total ones 1."""
    prior, points = Prior({name: uniform(-1.0, 1.0) for name in "ab"}), sobol_points(64, 2, 1)
    values = prior.values(points)
    emulator = Emulator.fit(points, values[:, 0] * values[:, 1])
    found = sobol_indices(emulator, prior)
    assert (found.first < 0.05).all()
    assert (found.total > 0.95).all()


def test_a_discrete_parameter_has_the_share_of_its_variance():
    """y = x + u: x is 0 or 2 with probabilities 3/4 and 1/4, variance 3/4; u is uniform in 0 to 1, variance 1/12."""
    steps = Discrete(distribution="discrete", values=[2.0, 0.0], frequencies=[1.0, 3.0])
    prior, points = Prior({"x": steps, "u": uniform(0.0, 1.0)}), sobol_points(32, 2, 1)
    emulator = Emulator.fit(prior.snapped(points), prior.values(points).sum(axis=1))
    found = sobol_indices(emulator, prior)
    np.testing.assert_allclose(found.total, [0.9, 0.1], atol=0.02)


def test_few_members_a_constant_and_noise_are_refused():
    points = sobol_points(FEWEST, 4, 3)
    noise = np.random.default_rng(0).standard_normal(FEWEST)
    scalars = {"reached_area": noise, "runout_distance": np.full(FEWEST, 7.0)}
    found, refused = analysed(scalars, points, UNIT)
    assert found == {}
    assert "of the variance of members that it has not seen, 0.9 is needed" in refused["reached_area"]
    assert refused["runout_distance"] == "it is 7 in all members; no parameter changes it"
    assert why_refused(31, noise, None).startswith("31 members have run; 32 are needed")
    assert not varies(np.full(5, 3.0))


def test_the_table_of_the_terminal_has_the_largest_parameter_first(additive_indices):
    emulator, found = additive_indices
    quantities = {"reached_area": {"title": "area reached", "held_out_q2": emulator.q2, **found.stored()}}
    text = list(lines({"members": ["m"] * FEWEST, "quantities": quantities, "refused": {"run-out": "too few"}}))
    assert text[0].startswith("area reached: 32 members, held-out Q2 0.9")
    assert [line.split()[0] for line in text[2:5]] == ["a", "b", "c"]
    assert text[-1] == "run-out: refused: too few"


@pytest.mark.parametrize(
    "distribution",
    [
        uniform(12.0, 22.0),
        Normal(distribution="normal", mean=3.0, standard_deviation=2.0, low=1.0),
        Triangular(distribution="triangular", low=0.0, mode=0.5, high=3.0),
    ],
)
def test_coordinates_of_values_are_their_probabilities(distribution):
    prior, points = Prior({"one": distribution}), np.linspace(0.01, 0.99, 9)[:, None]
    np.testing.assert_allclose(prior.coordinates(prior.values(points)), points, atol=1e-9)


def test_deviation_of_a_prior_is_that_of_its_distribution():
    prior = Prior({"one": uniform(0.0, 12.0), "two": Normal(distribution="normal", mean=0.0, standard_deviation=3.0)})
    np.testing.assert_allclose(prior.deviations, [12.0 / np.sqrt(12.0), 3.0], rtol=5e-3)


def test_predicted_deviations_hold_for_members_that_were_left_out():
    points = sobol_points(32, 4, 5)
    emulator = Emulator.fit(points, additive(UNIT.values(points), seed=1))
    others = np.random.default_rng(2).uniform(size=(400, 4))
    mean, deviation = emulator.predict(others)
    expected = emulator.process.predict(others - 0.5, return_std=True)
    np.testing.assert_allclose((mean - emulator.centre) / emulator.scale, expected[0], atol=1e-8)
    np.testing.assert_allclose(deviation / emulator.scale / emulator.widening, expected[1], rtol=1e-6)
    inside = np.abs(additive(others, seed=3) - mean) < 1.645 * deviation
    assert 0.8 <= inside.mean() <= 0.99


def test_a_missing_library_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.gaussian_process.kernels", None)
    with pytest.raises(LibraryError, match=r"scikit-learn.*pip install 'runout\[calibration\]'"):
        Emulator.fit(sobol_points(16, 1, 0), np.arange(16.0))
