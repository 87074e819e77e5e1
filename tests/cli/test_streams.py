"""Every command answers when it is called bare, for its help, and with standard streams that are closed or that nobody reads."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import write_site

from runout import cli
from runout.errors import ExitCode

NAMES = [command.__name__.replace("_", "-") for command in cli.COMMANDS]
WITH_ARGUMENTS = [name for name in NAMES if any(a.required and a.parse for a in cli.app[name].assemble_argument_collection())]
RUNOUT = f"{sys.executable} -P -m runout"
CLOSED = {"input": "<&-", "output": ">&-", "errors": "2>&-", "all streams": "<&- >&- 2>&-"}


def shell(line, folder):
    """Exit code and error output of a command line, of its first command in a pipe."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    script = f"set -o pipefail; {line}"
    done = subprocess.run(["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True, timeout=120)
    return done.returncode, done.stderr


@cache
def code_with_open_streams(command, folder):
    """Exit code of a command; a process for each command, not for each test."""
    return shell(f"{RUNOUT} {command}", folder)[0]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder that holds the site ``ramp``."""
    folder = tmp_path_factory.mktemp("streams")
    write_site(folder / "ramp")
    return folder


@pytest.mark.parametrize("tokens", [[], ["-v"], ["-q"], ["--help"], ["-v", "-q"]], ids=" ".join)
def test_a_call_without_a_command_prints_the_help(tokens, capsys):
    assert cli.main(tokens) == ExitCode.OK
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "Usage: runout COMMAND" in printed.out
    assert [name for name in NAMES if f" {name} " not in printed.out] == []
    assert "--out" in printed.out


@pytest.mark.parametrize("name", WITH_ARGUMENTS)
def test_a_bare_command_names_what_it_needs_and_where_its_options_are(name, capsys):
    assert cli.main([name]) == ExitCode.CONFIGURATION
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert f"usage: runout {name} " in line
    assert line.endswith(f"all options: runout {name} --help")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_every_command_prints_its_help(name, option, capsys):
    assert cli.main([name, option]) == ExitCode.OK
    printed = capsys.readouterr()
    assert printed.err == ""
    assert f"Usage: runout {name}" in printed.out


@pytest.mark.parametrize("stream", CLOSED)
@pytest.mark.parametrize("command", ["", "--version", "check --help", "status ramp", "clean ramp", "check nowhere"])
def test_a_closed_stream_changes_nothing_else(site, command, stream):
    code, said = shell(f"{RUNOUT} {command} {CLOSED[stream]}", site)
    assert code == code_with_open_streams(command, site)
    assert "Traceback" not in said
    assert "fault of runout" not in said


def test_files_that_a_command_opens_do_not_take_the_place_of_a_closed_stream(site):
    """Else messages go to the first file that is opened, here the log."""
    line = f"{RUNOUT} terrain ramp --out {{}} {{}}; wc -l < {{}}/run.log >&2"
    usual = shell(line.format("open", "", "open"), site)[1].splitlines()[-1]
    closed = shell(line.format("closed", ">&- 2>&-", "closed"), site)[1].splitlines()[-1]
    assert closed == usual
    assert b"\x1b" not in (site / "closed" / "terrain.nc").read_bytes()[:100]


@pytest.mark.parametrize("command", ["", "--help", "check --help", "status ramp"])
def test_a_pipe_that_nobody_reads_ends_the_command_in_silence(site, command):
    code, said = shell(f"{RUNOUT} {command} | true", site)
    assert (code, said) in ((cli.BROKEN_PIPE, ""), (0, ""))  # 0: it had written all before the reader ended


def test_a_pipe_that_was_closed_before_is_code_141(site):
    read, write = os.pipe()
    os.close(read)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([*RUNOUT.split(), "--help"], stdout=write, stderr=subprocess.PIPE, env=environment, text=True)
    os.close(write)
    assert (done.returncode, done.stderr) == (cli.BROKEN_PIPE, "")


def test_messages_that_nobody_reads_do_not_end_the_work(site):
    read, write = os.pipe()
    os.close(read)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [*RUNOUT.split(), "terrain", "ramp", "--out", "unread"]
    done = subprocess.run(command, stdout=write, stderr=write, env=environment, cwd=site)
    os.close(write)
    assert done.returncode == 0
    assert (site / "unread" / "terrain.nc").is_file()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full is of Linux")
@pytest.mark.parametrize("command", ["--help", "status ramp"])
def test_a_full_disk_under_the_output_is_one_line(site, command):
    code, said = shell(f"{RUNOUT} {command} > /dev/full", site)
    assert code == ExitCode.FAILURE
    assert said.count("\n") == 1
    assert "No space left on device" in said
