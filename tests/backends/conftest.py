"""Every test of this folder runs on each backend that is there."""

from importlib.util import find_spec

import pytest
from scenes import engine_of

from runout.backends.protocol import BACKENDS

AVAILABLE = [name for name in BACKENDS if find_spec(f"runout.backends.{name}") and find_spec(f"runout.backends.{name}.backend")]


@pytest.fixture(params=AVAILABLE)
def backend(request):
    """A fresh backend on one thread of the CPU; hash where the environment says."""
    return engine_of(request.param)
