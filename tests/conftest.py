"""Each test leaves the process as it found it."""

import logging
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
