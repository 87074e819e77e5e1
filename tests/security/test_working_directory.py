"""A folder from elsewhere is only read: no command imports its Python files or follows its settings."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import write_site

from runout import cli
from runout.processes.lifetime import import_path, interrupts_kept, python_command
from runout.view.process import RENDERER

# what a command or one of its processes imports, and names of files that Python or a library reads where it starts
MODULES = [
    *("numpy", "numba", "warp", "scipy", "pandas", "xarray", "rasterio", "netCDF4", "matplotlib", "pyvista", "dask", "distributed"),
    *("cyclopts", "rich", "yaml", "ruamel", "shapely", "pyproj", "pyogrio", "pickle", "json", "struct", "subprocess"),
    *("multiprocessing", "tempfile", "socket", "inspect", "logging", "pathlib", "typing"),
    *("sitecustomize", "usercustomize", "conftest"),
]
SETTINGS = {
    ".numba_config.yaml": "cache_dir: evil\ndisable_jit: 1\n",
    "matplotlibrc": "backend: module://pickle\nfigure.facecolor: red\nno.such.key: 1\n",
    "evil.pth": "import pickle\n",
    "pyproject.toml": "[tool.pytest.ini_options\n",
    ".env": "PYTHONPATH=.\n",
    "setup.cfg": "[\n",
}
MARK = "imported"
OF_A_SITE = ("check", "terrain", "status", "clean", "hazard", "report")
NAMES = [command.__name__.replace("_", "-") for command in cli.COMMANDS]


@pytest.fixture
def folder(tmp_path):
    """Folder with a site beside planted files; each module leaves a mark when it is imported."""
    write_site(tmp_path / "ramp")
    for name in MODULES:
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / MARK)!r}, 'a').write({name!r} + ' ')\n")
    for name, text in SETTINGS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def called(folder, *command):
    """A process in the folder, where Python finds runout as an installed package."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    package = os.pathsep.join(place for place in sys.path if place and Path(place).name != "workflow")
    environment |= {"PYTHONPATH": package, "MPLCONFIGDIR": str(folder / "ramp")}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def marks(folder):
    mark = folder / MARK
    return mark.read_text() if mark.exists() else ""


def test_the_planted_files_run_where_python_is_not_told_otherwise(folder):
    called(folder, sys.executable, "-c", "import pyogrio, pickle")
    assert marks(folder) == "pyogrio pickle "


@pytest.mark.parametrize("name", ["", "run", *OF_A_SITE])
def test_no_command_imports_from_the_working_directory(folder, name):
    """The help of ``run`` stands for that of the other commands, see below."""
    tokens = [name] if name else []
    site = ["ramp"] if name in OF_A_SITE else []
    done = called(folder, sys.executable, "-m", "runout", *tokens, *(site or ["--help"]))
    assert "Traceback" not in done.stderr
    assert "fault of runout" not in done.stderr
    assert done.returncode in ((0,) if name not in ("hazard", "report") else (1, 3)), done.stderr
    assert marks(folder) == ""


def test_the_help_of_each_command_imports_what_that_of_another_does():
    code = (
        "import sys; from runout import cli\n"
        "loaded = cli.main(['run', '--help']) or set(sys.modules)\n"
        "codes = [cli.main([name, '--help']) for name in sys.argv[1:]]\n"
        "print(len(codes), any(codes), *sorted(set(sys.modules) - loaded))"
    )
    done = subprocess.run([sys.executable, "-c", code, *NAMES], capture_output=True, text=True, check=True, timeout=300)
    assert done.stdout.splitlines()[-1] == f"{len(NAMES)} False"


def test_doctor_and_the_processes_that_it_starts_import_nothing(folder):
    done = called(folder, sys.executable, "-m", "runout", "doctor")
    assert "imports" in done.stdout
    assert "cannot be imported" not in done.stdout
    assert marks(folder) == ""


@pytest.mark.parametrize("code", [RENDERER, "import warp", "import pickle, numpy, numba, matplotlib.figure"])
def test_child_processes_import_nothing_from_the_working_directory(folder, code, monkeypatch):
    monkeypatch.chdir(folder)
    environment = {**os.environ, "PYTHONPATH": import_path()}
    subprocess.run(python_command(code), env=environment, stdin=subprocess.DEVNULL, capture_output=True, timeout=120)
    assert marks(folder) == ""


WORKERS = """
if __name__ == "__main__":
    import sys
    from runout import safe_start
    safe_start.begin()
    import os
    from runout.ensemble.worker import packed, start_worker
    worker = start_worker(0, None, ("pickle", "numpy", "numba", "xarray", "matplotlib.figure"))
    worker.assign(packed(print))
    print(type(worker.hear()).__name__)
    worker.end()
"""


def test_worker_processes_import_nothing_from_the_working_directory(folder, tmp_path_factory):
    script = tmp_path_factory.mktemp("scripts") / "workers.py"
    script.write_text(WORKERS)
    done = called(folder, sys.executable, str(script))
    assert done.stdout == "Ready\n", done.stderr
    assert marks(folder) == ""


def test_a_program_keeps_its_search_path_and_its_environment(monkeypatch):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    before = list(sys.path)
    with interrupts_kept():
        assert os.environ["PYTHONSAFEPATH"] == "1"
    assert "PYTHONSAFEPATH" not in os.environ
    assert sys.path == before


SETTINGS_USED = """
from runout.safe_start import ignore_settings
ignore_settings()
import matplotlib, yaml
from numba.core import config
print(matplotlib.rcParams["figure.facecolor"], matplotlib.get_backend(), config.CACHE_DIR, config.DISABLE_JIT, bool(yaml.safe_load))
config.reload_config()
print(config.CACHE_DIR, config.DISABLE_JIT)
"""


def test_settings_of_numba_and_matplotlib_in_the_working_directory_are_not_used(folder):
    (folder / "yaml.py").unlink()
    done = called(folder, sys.executable, "-P", "-c", SETTINGS_USED.replace("config.CACHE_DIR", "repr(config.CACHE_DIR)"))
    assert done.stdout == "white agg '' 0 True\n'' 0\n", done.stderr
    assert done.stderr == ""


def test_a_place_of_pythonpath_stays_on_the_search_path(tmp_path):
    """Laws of a user lie there, also where it is the working directory."""
    (tmp_path / "own_law.py").write_text("print('imported')\n")
    program = (
        "import runout.__main__ as entry, sys; sys.argv[:] = ['runout', '--version']; entry.begin(); entry.begin(); import own_law"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout == "imported\n", done.stderr
