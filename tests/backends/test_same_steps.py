"""All backends plan the same steps: their length and the looks follow from the flow, not from how many a backend makes at once."""

import numpy as np
import pytest
from scenes import GRAVITY, HASH_DEVICE, plane, scene

from runout import DruckerPrager, Elastic, Release, Terrain, simulate
from runout.simulation.run import BATCH, Run, RunControl

TERRAIN = Terrain(np.tile(60.0 - 3.0 * np.arange(20), (14, 1)), (5.0, 5.0))
THICKNESS = np.zeros(TERRAIN.shape)
THICKNESS[5:9, 2:6] = 5.0
OF_THE_INDEX = ("active_blocks", "active_nodes", "sparsity", "memory", "contact_particles")


def run(backend, youngs_modulus, **choices):
    material = DruckerPrager(density=2000.0, youngs_modulus=youngs_modulus, friction_angle=30.0)
    place = {"device": HASH_DEVICE} if backend == "hash" else {"threads": 1}
    return simulate(
        terrain=TERRAIN, release=Release(THICKNESS, TERRAIN, placement="on_surface"), material=material, basal_friction_angle=5.0,
        cell_size=5.0, precision="float64", backend=backend, **{"end_time": 5.0, **place, **choices},
    )  # fmt: skip


@pytest.mark.parametrize("backend", ["reference", "scan"])
@pytest.mark.parametrize("youngs_modulus", [4e5, 4e7], ids=["flow as fast as its waves", "slow flow"])
def test_runs_differ_by_rounding(backend, youngs_modulus):
    found, expected = run(backend, youngs_modulus), run("hash", youngs_modulus)
    assert (found.steps, found.stop_reason) == (expected.steps, expected.stop_reason)
    assert len(set(np.round(expected.series["dt"], 9))) > 3  # the flow speeds up
    for name, values in expected.fields.items():
        np.testing.assert_allclose(found.fields[name], values, rtol=0, atol=1e-9 * np.nanmax(values), err_msg=name)
    for name in set(expected.series) - set(OF_THE_INDEX):
        size = np.abs(expected.series[name]).max()
        np.testing.assert_allclose(found.series[name], expected.series[name], rtol=0, atol=1e-7 * size + 1e-3, err_msg=name)


class Engine:
    """A backend whose fastest particle moves as it is told."""

    def __init__(self, a_scene, speed):
        self.scene, self.max_speed, self.made = a_scene, speed, 0

    def stable_step(self):
        return self.scene.stable_step(self.max_speed)

    def step(self, dt, substeps=1):
        self.scene.require_stable(dt, self.max_speed, self.made)
        self.made += 1
        if self.made == 3:
            self.max_speed *= 2.0


def run_of(youngs_modulus, speed):
    a_scene = scene(plane(), (5.0, 5.0, 5.0), (Elastic(density=2000.0, youngs_modulus=youngs_modulus, poisson_ratio=0.3),))
    made = Run(Engine(a_scene, speed), a_scene, RunControl(end_time=1e4), None, None)
    made.due = made.ledger_due = 1e3  # no look and no row of the ledger in between
    return made


@pytest.mark.parametrize("youngs_modulus", [1e5, 1e6, 1e9])
def test_steps_planned_at_once_stay_stable_in_free_fall(youngs_modulus):
    """Gravity may add more than the speed of the waves within 32 steps."""
    planned = run_of(youngs_modulus, 3.0)
    count = planned.plan(BATCH)
    assert planned.scene.bears(planned.dt, 3.0 + (count - 1) * planned.dt * GRAVITY)
    assert (count == BATCH) == (youngs_modulus == 1e9)
    assert count == BATCH or not planned.scene.bears(planned.dt, 3.0 + 4 / 3 * count * planned.dt * GRAVITY)


def test_steps_made_singly_end_where_the_next_would_be_unstable():
    hit = run_of(1e9, 400.0)
    hit.plan(BATCH)
    assert hit._step_singly(BATCH) == 3
    assert hit.due == hit.time  # the maps are looked at after the next step
