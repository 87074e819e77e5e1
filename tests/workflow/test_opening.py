"""`runout open`: the report in the browser, the project in QGIS; `view` and `animate` take the representative member."""

import json
import os
import time
import webbrowser

import numpy as np
import pytest
from ramp_site import write_site

from runout import cli
from runout.config.site import read_site
from runout.errors import ExitCode
from runout.hazard.reach import representative
from runout.report.study import read_study
from runout.workflow import seeing
from runout.workflow.study import Study


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Function that puts a program on the PATH which writes its arguments to a file; returns the file."""

    def make(name):
        script, said = tmp_path / "bin" / name, tmp_path / f"{name}.txt"
        script.parent.mkdir(exist_ok=True)
        script.write_text(f'#!/bin/sh\nprintf "%s" "$*" > "{said}"\n')
        script.chmod(0o755)
        monkeypatch.setenv("PATH", f"{script.parent}{os.pathsep}{os.environ['PATH']}")
        return said

    return make


def written(file):
    """Text of a file that another process writes."""
    for _ in range(100):
        if file.is_file() and file.read_text():
            return file.read_text()
        time.sleep(0.1)
    raise AssertionError(f"{file} was not written")


def test_the_browser_gets_the_report(finished_site, program, monkeypatch, capsys):
    folder, _ = finished_site
    said = program("my-browser")
    monkeypatch.setenv("BROWSER", "my-browser %s")
    monkeypatch.setattr(webbrowser, "_tryorder", None)  # which it made of the environment of an earlier test
    assert cli.main(["open", str(folder)]) == ExitCode.OK
    report = folder / "results" / "report.html"
    assert written(said) == report.as_uri()
    assert capsys.readouterr().out.strip() == str(report)


def test_without_a_browser_the_path_is_printed(finished_site, monkeypatch, capsys):
    folder, _ = finished_site
    for name in ("BROWSER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert cli.main(["open", str(folder)]) == ExitCode.OK
    printed = capsys.readouterr()
    assert printed.out.strip() == str(folder / "results" / "report.html")
    assert "no browser can be started here" in printed.err


def test_a_site_without_results_says_what_to_run(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp")
    assert cli.main(["open", str(folder)]) != ExitCode.OK
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"report.html: not there; run `runout run {folder}` first")
    assert cli.main(["open", str(folder), "--out", str(tmp_path / "out")]) != ExitCode.OK
    assert f"--out {tmp_path / 'out'}` first" in capsys.readouterr().err


def test_qgis_gets_the_project(finished_site, tmp_path, program, monkeypatch, capsys):
    folder, _ = finished_site
    project = tmp_path / "results" / "ramp.qgz"
    assert cli.main(["open", str(folder), "--qgis", "--out", str(project.parent)]) != ExitCode.OK
    assert "*.qgz: not there" in capsys.readouterr().err
    project.parent.mkdir()
    project.touch()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert cli.main(["open", str(folder), "--qgis", "--out", str(project.parent)]) != ExitCode.OK
    assert "there is no command qgis on the PATH" in capsys.readouterr().err
    said = program("qgis")
    assert cli.main(["open", str(folder), "--qgis", "--out", str(project.parent)]) == ExitCode.OK
    assert written(said) == str(project)


def test_the_member_of_the_last_run_is_that_of_the_report_and_of_the_products(finished_site):
    folder, _ = finished_site
    study = Study.open(folder)
    number = seeing.representative_member(study)
    valid = read_study(study.results).valid
    assert valid["runout_distance"][number] == np.sort(valid["runout_distance"])[1]  # the lower one of the two in the middle
    assert number == representative(valid)
    assert number == json.loads((study.results / "run.json").read_text())["representative_member"]
    assert seeing.of_last_run(folder, None, seeing.Choices(member=3)).member == 3
    assert seeing.of_last_run(folder, None, seeing.Choices()).member == number


def test_without_a_run_the_first_member_is_shown(tmp_path):
    site = read_site(write_site(tmp_path / "ramp"))
    assert seeing.representative_member(Study.of(site)) == 0
