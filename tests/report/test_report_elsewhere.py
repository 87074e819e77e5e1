"""Pictures that other processes draw are those that this one draws, and are there if such a process fails."""

import operator
import os
import sys
from functools import partial

import pytest

from runout.report import elsewhere
from runout.report.elsewhere import Helpers
from runout.report.html import write_report

HERE = os.getpid()


def test_a_free_process_does_a_job_and_the_caller_what_is_left():
    with Helpers(2) as helpers:
        first, second, third = (helpers.do(job) for job in (os.getpid, partial(operator.add, 2, 3), os.getpid))
        assert third() == HERE
        assert second() == 5
        assert first() not in (HERE, third())


def test_no_more_processes_than_stated_are_started(monkeypatch):
    monkeypatch.setattr(elsewhere, "MOST", 1)
    with Helpers(5) as helpers:
        assert len(helpers.free) == 1
    assert Helpers(0).free == Helpers().free == []


def test_what_a_job_prints_is_no_result():
    with Helpers(1) as helpers:
        assert helpers.do(partial(print, "words"))() is None


@pytest.mark.parametrize("command", ["raise SystemExit(3)", "import os; os.kill(os.getpid(), 9)"])
def test_the_job_of_a_process_that_fails_is_done_here(monkeypatch, command):
    monkeypatch.setattr(elsewhere, "COMMAND", command)
    with Helpers(1) as helpers:
        assert helpers.do(os.getpid)() == HERE


def test_jobs_are_done_here_where_no_process_can_be_started(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with Helpers(2) as helpers:
        assert helpers.free == []
        assert helpers.do(os.getpid)() == HERE


def test_an_error_of_a_job_is_that_of_the_caller():
    with Helpers(1) as helpers, pytest.raises(ZeroDivisionError):
        helpers.do(partial(operator.truediv, 1, 0))()


def test_processes_without_jobs_end_with_the_context():
    with Helpers(1) as helpers:
        (process,) = helpers.free
    assert process.returncode is not None


def test_the_report_does_not_depend_on_how_many_processes_draw_it(site, results):
    alone = write_report(site, results).read_bytes()
    for count in (1, 3):
        with Helpers(count) as helpers:
            assert write_report(site, results, helpers=helpers).read_bytes() == alone
            assert helpers.free == []
