"""Scores of areas: closed values, properties, and the published medians of the ISeeSnow tools."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from runout import scores
from runout.errors import ObservationError

SHARES = arrays(np.float64, (6, 7), elements=st.sampled_from([0.0, 0.25, 0.5, 1.0, np.nan]))


def block(first, width=4, shape=(10, 20)):
    reached = np.zeros(shape)
    reached[3:7, first : first + width] = 1.0
    return reached


def test_scores_of_two_squares_that_overlap_by_half():
    table = scores.contingency(block(4), block(6), cell_area=25.0)
    assert (table.hits, table.misses, table.false_alarms) == (200.0, 200.0, 200.0)
    assert table.correct_rejections == 25.0 * (200 - 24)
    assert table.critical_success_index == pytest.approx(1 / 3)
    assert table.probability_of_detection == table.false_alarm_ratio == 0.5
    assert table.area_bias == 1.0


def test_a_model_that_reaches_twice_the_area_detects_all_of_it_and_is_half_false():
    table = scores.contingency(block(2, 8), block(4, 4))
    assert table.probability_of_detection == 1.0
    assert table.false_alarm_ratio == table.critical_success_index == 0.5
    assert table.area_bias == 2.0


@pytest.mark.parametrize("shift", range(7))
def test_csi_of_a_shifted_square_falls_as_its_overlap(shift):
    table = scores.contingency(block(4 + shift), block(4))
    common = max(4 - shift, 0)
    assert table.critical_success_index == pytest.approx(common / (8 - common))


def test_nothing_reached_has_no_scores():
    table = scores.contingency(np.zeros((3, 3)), np.zeros((3, 3)))
    assert math.isnan(table.critical_success_index)
    assert math.isnan(table.area_bias)


@given(SHARES)
def test_a_map_is_a_perfect_forecast_of_itself(shares):
    table = scores.contingency(shares, shares, 4.0)
    assert table.misses == table.false_alarms == 0.0
    assert table.hits == pytest.approx(4.0 * np.nansum(shares))
    assert table.unknown == 4.0 * np.isnan(shares).sum()
    if table.hits:
        assert table.critical_success_index == table.probability_of_detection == table.area_bias == 1.0


@given(SHARES, SHARES)
def test_scores_are_bounded_complete_and_exchange_with_their_maps(one, other):
    table, turned = scores.contingency(one, other, 2.0), scores.contingency(other, one, 2.0)
    parts = (table.hits, table.misses, table.false_alarms, table.correct_rejections, table.unknown)
    assert min(parts) >= 0
    assert sum(parts) == pytest.approx(2.0 * one.size)
    assert (turned.hits, turned.misses) == (table.hits, table.false_alarms)
    if table.hits + table.misses + table.false_alarms > 0:
        assert 0 <= table.critical_success_index <= 1
        assert turned.critical_success_index == table.critical_success_index
    if table.observed > 0:
        assert table.critical_success_index <= table.probability_of_detection + 1e-12
    if table.observed > 0 and table.modelled > 0:
        assert 1.0 - table.false_alarm_ratio == pytest.approx(turned.probability_of_detection)
        assert table.area_bias == pytest.approx(1.0 / turned.area_bias)


def test_unknown_cells_are_excluded_and_counted_and_no_dry_ground():
    modelled, observed = block(4), block(4)
    observed[:, 6:] = np.nan
    table = scores.contingency(modelled, observed, 25.0)
    assert (table.hits, table.misses, table.false_alarms) == (8 * 25.0, 0.0, 0.0)
    assert table.unknown == 25.0 * 10 * 14


def test_a_value_written_as_the_threshold_reaches_it():
    values = np.array([[np.float32(0.1), 0.0999999, np.nan]])
    assert np.array_equal(scores.reached(values, 0.1), [[1.0, 0.0, np.nan]], equal_nan=True)


def test_maps_of_different_grids_and_shares_beyond_one_are_refused():
    with pytest.raises(ObservationError, match=r"\(2, 2\) and \(3, 2\) cells; bring them to one grid with"):
        scores.contingency(np.zeros((2, 2)), np.zeros((3, 2)))
    with pytest.raises(ObservationError, match="observed: 2 is no share of a cell"):
        scores.contingency(np.zeros((2, 2)), np.full((2, 2), 2.0))


@pytest.mark.parametrize(("case", "expected"), [("IdealizedTopo", (0.893, 0.884)), ("CoulombOnly", (0.835, 0.813))])
def test_median_csi_of_the_published_iseesnow_tools(case, expected, iseesnow):
    """Each tool against the median of the others, thickness over 0.1 and 0.5 m, on the grid of the elevations."""
    tools, _ = iseesnow(case)
    for threshold, known in zip((0.1, 0.5), expected, strict=True):
        areas = {name: scores.reached(values, threshold) for name, values in tools.items()}
        medians = []
        for name, area in areas.items():
            others = (scores.contingency(area, other) for label, other in areas.items() if label != name)
            medians.append(np.median([table.critical_success_index for table in others]))
        assert np.median(medians) == pytest.approx(known, abs=6e-4)
