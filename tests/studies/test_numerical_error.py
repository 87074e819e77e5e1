"""Error bars of runs on several grids: power laws, noise, values that turn, maps, and what is printed of them."""

import numpy as np
import pytest

from runout.forecast.numerical_error import MAP, MAP_SAFETY, ORDER, SAFETY, SHARE, ErrorBar, fitted, measured_errors, statements

RATIOS = (2.0, 2.0, 1.7, 1.7, 1.4, 1.4, 1.2, 1.0)


def values(order, noise=0.0, seed=0):
    """A quantity 100 + 3 r^order whose runs scatter; the error on the finest grid is 3."""
    rng = np.random.default_rng(seed)
    return [100.0 + 3.0 * r**order + noise * r * rng.standard_normal() for r in RATIOS]


def test_trend_of_a_power_law_of_the_given_order_is_its_error():
    start, trend, scatter = fitted(RATIOS, values(ORDER), ORDER)
    assert (start, trend, scatter) == pytest.approx((103.0, 3.0, 0.0), abs=1e-9)
    bar = ErrorBar.of_value(RATIOS, values(ORDER), 0.0)
    assert bar.error == pytest.approx(SAFETY * 3.0)
    assert bar.relative == pytest.approx(SAFETY * 3.0 / 103.0)


@pytest.mark.parametrize("order", [1.5, 2.0, 3.0])
def test_errors_of_the_given_and_of_higher_orders_are_within_their_bars(order):
    assert 3.0 < ErrorBar.of_value(RATIOS, values(order), 0.0).error < 25.0


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("noise", [0.0, 0.2, 1.0])
def test_nine_of_ten_bars_hold_with_a_map_as_uncertain_as_the_value(order, noise):
    """A bar of 9 of 10 cases, where the relative error of the map is twice that of the value, as maps have it."""
    made = [values(order, noise, seed) for seed in range(400)]
    bars = [ErrorBar.of_value(RATIOS, found, MAP_SAFETY * 2.0 * np.hypot(3.0, noise) / 100.0) for found in made]
    held = np.mean([abs(found[-1] - 100.0) <= bar.error for found, bar in zip(made, bars, strict=True)])
    assert held >= 0.93


def test_relief_that_finer_grids_meet_widens_bars_of_values_and_maps():
    bar = ErrorBar.of_value(RATIOS, values(ORDER), 0.0, 4.0)
    assert bar.error == pytest.approx(SAFETY * 5.0)  # of a trend of 3
    distances = [0.08 * (r - 1.0) for r in RATIOS[:-1]]
    assert ErrorBar.of_map(RATIOS[:-1], distances, 0.3).error == pytest.approx(np.hypot(MAP_SAFETY * 0.08, SAFETY * 0.3))


def test_measured_errors_follow_the_cells_by_first_order():
    content = {"quantities": {"f99": {"relative_error": 0.1}}, "levels": [{"cell_size": [20.0] * 3}, {"cell_size": [10.0] * 3}]}
    assert measured_errors(content, 5.0) == (None, pytest.approx(0.05))
    assert measured_errors({}, 5.0) == (None, None)


def test_a_value_that_turns_between_the_grids_keeps_its_share_of_the_error_of_the_map():
    """Values of 97, 100, 97 have no trend at the middle of a parabola."""
    turning = [100.0 - 3.0 * (2.0 * r - 3.0) ** 2 for r in (2.0, 1.5, 1.0)]
    bar = ErrorBar.of_value((2.0, 1.5, 1.0), turning, 0.1)
    assert abs(bar.trend) < 1.0
    assert bar.error >= SHARE * 0.1 * 97.0


def test_a_map_of_first_order_has_the_slope_of_its_distances_and_one_of_noise_has_its_noise():
    first = ErrorBar.of_map(RATIOS[:-1], [0.08 * (r - 1.0) for r in RATIOS[:-1]])
    assert first.error == pytest.approx(MAP_SAFETY * 0.08)
    noise = ErrorBar.of_map(RATIOS[:-1], [0.08 * np.sqrt(2.0)] * 7)
    assert noise.error == pytest.approx(MAP_SAFETY * 0.08)
    both = ErrorBar.of_map(RATIOS[:-1], [0.08 * np.hypot(r, 1.0) for r in RATIOS[:-1]])  # noise that grows with the cells
    assert 0.08 <= both.error <= 2.0 * MAP_SAFETY * 0.08


def test_a_value_of_zero_has_no_relative_error():
    bar = ErrorBar.of_value((2.0, 1.0), (4.0, 0.0), 0.0)
    assert bar.relative is None
    assert list(statements({"quantities": {"area_above_1_m": bar.as_dict("area_above_1_m")}})) == [
        "area deeper than 1 m 0 ± 2.7 m2"
    ]


def test_statements_name_quantity_value_bar_and_unit():
    front, field = ErrorBar(1347.2, 80.0, 22.0, 0.0, 123.0), ErrorBar(None, 0.06, 0.02, 0.0, 0.08)
    found = {"quantities": {"f99": front.as_dict("f99"), MAP: field.as_dict(MAP)}}
    assert list(statements(found)) == [
        "run-out of 99 % of the mass 1347 ± 120 m (9.1 %)",
        "map of flow thickness (relative L1) ± 8 %",
    ]
