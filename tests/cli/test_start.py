"""The command line starts quickly and says clearly what is wrong."""

import json
import logging
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from runout import __version__, cli, log
from runout.errors import BudgetError, ConfigError, ExitCode, PartialEnsembleError, Problem

HEAVY = (
    *("numpy", "scipy", "pandas", "xarray", "numba", "warp"),
    *("rasterio", "geopandas", "shapely", "matplotlib", "pydantic"),
)


def imported_by(*arguments):
    program = f"import sys; from runout.cli import main; main({list(arguments)!r}); print('\\n' + ' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["run", "--help"]])
def test_help_imports_nothing_heavy(arguments):
    modules = imported_by(*arguments)
    assert "runout.cli" in modules
    assert modules.isdisjoint(HEAVY)


def test_version_is_that_of_the_package(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == __version__


def test_unknown_command_names_the_nearest_one(capsys):
    assert cli.main(["chekc", "somewhere"]) == ExitCode.CONFIGURATION
    assert 'Did you mean "check"?' in capsys.readouterr().err


def test_missing_site_is_one_clear_message(tmp_path, capsys):
    assert cli.main(["run", str(tmp_path / "nowhere")]) == ExitCode.CONFIGURATION
    said = capsys.readouterr().err
    assert "nowhere" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigError([Problem("site.yaml", 5, "terrain.resolutoin", "unknown key", "did you mean 'resolution'?")]), 2),
        (PartialEnsembleError("every member failed"), 3),
        (BudgetError("needs 9 hours of 1"), 4),
        (OSError(28, "No space left on device", "results/terrain.nc"), 1),
    ],
)
def test_every_error_has_its_exit_code_and_is_said_once(monkeypatch, capsys, tmp_path, error, code):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("runout.workflow.hazard_map.run", fail)
    assert cli.main(["run", str(tmp_path)]) == code
    said = capsys.readouterr().err
    assert said.count("error:") == 1
    assert "Traceback" not in said
    assert (
        str(error) if not isinstance(error, OSError) else "results/terrain.nc: No space left on device; the disk is full"
    ) in said


def test_global_options_hold_before_and_after_the_command(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr("runout.commands.sites._stages", lambda site, stages, session, **_: seen.append(session) or 0)
    out = str(tmp_path / "elsewhere")
    assert cli.main(["-v", "--out", out, "terrain", "site"]) == 0
    assert cli.main(["terrain", "site", "-v", "--out", out]) == 0
    assert cli.main(["terrain", "site", "-q"]) == 0
    assert seen[0] == seen[1] == cli.Session(1, tmp_path / "elsewhere")
    assert seen[2] == cli.Session(-1, None)


def test_unforeseen_error_is_short_and_its_traceback_is_kept(tmp_path):
    program = (
        "import sys, runout.workflow.hazard_map as study; from pathlib import Path; from runout import log\n"
        "def broken(*a, **k):\n"
        "    with log.to_file(Path(sys.argv[1])): raise ZeroDivisionError('deep inside')\n"
        "study.run = broken\n"
        "from runout.cli import main\n"
        "sys.exit(main(['run', 'site', *sys.argv[2:]]))\n"
    )
    file = tmp_path / "run.log"
    short = subprocess.run([sys.executable, "-c", program, str(file)], capture_output=True, text=True, check=False)
    assert short.returncode == 1
    assert "ZeroDivisionError: deep inside" in short.stderr
    assert "Traceback" not in short.stderr
    assert "ZeroDivisionError: deep inside" in json.loads(file.read_text().splitlines()[-1])["traceback"]
    long = subprocess.run([sys.executable, "-c", program, str(file), "-v"], capture_output=True, text=True, check=False)
    assert "Traceback" in long.stderr


def test_log_file_holds_json_lines_with_details(tmp_path, capsys):
    log.to_terminal(0)
    with log.to_file(tmp_path / "results" / "run.log"):
        logging.getLogger("runout.somewhere").debug("a detail")
        logging.getLogger("runout.somewhere").warning("member %d failed", 3, extra={"member": 3})
    lines = [json.loads(line) for line in (tmp_path / "results" / "run.log").read_text().splitlines()]
    assert [line["message"] for line in lines] == ["a detail", "member 3 failed"]
    assert lines[1]["level"] == "warning"
    assert lines[1]["member"] == 3
    assert capsys.readouterr().err == "warning: member 3 failed\n"


def test_a_screen_shows_one_of_the_warnings_that_differ_in_numbers_and_a_file_shows_each(capsys, monkeypatch):
    from rich.console import Console

    def told(is_terminal):
        console = Console(stderr=True, force_terminal=is_terminal, color_system=None, soft_wrap=True, highlight=False)
        monkeypatch.setattr(log, "console", lambda: console)
        log.to_terminal(0)
        for member in range(3):
            with log.of_member(member):
                logging.getLogger("runout.simulation.single").warning("0.%d cells through the depth", member)
        return capsys.readouterr().err.splitlines()

    assert told(True) == ["warning: member 0: 0.0 cells through the depth"]
    assert told(False) == [f"warning: member {k}: 0.{k} cells through the depth" for k in range(3)]


@pytest.fixture
def line(monkeypatch):
    """A line of progress of the third of five stages, after 100 s of 400 s, and the clock."""
    clock = [0.0]
    monkeypatch.setattr(log.time, "monotonic", lambda: clock[0])
    shown = log.StatusLine(hidden=False)
    shown.stage = "stage 3 of 5, ensemble"
    shown.begin("")
    clock[0] = 100.0
    return shown, clock


def test_line_of_progress_states_stage_members_and_time_left(line, capsys):
    shown, clock = line
    shown.update(0.25, "4 of 16 members")
    assert capsys.readouterr().err == "stage 3 of 5, ensemble, 4 of 16 members, 25 %, 5 min 0 s left\n"  # to a file
    clock[0] += 0.9 * log.REPORT_SECONDS
    shown.update(0.5, "8 of 16 members", 60.0)
    assert capsys.readouterr().err == "", "a file gets a line now and then"
    assert shown.text() == "stage 3 of 5, ensemble, 8 of 16 members, 50 %, 60 s left"


@pytest.mark.parametrize("width", [10, 20, 40, 60, 200])
def test_line_of_progress_fits_on_a_terminal(line, width, monkeypatch):
    from io import StringIO

    from rich.console import Console

    shown, _ = line
    shown.update(0.25, "4 of 16 members")
    screen = Console(file=StringIO(), force_terminal=True, color_system=None, width=width)
    monkeypatch.setattr(log, "console", lambda: screen)
    screen.print(shown._drawn())
    drawn = screen.file.getvalue()
    assert drawn.count("\n") == 1
    assert len(drawn.strip()) < width
    assert "25 %" in drawn
    assert ("ensemble" in drawn) == (width >= 40)
    assert ("4 of 16 members" in drawn) == (width >= 60)


def test_stages_and_their_parts_share_one_line():
    log.to_terminal(-1)
    with log.progress_of_stages() as begin:
        begin("stage 1 of 2, terrain")
        outer = log.LINE.get()
        with log.progress("members") as update:
            update(0.5)
            assert log.LINE.get() is outer
        begin("stage 2 of 2, release")
        assert outer.text().startswith("stage 2 of 2, release, 1 s")
    assert log.LINE.get() is None


@dataclass
class FakeStudy:
    """What a run needs of a study before its first stage."""

    results: Path
    cluster: object = None


def test_log_folder_that_cannot_be_made_is_said_clearly(tmp_path, capsys, monkeypatch):
    (tmp_path / "results").write_text("a file, not a folder")
    monkeypatch.setattr("runout.workflow.study.Study.open", lambda *_, **__: FakeStudy(tmp_path / "results"))
    assert cli.main(["run", "site"]) == ExitCode.FAILURE
    assert "--out" in capsys.readouterr().err


@pytest.mark.parametrize("console", [log.console, log.output])
def test_a_colon_beside_a_number_stays_text(console):
    shown = console()
    with shown.capture() as text:
        shown.print("--members 0:100: a:b")
    assert text.get() == "--members 0:100: a:b\n"


@pytest.mark.parametrize("option", ["--threads", "--workers"])
def test_no_thread_and_no_worker_are_refused_before_anything_runs(option, tmp_path, capsys):
    assert cli.main(["run", str(tmp_path), option, "0"]) == ExitCode.CONFIGURATION
    assert f"{option}" in capsys.readouterr().err
