"""Hydrographs of CSV files: what is read, and every row that is refused with its line."""

import numpy as np
import pytest

from runout.errors import ConfigError, InputError
from runout.io.hydrographs import read_hydrograph


def written(folder, text):
    path = folder / "q.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("divider", [",", ";", "\t"])
def test_columns_are_found_by_name_and_unit(tmp_path, divider):
    rows = ["# gauge at the bridge", "Discharge [m3/s], note ,Time (s),velocity [m/s]", "0,a,0,1", "", "12.5,b,60,2.5", "0,,90,1"]
    found = read_hydrograph(written(tmp_path, "\n".join(rows).replace(",", divider)))
    np.testing.assert_array_equal(found.time, [0, 60, 90])
    np.testing.assert_array_equal(found.discharge, [0, 12.5, 0])
    np.testing.assert_array_equal(found.velocity, [1, 2.5, 1])
    assert found.source == str(tmp_path / "q.csv")
    assert found.volume == pytest.approx(0.5 * 12.5 * 90)


def test_velocity_may_be_missing(tmp_path):
    assert read_hydrograph(written(tmp_path, "time,discharge\n0,1\n1,1\n")).velocity is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,q\n0,1\n", r"q.csv:1: there is no column discharge among 'time, q'; write a header"),
        ("0,1\n1,2\n", r"q.csv:1: there is no column time and no column discharge"),
        ("time,time,discharge\n0,0,1\n", r"q.csv:1: time: there are two columns of this name; remove one"),
        ("time,discharge [l/s]\n0,1\n1,1\n", r"q.csv:1: discharge: the column is in 'l/s'; convert it to m3/s"),
        ("# only a note\n", r"q.csv: has no rows; write a header time,discharge"),
        ("time,discharge\n0,1\n", r"q.csv: 1 row of numbers; give two times at least"),
        ("time,discharge\n0,1\n5,0\n5,1\n", r"q.csv:4: time: is 5 s after 5 s; times must ascend"),
        ("time,discharge\n0,1\n9,0\n4,1\n", r"q.csv:4: time: is 4 s after 9 s; times must ascend"),
        ("time,discharge\n0,1\n1,-2\n", r"q.csv:3: discharge: is -2 m3/s; it must be at least 0 and at most 1e\+07"),
        ("time,discharge\n0,1\n1,nan\n", r"q.csv:3: discharge: is nan; it must be a finite number"),
        ("time,discharge\n0,1\n1,inf\n", r"q.csv:3: discharge: is inf; it must be a finite number"),
        ("time,discharge\n0,1\n1\n", r"q.csv:3: discharge: has no value; write a number, or remove the row"),
        ("time;discharge\n0;1\n1;2,5\n", r"q.csv:3: discharge: '2,5' is no number; write a decimal point"),
        ("time,discharge,velocity\n0,1,0\n1,1,2\n", r"q.csv:2: velocity: is 0 m/s; it must be above 0 where there is a discharge"),
        ("time,discharge,velocity\n0,1,1\n1,1,900\n", r"q.csv:3: velocity: is 900 m/s; it must be above 0 .* at most 200"),
        ("time,discharge\n0,0\n1,0\n", r"q.csv: discharge is 0 at all times; state an inflow, or remove it"),
        ("time,discharge\n-2,1\n-1,1\n", r"q.csv: the last time is -1 s; the run starts at 0 s"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_line(tmp_path, text, said):
    with pytest.raises(ConfigError, match=said):
        read_hydrograph(written(tmp_path, text))


def test_all_problems_are_told_at_once(tmp_path):
    with pytest.raises(ConfigError) as refused:
        read_hydrograph(written(tmp_path, "time,discharge,velocity\n0,-1,1\n0,x,y\n2,3,-1\n"))
    told = str(refused.value).splitlines()
    beginnings = ["2: discharge", "3: discharge", "3: velocity:", "3: time: is ", "4: velocity:"]
    assert [line.rsplit("q.csv:")[-1][:12] for line in told] == beginnings
    with pytest.raises(ConfigError) as refused:
        read_hydrograph(written(tmp_path, "time,discharge,velocity\n0,-1,1\n0,1,1\n2,3,-1\n"))
    assert [problem.line for problem in refused.value.problems] == [2, 3, 4]


def test_a_long_list_of_problems_is_cut(tmp_path):
    with pytest.raises(ConfigError, match="30 more rows cannot be used") as refused:
        read_hydrograph(written(tmp_path, "time,discharge\n" + "\n".join(f"{k},-1" for k in range(50))))
    assert len(refused.value.problems) == 21


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "q.csv"
    path.write_bytes(b"time,discharge\n\xff\xfe\x00")
    with pytest.raises(InputError, match=r"is no text .*; export it as CSV in UTF-8"):
        read_hydrograph(path)
    with pytest.raises(InputError, match=r"other\.csv: cannot be read"):
        read_hydrograph(tmp_path / "other.csv")
