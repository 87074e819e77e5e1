"""The plugin of QGIS: its zip, and its algorithms in QGIS without a display, on a small slope."""

import ast
import configparser
import json
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from runout import __version__, cli
from runout.config.process_ranges import processes
from runout.errors import ConfigError, ExitCode
from runout.workflow.qgis_plugin import NAMES, write_plugin

SOURCES = Path(__file__).parents[2] / "runout" / "qgis_plugin"
OLDEST = (3, 9)  # Python of QGIS 3.22 on Windows and macOS
HEADLESS, LIMIT = Path(__file__).with_name("headless.py"), 590  # [s]
ASK_QGIS = "from qgis.core import Qgis; import processing; print(Qgis.QGIS_VERSION)"
PYTHON = "/usr/bin/python3"


def qgis_version():
    """Version of the QGIS of the system; empty without one."""
    code = f"import sys; sys.path.insert(0, '/usr/share/qgis/python/plugins'); {ASK_QGIS}"
    if not Path(PYTHON).is_file():
        return ""
    return subprocess.run([PYTHON, "-c", code], capture_output=True, text=True).stdout.strip()


def algorithms():
    """Values of the class attributes of each algorithm, by command."""
    classes = [node for node in ast.parse((SOURCES / "algorithms.py").read_text()).body if isinstance(node, ast.ClassDef)]
    made = {}
    for one in classes:
        values = {}
        for node in one.body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
                values |= {name.id: value for name, value in zip(node.targets[0].elts, node.value.elts, strict=True)}
            elif isinstance(node, ast.Assign):
                values[node.targets[0].id] = node.value
        passed = ast.literal_eval(values["passed"]) if "passed" in values else {}
        made[ast.literal_eval(values["command"])] = passed
    return {command: passed for command, passed in made.items() if command}


def test_the_command_writes_one_whole_zip_that_is_equal_each_time(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    with caplog.at_level("INFO"):
        assert cli.main(["qgis-plugin"]) == ExitCode.OK
        assert cli.main(["qgis-plugin", "--out", "folder/plugin.zip"]) == ExitCode.OK
    first = tmp_path / f"runout_qgis_{__version__}.zip"
    assert first.read_bytes() == (tmp_path / "folder" / "plugin.zip").read_bytes()
    assert f"wrote {first.name}; in QGIS: Plugins > Manage and Install Plugins > Install from ZIP" in caplog.text
    with zipfile.ZipFile(first) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == [f"runout_qgis/{name}" for name in NAMES]


@pytest.mark.parametrize(("place", "message"), [("plugin.tgz", "must end in .zip"), ("here.zip", "is a folder")])
def test_a_place_that_takes_no_zip_is_refused(tmp_path, monkeypatch, capsys, place, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here.zip").mkdir()
    assert cli.main(["qgis-plugin", "--out", place]) == ConfigError("").exit_code
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["here.zip"]


def test_the_zip_has_every_file_of_the_plugin():
    files = {path.name for path in SOURCES.iterdir() if path.is_file()}
    assert files == set(NAMES)


def test_the_plugin_is_short_and_imports_nothing_but_qgis_and_the_standard_library():
    texts = {path: path.read_text(encoding="utf-8") for path in SOURCES.iterdir() if path.is_file()}
    assert sum(len(text.splitlines()) for text in texts.values()) < 600
    for path, text in texts.items():
        if path.suffix != ".py":
            continue
        tree = ast.parse(text, feature_version=OLDEST)
        nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom) and not getattr(node, "level", 0)]
        names = {(node.module if isinstance(node, ast.ImportFrom) else node.names[0].name).split(".")[0] for node in nodes}
        assert names <= {"qgis", "processing", *sys.stdlib_module_names}, path


def test_the_description_of_the_plugin_is_complete(tmp_path):
    with zipfile.ZipFile(write_plugin(tmp_path / "p.zip")) as archive:
        parser = configparser.ConfigParser()
        parser.read_string(archive.read("runout_qgis/metadata.txt").decode())
    stated = parser["general"]
    assert stated["version"] == __version__
    assert stated["hasprocessingprovider"] == "yes"
    assert (stated["qgisminimumversion"], stated["icon"]) == ("3.22", "icon.svg")
    needed = {"name", "description", "about", "author", "email", "tracker", "repository", "tags", "category"}
    assert needed <= set(stated)


def test_the_plugin_offers_the_processes_of_the_command():
    text = (SOURCES / "algorithms.py").read_text()
    assert ast.literal_eval(re.search(r"^PROCESSES = (\(.*\))$", text, re.MULTILINE)[1]) == tuple(processes())


@pytest.mark.parametrize("command", sorted(set(algorithms()) - {"open-results"}))
def test_each_option_that_an_algorithm_passes_is_one_of_the_command(command):
    names = {one.__name__.replace("_", "-") for one in cli.COMMANDS}
    if command not in names:
        pytest.skip(f"this version has no command {command}")
    known = {name for argument in cli.app[command].assemble_argument_collection() for name in argument.names} | {"--out", ""}
    assert set(algorithms()[command].values()) <= known


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """What the algorithms give in QGIS, by name."""
    version = qgis_version()
    if not version:
        pytest.skip(f"QGIS for {PYTHON} is not installed (Debian: qgis, python3-qgis)")
    folder = tmp_path_factory.mktemp("qgis")
    root = Path(__file__).parents[2]
    command = folder / "bin" / "runout"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nenv > "{folder}/environment"\nPYTHONPATH="{root}" exec "{sys.executable}" -m runout "$@"\n')
    command.chmod(0o755)
    words = [PYTHON, str(HEADLESS), str(write_plugin(folder / "p.zip")), str(folder), str(command)]
    clean = {"PATH": "/usr/bin:/bin", "HOME": str(Path.home())}  # compiled kernels lie there
    done = subprocess.run(words, capture_output=True, text=True, env=clean, timeout=LIMIT)
    lines = [json.loads(line.removeprefix("ANSWER ")) for line in done.stdout.splitlines() if line.startswith("ANSWER ")]
    assert done.returncode == 0, done.stderr[-4000:]
    return {line["name"]: line for line in lines} | {"environment": (folder / "environment").read_text(), "folder": folder}


def test_qgis_loads_the_plugin_from_the_zip_with_help_for_each_algorithm(answers):
    assert answers["load"]["loaded"]
    assert answers["load"]["started"]
    assert answers["provider"]["algorithms"] == sorted(name.replace("-", "_") for name in algorithms())
    assert all(len(text) > 40 for text in answers["provider"]["help"])


def test_a_command_that_is_not_installed_is_said_with_the_remedy(answers):
    assert "The command runout is not on the PATH. Install it" in answers["absent"]["error"]
    assert "Processing > Providers > runout" in answers["absent"]["error"]
    assert "there is no command runout, which the settings of Processing name" in answers["wrong"]["error"]


def test_the_command_does_not_see_the_libraries_of_qgis(answers):
    names = {line.partition("=")[0] for line in answers["environment"].splitlines()}
    assert not names & {"PROJ_DATA", "PROJ_LIB", "GDAL_DATA", "PYTHONHOME", "PYTHONPATH"}


def test_a_site_is_made_of_layers_in_memory_that_are_not_saved(answers):
    made = answers["new"]["outputs"]
    assert "Give one of these: Field with the thickness" in answers["twice"]["error"]
    site = Path(made["SITE"])
    assert (site / "inputs" / "release.gpkg").is_file()
    text = (site / "site.yaml").read_text()
    assert "thickness: depth" in text
    assert "law: voellmy" in text


def test_a_problem_of_check_fails_the_algorithm_with_its_text(answers):
    line = r"problem site\.yaml:\d+: simulation\.end_time: 'soon' is text; a number is needed"
    assert re.fullmatch(line, answers["bad"]["error"])
    assert "a run would" in answers["check"]["outputs"]["TEXT"]


def test_a_run_is_cancelled_with_all_its_processes_and_continues(answers):
    assert "Cancelled; finished members are kept" in answers["cancel"]["error"]
    assert answers["cancel"]["waited"] < 12
    assert answers["cancel"]["left"] == []
    assert answers["progress"]["shares"] == [2.0, 47.0, 25.5, None, None, None]
    shares = answers["run"]["shares"]
    assert shares == sorted(shares)
    assert {90.0, 97.0, 100.0} <= set(shares)
    assert "2 of 2" in answers["run"]["outputs"]["TEXT"]


@pytest.mark.parametrize("name", ["layers", "open"])
def test_results_open_as_one_group_with_their_styles(answers, name):
    if name == "open":
        assert any("layers of" in line and line.endswith("are open") for line in answers["open"]["lines"])
        assert "has no results yet; run the site first" in answers["early"]["error"]
        return
    drawn = answers["layers"]["drawn"]
    assert answers["layers"]["groups"] == ["runout ramp site"]
    probability = next(kind for layer, kind in drawn.items() if "probability" in layer.lower() or "inundation" in layer.lower())
    assert probability in ("QgsSingleBandPseudoColorRenderer", "QgsCategorizedSymbolRenderer", "QgsRuleBasedRenderer")
    assert not {"QgsSingleBandGrayRenderer", "QgsMultiBandColorRenderer"} & set(drawn.values())


def test_profiles_series_and_scores_are_made_of_layers_in_memory(answers):
    for name in ("profile", "probe"):
        folder = Path(answers[name]["outputs"]["RESULTS"])
        assert list(folder.glob("my_*.csv")), answers[name]
    assert Path(answers["compare"]["outputs"]["PAGE"]).is_file()


def test_calibration_of_a_site_without_observations_says_what_is_missing(answers):
    assert "observations" in answers["calibrate"]["error"]


def test_calibration_runs_whole_and_writes_the_posterior(answers):
    calibrated = answers["calibrated"]
    folder = Path(calibrated["outputs"]["RESULTS"])
    record = json.loads((folder / "calibration.json").read_text())
    assert "round 1 of 1" in calibrated["outputs"]["TEXT"]
    assert record
    assert len((folder / "posterior.csv").read_text().splitlines()) > 2, "a head and members"


def test_what_if_passes_values_and_options_in_the_order_of_the_command(answers):
    words = [line.removeprefix("word ") for line in answers["what_if"]["outputs"]["TEXT"].splitlines()]
    site, page = str(answers["folder"] / "ramp site"), str(answers["folder"] / "if")
    values = ["basal_mu=0.05:0.2:0.05", "bulking=1,2"]
    assert words == ["what-if", site, *values, "--budget", "5min", "--cell-size", "12.5", "--out", page, "--one-at-a-time"]


def test_what_if_of_the_real_command_writes_its_page(answers):
    page = Path(answers["swept"]["outputs"]["PAGE"])
    assert page.name == "what_if.html"
    table = (page.parent / "what_if.csv").read_text(encoding="utf-8").splitlines()
    assert len(table) == 3, "a head and two values"


def test_qgis_process_lists_the_algorithms(answers):
    program = shutil.which("qgis_process.bin") or shutil.which("qgis_process")  # the second of Debian is a script that fails
    if program is None:
        pytest.skip("qgis_process is not installed")
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(answers["folder"]), "QT_QPA_PLATFORM": "offscreen"}
    environment["QGIS_PLUGINPATH"] = str(answers["folder"] / "profile" / "python" / "plugins")
    enable = subprocess.run([program, "plugins", "enable", "runout_qgis"], capture_output=True, text=True, env=environment)
    listed = subprocess.run([program, "list"], capture_output=True, text=True, env=environment)
    assert "runout:check" in listed.stdout, enable.stdout + enable.stderr + listed.stderr
