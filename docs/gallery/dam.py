"""
With and without a dam
======================

The same release on two terrains: as it is, and with a dam of 8 m at the foot of the slope. In a site: ``terrain.obstacles``.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
release = runout.Release.from_array(np.where(np.hypot(x - 50, y - 75) < 30, 5.0, 0.0), terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
dam = np.where(abs(x - 265) < 10, 8.0, 0.0)
protected = runout.Terrain.from_array(terrain.elevation + dam, cell)

figure, axes = plt.subplots(2, 1, sharex=True, layout="constrained")
behind = []
for axis, ground in zip(axes, (terrain, protected), strict=True):
    result = runout.simulate(ground, release, rock, basal_friction_angle=20.0, cell_size=5.0, end_time=30.0)
    deposit = result.maps["deposit_thickness"]
    behind.append(float(deposit.where(deposit.x > 275).sum()) * cell**2)
    image = deposit.where(deposit > 0.1).plot(ax=axis, vmin=0, vmax=5, cmap="viridis", add_colorbar=False)
    axis.contour(deposit.x, deposit.y, ground.elevation, 20, colors="0.6", linewidths=0.5)
    axis.set(title=f"{behind[-1]:.0f} m³ beyond x = 275 m", aspect="equal", xlabel="", ylabel="y [m]")
axes[1].set_xlabel("x [m]")
figure.colorbar(image, ax=axes, label="deposit [m]")
assert behind[1] < 0.5 * behind[0]
