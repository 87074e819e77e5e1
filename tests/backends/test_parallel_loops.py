"""The body of a parallel loop is a function that numba compiles once, and that threads call for shares of the indices."""

import inspect
import textwrap

import numba
import numpy as np
import pytest
from numba.core import event

from runout.backends import compile as binding
from runout.backends.compile import functions_of, numba_binding
from runout.backends.lanes.parallel_loops import without_parallel_loops
from runout.backends.scan.kernels import BY_PORES, BY_STRUCTURES, BY_SUBSTEPS, COMMON, CONTACT, MOTION

HEAD = "import numpy as np\nfrom numba import prange\n\n"
KERNELS = """
def _twice(value):
    return value + value

def fill(values, marks):
    offset, calls = 1.0, marks.calls
    for k in prange(len(values)):
        if k == 2:
            continue
        step = _twice(k)
        values[k] = offset + step
        marks.calls[k] += 1
    for a in range(2):
        for k in prange(a):
            marks.last[k] = len(values)
    total = 0.0
    for k in range(len(values)):
        total += values[k] * calls[k]
    return total
"""


@pytest.fixture
def module_of(tmp_path, monkeypatch):
    """Modules of some source, and an empty cache for their kernels."""
    from importlib.util import module_from_spec, spec_from_file_location

    def load(source, name="kernels_of_a_test"):
        path = tmp_path / f"{name}.py"
        path.write_text(HEAD + textwrap.dedent(source))
        module = module_from_spec(spec := spec_from_file_location(name, path))
        spec.loader.exec_module(module)
        return module

    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "cache"))
    binding.cache_root.cache_clear()
    yield load
    binding.cache_root.cache_clear()


class Compiled(event.Listener):
    """Names of the functions that numba compiles."""

    def __init__(self):
        self.names = []

    def on_start(self, of_function):
        self.names.append(of_function.data["dispatcher"].py_func.__name__)

    def on_end(self, of_function):
        pass


def test_loops_reach_every_index_once_with_any_number_of_threads_and_compile_once(module_of):
    from collections import namedtuple

    marks_of, count = namedtuple("Marks", "calls last"), 101
    expected = 1.0 + 2.0 * np.arange(count)
    expected[2] = 0.0
    names, module = Compiled(), module_of(KERNELS)
    with event.install_listener("numba:compile", names):
        kernel = numba_binding(np.float64).kernels(module).fill
        for threads in range(1, numba.config.NUMBA_NUM_THREADS + 1):
            marks, values = marks_of(np.zeros(count, np.int64), np.zeros(2)), np.zeros(count)
            with binding.threads_at_most(threads):
                total = kernel(values, marks)
            assert np.array_equal(values, expected)
            assert marks.calls.tolist() == [int(k != 2) for k in range(count)]
            assert marks.last.tolist() == [count, 0.0]
            assert total == expected.sum()
    assert sorted(name for name in names.names if name.startswith(("fill", "_twice"))) == [
        "_twice",
        "fill",
        "fill_loop_1",
        "fill_loop_2",
    ]
    names.names.clear()
    again = numba_binding(np.float64).kernels(module).fill
    with event.install_listener("numba:compile", names):
        again(np.zeros(count), marks_of(np.zeros(count, np.int64), np.zeros(2)))
    assert sum(again.stats.cache_hits.values()) == 1
    assert names.names == []


def test_an_inlined_function_is_compiled_again_only_where_its_names_mean_something_else(module_of):
    source = "FACTOR = 2\n\ndef _scaled(a):\n    return FACTOR * a\n\ndef {name}(a):\n    return _scaled(a)\n"
    numbers, names = numba_binding(np.float64), Compiled()
    module = module_of(source.format(name="first"))
    with event.install_listener("numba:compile", names):
        assert numbers.kernels(module).first(3.0) == 6.0
        assert numbers.kernels(module, nogil=True, OTHER=1).first(3.0) == 6.0
        assert names.names == ["first", "_scaled", "first"]
        assert numbers.kernels(module, FACTOR=5).first(3.0) == 15.0
        assert names.names[3:] == ["first", "_scaled"]
        assert numbers.kernels(module, FACTOR=2.5).first(3.0) == 7.5


@pytest.mark.parametrize(
    ("body", "name"),
    [
        ("total = 0.0\n    for k in prange(len(a)):\n        total += a[k]\n    return total", "total"),
        ("for k in prange(len(a)):\n        last = a[k]\n    return last", "last"),
        ("b = 1.0\n    for k in prange(len(a)):\n        a[k] = b\n        b = a[0]", "b"),
    ],
)
def test_a_loop_that_sets_a_variable_of_its_kernel_is_refused(module_of, body, name):
    module = module_of(f"def kernel(a):\n    {body}\n")
    with pytest.raises(SyntaxError, match=f"kernel: a parallel loop sets {name}, which is used outside of it"):
        numba_binding(np.float64).kernels(module)


def test_every_parallel_kernel_of_scan_has_its_loops_taken_out():
    modules = {*COMMON, *CONTACT, *MOTION, *BY_SUBSTEPS, *BY_STRUCTURES, *BY_PORES}
    parallel = [f for module in modules for f in functions_of(module) if "prange" in f.__code__.co_names]
    assert len(parallel) > 20
    for function in parallel:
        kernel, bodies = without_parallel_loops(function, "key")
        assert len(bodies) == inspect.getsource(function).count("in prange(")
        assert "prange" not in kernel.__code__.co_names
        assert [body.__code__.co_varnames[:2] for body in bodies] == [("first_index", "end_index")] * len(bodies)
