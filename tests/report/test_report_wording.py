import math

import pytest

from runout.forecast.accuracy import expected_errors
from runout.report.structures import LoadError
from runout.report.wording import area, number, number_within, percent, quantity, span, volume


def test_numbers_carry_three_significant_digits_and_thin_spaces():
    assert number(426798.3) == "427\u202f000"
    assert number(0.012345) == "0.0123"
    assert number(-4.0) == "\u22124"
    assert number(0.0) == "0"


def test_unknown_numbers_are_a_dash_without_a_unit():
    assert number(math.nan) == "\u2013"
    assert quantity(math.nan, "m") == "\u2013"


def test_units_are_printed_as_people_write_them():
    assert quantity(12.5, "m s-1") == "12.5\u202fm s⁻¹"
    assert quantity(12.5, "degree") == "12.5°"
    assert quantity(0.5, "1") == "0.5"
    assert percent(0.125, 3) == "12.5\u202f%"


def test_large_volumes_are_printed_in_millions():
    assert volume(36.04e6) == "36\u202fmillion m³"
    assert volume(22481) == "22\u202f500\u202fm³"


def test_small_areas_are_printed_in_square_metres():
    assert area(1.144) == "1.14\u202fkm²"
    assert area(0.00877) == "8\u202f770\u202fm²"
    assert area(0.0) == "0\u202fkm²"


def test_a_span_of_equal_values_is_one_number_and_ignores_unknown_ones():
    assert span([3.0, 3.0], "m") == "3\u202fm"
    assert span([2.0, math.nan, 1.0], "°") == "1 to 2°"
    assert span([math.nan]) == "\u2013"


@pytest.mark.parametrize(
    ("value", "share", "shown"),
    [
        (37.42, 0.14, "37"), (374.2, 0.22, "370"), (1.534, 0.18, "1.5"), (9.96, 0.02, "10"), (1234.0, 0.001, "1\u202f230"),
        (86.4, 1.5, "90"), (37.42, None, "40"), (0.0, 0.2, "0"), (0.0, None, "0"),
    ],
)  # fmt: skip
def test_the_last_digit_of_a_value_is_of_the_size_of_its_error(value, share, shown):
    assert number_within(value, share) == shown


def test_loads_are_rounded_by_the_measured_error_of_pressure_else_by_that_expected_of_the_grid():
    field = {"map": "pressure", "relative_l1": 0.2, "error_over_difference": 0.5}
    assert LoadError.of({"fields": [field]}, 0.1).share == pytest.approx(0.1)
    assert "measured for the pressure map of this site" in LoadError.of({"fields": [field]}, 0.1).statement
    expected = LoadError.of({"fields": []}, 1.5)
    assert expected.share == pytest.approx(expected_errors(1.5)[0])
    assert "numerical error of 15\u202f% leaves (expected for the thickness map of this grid)" in expected.statement
    unknown = LoadError.of(None, 0.5)
    assert unknown.share is None
    assert "Loads have one digit" in unknown.statement
