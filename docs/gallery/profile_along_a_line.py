"""
Profile along a line
====================

Ground, largest thickness and largest speed along the axis of the flow. Of a site: ``runout profile SITE --line l.gpkg``.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
release = runout.Release.from_array(np.where(np.hypot(x - 50, y - 75) < 30, 5.0, 0.0), terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
result = runout.simulate(terrain, release, rock, basal_friction_angle=18.0, cell_size=5.0, end_time=30.0)

along = result.maps.sel(y=75.0, method="nearest")
ground = terrain.elevation[15]
thickness, speed = along["max_flow_thickness"], along["max_speed"]
assert float(speed.max()) < np.sqrt(2 * 9.81 * (ground.max() - ground.min()))

_, (upper, lower) = plt.subplots(2, 1, sharex=True, layout="constrained")
upper.plot(along.x, ground, "k", lw=0.8)
upper.fill_between(along.x, ground, ground + 4 * thickness, color="C1", alpha=0.6, label="largest thickness, times 4")
upper.set(ylabel="elevation [m]", title="Axis of the flow")
upper.legend()
lower.plot(along.x, speed)
lower.set(xlabel="x [m]", ylabel="largest speed [m/s]")
