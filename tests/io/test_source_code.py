"""The checksum of the sources tells two states of the package apart, and is the same wherever the same sources lie."""

import os
import shutil

import pytest

from runout.io import source_code
from runout.io.source_code import Checksums, checksums_of


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A small package that takes the place of runout."""
    for name in ("physics/contact.py", "report/maps.py", "cli.py"):
        (tmp_path / "a" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "a" / name).write_text("x = 1\n")
    monkeypatch.setattr(source_code, "PACKAGE", tmp_path / "a")
    return tmp_path / "a"


def now():
    """Checksums as another process finds them."""
    return source_code.checksums.__wrapped__()


@pytest.mark.parametrize(
    ("name", "of_members", "of_products"),
    [("physics/contact.py", True, True), ("report/maps.py", False, True), ("cli.py", False, True), ("new.py", True, True),
     ("physics/note.txt", False, False)],
)  # fmt: skip
def test_a_change_of_a_source_changes_what_depends_on_it(package, name, of_members, of_products):
    before = now()
    (package / name).write_text("x = 2\n")
    after = now()
    assert (after.members != before.members, after.products != before.products) == (of_members, of_products)


def test_a_change_that_keeps_size_and_time_is_found(package):
    file = package / "physics" / "contact.py"
    before, times = now(), file.stat()
    file.write_text("x = 3\n")
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert now() != before


def test_equal_sources_have_equal_checksums_wherever_they_lie(package, tmp_path):
    shutil.copytree(package, tmp_path / "b" / "site-packages" / "runout")
    assert checksums_of(tmp_path / "b" / "site-packages" / "runout") == now()


def test_a_file_that_moves_changes_the_checksum(package):
    before = now()
    (package / "physics" / "contact.py").rename(package / "physics" / "friction.py")
    assert now() != before


def test_keys_of_members_stages_and_checkpoints_hold_it(monkeypatch):
    from runout.workflow.stages import Stage, stage_key

    stage = Stage("hazard", "", ())
    before = stage_key(stage, {}, "inputs")
    monkeypatch.setattr(source_code, "checksums", lambda: Checksums("members", "products"))
    assert stage_key(stage, {}, "inputs") != before
