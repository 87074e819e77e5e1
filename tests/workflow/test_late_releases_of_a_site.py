"""Releases that start later in a site: `check`, the ensemble, and what report and record say of them."""

import json

import numpy as np
import xarray as xr
from ramp_site import COLUMNS, ROWS, SITE, member_file, write_raster, write_site

from runout import cli
from runout.errors import ExitCode
from runout.workflow.check import inspect

SECOND = "  - {{name: second, raster: inputs/second.tif, placement: on_surface, {}}}\nmaterial:"
SAMPLED = "    second.start_time: {distribution: uniform, low: 2, high: 8}\n"


def write_two(folder, start, sampled="", where=(9, 15)):
    """The site with a second mass further down, or beside, that states its start."""
    text = SITE.replace("material:", SECOND.format(start)).replace("members: 4", "members: 2")
    write_site(folder, text.replace("hazard:", f"{sampled}hazard:"))
    second = np.zeros((ROWS, COLUMNS))
    second[slice(*where), 14:18] = 4.0
    write_raster(folder / "inputs" / "second.tif", second)
    return folder


def test_check_says_when_each_release_starts(tmp_path):
    findings = inspect(write_two(tmp_path / "a", "start_time: 5, velocity: {speed: 3, azimuth_deg: 90}"))
    assert not findings.problems
    said = "release second starts at 5 s, with 3 m/s towards 90 deg from north; it is not there before"
    assert sum(said in note for note in findings.notes) == 1
    assert not any("start together" in note for note in findings.notes)
    findings = inspect(write_two(tmp_path / "b", "starts_when: {arrives: slab, thickness: 0.5}"))
    assert any("release second starts when the flow of slab arrives with 0.5 m" in note for note in findings.notes)


def test_check_names_a_speed_on_level_ground(tmp_path):
    folder = write_two(tmp_path / "a", "velocity: 3")
    second = np.zeros((ROWS, COLUMNS))
    second[9:15, 35:40] = 4.0
    write_raster(folder / "inputs" / "second.tif", second)
    (problem,) = inspect(folder).problems
    assert "release second: velocity states no azimuth, and the ground below the release is level in the mean" in str(problem)


def test_members_sample_the_start_and_the_report_says_it(tmp_path):
    """Two releases that start at different times: one at once, one at a time that each member draws."""
    folder = write_two(tmp_path / "site", "start_time: 4", SAMPLED)
    assert cli.main(["run", str(folder), "--workers", "1"]) == ExitCode.OK
    members = xr.open_dataset(folder / "results" / "members.nc")
    starts = members["second.start_time"].values
    assert len(set(starts.tolist())) == 2
    for number, start in enumerate(starts.tolist()):
        file = member_file(folder, number)
        with xr.open_dataset(file, group="ledger") as ledger:
            mass = ledger["mass"] + ledger["escaped_mass"] + ledger["waiting_mass"]
            np.testing.assert_allclose(mass, mass[0], rtol=1e-6)
            entered = ledger["time"].values[ledger["entered_mass"].values > 0]
            assert abs(entered[0] - start) < 1e-6
        with xr.open_dataset(file) as maps:
            assert np.atleast_1d(maps.attrs["late_source_start_time"])[0] == start
    record = json.loads((folder / "results" / "run.json").read_text())
    assert any("release second starts at 4 s" in said for said in record["releases"]["start"])
    page = (folder / "results" / "report.html").read_text()
    assert "Release second starts at 4 s; it is not there before" in page
    assert "never started" not in page


def test_the_report_warns_of_a_release_that_never_starts(tmp_path, caplog):
    folder = write_two(tmp_path / "site", "starts_when: {arrives: slab}", where=(20, 23))
    assert cli.main(["run", str(folder), "--workers", "1"]) == ExitCode.OK
    page = (folder / "results" / "report.html").read_text()
    assert "a release that waits for the flow of another never started" in page
