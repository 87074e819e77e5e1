"""The table of members: distributions, frequencies, and what stays when it grows."""

from statistics import NormalDist
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from ensemble_fakes import EIGHT
from hypothesis import given, settings
from hypothesis import strategies as st

from runout.config.schema import EnsembleSettings
from runout.ensemble.design import member_table, quantiles
from runout.errors import ConfigError

UNIFORM = SimpleNamespace(distribution="uniform", low=12.0, high=22.0)
NORMAL = SimpleNamespace(distribution="normal", mean=2000.0, standard_deviation=100.0, low=None, high=None)
CUT = SimpleNamespace(distribution="normal", mean=0.0, standard_deviation=1.0, low=0.0, high=None)
TRIANGULAR = SimpleNamespace(distribution="triangular", low=10.0, mode=12.0, high=20.0)
DISCRETE = SimpleNamespace(distribution="discrete", values=[0.5, 1, 2], frequencies=[0.6, 0.3, 0.1])
ALL = {"uniform": UNIFORM, "normal": NORMAL, "cut": CUT, "triangular": TRIANGULAR, "discrete": DISCRETE}


def table(members, parameters=None, seed=1):
    return member_table(SimpleNamespace(members=members, seed=seed, parameters=parameters))


def test_thirty_two_members_and_thirty_two_more_are_sixty_four():
    small, large = table(32, ALL), table(64, ALL)
    pd.testing.assert_frame_equal(small.drop(columns="weight"), large.drop(columns="weight").iloc[:32], check_exact=True)
    assert small["discrete"].tolist() == large["discrete"].tolist()[:32]
    assert len(large["uniform"].unique()) == 64


def test_any_number_of_members_extends_any_smaller_one():
    largest = table(100, ALL).drop(columns="weight")
    for members in (1, 2, 3, 8, 33, 99):
        smaller = table(members, ALL).drop(columns="weight")
        pd.testing.assert_frame_equal(smaller, largest.iloc[:members], check_exact=True)


def test_weights_sum_to_one_and_are_equal():
    for members in (1, 7, 8, 50):
        assert table(members, ALL)["weight"].sum() == pytest.approx(1.0, abs=1e-14)
        assert table(members, ALL)["weight"].nunique() == 1


def test_table_is_indexed_by_member_and_has_a_column_per_parameter_in_the_order_of_the_file():
    members = table(8, {"uniform": UNIFORM, "discrete": DISCRETE})
    assert members.index.tolist() == list(range(8))
    assert members.index.name == "member"
    assert members.columns.tolist() == ["uniform", "discrete", "weight", "seed"]


def test_same_seed_gives_the_same_table_and_another_seed_another():
    pd.testing.assert_frame_equal(table(16, ALL), table(16, ALL), check_exact=True)
    assert not np.isin(table(16, ALL, seed=2)["uniform"], table(16, ALL)["uniform"]).any()
    assert not np.isin(table(16, ALL, seed=2)["seed"], table(16, ALL)["seed"]).any()


def test_order_of_parameters_in_the_file_changes_no_value():
    turned = dict(reversed(ALL.items()))
    pd.testing.assert_frame_equal(table(16, turned)[list(ALL)], table(16, ALL)[list(ALL)], check_exact=True)


def test_members_without_parameters_differ_in_their_seed_only():
    for none in (None, {}):
        members = table(4, none)
        assert members.columns.tolist() == ["weight", "seed"]
        assert members["seed"].nunique() == 4
        assert members["weight"].tolist() == [0.25] * 4


def test_sixty_four_uniform_members_fall_one_into_each_stratum():
    """A Sobol sequence in base 2: every one of 64 equal intervals holds one of 64 points."""
    strata = np.floor((table(64, ALL)["uniform"] - 12.0) / 10.0 * 64)
    assert sorted(strata) == list(range(64))


def test_means_and_spreads_are_those_of_the_distributions():
    members = table(1024, ALL)
    assert members["uniform"].mean() == pytest.approx(17.0, abs=0.01)
    assert members["normal"].mean() == pytest.approx(2000.0, abs=0.5)
    assert members["normal"].std() == pytest.approx(100.0, rel=0.01)
    assert members["cut"].mean() == pytest.approx(np.sqrt(2 / np.pi), abs=0.005)  # half-normal
    assert members["triangular"].mean() == pytest.approx((10 + 12 + 20) / 3, abs=0.01)
    assert members["triangular"].median() == pytest.approx(20 - np.sqrt(0.5 * 10 * 8), abs=0.02)


def test_values_stay_between_their_bounds():
    members = table(1024, ALL)
    assert members["uniform"].between(12, 22).all()
    assert members["cut"].min() >= 0.0
    assert members["triangular"].between(10, 20).all()


def test_truncated_normal_is_renormalised_between_its_bounds():
    both = SimpleNamespace(distribution="normal", mean=0.0, standard_deviation=1.0, low=-1.0, high=2.0)
    values = quantiles(both, np.array([1e-9, 0.5, 1 - 1e-9]))
    assert values[[0, 2]] == pytest.approx([-1.0, 2.0], abs=1e-6)
    phi = NormalDist()
    assert values[1] == pytest.approx(phi.inv_cdf((phi.cdf(-1.0) + phi.cdf(2.0)) / 2), abs=1e-9)


def test_discrete_values_come_with_their_frequencies():
    counts = table(1000, ALL)["discrete"].value_counts()
    assert counts[0.5] == pytest.approx(600, abs=2)
    assert counts[1.0] == pytest.approx(300, abs=2)
    assert counts[2.0] == pytest.approx(100, abs=2)


def test_eight_members_sample_each_of_eight_equally_frequent_values_once():
    assert sorted(table(8, {"angle": EIGHT})["angle"]) == [0, 1, 2, 3, 4, 5, 6, 7]


def test_frequencies_need_not_sum_to_one_and_a_frequency_of_zero_is_never_drawn():
    counted = SimpleNamespace(distribution="discrete", values=[1, 2, 3], frequencies=[3, 0, 1])
    assert table(64, {"a": counted})["a"].value_counts().to_dict() == {1.0: 48, 3.0: 16}


@settings(max_examples=50, deadline=None)
@given(
    low=st.floats(-1e6, 1e6),
    widths=st.tuples(st.floats(1e-3, 1e6), st.floats(1e-3, 1e6)),
    probability=st.floats(2.0**-31, 1 - 2.0**-31),
)
def test_quantiles_are_inside_the_bounds_and_increase_with_probability(low, widths, probability):
    high = low + sum(widths)
    shapes = [
        SimpleNamespace(distribution="uniform", low=low, high=high),
        SimpleNamespace(distribution="triangular", low=low, mode=low + widths[0], high=high),
        SimpleNamespace(distribution="normal", mean=low + widths[0], standard_deviation=widths[1], low=low, high=high),
    ]
    for shape in shapes:
        first, second = quantiles(shape, np.array([probability / 2, probability]))
        slack = 1e-9 * (abs(low) + abs(high))
        assert low - slack <= first <= second <= high + slack


def test_unknown_distribution_is_refused_by_name():
    with pytest.raises(ConfigError, match=r"ensemble.parameters.cohesion.*'gamma'.*uniform, normal"):
        table(4, {"cohesion": SimpleNamespace(distribution="gamma")})


def test_ensemble_without_members_is_refused():
    with pytest.raises(ConfigError, match="members is 0"):
        table(0)


def test_settings_of_a_site_give_the_same_table_as_their_plain_values():
    plain = {name: {k: v for k, v in vars(shape).items() if v is not None} for name, shape in ALL.items()}
    parameters = {
        "basal_friction_angle_deg": plain["uniform"],
        "density": plain["normal"],
        "friction_angle_deg": plain["triangular"],
        "release_volume_factor": {**plain["discrete"], "values": [0.5, 1.0, 2.0]},
    }
    read = EnsembleSettings.model_validate({"members": 16, "seed": 1, "parameters": parameters})
    expected = {name: SimpleNamespace(**{"low": None, "high": None, **p}) for name, p in parameters.items()}
    pd.testing.assert_frame_equal(member_table(read), table(16, expected), check_exact=True)
