"""
Voellmy friction with a zone of forest
======================================

A zone multiplies the friction of the ground. In a site: ``terrain.friction_zones``.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
release = runout.Release.from_array(np.where(np.hypot(x - 50, y - 75) < 30, 3.0, 0.0), terrain, placement="on_surface")
snow = runout.DruckerPrager(density=300.0, friction_angle=30.0)
voellmy = runout.Voellmy(mu=0.3, xi=2000.0)
forest = np.where((x > 170) & (y < 75), 2.0, 1.0)[::-1].T  # by east and north, from the south-west corner
zones = runout.FrictionZones(forest, np.zeros_like(forest), (cell, cell))
choices = {"basal_friction": voellmy, "cell_size": 5.0, "end_time": 40.0}
result = runout.simulate(terrain, release, snow, friction_zones=zones, **choices)

thickness = result.maps["max_flow_thickness"]
reach = [
    float(thickness.x[(rows > 0.1).any("y")].max()) for rows in (thickness.sel(y=slice(150, 75)), thickness.sel(y=slice(75, 0)))
]
assert reach[1] < reach[0]

_, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
thickness.where(thickness > 0.1).plot(ax=axes, cmap="viridis", cbar_kwargs={"label": "largest thickness [m]", "shrink": 0.7})
axes.contourf(thickness.x, thickness.y, np.where((x > 170) & (y < 75), 1.0, np.nan), colors="none", hatches=["//"])
axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Hatched: friction times 2")
