"""Where the documentation is, and the data that its tutorial needs."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def repository():
    """Root of the repository."""
    return Path(__file__).parents[2]


@pytest.fixture
def rasters_of_cascades():
    """For a test that runs the site cascades_2021; skips it where its rasters are not."""
    folder = os.environ.get("RUNOUT_DATA", "")
    if not folder or not (Path(folder) / "cascades_2021_landlab").is_dir():
        pytest.skip("RUNOUT_DATA names no folder with cascades_2021_landlab, the rasters of the tutorial of an event")
