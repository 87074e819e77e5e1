"""The command ``runout validate``: cases, missing data, records."""

import json
import runpy
from pathlib import Path

import pytest

from runout.cli import main
from runout.errors import ConfigError, ExitCode, InputError
from runout.studies import validation
from runout.studies.validation import CASES
from runout.studies.validation_cases.case import ValidationCase, data_folder

ROOT = Path(__file__).parents[2]


def test_without_a_case_the_command_lists_all(caplog):
    with caplog.at_level("INFO", "runout.validation"):
        assert main(["validate"]) == ExitCode.OK
    for case in CASES.values():
        assert case.title in caplog.text


def test_an_unknown_case_is_refused_with_the_list():
    with pytest.raises(ConfigError, match=r"no case 'bingham'; choose among coulomb_only"):
        validation.named("bingham")


@pytest.mark.parametrize("folder", [None, "empty"])
def test_missing_data_are_named_with_their_source(monkeypatch, tmp_path, folder):
    if folder is None:
        monkeypatch.delenv("RUNOUT_DATA", raising=False)
    else:
        monkeypatch.setenv("RUNOUT_DATA", str(tmp_path))
    with pytest.raises(InputError, match=r"iseesnow/CoulombOnly.* get the files from example\.org"):
        data_folder("iseesnow/CoulombOnly", "example.org")


def fake_case(seen):
    """A case that notes the size it was run at."""

    def measure(full):
        seen.append(full)
        return {"lines": ["  one line"]}

    return ValidationCase("fake", "a title", measure)


def test_a_record_says_how_it_was_made(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setitem(CASES, "fake", fake_case(seen))
    assert main(["--out", str(tmp_path), "validate", "fake", "--full"]) == ExitCode.OK
    record = json.loads((tmp_path / "validation_fake.json").read_text())
    assert seen == [True]
    assert record["full"]
    assert record["command"] == "runout validate fake --full --out DIR"
    assert record["machine"]["cores"] >= 1
    assert record["versions"]["numpy"]
    assert record["title"] == "a title"


def test_the_script_runs_a_case_at_its_coarse_size(monkeypatch, tmp_path, capsys):
    seen = []
    monkeypatch.setitem(CASES, "fake", fake_case(seen))
    record = runpy.run_path(str(ROOT / "pipelines" / "validation.py"))["main"](tmp_path, "fake")
    assert seen == [False]
    assert record.is_file()
    assert "one line" in capsys.readouterr().out
