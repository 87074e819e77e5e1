"""The small synthetic site after one whole run."""

import logging
import sys

import pytest
from ramp_site import write_site


@pytest.fixture(scope="session")
def finished_site(tmp_path_factory):
    """The site after one whole run, and what the run said it did; only to be read."""
    from pipelines import hazard_map

    folder = write_site(tmp_path_factory.mktemp("study") / "ramp")
    return folder, hazard_map.run(folder, workers=1)


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
