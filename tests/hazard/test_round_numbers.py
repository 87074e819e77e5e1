"""Round numbers of scale bars, axes, classes and steps."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runout.hazard.round_numbers import round_above, round_below, round_edges, round_length, round_series, round_ticks

SIZES = st.floats(1e-9, 1e12)


def is_round(value):
    return f"{value:.0e}"[0] in "125" and value == float(f"{value:.0e}")


@given(SIZES)
def test_round_numbers_enclose_a_value_within_a_ratio_of_two_and_a_half(value):
    low, high = round_below(value), round_above(value)
    assert is_round(low)
    assert is_round(high)
    assert low <= value * (1 + 1e-8)
    assert high >= value * (1 - 1e-8)
    assert high / low <= 2.5 * (1 + 1e-8)


@pytest.mark.parametrize("value", [0.001, 0.02, 0.5, 1.0, 200.0, 5e6])
def test_a_round_number_stays_itself(value):
    assert round_below(value) == round_above(value) == value


def test_the_scale_bar_is_a_round_length_of_at_most_a_quarter():
    assert round_length(8000.0) == 2000.0
    assert round_length(790.0) == 100.0
    assert round_length(2100.0) == 500.0
    assert round_length(8000.0, part=0.125) == 1000.0


def test_round_ticks_are_multiples_of_one_two_or_five_within_the_range():
    assert round_ticks(0.0, 10.0, 5) == [0, 2, 4, 6, 8, 10]
    assert round_ticks(748312.0, 753000.0, 5) == [749000, 750000, 751000, 752000, 753000]
    assert round_ticks(3.0, 3.0, 5) == [3.0]


@pytest.mark.parametrize("largest", [1e-3, 1.0, 7.7, 20.0, 1e6])
def test_round_edges_ascend_below_the_largest_value(largest):
    edges = round_edges(0.0, largest)
    assert edges == sorted(set(edges))
    assert edges[0] == 0.0
    assert largest / 2 <= edges[-1] < largest
    assert 3 <= len(edges) <= 9


def test_round_edges_begin_at_or_below_the_smallest_value():
    assert round_edges(437.0, 1077.0) == [400, 500, 600, 700, 800, 900, 1000]
    assert round_edges(4.0, 4.0)[0] == 4.0


@given(SIZES, st.floats(1.0, 1e6))
def test_a_series_is_the_densest_that_fits(low, ratio):
    series = round_series(low, low * ratio, 7)
    assert all(low <= number <= low * ratio for number in series)
    assert len(series) <= max(7, math.log10(ratio) + 2)
    if ratio >= 10.0:
        assert series, "a decade holds a power of ten"


def test_series_have_three_digits_two_or_one():
    assert round_series(1.0, 60.0, 7) == [1, 2, 5, 10, 20, 50]
    assert round_series(1.0, 1000.0, 7) == [1, 3, 10, 30, 100, 300, 1000]
    assert round_series(1.0, 1e5, 7) == [1, 10, 100, 1000, 1e4, 1e5]
    assert round_series(3.0, 2.0, 7) == []
