"""Three errors in each cell: spread of the members, sampling error of the mean, and the numerical error from a second grid."""

import numpy as np
import pandas as pd
import pytest
from synthetic_ensemble import SHAPE, THRESHOLDS, make_terrain, member_maps, write_part

from runout.forecast.sampling_error import BAR
from runout.hazard.exceedance import aggregate
from runout.hazard.sampling import Estimator, Strata
from runout.hazard.second_grid import DECIDING, RATIO, add_errors, numerical_error
from runout.quantities import QUANTITIES

THICKNESS = QUANTITIES["thickness"]


def hazard(folder, thicknesses, weights=None, **options):
    """Hazard maps of members whose largest thickness is stated as maps (rows, columns)."""
    folder.mkdir(exist_ok=True)
    files = [
        write_part(folder, number, make_terrain(), {**member_maps(1), "max_flow_thickness": thickness})
        for number, thickness in enumerate(thicknesses)
    ]
    return aggregate(files, weights or [1.0] * len(files), THRESHOLDS, [50.0], **options)


def block(value, rows=slice(8, 20), columns=slice(10, 30)):
    thickness = np.zeros(SHAPE)
    thickness[rows, columns] = value
    return thickness


def test_deviation_and_sampling_error_of_the_mean_are_those_of_the_values(tmp_path):
    values, weights = np.array([1.0, 2.0, 4.0, 0.0]), np.array([0.4, 0.3, 0.2, 0.1])
    maps = hazard(tmp_path, [block(value) for value in values], list(weights))
    mean, effective = weights @ values, 1.0 / np.sum(weights**2)
    deviation = np.sqrt(weights @ (values - mean) ** 2 * effective / (effective - 1.0))
    cell = maps.isel(y=10, x=15)
    assert float(cell[THICKNESS.mean]) == pytest.approx(mean)
    assert float(cell[THICKNESS.deviation]) == pytest.approx(deviation)
    assert float(cell[THICKNESS.standard_error]) == pytest.approx(deviation / np.sqrt(effective))
    assert float(maps[THICKNESS.deviation][-2, -2]) == 0.0


def test_one_member_has_no_spread(tmp_path):
    maps = hazard(tmp_path, [block(2.0)])
    assert np.isnan(maps[THICKNESS.deviation][10, 15])
    assert np.isnan(maps[THICKNESS.standard_error][10, 15])
    assert float(maps[THICKNESS.mean][10, 15]) == 2.0


@pytest.mark.parametrize("blocks", [0, 4])
def test_error_of_a_probability_is_that_of_the_mean_of_yes_and_no(blocks):
    estimator, values = Estimator(blocks), np.random.default_rng(1).random((50, 16)).astype(np.float32)
    members, limits = np.arange(16), np.array([0.3, 0.8], np.float32)
    if not blocks:
        assert estimator.of_mean(values, members, 16) is None
        return
    expected = [estimator.of_mean(values >= limit, members, 16) for limit in limits]
    np.testing.assert_array_equal(estimator.spread(values, members, 16, limits), expected)
    of_block = values.reshape(50, 4, 4).mean(axis=2, dtype=float)
    np.testing.assert_allclose(estimator.of_mean(values, members, 16), np.std(of_block, axis=1, ddof=1) / 2.0)


def test_error_of_a_stratified_mean_is_that_of_its_scenarios():
    table = pd.DataFrame({"scenario": ["a"] * 3 + ["b"] * 2, "weight": [0.2] * 3 + [0.2] * 2, "rate": [0.2] * 5})
    strata = Strata.of(table, range(5))
    values = np.array([[1.0, 2.0, 6.0, 3.0, 5.0]])
    expected = np.sqrt(0.6**2 * np.var([1, 2, 6]) / 3 + 0.4**2 * np.var([3, 5]) / 2)
    assert strata.of_mean(values, np.arange(5), 5) == pytest.approx(expected)


def test_error_of_first_order_is_the_whole_error():
    """A map a + c h on cells h and 1.5 h is off by c h."""
    exact, slope = np.full((9, 9), 3.0), np.zeros((9, 9))
    slope[4, 4] = 0.2
    error = numerical_error(exact + slope, exact + RATIO * slope, (1, 2))
    assert error[4, 4] == pytest.approx(0.2)
    assert np.count_nonzero(np.isclose(error, 0.2)) == 3 * 5  # as far as the reach
    unknown = exact.copy()
    unknown[0, 0] = np.nan
    assert np.isnan(numerical_error(unknown, exact, (1, 1))[0, 0])


def test_maps_of_two_grids_give_errors_and_the_largest_source(tmp_path):
    first = hazard(tmp_path / "first", [block(2.0), block(2.2)])
    second = hazard(tmp_path / "second", [block(2.5), block(2.7)])
    add_errors(first, second, (15.0, 15.0))
    cell = first.isel(y=10, x=15)
    assert float(cell[THICKNESS.numerical_error]) == pytest.approx(1.0)
    assert int(cell[DECIDING]) == 2  # the grid: 1.645 standard deviations are 0.23 m
    assert BAR * float(cell[THICKNESS.deviation]) < 1.0
    outside = first.isel(y=-3, x=-3)
    assert (float(outside[THICKNESS.numerical_error]), int(outside[DECIDING])) == (0.0, 0)
    probability = first["thickness_exceedance_numerical_error"].sel(thickness_threshold=2.0)
    assert float(probability.max()) == 0.0, "all members reach 2 m on both grids"
    assert first[DECIDING].attrs["flag_meanings"] == "none parameters grid number_of_members"


def test_a_probability_is_off_by_one_at_most(tmp_path):
    first = hazard(tmp_path / "first", [block(0.9)] * 2)
    add_errors(first, hazard(tmp_path / "second", [block(1.1)] * 2), (15.0, 15.0))
    errors = first["thickness_exceedance_numerical_error"].sel(thickness_threshold=1.0)
    assert float(errors.max()) == 1.0
