"""Contact with structures on each backend that is there."""

import sys
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / "backends")]

from scenes import engine_of  # noqa: E402

from runout.backends.protocol import BACKENDS  # noqa: E402


@pytest.fixture(params=BACKENDS)
def backend(request):
    """A fresh backend on one thread of the CPU; hash where the environment says."""
    return engine_of(request.param)
