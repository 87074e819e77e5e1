"""Processes that compile kernels for the cache make no machine code of what the kernels inline; results and cache are the same."""

import os
import subprocess
import sys

import pytest

KERNELS = """
import numba
import numpy as np

inline = numba.njit(forceinline=True, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
kernel = numba.njit(cache=True, no_cfunc_wrapper=True)
parallel = numba.njit(cache=True, parallel=True, no_cfunc_wrapper=True)

@inline
def half_of(x):
    return 0.5 * x

@parallel
def halved(values):
    for k in numba.prange(len(values)):
        values[k] = half_of(values[k])

@kernel
def total_of(values):
    total = 0.0
    for value in values:
        total += half_of(value)
    return total

@parallel
def half_total_of(values):
    halved(values)
    return total_of(values)
"""
RUN = """
import sys
sys.path.insert(0, sys.argv[1])
from numba.core.codegen import JITCodeLibrary
make, made = JITCodeLibrary._finalize_final_module, []
JITCodeLibrary._finalize_final_module = lambda self: (made.append(self.name), make(self))
from runout.backends.scan.deferred_code import make_code_when_called
if sys.argv[2] == "deferred":
    assert make_code_when_called() and make_code_when_called()
import numpy as np
from kernels import half_total_of, halved, total_of
for name in sys.argv[3:]:
    values = np.arange(8.0)
    found = {"halved": halved, "total_of": total_of, "half_total_of": half_total_of}[name](values)
    print(name, found, values.tolist())
hits = [k.py_func.__name__ for k in (halved, total_of, half_total_of) if sum(k.stats.cache_hits.values())]
print("loaded", *hits)
print("helpers with machine code", sum("half_of" in name for name in made))
"""
EXPECTED = {
    "halved": "halved None [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]",
    "total_of": "total_of 14.0 [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]",
    "half_total_of": "half_total_of 7.0 [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]",
}


@pytest.fixture
def run(tmp_path):
    (tmp_path / "kernels.py").write_text(KERNELS)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def script(how, *names):
        command = [sys.executable, "-c", RUN, str(tmp_path), how, *names]
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        *results, loaded, helpers = done.stdout.splitlines()
        assert results == [EXPECTED[name] for name in names]
        return loaded.split()[1:], int(helpers.split()[-1])

    return script


def test_functions_that_kernels_inline_have_no_machine_code(run):
    assert run("deferred", "halved", "total_of") == ([], 0)


def test_without_the_replacement_they_have(run):
    assert run("plain", "halved", "total_of")[1] > 0


def test_processes_that_compile_load_and_call_what_another_has_compiled(run):
    """One that links a kernel of the cache into its own, and one without the replacement."""
    run("deferred", "halved", "total_of")
    loaded, helpers = run("deferred", "total_of", "half_total_of", "halved")
    assert (set(loaded), helpers) == ({"total_of", "halved"}, 0)
    assert set(run("plain", "half_total_of", "total_of")[0]) == {"half_total_of", "total_of"}


def test_numba_without_these_methods_stays_as_it_is(monkeypatch):
    from numba.core import codegen

    from runout.backends.scan.deferred_code import make_code_when_called

    monkeypatch.delattr(codegen.JITCPUCodegen, "set_env")
    before = dict(vars(codegen.JITCodeLibrary))
    assert not make_code_when_called()
    assert dict(vars(codegen.JITCodeLibrary)) == before
