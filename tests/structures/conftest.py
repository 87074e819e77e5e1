"""Contact with structures on each backend that is there."""

import sys
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / "backends")]

from scenes import engine_of  # noqa: E402

WITHOUT_STRUCTURES = ("hash",)


@pytest.fixture(params=["scan", "hash", "reference"])
def backend(request):
    """A fresh backend on one thread of the CPU."""
    if request.param in WITHOUT_STRUCTURES:
        pytest.skip(f"{request.param} has no contact with structures")
    return engine_of(request.param)
