"""Modules are loaded by threads at once, and launches are recorded as graphs."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import warp as wp
from scenes import HASH_DEVICE

from runout.backends.hash.graphs import Graphs

BENCHMARK = Path(__file__).parents[1] / "benchmarks" / "gpu_friction.py"


def test_the_context_of_a_device_is_taken_before_threads_load_modules(monkeypatch):
    """Each thread that finds none takes one, with a stream of its own: launches and copies then go to different streams."""
    done = []
    monkeypatch.setattr(wp, "get_stream", lambda device: done.append("context"))
    monkeypatch.setattr(wp, "force_load", lambda *arguments, **options: done.append("modules"))
    Graphs(SimpleNamespace(is_cuda=True), [])
    assert done == ["context", "modules"]


@pytest.mark.skipif(not HASH_DEVICE.startswith("cuda"), reason="needs a GPU: RUNOUT_TEST_DEVICE=cuda:0")
def test_a_process_whose_kernels_are_compiled_already_records_its_graphs():
    """Its threads load all modules at the same time, before anything else has used the device."""
    for _ in range(3):
        command = [sys.executable, str(BENCHMARK), "--device", HASH_DEVICE, "--sizes", "0.1M"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
