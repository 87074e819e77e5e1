"""`runout new` at a terminal asks for what it needs; elsewhere, or with options, it asks nothing."""

import os
import pty
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import geopandas
import pytest
import shapely

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import NORTH, WEST, ramp, slab, write_raster

from runout.config.read import load

ROOT = Path(__file__).parents[2]
BOX = shapely.box(WEST + 50, NORTH - 150, WEST + 110, NORTH - 90)
LIMIT = 100  # [s]


@pytest.fixture
def here(tmp_path):
    """Folder with an elevation raster and polygons."""
    write_raster(tmp_path / "dem.tif", ramp() + 300.0)
    geopandas.GeoDataFrame({"depth": [4.0]}, geometry=[BOX], crs="EPSG:32632").to_file(tmp_path / "scar.gpkg")
    return tmp_path


def at_terminal(folder, tokens, answers):
    """Exit status and text of a call at a terminal; each answer follows the next prompt, and a byte as an answer is a key."""
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder)
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
        os.execve(sys.executable, [sys.executable, "-m", "runout", *tokens], environment)
    text, answered, waiting, begun = b"", 0, list(answers), time.monotonic()
    while time.monotonic() - begun < LIMIT:
        if select.select([terminal], [], [], 0.2)[0]:
            try:
                text += os.read(terminal, 4096)
            except OSError:  # the command has ended
                break
        elif waiting and re.search(rb": ?$", text[answered:]):
            answer, answered = waiting.pop(0), len(text)
            os.write(terminal, answer if isinstance(answer, bytes) else f"{answer}\n".encode())
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), text.decode().replace("\r\n", "\n")


def test_answers_are_checked_at_once_and_become_the_options_of_a_command(here):
    answers = ["scar.gpkg", "slope", "lahar", "3", "gone.tif", "", "", "width", "", "many", "8"]
    code, text = at_terminal(here, ["new"], answers)
    assert code == 0, text
    for message in (
        "scar.gpkg: is there already; choose another name or remove it",
        "--process lahar: there is no such process; choose one of rock_avalanche",
        "gone.tif: there is no such elevation file",
        "no attribute 'width' for the thickness; attributes: 'depth'",
        "'many' is not a number of metres",
        "(DEM) [dem.tif]: ",
        "raster of thickness [scar.gpkg]: ",
        "vertical metres [depth]: ",
        "recommended [10]: ",
        "runout new slope --process debris_flow --dem dem.tif --release scar.gpkg --thickness depth --cell-size 8",
    ):
        assert message in text, text
    settings = load(here / "slope")
    assert (settings.simulation.cell_size, settings.release[0].thickness) == (8.0, "depth")
    assert settings.basal_friction.law == "voellmy"


def test_a_raster_of_thickness_is_not_asked_for_a_thickness(here):
    (here / "scar.gpkg").unlink()
    write_raster(here / "thickness.tif", slab())
    code, text = at_terminal(here, ["new", "slope"], ["7", "dem.tif", "thickness.tif", ""])
    assert code == 0, text
    assert "Folder of the new site" not in text
    assert "vertical metres" not in text
    assert "[dem.tif]" not in text  # one of two rasters
    assert load(here / "slope").basal_friction_angle_deg == 20.0


@pytest.mark.parametrize("key", [b"\x03", b"\x04"], ids=["Ctrl-C", "end of input"])
def test_an_end_in_the_middle_leaves_nothing_behind(here, key):
    before = sorted(here.iterdir())
    code, text = at_terminal(here, ["new", "slope"], ["1", "", key])
    assert code != 0
    assert "Traceback" not in text
    assert "interrupted" in text if key == b"\x03" else "the input ended before the last answer; nothing was made" in text
    assert sorted(here.iterdir()) == before


@pytest.mark.parametrize(
    ("tokens", "code", "message"),
    [
        (["new", "slope", "--dem", "dem.tif", "--release", "scar.gpkg"], 0, "made slope/site.yaml"),
        (["new", "slope", "--process", "debris_flow"], 2, "usage: runout new FOLDER --dem DEM --release RELEASE"),
        (["new", "dem.tif"], 2, "dem.tif: is there already; choose another name or remove it"),
        (["new", "slope", "--cell-size", "0"], 2, "usage: runout new FOLDER --dem DEM --release RELEASE"),
    ],
)
def test_options_at_a_terminal_ask_nothing(here, tokens, code, message):
    status, text = at_terminal(here, tokens, [])
    assert status == code, text
    assert message in text
    assert "Ctrl-C" not in text


def test_without_a_terminal_nothing_is_asked(here):
    command = [sys.executable, "-m", "runout", "new", "slope"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=here, input="1\n", capture_output=True, text=True, env=environment, timeout=LIMIT)
    assert done.returncode == 2
    assert "usage: runout new FOLDER --dem DEM --release RELEASE" in done.stderr
    assert "Process" not in done.stderr


def test_a_cell_size_out_of_range_is_refused(here):
    command = [sys.executable, "-m", "runout", "new", "slope", "--dem", "dem.tif", "--release", "scar.gpkg", "--cell-size", "0"]
    done = subprocess.run(command, cwd=here, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode != 0
    assert "--cell-size is 0 m; it must be" in done.stderr
    assert not (here / "slope").exists()
