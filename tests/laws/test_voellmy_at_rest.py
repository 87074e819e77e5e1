"""A mass that Voellmy friction holds comes to rest; the reference agrees with scan and hash step by step (test_voellmy)."""

import math

import numpy as np
import pytest

import runout

VOELLMY = runout.Voellmy(mu=math.tan(math.radians(20.0)), xi=1000.0)


def speed_at_the_end(backend):
    """Root mean square speed [m/s] of a flat cap, 8 m thick, 10 s after it was laid on level ground; cells of 10 m."""
    place = (np.arange(20) + 0.5) * 10.0 - 100.0
    thickness = np.maximum(0.0, 8.0 * (1.0 - (place**2 + place[:, None] ** 2) / 80.0**2))
    terrain = runout.Terrain.from_array(np.full((20, 20), 500.0), 10.0)
    release = runout.Release.from_array(thickness, terrain, placement="on_surface")
    material = runout.DruckerPrager(density=2000.0, youngs_modulus=5.81e6, friction_angle=35.0)
    ledger = runout.simulate(
        terrain, release, material, basal_friction=VOELLMY, cell_size=10.0, end_time=10.0, stop=False, backend=backend
    ).ledger
    return float(np.sqrt(2.0 * ledger["kinetic_energy"][-1] / ledger["mass"][-1]))


@pytest.mark.parametrize("backend", ["scan", "hash"])
def test_cap_on_level_ground_stops_trembling(backend):
    assert speed_at_the_end(backend) < 0.02
