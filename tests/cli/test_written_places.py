"""A place that an option names and that cannot be written is refused at once, by one line with the option."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import write_site

from runout import cli
from runout.errors import ConfigError, ExitCode
from runout.io.places import require_place, require_results


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Working folder with a site and a file; it must stay as it is."""
    write_site(tmp_path / "ramp")
    (tmp_path / "note").write_text("a file")
    (tmp_path / "film.gif").mkdir()
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    yield tmp_path
    assert sorted(tmp_path.rglob("*")) == before


def line(capsys, *tokens):
    """What a refused command says."""
    assert cli.main(tokens) == ExitCode.CONFIGURATION
    captured = capsys.readouterr()
    assert captured.out == ""
    (said,) = captured.err.splitlines()
    return said.removeprefix("error: ")


COMMANDS = [
    ("run", "ramp"), ("ensemble", "ramp"), ("hazard", "ramp"), ("simulate", "ramp"), ("animate", "ramp"), ("probe", "ramp"),
    ("profile", "ramp", "--line", "note"), ("screen", "ramp"), ("suggest-release", "ramp"), ("scarp", "ramp"),
    ("compare", "ramp", "ramp"), ("calibrate", "ramp"), ("sensitivity", "ramp"),
    ("verify", "U6"), ("validate", "columns"), ("stress",),
]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_every_command_refuses_results_in_a_file(folder, capsys, command):
    assert line(capsys, "--out", "note", *command) == "--out note: is a file; name a folder"
    beyond = f"--out note/results: {folder / 'note'} is a file, not a folder; name another place"
    assert line(capsys, "--out", "note/results", *command) == beyond


@pytest.mark.parametrize(
    ("option", "path", "said"),
    [
        ("--output", "note", "is a file; name a folder"),
        ("--output", "film.gif", "is a folder; name a file in it"),
        ("--output", "note/film.mp4", "{folder}/note is a file, not a folder; name another place"),
        ("--vtk", "note", "is a file; name a folder"),
        ("--vtk", "note/files", "{folder}/note is a file, not a folder; name another place"),
    ],
)
def test_films_and_files_for_paraview_are_refused_by_their_option(folder, capsys, option, path, said):
    assert line(capsys, "animate", "ramp", option, path) == f"{option} {path}: {said.format(folder=folder)}"


def test_files_of_studies_are_refused_by_their_option(folder, capsys):
    assert line(capsys, "verify", "U6", "--json", "film.gif") == "--json film.gif: is a folder; name a file in it"
    assert line(capsys, "bench", "--json", "note/a.json").startswith("--json note/a.json: ")


def test_the_usual_results_folder_is_checked_too(folder, capsys):
    results = folder / "ramp" / "results"
    results.write_text("a file")
    assert line(capsys, "screen", "ramp") == "--out [default] ramp/results: is a file; name a folder"
    assert cli.main(["status", "ramp"]) is not None  # a command that only reads says what it finds
    results.unlink()


def test_a_missing_folder_is_made_later_and_nothing_is_left_by_the_check(tmp_path):
    require_place("--out", tmp_path / "a" / "b", folder=True)
    require_place("--json", tmp_path / "a" / "b.json", folder=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/proc/results", "nothing can be written in /proc"),
        ("/dev/null", "is a device; name another place"),
        ("a" * 300, "File name too long"),
        ("a\0b", "no name holds a null character"),
    ],
)
def test_places_that_the_system_refuses_are_named(path, said):
    with pytest.raises(ConfigError) as caught:
        require_place("--json", Path(path), folder=False)
    assert str(caught.value).startswith("--json ")
    assert said in str(caught.value)


IN_THE_WAY = [
    ("results", "file", "results: is a file; name a folder"),
    ("results/report.html", "folder", "results/report.html: is a folder where results have a file; remove it"),
    ("results/structures.nc", "folder", "results/structures.nc: is a folder where results have a file; remove it"),
    ("results/maps", "file", "results/maps: is a file where results have a folder; remove it"),
    ("results/members/0000.nc", "folder", "results/members/0000.nc: is a folder where results have a file; remove it"),
]


@pytest.mark.parametrize(("name", "kind", "said"), IN_THE_WAY, ids=[name for name, _, _ in IN_THE_WAY])
def test_what_lies_in_the_place_of_results_is_refused_before_the_work(tmp_path, capsys, monkeypatch, name, kind, said):
    write_site(tmp_path / "ramp")
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "ramp" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "file":
        path.write_text("a file")
    else:
        path.mkdir()
    before = sorted(tmp_path.rglob("*"))
    assert line(capsys, "run", "ramp").startswith(f"--out [default] ramp/{said}")
    assert cli.main(["check", "ramp"]) == ExitCode.CONFIGURATION
    listed = [row for row in capsys.readouterr().out.replace("\n  ", " ").splitlines() if row.startswith("problem ")]
    assert len(listed) == 1
    assert said.split(" ")[0] in listed[0]
    assert sorted(tmp_path.rglob("*")) == before


def test_several_things_in_the_place_of_results_are_counted(tmp_path):
    for name in ("hazard.nc", "report.html", "maps"):
        (tmp_path / name).mkdir()
    (tmp_path / "run.log").write_text("")
    with pytest.raises(ConfigError, match=r"hazard\.nc: is a folder where results have a file, and 1 more; remove it"):
        require_results("--out", tmp_path)
