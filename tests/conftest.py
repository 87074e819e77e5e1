"""Each test leaves the process as it found it."""

import importlib.util
import logging
import os
import sys

import pytest


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
