"""Force, moment and pressure of facades from impulses on patches; runs record them."""

import numpy as np
import pytest
from boxes import FACES, between, field_of_boxes

import runout
from runout.errors import ConfigError
from runout.model.structures import Structures
from runout.simulation.structure_forces import StructureForces, named_structures, percentile_by_area

HOUSE, SHED = between((0, 0, 0), (2, 4, 3)), between((9, 0, 0), (10, 1, 1))
FIELD = field_of_boxes([HOUSE, SHED], 0.5, 2.0)
NAMES = tuple(f"{face} {k}" for k in range(2) for face in ("west", "east", "south", "north", "bottom", "top"))
STRUCTURES = Structures(("house", "shed"), NAMES, np.repeat([0, 1], FACES), FIELD)
PATCHES = FIELD.patches


def forces(pressure, times=(0.0, 0.5, 1.0)):
    """Forces of pressures (n, patches) [Pa] that press on each patch."""
    duration = np.diff(times)[:, None, None]
    return StructureForces(STRUCTURES, np.array(times), -duration * (pressure * PATCHES.area)[:, :, None] * PATCHES.normal[None])


def test_hydrostatic_pressure_on_a_wall_has_its_force_and_moment():
    """p = w (3 - z) on the western face of 4 m by 3 m: w b h^2 / 2, at a third of the height, by patches of one metre."""
    weight = 1.0e4
    west = (PATCHES.facade == 0).astype(float)
    found = forces(np.stack([west, 2.0 * west]) * weight * (3.0 - PATCHES.centre[:, 2]))
    np.testing.assert_allclose(found.force[0, 0], [weight * 4 * 9 / 2, 0.0, 0.0], rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(found.force[1], 2.0 * found.force[0])
    np.testing.assert_allclose(found.foot, [[1.0, 2.0, 0.0], [9.5, 0.5, 0.0]], atol=1e-12)
    height = (2.5 * 0.5 + 1.5 * 1.5 + 0.5 * 2.5) / 4.5  # of the patches, 1 m for a fine division
    np.testing.assert_allclose(found.moment[0, 0], [0.0, weight * 18 * height, 0.0], rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(found.pressure[0, 0], weight * 1.5, rtol=1e-12)
    np.testing.assert_allclose(found.high_pressure[0, 0], weight * 2.5, rtol=1e-12)
    np.testing.assert_allclose(found.loaded_area[:, :2], [[12.0, 0.0]] * 2)
    assert not found.force[:, 1:].any()


def test_forces_along_a_surface_make_no_pressure():
    impulses = np.zeros((1, len(PATCHES.area), 3))
    impulses[0, PATCHES.facade == 5] = (3.0, 4.0, 0.0)
    found = StructureForces(STRUCTURES, np.array([0.0, 1.0]), impulses)
    np.testing.assert_allclose(found.force[0, 5], 8 * np.array([3.0, 4.0, 0.0]))
    assert not found.pressure.any()


def test_percentiles_count_area():
    values, area = np.array([[5.0, 1.0, 3.0], [0.0, 9.0, 0.0]]), np.array([[0.04, 0.5, 0.46]] * 2)
    np.testing.assert_array_equal(percentile_by_area(values, area, 95.0), [3.0, 9.0])
    np.testing.assert_array_equal(percentile_by_area(values, area, 97.0), [5.0, 9.0])
    np.testing.assert_array_equal(percentile_by_area(values, area, 51.0), [3.0, 9.0])
    np.testing.assert_array_equal(percentile_by_area(values, area, 49.0), [1.0, 0.0])
    np.testing.assert_array_equal(percentile_by_area(values, 0.0 * area, 95.0), [0.0, 0.0])


def test_a_field_alone_is_one_structure_with_numbered_facades():
    found = named_structures(FIELD)
    assert found.names == ("structures",)
    assert len(found.facades) == 2 * FACES
    assert named_structures(None) is None


@pytest.fixture(scope="module")
def inputs():
    """Sand above a wall on a plane of 25 degrees."""
    x = np.tile((np.arange(30) + 0.5) * 2.0, (20, 1))
    terrain = runout.Terrain.from_array(60.0 - np.tan(np.radians(25.0)) * x, 2.0)
    thickness = np.zeros(terrain.shape)
    thickness[7:13, 5:9] = 4.0
    release = runout.Release.from_array(thickness, terrain, placement="on_surface")
    sand = runout.DruckerPrager(density=1800.0, youngs_modulus=1e7, poisson_ratio=0.3, friction_angle=34.0, cohesion=0.0)
    wall = field_of_boxes([between((20, 12, 38), (25, 28, 60))], 1.0, 5.0)
    return terrain, release, sand, wall


def run(inputs, **choices):
    terrain, release, sand, wall = inputs
    given = {"structures": wall, "basal_friction_angle": 5.0, "cell_size": 2.0, "particles_per_cell": 8, "end_time": 1.5}
    return runout.simulate(terrain, release, sand, **{**given, "precision": "float64", "stop": False, **choices})


def test_a_run_records_the_forces_of_its_flow(inputs):
    result = run(inputs)
    found = result.structure_forces
    assert found.times[0] == 0.0
    assert found.times[-1] == pytest.approx(1.5)
    assert len(found.times) > 20
    west = found.force[:, 0, 0]
    assert not west[0]
    assert west.max() > 1e5
    pushed = west > 0.0
    assert (found.loaded_area[pushed, 0] > 0.0).all()
    assert (found.high_pressure[pushed, 0] > found.pressure[pushed, 0]).all()
    assert float(result.ledger.structure_dissipation[-1]) > 0.0
    budget = ("basal_dissipation", "structure_dissipation", "plastic_dissipation")
    np.testing.assert_allclose(result.ledger.dissipation, sum(result.ledger[name] for name in budget))
    for interval, fewest, most in ((0.5, 2, 3), (0.0, result.steps // 4, result.steps), (0.0371, 20, 41)):
        other = run(inputs, force_interval=interval)
        assert fewest <= len(other.structure_forces.impulses) <= most
        np.testing.assert_allclose(other.structure_forces.impulses.sum(axis=0), found.impulses.sum(axis=0), rtol=1e-14)
        for name, values in result.fields.items():
            np.testing.assert_array_equal(other.fields[name], values, err_msg=name)


def test_an_interrupted_run_continues_with_the_forces_before(inputs, tmp_path):
    class Interrupted(Exception):
        pass

    def interrupt(fraction):
        if fraction > 0.7:
            raise Interrupted

    whole = run(inputs, end_time=1.2)
    saved = {"end_time": 1.2, "checkpoint": tmp_path / "run.npz", "checkpoint_every": 0.0}
    with pytest.raises(Interrupted):
        run(inputs, progress=interrupt, **saved)
    assert (tmp_path / "run.npz").is_file()
    resumed = run(inputs, **saved)
    np.testing.assert_array_equal(resumed.structure_forces.times, whole.structure_forces.times)
    np.testing.assert_array_equal(resumed.structure_forces.impulses, whole.structure_forces.impulses)
    assert whole.structure_forces.impulses.any()


def test_runs_without_structures_record_none(inputs):
    assert run(inputs, structures=None, end_time=0.1).structure_forces is None


def test_an_interval_that_is_negative_is_refused(inputs):
    with pytest.raises(ConfigError, match="force_interval is -1"):
        run(inputs, force_interval=-1.0)
