"""Each test leaves the process as it found it; workers of pytest that take all cores use one process each."""

import importlib.util
import logging
import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest

WORKERS_TAKE_ALL_CORES = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "0")) >= len(os.sched_getaffinity(0))
if WORKERS_TAKE_ALL_CORES:  # before numpy is imported: threads of OpenBLAS would wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_collection_finish(session):
    """Refuse test modules that run a simulation while they are imported: each worker would compile and run it before any test."""
    kernels = sys.modules.get("runout.backends.scan.kernels")
    if kernels and kernels._MADE:
        raise pytest.UsageError("a test module simulates while it is imported; simulate in a test or a fixture")


@pytest.fixture(scope="session", autouse=True)
def one_process_where_workers_take_all_cores(tmp_path_factory):
    """One process for each number type compiles the kernels of scan for all workers: no core is left for others."""
    if not WORKERS_TAKE_ALL_CORES:
        yield
        return
    from kernel_compiler import KernelCompiler

    from runout.backends.scan import precompile

    folder = tmp_path_factory.getbasetemp().parent / "compilers"  # of all workers
    folder.mkdir(exist_ok=True)
    compiler = KernelCompiler(precompile._warm_up_elsewhere, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(precompile, "os", SimpleNamespace(**{**vars(os), "sched_getaffinity": lambda _: {0}}))
        patch.setattr(precompile, "_warm_up_elsewhere", compiler)
        yield
    compiler.end()


@pytest.fixture(scope="session")
def kernels_of_a_site(one_process_where_workers_take_all_cores):
    """For a command in a process of its own, which would compile all functions anew: the kernels of one mass of sand are there."""
    from runout import Coulomb, DruckerPrager
    from runout.backends.scan import kernels, precompile, warm_up

    sand = DruckerPrager(density=2000.0, youngs_modulus=2e6, friction_angle=30.0)
    scene, _ = warm_up.small_slope((sand,), (Coulomb(friction_angle=20.0),), "float32")
    scene = replace(scene, friction_zones=None, substeps=4)
    precompile.ensure_compiled(scene, kernels.sources_of(scene))


@pytest.fixture(autouse=True)
def terminal_as_before(monkeypatch):
    """Undo what a command does to the process: handlers, levels, hooks."""
    logger = logging.getLogger("runout")
    handlers, level = list(logger.handlers), logger.level
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(logging, "raiseExceptions", True)
    yield
    logging.captureWarnings(False)
    logger.handlers[:] = handlers
    logger.setLevel(level)


def not_here(reason):
    """End a test that needs what this machine lacks: a skip, but a failure where the variable CI is set."""
    if os.environ.get("CI", "").lower() in ("", "0", "false"):
        pytest.skip(reason)
    pytest.fail(f"{reason}; CI is set, so that this is a failure", pytrace=False)


@pytest.fixture(scope="session")
def drawable():
    """For a test that needs pyvista, not OpenGL."""
    if importlib.util.find_spec("pyvista") is None:
        not_here("pyvista is not installed (extra view)")


@pytest.fixture(scope="session")
def opengl(drawable):
    """For a test that draws."""
    from runout.errors import RenderError
    from runout.view import process

    try:
        process.drawn_by()
    except RenderError as error:
        not_here(f"nothing can be drawn here: {error}")


@pytest.fixture(scope="session")
def browser():
    """For a test that opens a page."""
    tried = [sys.executable, "-c", "from PyQt6 import QtWebEngineWidgets"]
    done = subprocess.run(tried, capture_output=True, text=True, check=False)
    if done.returncode:
        not_here(f"no page can be opened here: {done.stderr.strip().splitlines()[-1]}")
