"""Kernels of scan take groups of arrays, few of them, and write arrays of a group only where numba keeps the write."""

import ast
import inspect

import pytest

from runout.backends.compile import functions_of
from runout.backends.scan import groups
from runout.backends.scan.kernels import BY_STRUCTURES, COMMON, CONTACT, domain, grid_to_particles, substep, tile

OTHERS = {domain, tile, grid_to_particles, substep}
MODULES = sorted({*COMMON, *CONTACT, *BY_STRUCTURES, *OTHERS}, key=lambda module: module.__name__)
MOST_ARGUMENTS = 12


def functions_in(module):
    return [node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.FunctionDef)]


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__.rsplit(".", 1)[-1])
def test_no_kernel_has_more_than_a_dozen_arguments(module):
    assert [f.name for f in functions_in(module) if len(f.args.args) > MOST_ARGUMENTS] == []


def unsafe_writes(function):
    """Arrays of groups that a function writes by index, and does not bind by ``name = group.array`` before."""
    nodes = list(ast.walk(function))
    written = [node.value for node in nodes if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store)]
    through_groups = [ast.unparse(value) for value in written if isinstance(value, ast.Attribute)]
    names = {value.id for value in written if isinstance(value, ast.Name)}
    assigned = [node for node in nodes if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple)]
    unpacked = {t.id for node in assigned for t in ast.walk(node.targets[0]) if isinstance(t, ast.Name)}
    return through_groups + sorted(names & unpacked)


def test_parallel_kernels_bind_each_array_that_they_write():
    """Numba removes a write to an array of a group in a parallel loop as dead code if it does not see that it is an argument."""
    kernels = [f for module in MODULES for f in functions_in(module) if "prange" in ast.unparse(f)]
    assert len(kernels) > 20
    assert {f.name: found for f in kernels if (found := unsafe_writes(f))} == {}


def test_the_check_finds_unsafe_writes():
    head = "def k(g):\n    a, b = g.a, g.b\n    c = g.c\n"
    source = head + "    for i in prange(3):\n        g.held[i] = a[i]\n        b[i] += 1\n        c[i] = 0"
    assert unsafe_writes(ast.parse(source).body[0]) == ["g.held", "b"]


def test_every_group_states_each_of_its_fields():
    classes = [value for value in vars(groups).values() if inspect.isclass(value) and value.__module__ == groups.__name__]
    assert len(classes) >= 12
    for group in classes:
        missing = [field for field in group._fields if field not in group.__doc__ and group is not groups.Buffers]
        assert missing == [], group.__name__


def test_kernels_are_functions_of_these_modules():
    assert sum(len(functions_of(module)) for module in MODULES) > 150
