"""The first minutes of a new user, in a folder whose name has a space and an umlaut: every message says what to do next."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import geopandas
import pytest
import shapely

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import NORTH, WEST, ramp, slab, write_raster

from runout import cli
from runout.errors import ExitCode

DEM, POLYGONS, RASTER = "Höhen modell.tif", "Anriss fläche.gpkg", "Mächtigkeit.tif"
BOX = shapely.box(WEST + 50, NORTH - 150, WEST + 110, NORTH - 90)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Folder with inputs, good and bad."""
    folder = tmp_path_factory.mktemp("Hang Süd")
    write_raster(folder / DEM, ramp() + 300.0)
    write_raster(folder / RASTER, slab())
    for name, columns in ((POLYGONS, {"thickness": [4.0]}), ("ohne.gpkg", {"name": ["a"]})):
        geopandas.GeoDataFrame(columns, geometry=[BOX], crs="EPSG:32632").to_file(folder / name)
    (folder / "leer.tif").touch()
    (folder / "text.tif").write_text("hello")
    (folder / "notes.txt").write_text("notes")
    (folder / "daten").mkdir()
    return folder


@pytest.fixture
def here(inputs, monkeypatch):
    """The folder with the inputs as working directory."""
    monkeypatch.chdir(inputs)
    return inputs


def said(capsys, *tokens):
    """Exit code, and the lines of output and messages."""
    code = cli.main(tokens)
    printed = capsys.readouterr()
    assert "Traceback" not in printed.err
    assert "fault of runout" not in printed.err
    return code, printed.out.splitlines() + printed.err.splitlines()


WRONG = [
    ((), "usage: runout new FOLDER --dem DEM --release RELEASE; all options: runout new --help"),
    (("site",), "usage: runout new FOLDER --dem DEM --release RELEASE"),
    (("site", "--dem", DEM), '"new" parameter --release requires an argument; usage: runout new FOLDER'),
    (("site", "--dem", "Hohen modell.tif", "--release", POLYGONS), f"there is no such elevation file; did you mean {DEM}?"),
    (("site", "--dem", DEM, "--release", "Anriss.gpkg"), "there is no such release file"),
    (("site", "--dem", "daten", "--release", POLYGONS), "daten: is a folder; name the elevation file in it"),
    (("site", "--dem", DEM, "--release", "daten"), "daten: is a folder; name the release file in it"),
    (("site", "--dem", "leer.tif", "--release", POLYGONS), "leer.tif: is empty (0 bytes); copy it again"),
    (("site", "--dem", "text.tif", "--release", POLYGONS), "text.tif: cannot be read as a raster"),
    (("site", "--dem", POLYGONS, "--release", DEM), "cannot be read as a raster"),
    (("site", "--dem", DEM, "--release", "notes.txt"), "notes.txt: cannot be read as a raster"),
    (("site", "--dem", DEM, "--release", POLYGONS, "--thickness", "-4"), "thickness is -4 m; it must be at least"),
    (("site", "--dem", DEM, "--release", POLYGONS, "--thickness", "dicke"), "no attribute 'dicke' for the thickness"),
    (
        ("site", "--dem", DEM, "--release", RASTER, "--thickness", "3"),
        "is a raster, which holds its own thickness",
    ),
    (("site", "--dem", DEM, "--release", POLYGONS, "--thicknes", "3"), "Did you mean --thickness?"),
    (("notes.txt", "--dem", DEM, "--release", POLYGONS), "FOLDER notes.txt: is a file; name a folder"),
    (("notes.txt/site", "--dem", DEM, "--release", POLYGONS), "is a file, not a folder; name another place"),
    (("daten", "site", "--dem", DEM, "--release", POLYGONS), "Unused Tokens: ['site']"),
]


@pytest.mark.parametrize(("tokens", "message"), WRONG)
def test_a_wrong_call_of_new_makes_nothing_and_says_in_one_line_what_to_do(here, capsys, tokens, message):
    before = sorted(here.rglob("*"))
    code, lines = said(capsys, "new", *tokens)
    assert code == ExitCode.CONFIGURATION
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert message in lines[0]
    assert sorted(here.rglob("*")) == before


@pytest.mark.parametrize("release", [POLYGONS, RASTER])
def test_a_new_site_is_ready_after_the_command_that_is_named(here, capsys, release):
    folder = f"Lawine Nörd {release[:2]}"
    code, lines = said(capsys, "new", folder, "--dem", DEM, "--release", release)
    assert code == ExitCode.OK
    next_command = shlex.split(lines[-1].partition("then: ")[2])
    assert next_command == ["runout", "check", folder]
    code, lines = said(capsys, *next_command[1:])
    assert code == ExitCode.OK
    assert lines[-1].startswith("memory ")
    code, lines = said(capsys, "new", folder, "--dem", DEM, "--release", release)
    assert code == ExitCode.CONFIGURATION
    assert lines[-1] == f"error: {folder}: is there already; choose another name or remove it"


def test_a_release_without_a_thickness_gets_a_value_and_a_warning(here, capsys):
    code, lines = said(capsys, "new", "ohne", "--dem", DEM, "--release", "ohne.gpkg")
    assert code == ExitCode.OK
    assert "site.yaml states 10 m: edit it, or make the site anew with --thickness" in lines[0]


@pytest.mark.parametrize("command", ["check", "run", "status"])
@pytest.mark.parametrize(
    ("site", "message"),
    [
        ("Hang", "no such site"),
        ("notes.txt", "the file holds no `key: value` lines; `runout new` writes a commented one to start from"),
        ("daten", "the folder holds no site.yaml; `runout new daten --dem ... --release ...` makes a site"),
        (DEM, "Höhen modell.tif"),
    ],
)
def test_what_is_no_site_is_named_with_the_way_to_one(here, capsys, command, site, message):
    code, lines = said(capsys, command, site)
    assert code == ExitCode.CONFIGURATION
    assert message in lines[0]


def test_commands_that_are_no_commands_are_answered_with_one(here, capsys):
    code, lines = said(capsys, "chekc", "daten")
    assert code == ExitCode.CONFIGURATION
    assert 'Did you mean "check"?' in lines[0]
    code, lines = said(capsys, "daten")
    assert "to check this site: runout check daten; runout --help lists all commands" in lines[0]
    code, lines = said(capsys, "help")
    assert lines[0].endswith("; runout --help lists all commands")


def test_an_early_stage_names_the_command_that_comes_first(here, capsys):
    said(capsys, "new", "früh und leer", "--dem", DEM, "--release", POLYGONS)
    code, lines = said(capsys, "hazard", "früh und leer")
    assert code == ExitCode.PARTIAL_ENSEMBLE
    assert lines[-1].endswith("run `runout ensemble 'früh und leer'` first")
    code, lines = said(capsys, "report", "früh und leer")
    assert code == ExitCode.FAILURE
    assert lines[-1].endswith("run `runout hazard 'früh und leer'` first")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp437", "utf-8"])
def test_a_terminal_of_any_encoding_shows_the_forecast(here, capsys, encoding):
    said(capsys, "new", f"zeichen {encoding}", "--dem", DEM, "--release", POLYGONS)
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-P", "-m", "runout", "check", f"zeichen {encoding}"]
    done = subprocess.run(command, env=environment, capture_output=True, cwd=here)
    assert done.returncode == ExitCode.OK, done.stderr
    assert b"memory " in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="names of any bytes")
def test_a_folder_whose_name_is_no_text_is_shown_and_works(here, capsys):
    name = os.fsdecode(b"alt\xfc")
    done = subprocess.run(
        [sys.executable, "-P", "-m", "runout", "new", name, "--dem", DEM, "--release", POLYGONS],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, capture_output=True, cwd=here,
    )  # fmt: skip
    assert done.returncode in (ExitCode.OK, ExitCode.CONFIGURATION), done.stderr
    assert b"Traceback" not in done.stderr
    assert b"fault of runout" not in done.stderr
