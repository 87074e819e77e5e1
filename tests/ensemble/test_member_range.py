"""Ranges of members: what a job of a job array computes, and what is refused."""

import pytest

from runout.ensemble.member import member_range
from runout.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "expected"),
    [("0:4", range(4)), ("2:4", range(2, 4)), ("2:", range(2, 8)), (":3", range(3)), ("7", range(7, 8)), ("0:8", range(8))],
)
def test_a_range_ends_before_its_second_number(text, expected):
    assert member_range(text, 8) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "this is no range; state first:end"),
        (":", "this is no range"),
        ("-1:4", "this is no range"),
        ("a:b", "this is no range"),
        ("1:2:3", "this is no range"),
        ("1.5:3", "this is no range"),
        ("4:4", "it holds no member"),
        ("5:2", "it holds no member"),
        ("8:", "the ensemble has members 0 to 7"),
        ("9", "the ensemble has members 0 to 7"),
        ("8:16", "the ensemble has members 0 to 7"),
        ("4:12", "the ensemble has members 0 to 7; use 4:8"),
    ],
)
def test_a_range_without_members_or_beyond_the_ensemble_is_refused(text, message):
    with pytest.raises(ConfigError, match=message):
        member_range(text, 8)
