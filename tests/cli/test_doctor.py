"""The doctor finds what is wrong and says how to mend it; caches move to where they can be written."""

import os
import subprocess
import sys
import tempfile

import pytest

from runout.backends.compile import cache_root
from runout.errors import ExitCode
from runout.forecast import engine_notes
from runout.processes import caches
from runout.workflow import doctor


def test_doctor_names_versions_devices_and_caches(capsys, monkeypatch):
    for variable in doctor.FOREIGN_DATA:
        monkeypatch.delenv(variable, raising=False)
    assert doctor.examine() == ExitCode.OK
    said = capsys.readouterr().out
    assert all(topic in said for topic in ("versions", "devices", "caches", "environment"))
    assert "numba" in said
    assert "cores" in said
    assert "nothing is wrong" in said


def test_projection_database_of_another_program_is_found(monkeypatch, tmp_path):
    monkeypatch.setenv("PROJ_DATA", str(tmp_path / "share" / "proj"))
    wrong = [f for f in doctor._foreign_data() if f.fix]
    assert len(wrong) == 1
    assert "does not exist" in wrong[0].text
    assert wrong[0].fix.startswith("unset PROJ_DATA")


def test_cache_that_cannot_be_written_is_found_with_its_variable(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    wrong = [f for f in doctor._caches() if f.fix]
    assert [("NUMBA_CACHE_DIR" in f.fix) for f in wrong] == [True]


def test_notes_on_kernels_lie_beside_the_kernels(monkeypatch, tmp_path):
    """Else a run with a new cache takes kernels for compiled that lie in another."""
    for variable in ("NUMBA_CACHE_DIR", "RUNOUT_CACHE"):  # the second comes first
        monkeypatch.setenv(variable, str(tmp_path / variable))
        assert engine_notes._folder().parent == cache_root.__wrapped__().parent == tmp_path / variable


@pytest.fixture
def unwritable_home(monkeypatch, tmp_path):
    """A home folder under a file: nothing can be made in it, whoever runs the test."""
    (tmp_path / "file").write_text("")
    for variable in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(variable, str(tmp_path / "file" / "home"))
    for cache in caches.all_caches():
        monkeypatch.setenv(cache.variable, "")  # so that it is put back afterwards
        monkeypatch.delenv(cache.variable)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def test_caches_move_to_a_temporary_folder_when_home_is_unwritable(unwritable_home, tmp_path):
    caches.prepare()
    folders = [os.environ[cache.variable] for cache in caches.all_caches()]
    assert all(folder.startswith(str(tmp_path)) for folder in folders)
    assert len(set(folders)) == 3
    assert [caches.try_to_write(cache.folder) for cache in caches.all_caches()] == [None] * 3


def test_a_cache_that_somebody_set_is_left_alone(unwritable_home, monkeypatch, tmp_path):
    monkeypatch.setenv("MPLCONFIGDIR", str(tmp_path / "file" / "mine"))
    caches.prepare()
    assert os.environ["MPLCONFIGDIR"] == str(tmp_path / "file" / "mine")


def test_a_command_works_with_a_home_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "temporary").mkdir()
    home = str(tmp_path / "file" / "home")
    places = {"HOME": home, "XDG_CACHE_HOME": home, "XDG_CONFIG_HOME": home, "TMPDIR": str(tmp_path / "temporary")}
    environment = {name: value for name, value in os.environ.items() if name not in {c.variable for c in caches.all_caches()}}
    program = "import sys; from runout.cli import main; sys.exit(main(['doctor']))"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env={**environment, **places}, capture_output=True, text=True, check=False)
    caches_said = done.stdout.partition("caches")[2].partition("environment")[0]
    assert caches_said.count(str(tmp_path / "temporary")) == 3
    assert "wrong" not in caches_said
    assert "Traceback" not in done.stderr


def test_writable_caches_stay_where_they_are(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.delenv("WARP_CACHE_PATH", raising=False)
    caches.prepare()
    assert "NUMBA_CACHE_DIR" not in os.environ
    assert not (tmp_path / "cache").exists()
