"""The command does not import dask, which xarray would do with its first array; a cluster still can."""

import subprocess
import sys

ALONE = """
import sys
import runout.__main__ as entry
sys.argv[:] = ["runout", "--version"]
entry.main()
import xarray
assert float(xarray.Variable("x", [1.0]).sum()) == 1.0
assert not any(name.startswith("dask.") for name in sys.modules)
from runout.processes.without_dask import show_dask
show_dask()
import dask.array
assert xarray.Variable("x", dask.array.ones(2).compute()).size == 2
"""


def test_xarray_does_without_dask_until_a_cluster_needs_it():
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
