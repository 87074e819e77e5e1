"""Section of a calibration: what it draws of a record, and records that it does not show."""

import json
from hashlib import sha256
from types import SimpleNamespace

import pandas as pd
import pytest

from runout.report.calibration import calibration_section

NAMES = ("basal_friction_angle_deg", "release_volume_factor")
COMPARED = {
    "units": "m", "observed": 400.0, "standard_error": 10.0, "predicted": 425.0, "standard_deviation": 10.0, "deviation": -2.5,
}  # fmt: skip
SUMMARY = {
    "mean": 15.0, "standard_deviation": 1.0, "p5": 13.5, "p50": 15.0, "p95": 16.5, "standard_deviation_over_prior": 0.25,
}  # fmt: skip
RECORD = {
    "parameters": dict.fromkeys(NAMES, SUMMARY),
    "marginals": {name: {"edges": [10.0, 15.0, 20.0], "prior": [0.5, 0.5], "posterior": [0.9, 0.1]} for name in NAMES},
    "statements": ["basal friction and volume trade: a line, not a point"],
    "misfits": ["outline.runout: observed 400 m, all 32 members lie between 410 and 900"],
    "observations": {"outline.runout": COMPARED},
    "validation": {"outline.runout": {**COMPARED, "predicted": 430.0, "deviation": -3.0}},
    "grid_error": None,
    "files_of_the_ensemble": ["a.nc", "b.nc"],
}


@pytest.fixture
def results(tmp_path):
    folder = tmp_path / "calibration"
    folder.mkdir()
    pd.DataFrame({name: [14.0, 15.0, 16.0] for name in NAMES}).to_csv(folder / "posterior.csv", index=False)
    write(folder, RECORD)
    return tmp_path


def write(folder, record):
    tables = {"posterior.csv": sha256((folder / "posterior.csv").read_bytes()).hexdigest()}
    (folder / "calibration.json").write_text(json.dumps({**record, "tables": tables}))


def study(results, files=("a.nc",)):
    return SimpleNamespace(results=results, valid=pd.DataFrame({"file": list(files)}))


def test_charts_and_tables_hold_what_the_record_states(results):
    section = calibration_section(study(results), None)
    assert len(section["marginals"]) == 2
    assert len(section["pairs"]) == 1
    assert section["pairs"][0].count("<circle") == 3
    assert section["deviations"].count("<circle") == 2  # calibration and validation
    assert [title for title, _ in section["comparisons"]] == [
        "calibration, predicted from all observations", "validation, each predicted from the other observations alone",
    ]  # fmt: skip
    assert section["comparisons"][1][1] == [("outline runout [m]", ["400", "10", "430", "10", "\u22123.0"])]
    assert section["statements"][1].startswith("outline.runout: observed 400 m")
    assert section["parameters"][0][1] == ["13.5", "15", "16.5", "1", "25%"]


def test_a_posterior_that_the_ensemble_reads_is_shown_whatever_the_members_are(results):
    table = results / "calibration" / "posterior.csv"
    section = calibration_section(study(results / "elsewhere", ["c.nc"]), table)
    assert section["source"] == "that posterior.csv comes from"


def test_several_events_have_their_own_tables(results):
    of_event = {name: RECORD[name] for name in ("observations", "validation", "misfits", "grid_error")}
    write(results / "calibration", {**RECORD, "events": {"first": of_event, "second": of_event}})
    section = calibration_section(study(results), None)
    assert section["events"] == ["first", "second"]
    titles = [title for title, _ in section["comparisons"]]
    assert titles[2:] == [
        "second: calibration, predicted from all observations", "second: validation, each predicted from the other events alone",
    ]  # fmt: skip
    assert section["deviations"].count("<circle") == 4


def test_a_record_of_other_members_or_of_another_table_is_not_shown(results):
    assert calibration_section(study(results, ["c.nc"]), None) is None
    table = results / "calibration" / "posterior.csv"
    table.write_text(table.read_text() + "14,15\n")
    assert calibration_section(study(results), None) is None
    assert calibration_section(study(results), table) is None


def test_a_site_without_a_calibration_has_no_section(tmp_path):
    assert calibration_section(study(tmp_path), None) is None
    assert calibration_section(study(tmp_path), tmp_path / "inputs" / "members.csv") is None
