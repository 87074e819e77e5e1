"""Kernels of scan take groups of arrays, few of them, and write arrays of a group only where numba keeps the write."""

import ast
import inspect

import pytest

from runout.backends.compile import functions_of
from runout.backends.scan import groups
from runout.backends.scan.kernels import BY_GRADIENTS, COMMON, domain, grid_to_particles

MODULES = sorted({*COMMON, *BY_GRADIENTS, domain, grid_to_particles}, key=lambda module: module.__name__)
MOST_ARGUMENTS = 12


def functions_in(module):
    return [node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.FunctionDef)]


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__.rsplit(".", 1)[-1])
def test_no_kernel_has_more_than_a_dozen_arguments(module):
    assert [f.name for f in functions_in(module) if len(f.args.args) > MOST_ARGUMENTS] == []


def written_through_a_group(function):
    """Places of a group's array that a function writes by index, without a name for the array."""
    written = [node for node in ast.walk(function) if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store)]
    return [ast.unparse(node) for node in written if isinstance(node.value, ast.Attribute)]


def test_parallel_kernels_bind_the_arrays_that_they_write():
    """Numba removes ``group.array[i] = x`` in a parallel loop as dead code."""
    kernels = [f for module in MODULES for f in functions_in(module) if "prange" in ast.unparse(f)]
    assert len(kernels) > 20
    assert {f.name: found for f in kernels if (found := written_through_a_group(f))} == {}


def test_the_check_finds_a_write_through_a_group():
    source = "def kernel(blocks):\n    for b in prange(3):\n        blocks.held[b] = 0\n        blocks.first[b] += 1"
    assert written_through_a_group(ast.parse(source).body[0]) == ["blocks.held[b]", "blocks.first[b]"]


def test_every_group_states_each_of_its_fields():
    classes = [value for value in vars(groups).values() if inspect.isclass(value) and value.__module__ == groups.__name__]
    assert len(classes) >= 12
    for group in classes:
        missing = [field for field in group._fields if field not in group.__doc__ and group is not groups.Buffers]
        assert missing == [], group.__name__


def test_kernels_are_functions_of_these_modules():
    assert sum(len(functions_of(module)) for module in MODULES) > 150
