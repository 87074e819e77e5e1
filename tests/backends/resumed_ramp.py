"""A short run on a slope; as a script it runs with checkpoints, to be killed."""

import sys

import numpy as np

from runout import DruckerPrager, Release, Terrain

CELL = 5.0
ELEVATION = np.tile(np.maximum(0.0, 60.0 - 0.6 * CELL * np.arange(30)), (20, 1))
TERRAIN = Terrain(ELEVATION, (CELL, CELL))
THICKNESS = np.zeros(TERRAIN.shape)
THICKNESS[6:14, 3:11] = 8.0
ARGUMENTS = {
    "terrain": TERRAIN,
    "release": Release(THICKNESS, TERRAIN, placement="on_surface"),
    "material": DruckerPrager(density=2000.0, youngs_modulus=2e6, friction_angle=30.0),
    "cell_size": 2.0,  # 25600 particles: enough for two threads
    "end_time": 2.5,
    "snapshot_times": (0.0, 0.4, 2.0),
    "snapshot_particles": 100,
}

if __name__ == "__main__":
    from runout.simulation.single import simulate

    simulate(**ARGUMENTS, threads=2, checkpoint=sys.argv[1], checkpoint_every=0.05)
