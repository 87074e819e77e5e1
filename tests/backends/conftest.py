"""Every test of this folder runs on each backend that is there."""

from importlib.util import find_spec

import pytest

from runout.backends.protocol import BACKENDS, get_backend

AVAILABLE = [name for name in BACKENDS if find_spec(f"runout.backends.{name}") and find_spec(f"runout.backends.{name}.backend")]


@pytest.fixture(params=AVAILABLE)
def backend(request):
    """A fresh backend on one thread of the CPU."""
    return get_backend(request.param, "cpu", threads=1)
