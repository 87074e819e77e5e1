"""The command leaves out what xarray and numpy would do and no part of runout needs: dask, and threads of linear algebra."""

import os
import subprocess
import sys

import pytest

STARTED = """
import sys
import runout.__main__ as entry
sys.argv[:] = ["runout", "--version"]
entry.main()
"""
ALONE = """
import xarray
assert float(xarray.Variable("x", [1.0]).sum()) == 1.0
assert not any(name.startswith("dask.") for name in sys.modules)
from runout.processes.imports import show_dask
show_dask()
import dask.array
assert xarray.Variable("x", dask.array.ones(2).compute()).size == 2
"""
THREADS = """
import numpy
from threadpoolctl import threadpool_info
print(*[pool["num_threads"] for pool in threadpool_info() if pool["internal_api"] == "openblas"])
"""


def outcome(program, **environment):
    own = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"} | environment
    return subprocess.run([sys.executable, "-c", STARTED + program], capture_output=True, text=True, env=own)


def test_xarray_does_without_dask_until_a_cluster_needs_it():
    done = outcome(ALONE)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core")
@pytest.mark.parametrize(("environment", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_linear_algebra_has_one_thread_unless_the_user_chooses(environment, threads):
    done = outcome(THREADS, **environment)
    assert done.returncode == 0, done.stderr
    pools = done.stdout.splitlines()[-1].split()
    if not pools:
        pytest.skip("this numpy has another library than OpenBLAS")
    assert set(pools) == {threads}
