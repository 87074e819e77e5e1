"""What rests must rest: contact neither pumps energy nor lets a mass creep, and the ledger says so, on scan and hash.

The reference agrees with both step by step (tests/backends).
"""

import numpy as np
import pytest

import runout

FRICTION_DEG = 30.0
PER_KG = ("potential_energy", "basal_dissipation", "plastic_dissipation", "numerical_dissipation")


def ledger_of_a_cap(slope_deg, backend, end_time=5.0):
    """Ledger per kilogram of a cap of sand, 4 m high and 32 m wide, on a plane; cells of 2 m, 2 x 2 x 2 particles."""
    x, y = np.meshgrid((np.arange(22) + 0.5) * 2.0, (np.arange(22) + 0.5) * 2.0)
    terrain = runout.Terrain.from_array((200.0 - np.tan(np.radians(slope_deg)) * x)[::-1], 2.0)
    cap = 4.0 * np.clip(1.0 - (np.hypot(x - 22.0, y - 22.0) / 16.0) ** 2, 0.0, 1.0)
    release = runout.Release.from_array(cap[::-1], terrain, placement="on_surface")
    sand = runout.DruckerPrager(density=2000.0, youngs_modulus=2e7, poisson_ratio=0.3, friction_angle=34.0, cohesion=0.0)
    chosen = {"backend": backend, "precision": "float64", "particles_per_cell": 8, "threads": 1, "stop": False}
    run = runout.simulate(terrain, release, sand, basal_friction_angle=FRICTION_DEG, cell_size=2.0, end_time=end_time, **chosen)
    mass = run.ledger.mass.values[-1]
    rows = {name: run.ledger[name].values / mass for name in PER_KG}
    rows["speed"] = np.sqrt(2.0 * run.ledger.kinetic_energy.values / mass)
    return run.ledger.time.values, rows


@pytest.mark.parametrize("backend", ["scan", "hash"])
@pytest.mark.parametrize("slope_deg", [0.0, 15.0])
def test_cap_at_rest_neither_sinks_nor_is_pumped(slope_deg, backend):
    time, rows = ledger_of_a_cap(slope_deg, backend)
    later = np.searchsorted(time, 2.5)
    span = time[-1] - time[later]
    sinking = -(rows["potential_energy"][-1] - rows["potential_energy"][later]) / 9.81 / span
    assert abs(sinking) < 5e-4  # [m/s]
    assert rows["speed"][-1] < 3e-3
    assert np.diff(rows["basal_dissipation"][later:]).min() > -1e-5
    assert rows["basal_dissipation"][-1] > -1e-3
    assert abs(rows["numerical_dissipation"][-1] - rows["numerical_dissipation"][later]) / span < 2e-3  # [W/kg]
