"""A results folder holds files and folders only: links, pipes and devices in it are refused by every command, and named."""

import json
import logging
import os
import shutil
import stat
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import write_site

from runout import cli, log
from runout.config.site import read_site
from runout.ensemble.run import run_ensemble
from runout.errors import ConfigError, ExitCode, StorageError
from runout.io.atomic import read_json, write_json
from runout.io.boundary import irregular, open_regular
from runout.io.lock import exclusive, shared
from runout.io.part import remove_stale
from runout.io.places import fault_in_results
from runout.processes import caches
from runout.workflow import hazard_map

pytestmark = pytest.mark.skipif(os.name != "posix", reason="links and pipes of POSIX")
NAMES = ["run.log", "stages.json", "inputs.json", "checksums.json", "hazard.nc", "terrain.nc", "run.json",
         "report.html", "members", "maps", "simulations", "animations", "probes", "screen", "slopes", ".locks", "members/x.nc",
         "members/.lock",
         "maps/a.tif", ".locks/terrain", "simulations/0000.nc", "maps/deep/er/a.tif"]  # fmt: skip
COMMANDS = [
    ("check",), ("run",), ("terrain",), ("release",), ("ensemble",), ("ensemble", "--members", "0:1"), ("hazard",), ("report",),
    ("status",), ("clean",), ("simulate",), ("probe",), ("view",), ("animate",), ("animate", "--output", "film.gif"), ("screen",),
    ("suggest-release",), ("calibrate",), ("sensitivity",),
]  # fmt: skip


@pytest.fixture
def ramp(tmp_path):
    """A site without results."""
    return write_site(tmp_path / "ramp")


@pytest.fixture
def elsewhere(tmp_path):
    """Folder of somebody, with a file; both must stay as they are."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / ".profile").write_text("export A=1\n")
    yield folder
    assert [path.name for path in folder.iterdir()] == [".profile"]
    assert (folder / ".profile").read_text() == "export A=1\n"


def place(path, kind, elsewhere):
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to({"folder": elsewhere, "file": elsewhere / ".profile", "nothing": elsewhere / "new"}[kind])


@pytest.mark.parametrize("kind", ["folder", "file", "nothing", "pipe"])
@pytest.mark.parametrize("name", NAMES)
def test_links_and_pipes_are_found_wherever_they_lie(ramp, elsewhere, name, kind):
    place(ramp / "results" / name, kind, elsewhere)
    fault = fault_in_results(ramp / "results")
    assert fault.startswith(f"{ramp / 'results' / name}: is {'a named pipe' if kind == 'pipe' else 'a link'}; ")
    assert fault.endswith("remove it, or choose another folder with --out")


@pytest.mark.parametrize("kind", ["folder", "pipe"])
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_refuses_them_at_once(ramp, elsewhere, capsys, monkeypatch, command, kind):
    monkeypatch.chdir(ramp.parent)
    monkeypatch.setenv("DISPLAY", ":0")  # ``view`` refuses to start without one
    place(ramp / "results" / "members", kind, elsewhere)
    place(ramp / "results" / "run.log", "pipe" if kind == "pipe" else "file", elsewhere)
    assert cli.main([command[0], "ramp", *command[1:]]) == ExitCode.CONFIGURATION
    printed = capsys.readouterr()
    said = " ".join((printed.out + printed.err).split())
    assert f"ramp/results/members: is {'a named pipe' if kind == 'pipe' else 'a link'}, and 1 more;" in said
    assert len(list((ramp / "results").iterdir())) == 2


def test_the_interface_in_python_refuses_them_too(ramp, elsewhere):
    place(ramp / "results" / "maps", "folder", elsewhere)
    for call in (lambda: hazard_map.run(ramp), lambda: run_ensemble(read_site(ramp), ramp / "results")):
        with pytest.raises(ConfigError, match="maps: is a link"):
            call()


def test_results_may_be_a_link_to_a_folder_of_results(ramp, tmp_path):
    """On clusters the results lie on another disk."""
    disk = tmp_path / "disk"
    disk.mkdir()
    (ramp / "results").symlink_to(disk)
    assert fault_in_results(ramp / "results") == ""
    hazard_map.run(ramp, stages=("terrain",))
    assert (disk / "terrain.nc").is_file()
    (disk / "note.txt").write_text("mine")  # beside the record of stages, which says what the folder is
    assert fault_in_results(ramp / "results") == ""


def test_results_that_lead_to_other_files_are_refused(ramp, elsewhere):
    (ramp / "results").symlink_to(elsewhere)
    fault = fault_in_results(ramp / "results")
    assert f"is a link to {elsewhere}, which holds other files, such as .profile; remove the link" in fault


def test_results_that_lead_nowhere_are_refused(ramp, tmp_path):
    (ramp / "results").symlink_to(tmp_path / "missing")
    assert "which cannot be read (No such file or directory)" in fault_in_results(ramp / "results")


def test_results_in_a_folder_of_another_user_or_of_all_are_refused(ramp, tmp_path, monkeypatch):
    disk = tmp_path / "disk"
    disk.mkdir()
    (ramp / "results").symlink_to(disk)
    disk.chmod(0o777)
    assert "which can be written by every user" in fault_in_results(ramp / "results")
    disk.chmod(0o755)
    monkeypatch.setattr(os, "geteuid", lambda: disk.stat().st_uid + 1)
    if disk.stat().st_uid != 0:
        assert "which belongs to another user" in fault_in_results(ramp / "results")


@pytest.mark.parametrize("kind", ["file", "nothing", "pipe"])
def test_a_log_goes_into_no_link_and_no_pipe(tmp_path, elsewhere, kind):
    """The name of a file may hold a line of a shell, and a log line holds it."""
    place(tmp_path / "results" / "run.log", kind, elsewhere)
    with pytest.raises(StorageError, match="it is a link, a pipe or a device"), log.to_file(tmp_path / "results" / "run.log"):
        logging.getLogger("runout").error("$(touch x)")


@pytest.mark.parametrize("kind", ["file", "nothing", "pipe"])
def test_locks_and_records_are_no_links_and_no_pipes(tmp_path, elsewhere, kind):
    for name in (".lock", "record.json"):
        place(tmp_path / "results" / name, kind, elsewhere)
    for lock in (exclusive, shared):
        with pytest.raises(StorageError, match="it is a link, a pipe or a device"), lock(tmp_path / "results"):
            pass
    assert read_json(tmp_path / "results" / "record.json") == {}
    write_json({"a": 1}, tmp_path / "results" / "record.json")  # takes the place of the link
    assert read_json(tmp_path / "results" / "record.json") == {"a": 1}


def test_what_is_left_of_killed_processes_is_removed_here_only(tmp_path):
    other = tmp_path / "other"
    (other / ".a.x.part").mkdir(parents=True)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / ".b.x.part").symlink_to(other)
    (tmp_path / "results" / "members").symlink_to(other)
    assert remove_stale(tmp_path / "results") == 0
    assert (other / ".a.x.part").is_dir()


def test_a_regular_file_is_opened_and_others_are_not(tmp_path):
    (tmp_path / "a").write_text("x")
    os.close(open_regular(tmp_path / "a", os.O_RDONLY))
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "b", os.O_RDONLY)
    with pytest.raises(OSError, match="symbolic"):
        open_regular("/dev/null", os.O_WRONLY)


def test_a_large_results_folder_is_looked_through_in_a_moment(tmp_path):
    import time

    for number in range(5000):
        (tmp_path / f"{number}.nc").touch()
    started = time.perf_counter()
    assert irregular(tmp_path) == []
    assert time.perf_counter() - started < 0.5


CACHE = caches.Cache("kernels", "RUNOUT_TEST_CACHE", ("~/.cache", "runout"))


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The one cache, at its usual place in a home; a folder for temporary files beside it."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("RUNOUT_TEST_CACHE", raising=False)
    monkeypatch.setattr(caches, "all_caches", lambda: (CACHE,))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(caches.tempfile, "tempdir", str(tmp_path / "temporary"))
    folder = tmp_path / ".cache" / "runout"
    folder.mkdir(parents=True)
    yield folder
    os.environ.pop("RUNOUT_TEST_CACHE", None)


def test_a_cache_of_this_user_alone_is_used(cache):
    caches.prepare()
    assert "RUNOUT_TEST_CACHE" not in os.environ


@pytest.mark.parametrize("kind", ["link", "mode"])
def test_a_cache_in_which_others_could_place_code_is_replaced(cache, kind, tmp_path, caplog):
    if kind == "mode":
        cache.chmod(0o777)
    else:
        shutil.move(cache, tmp_path / "moved")
        cache.symlink_to(tmp_path / "moved")
    caches.prepare()
    assert Path(os.environ["RUNOUT_TEST_CACHE"]).is_relative_to(tmp_path / "temporary")
    assert f"{cache} {'is a link' if kind == 'link' else 'can be written by every user'}" in caplog.text


def test_a_stated_cache_that_every_user_writes_is_refused(cache, monkeypatch):
    monkeypatch.setenv("RUNOUT_TEST_CACHE", str(cache))
    caches.prepare()
    cache.chmod(0o777)
    with pytest.raises(ConfigError, match=r"RUNOUT_TEST_CACHE=.*can be written by every user; .* name a folder of your own"):
        caches.prepare()


@pytest.mark.parametrize("kind", ["link", "mode"])
def test_the_temporary_cache_is_a_folder_of_this_user(cache, kind, tmp_path):
    shared_name = tmp_path / "temporary" / f"runout-{os.getuid()}"
    if kind == "mode":
        shared_name.mkdir()
        shared_name.chmod(0o777)
    else:
        (tmp_path / "planted").mkdir()
        shared_name.symlink_to(tmp_path / "planted")
    folder = caches._temporary()
    assert folder != shared_name
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_cache_of_others_is_found_by_the_doctor(cache):
    from runout.workflow import doctor

    cache.chmod(0o777)
    (finding,) = doctor._caches()
    assert "can be written by every user; others could place code there" in finding.text
    assert finding.fix == "set RUNOUT_TEST_CACHE to a folder of your own"


def test_log_lines_are_json_whatever_a_name_holds(tmp_path):
    with log.to_file(tmp_path / "run.log"):
        logging.getLogger("runout").error("%s: bad", "a\n$(x)\x1b.tif")
    (line,) = (tmp_path / "run.log").read_text().splitlines()
    assert json.loads(line)["message"] == "a\n$(x)\x1b.tif: bad"
