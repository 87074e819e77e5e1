"""A file that was changed is found; one that nobody touched is not read again."""

import os
import subprocess
import sys
import textwrap
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from runout.errors import InputError, StorageError
from runout.io import fingerprint, part
from runout.io.atomic import whole_file
from runout.io.fingerprint import COARSE_STEP, Fingerprint, Unchanged, fingerprints
from runout.io.lock import exclusive


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "hazard.nc"
    path.write_bytes(b"some maps")
    return path


def settled(written: Fingerprint) -> Fingerprint:
    """As if it had been noted some time after the file was written."""
    return replace(written, noted=written.changed + COARSE_STEP + 1)


def test_an_untouched_file_is_not_read_again(file, monkeypatch):
    written = fingerprints([file])[file]
    if max(written.modified, written.changed) % fingerprint.SECOND == 0:
        pytest.skip("this file system counts whole seconds")
    monkeypatch.setattr(fingerprint, "sha256", lambda _: pytest.fail("it was read"))
    assert written.fault(file) is None


def test_a_change_within_the_clock_step_of_the_file_system_is_found(file):
    written, times = Fingerprint.of(file), os.stat(file)
    file.write_bytes(b"same size")
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    same_times = replace(written, modified=os.stat(file).st_mtime_ns, changed=os.stat(file).st_ctime_ns)
    assert same_times.fault(file) == "does not hold what was written"


@pytest.mark.skipif(sys.platform == "win32", reason="a file has no time of status there")
def test_a_change_with_the_old_time_of_content_is_found(file):
    written, times = settled(Fingerprint.of(file)), os.stat(file)
    file.write_bytes(b"same size")
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert written.fault(file) == "does not hold what was written"


def test_a_copy_of_the_results_counts(file, tmp_path):
    written = settled(Fingerprint.of(file))
    copy = tmp_path / "copy.nc"
    copy.write_bytes(file.read_bytes())
    assert written.fault(copy) is None


def test_faults_are_named(file):
    written = Fingerprint.of(file)
    file.write_bytes(b"some")
    assert written.fault(file) == "has 4 bytes where 9 were written"
    file.unlink()
    assert written.fault(file) == "is missing"
    file.mkdir()
    assert written.fault(file)


def test_only_a_whole_record_is_read(file):
    stored = Fingerprint.of(file).stored()
    assert Fingerprint.read(stored).stored() == stored
    short = {name: value for name, value in stored.items() if name != "inode"}
    for wrong in (None, [], "text", {}, short, stored | {"size": "9"}, stored | {"size": True}, stored | {"more": 1}):
        assert Fingerprint.read(wrong) is None


def test_inputs_must_not_change_while_they_are_used(file):
    inputs = Unchanged([file])
    inputs.require()
    file.write_bytes(b"other maps")
    with pytest.raises(InputError, match=r"hazard\.nc: this input was changed during the run"):
        inputs.require()


def test_a_lock_is_held_once(tmp_path):
    with ExitStack() as twice:
        twice.enter_context(exclusive(tmp_path / "results"))
        with pytest.raises(StorageError, match="another run is working there"):
            twice.enter_context(exclusive(tmp_path / "results"))
    with exclusive(tmp_path / "results"):
        pass


def test_files_that_live_processes_write_are_no_litter(tmp_path):
    writing = textwrap.dedent(f"""
        import sys
        from runout.io.atomic import whole_file
        with whole_file({str(tmp_path / "maps" / "a.tif")!r}) as temporary:
            temporary.write_text("half")
            print("writing", flush=True)
            sys.stdin.read()
    """)
    live = subprocess.Popen([sys.executable, "-c", writing], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert live.stdout.readline().strip() == b"writing"
    with whole_file(tmp_path / "b.nc") as temporary:
        temporary.write_text("mine")
        assert part.remove_stale(tmp_path) == 0
    live.stdin.close()
    live.wait()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a.tif", "b.nc", "maps"]


def test_a_folder_taken_for_litter_before_it_was_locked_is_made_again(tmp_path, monkeypatch):
    lock, seen = part.lock_folder, []

    def late(folder: Path, *, wait: bool):
        if not seen:
            seen.append(folder)
            folder.rmdir()
        return lock(folder, wait=wait)

    monkeypatch.setattr(part, "lock_folder", late)
    with whole_file(tmp_path / "a.json") as temporary:
        temporary.write_text("{}")
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
