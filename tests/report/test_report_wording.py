import math

from runout.report.wording import number, percent, quantity, span, volume


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


def test_a_span_of_equal_values_is_one_number_and_ignores_unknown_ones():
    assert span([3.0, 3.0], "m") == "3\u202fm"
    assert span([2.0, math.nan, 1.0], "°") == "1 to 2°"
    assert span([math.nan]) == "\u2013"
