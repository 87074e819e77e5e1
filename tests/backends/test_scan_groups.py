"""Kernels of scan take groups of arrays, few of them."""

import ast
import inspect
from types import SimpleNamespace

import numpy as np
import pytest

from runout.backends.compile import functions_of
from runout.backends.scan import groups
from runout.backends.scan.kernels import BY_STRUCTURES, COMMON, CONTACT, domain, grid_to_particles, substep, tile
from runout.backends.scan.node_columns import block_columns

OTHERS = {domain, tile, grid_to_particles, substep}
MODULES = sorted({*COMMON, *CONTACT, *BY_STRUCTURES, *OTHERS}, key=lambda module: module.__name__)
MOST_ARGUMENTS = 12


def functions_in(module):
    return [node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.FunctionDef)]


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__.rsplit(".", 1)[-1])
def test_no_kernel_has_more_than_a_dozen_arguments(module):
    assert [f.name for f in functions_in(module) if len(f.args.args) > MOST_ARGUMENTS] == []


def test_every_group_states_each_of_its_fields():
    classes = [value for value in vars(groups).values() if inspect.isclass(value) and value.__module__ == groups.__name__]
    assert len(classes) >= 12
    for group in classes:
        missing = [field for field in group._fields if field not in group.__doc__ and group is not groups.Buffers]
        assert missing == [], group.__name__


def test_kernels_are_functions_of_these_modules():
    assert sum(len(functions_of(module)) for module in MODULES) > 150


def test_block_columns_are_the_places_of_blocks_in_plan_in_ascending_order():
    plan = np.random.default_rng(1).integers(-9, 9, (200, 3)).astype(np.int32)
    places, column, start, parts = block_columns(SimpleNamespace(bxyz=plan, nall=180))
    assert (np.diff(places[:, 0] * 100 + places[:, 1]) > 0).all()
    assert (places[column] == plan[:180, :2]).all()
    for c in range(len(places)):
        assert (parts[start[c] : start[c + 1]] == np.flatnonzero(column == c)).all()
