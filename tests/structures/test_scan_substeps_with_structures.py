"""Transfers of several substeps on scan with all that a scene may have: drag, areas, zones, several materials and structures."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import Box, between, field_of_boxes
from scenes import SAND, assert_same, box, engine_of, loaded, plane, scene
from test_friction_zones import zones
from test_sparse_equals_dense import CLAY

from runout.backends.scan.backend import OF_SUBSTEPS
from runout.backends.scan.kernels import kernels_for
from runout.friction.voellmy import Voellmy

CUBES = (1.0, 1.0, 1.0)
SLOPE = plane(slope_x=-0.3)
FIELD = field_of_boxes([Box((38.0, 30.0, -6.0), (1.5, 6.0, 12.0), 0.3, 0.3), between((37, 22, -14), (42, 25, -6))], 0.5, 2.5)
FRICTION = Voellmy(mu=0.15, xi=300.0, cohesion=200.0), Voellmy(mu=0.1, xi=800.0)
BORDER = zones(1.3, 0.0, np.indices((40, 30))[0] >= 17)
SCENE = scene(SLOPE, CUBES, (SAND, CLAY), FRICTION, substeps=8, structures=FIELD, friction_zones=BORDER)


def sliding():
    """Sand and clay side by side that slide over the border of the zones into the structures; the highest particles fly.

    Their touching radius is small, so that some would enter the structures within eight substeps.
    """
    p = box((31, 25, 0), (5, 7, 3), CUBES, SAND.density, surface=SLOPE)
    clay = p.position(CUBES)[:, 1] > 28.0
    p.release[clay], p.mass[clay] = 1, CLAY.density * p.volume[clay]
    p.radius[:] = 0.02
    p.velocity[:] = (8.0, 0.0, -2.4)
    p.velocity[p.node[:, 2] == p.node[:, 2].max(), 2] = 6.0
    return p


def after(name, a_scene, transfers, number):
    """A backend after transfers of three time steps, some of them with one substep."""
    engine = loaded(engine_of(name), a_scene, sliding())
    for n in range(transfers):
        engine.step(3e-3 * (1 + 0.3 * (n % 3)), number if n % 5 else 1)
    return engine


def results_of(engine):
    return engine.particles(), engine.ledger(), engine.columns()


@pytest.mark.parametrize("number", [3, 8])
def test_scan_equals_reference(number):
    expected, found = (after(name, SCENE, 40, number) for name in ("reference", "scan"))
    assert_same(results_of(expected), results_of(found), 1e-9, CUBES, other_index=True)
    impulses = expected.structure_impulses()
    assert np.abs(impulses).any(axis=1).sum() > 2
    np.testing.assert_allclose(found.structure_impulses(), impulses, rtol=0, atol=1e-9 * np.abs(impulses).max())
    assert found.structures.stopped > 0 or number < 8  # a second impulse stops particles in the longest transfers


def test_one_substep_is_that_of_a_scene_without_more_but_for_rounding():
    """The kernel that ends a transfer is compiled for several substeps, and fuses products and sums in another way."""
    one, several = (after("scan", replace(SCENE, substeps=n), 20, 1) for n in (1, 8))
    assert_same(results_of(one), results_of(several), 1e-12, CUBES, other_index=True)
    impulses = one.structure_impulses()
    np.testing.assert_allclose(several.structure_impulses(), impulses, rtol=0, atol=1e-12 * np.abs(impulses).max())


def test_kernels_of_substeps_are_compiled_elsewhere_for_scenes_that_have_them():
    assert not set(OF_SUBSTEPS) & set(vars(kernels_for(replace(SCENE, substeps=1))))
    after("scan", SCENE, 3, 2)
    kernels = vars(kernels_for(SCENE))
    from_cache = {name for name, kernel in kernels.items() if sum(kernel.stats.cache_hits.values())}
    assert {*OF_SUBSTEPS, "push_from_structures", "solve_contacts", "slow_columns"} <= from_cache
    assert not [name for name, kernel in kernels.items() if sum(kernel.stats.cache_misses.values())]
