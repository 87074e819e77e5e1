"""
How far the edge of the flow may be off
=======================================

Each cell has a distance to the edge of every member. Their mean is 0 at the mean edge, their standard deviation says by how many
metres it varies. ``hazard.nc`` has both: ``boundary_distance_mean`` and ``boundary_distance_deviation``.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout
from runout.hazard.boundary import signed_distance

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
release = runout.Release.from_array(np.where(np.hypot(x - 50, y - 75) < 30, 5.0, 0.0), terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)


def thickness_of(friction):
    """Largest thickness [m] of a run with a friction angle [deg]."""
    result = runout.simulate(terrain, release, rock, basal_friction_angle=friction, cell_size=6.0, end_time=30.0)
    return result.maps["max_flow_thickness"]


reached = [thickness_of(angle).values >= 0.5 for angle in np.linspace(17.0, 27.0, 6)]
distance = np.array([signed_distance(one, (cell, cell)) for one in reached])
mean, deviation = distance.mean(0), distance.std(0)
share = np.mean(reached, axis=0)
assert deviation[15, 40:].max() > 3 * deviation[:, 25].max()

_, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
near = np.where((share > 0) & (share < 1), deviation, np.nan)
image = axes.pcolormesh(x, y, near, cmap="magma_r")
axes.contour(x, y, mean, [0.0], colors="k")
axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Line: mean edge of the flow of 0.5 m")
axes.figure.colorbar(image, label="standard deviation [m]", shrink=0.7)
