"""Checksums of input files are computed once, and again for a file that was changed."""

import json
import os
import time

import pytest

from runout.io import fingerprint
from runout.io.fingerprint import KnownFiles
from runout.io.provenance import sha256


@pytest.fixture
def old_file(tmp_path):
    """A file that was written some time ago."""
    path = tmp_path / "dem.asc"
    path.write_text("1 2 3")
    os.utime(path, (time.time() - 100, time.time() - 100))
    time.sleep(0.1)  # the time of status cannot be set
    return path


def saved(tmp_path, *files):
    known = KnownFiles(tmp_path / "inputs.json")
    for file in files:
        known.sha256(file)
    known.save()
    return KnownFiles(tmp_path / "inputs.json")


def test_file_that_nobody_changed_is_not_read_again(tmp_path, old_file, monkeypatch):
    expected = sha256(old_file)
    known = saved(tmp_path, old_file)
    monkeypatch.setattr(fingerprint, "sha256", None)  # not called
    assert known.sha256(old_file) == expected


@pytest.mark.parametrize("content", ["1 2 4", "1 2 3 4"])
def test_changed_file_is_read_again_even_if_its_time_of_content_was_set_back(tmp_path, old_file, content):
    known, before = saved(tmp_path, old_file), os.stat(old_file)
    old_file.write_text(content)
    os.utime(old_file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert known.sha256(old_file) == sha256(old_file)


def test_record_names_no_folder_of_the_machine(tmp_path, old_file):
    saved(tmp_path, old_file)
    assert str(tmp_path) not in (tmp_path / "inputs.json").read_text()


@pytest.mark.parametrize(
    "content", ["", "[1]", '{"files": [], "values": 3}', '{"files": {"a": {"sha256": 1}}, "values": {"x": 1}}']
)
def test_damaged_record_counts_as_empty(tmp_path, old_file, content):
    (tmp_path / "inputs.json").write_text(content)
    known = KnownFiles(tmp_path / "inputs.json")
    assert known.sha256(old_file) == sha256(old_file)
    assert known.value("x", "key") is None


def test_value_holds_for_its_key_alone(tmp_path):
    known = saved(tmp_path)
    known.note("extent", "one", {"edges": [0.0, 1.0]})
    known.save()
    known = KnownFiles(tmp_path / "inputs.json")
    assert known.value("extent", "one") == {"edges": [0.0, 1.0]}
    assert known.value("extent", "other") is None
    assert json.loads((tmp_path / "inputs.json").read_text())["values"]["extent"]["key"] == "one"


def test_nothing_is_written_without_a_record_or_a_change(tmp_path, old_file):
    KnownFiles().save()
    known = saved(tmp_path, old_file)
    before = os.stat(tmp_path / "inputs.json").st_mtime_ns
    known.sha256(old_file)
    known.save()
    assert os.stat(tmp_path / "inputs.json").st_mtime_ns == before
