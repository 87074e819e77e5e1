"""Processes that compile share parts of their work: each part is done once, also where a process dies."""

import subprocess
import sys
from functools import partial

import pytest

from runout.backends.scan.shared_parts import complete, share

NAMES = "abcdef"
SHARES = """
import sys, time
from functools import partial
from pathlib import Path
from runout.backends.scan.shared_parts import complete, share

folder, who = Path(sys.argv[1]), sys.argv[2]

def note(name):
    with open(folder / "done.txt", "a") as file:
        file.write(f"{name} {who}\\n")
    time.sleep(0.1)

parts = {name: partial(note, name) for name in "abcdef"}
share(parts, folder)
complete(parts, folder)
assert all((folder / name).exists() for name in parts)
"""
DIES = """
import os, sys
from pathlib import Path
from runout.backends.scan.shared_parts import share

share({"a": lambda: None, "b": lambda: os._exit(3), "c": lambda: None}, Path(sys.argv[1]))
"""


def test_each_part_is_done_once_and_all_are_done_at_the_end(tmp_path):
    processes = [subprocess.Popen([sys.executable, "-c", SHARES, str(tmp_path), who]) for who in ("first", "second", "third")]
    assert [process.wait() for process in processes] == [0, 0, 0]
    lines = (tmp_path / "done.txt").read_text().split("\n")[:-1]
    assert sorted(line[0] for line in lines) == list(NAMES)


def test_part_of_a_process_that_died_is_done_by_another(tmp_path):
    assert subprocess.run([sys.executable, "-c", DIES, str(tmp_path)]).returncode == 3
    done = []
    parts = {name: partial(done.append, name) for name in "abc"}
    complete(parts, tmp_path)
    assert done == ["b", "c"]
    complete(parts, tmp_path)
    assert done == ["b", "c"]


def test_part_that_fails_is_not_taken_as_done(tmp_path):
    def fail():
        raise RuntimeError("no room for code")

    with pytest.raises(RuntimeError):
        share({"a": fail}, tmp_path)
    done = []
    share({"a": partial(done.append, "a")}, tmp_path)
    assert done == ["a"]
