"""Numerical viscosity and cells through the depth: the formula against the decay that the transfers show, and who says it."""

import logging

import numpy as np
import pytest

from runout import DruckerPrager, Elastic, Release, Terrain, simulate
from runout.backends.protocol import get_backend
from runout.model.depth_resolution import LOST, WORST, DepthResolution, flow_depth, worst
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.physics.numerical_scales import numerical_viscosity

SOFT = Elastic(density=1000.0, youngs_modulus=1e3, poisson_ratio=0.0)
STEP = 0.1


def still_air(spacing=1.0, **choices):
    """A scene without weight and stiffness: only the transfers act."""
    raster = Raster(100, 100, (1.0, 1.0))
    return Scene((spacing,) * 3, None, raster, (SOFT,), (0.0,), (0.0, 0.0, 0.0), precision="float64", **choices)


def measured_viscosity(cells, substeps, since=60, steps=60):
    """Viscosity [m2/s] that stops a shear of ``cells`` cells wave length, cells of 1 m, eight particles each."""
    x, y, z = np.meshgrid([10.25, 10.75], [10.25, 10.75], np.arange(-1.5 * cells, 1.5 * cells, 0.5) + 0.25, indexing="ij")
    p, k = Particles.at(np.stack([x, y, z], axis=-1).reshape(-1, 3), np.ones(3)), 2 * np.pi / cells
    p.mass[:], p.volume[:], z = 1.0, 1e-15, z.ravel()
    p.velocity[:, 0], p.affine[:, 0, 2] = 1e-3 * np.cos(k * z), -1e-3 * k * np.sin(k * z)
    engine, inside, left = get_backend("reference"), np.abs(z) < cells / 2, []
    engine.load(still_air(substeps=substeps), p)
    for step in range(since + steps + 1):
        engine.step(STEP / substeps, substeps)
        left += [engine.particles().velocity[inside, 0] @ np.cos(k * z[inside])] if step in (since, since + steps) else []
    return -np.log(left[1] / left[0]) / (steps * STEP * k**2)


@pytest.mark.parametrize("cells", [16, 32])
@pytest.mark.parametrize("substeps", [1, 4])
def test_transfers_damp_as_the_viscosity_that_is_stated(cells, substeps):
    """The length of a transfer counts, not the number of its substeps."""
    assert measured_viscosity(cells, substeps) == pytest.approx(numerical_viscosity(1.0, cells, STEP), rel=0.05)


def test_ten_cells_keep_their_shear_a_minute_and_three_for_half_a_second():
    """Numbers of the glossary: cells of 2 m, steps of 1 ms."""
    scene = still_air(2.0)
    assert DepthResolution.of(20.0, scene, 1e-3, 0.5).shear_decay_time == pytest.approx(68.0, rel=0.02)
    three = DepthResolution.of(6.0, scene, 1e-3, 0.5)
    assert three.is_coarse
    assert three.shear_decay_time == pytest.approx(0.55, rel=0.02)
    assert "3 cells through a depth of 6 m" in three.statement()
    none = DepthResolution.of(0.0, scene, 1e-3, 0.5)
    assert none.shear_decay_time == np.inf
    assert "shear_decay_time" not in none.attributes()  # a file of JSON has no infinity


def test_without_a_flow_nothing_is_coarse_and_the_worst_of_none_is_nothing():
    assert flow_depth(np.zeros((3, 3))) == 0.0
    assert flow_depth(np.array([[2.0, 4.0], [np.nan, 0.0]])) == pytest.approx(20.0 / 6.0)
    assert not DepthResolution.of(0.0, still_air(), 0.1, 0.5).is_coarse
    assert worst([{}, {"cells_through_depth": 3.0}]) == {}
    two = [DepthResolution.of(depth, still_air(), 0.1, 0.5).attributes() for depth in (3.0, 6.0)]
    assert set(worst(two)) == set(WORST)
    assert worst(two)["least_thickness"] == 4.0 * 0.5 / (6.25 * still_air().spacing[0] * still_air().spacing[1])
    assert worst(two) == {name: two[0][name] for name in worst(two)}
    assert worst(two)["smallest_feature"] == 2 * max(*still_air().spacing[:2], *still_air().raster.cell_size)


@pytest.mark.parametrize(("thickness", "coarse"), [(2.0, True), (9.0, False)])
def test_a_run_reports_its_resolution_and_warns_of_few_cells(tmp_path, caplog, thickness, coarse):
    terrain = Terrain.from_array(np.zeros((20, 20)), 5.0)
    heap = np.zeros((20, 20))
    heap[6:14, 6:14] = thickness
    sand = DruckerPrager(density=2000.0, youngs_modulus=5e6, poisson_ratio=0.3, friction_angle=30.0)
    with caplog.at_level(logging.WARNING, "runout"):
        result = simulate(
            terrain, Release.from_array(heap, terrain), sand, cell_size=(2.5, 2.5, 2.0), particles_per_cell=(1, 1, 2), end_time=0.3,
            backend="reference", stop=False, substeps=1,
        )  # fmt: skip
    assert any(record.message.endswith(LOST) for record in caplog.records) == coarse
    assert 0.6 * thickness / 2.0 < result.depth_resolution.cells_through_depth < 1.05 * thickness / 2.0
    dt = 0.3 / result.steps
    assert result.depth_resolution.numerical_viscosity == pytest.approx(
        0.95 * (2.0 / (4 * result.depth_resolution.depth)) ** 2 * 4.0 / dt
    )
    result.to_netcdf(tmp_path / "run.nc")
    from runout.io.netcdf import read, read_attributes

    for attributes in (read_attributes(tmp_path / "run.nc"), read(tmp_path / "run.nc", "ledger").attrs):
        assert attributes["cells_through_depth"] == pytest.approx(result.depth_resolution.cells_through_depth)
        assert attributes["shear_decay_time"] == pytest.approx(result.depth_resolution.shear_decay_time)
