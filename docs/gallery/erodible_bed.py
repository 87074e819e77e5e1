"""
An erodible bed
===============

The flow takes up its bed at the rate of a law: the ground is lowered on the slope and raised below. In a site: ``bed``.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
release = runout.Release.from_array(np.where(np.hypot(x - 50, y - 75) < 30, 5.0, 0.0), terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
bed = runout.Bed(depth=np.where(x > 90, 1.0, 0.0), erosion=runout.RammsErosion(rate=0.05))
result = runout.simulate(terrain, release, rock, basal_friction_angle=18.0, cell_size=5.0, end_time=30.0, bed=bed)
taken_up = float(result.maps["eroded_depth"].sum()) * cell**2
assert 0 < taken_up < float(bed.depth.sum()) * cell**2

change = result.maps["elevation_change"]
_, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
colours = {"cmap": "RdBu_r", "vmin": -5, "vmax": 5, "cbar_kwargs": {"label": "change of elevation [m]", "shrink": 0.7}}
change.where(abs(change) > 0.05).plot(ax=axes, **colours)
axes.contour(change.x, change.y, terrain.elevation, 20, colors="0.6", linewidths=0.5)
axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=f"{release.volume:.0f} m³ took up {taken_up:.0f} m³")
