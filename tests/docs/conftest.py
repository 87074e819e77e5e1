"""Where the documentation is."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def repository():
    """Root of the repository."""
    return Path(__file__).parents[2]
