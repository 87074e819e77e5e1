"""
Pore pressure that drains
=========================

Water that carries 70 % of the weight lets a mass run as on a lower friction, until it has drained. In a site: ``pore_pressure``
of a release.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
wet = np.where(np.hypot(x - 50, y - 75) < 30, 4.0, 0.0)
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)

_, axes = plt.subplots(layout="constrained")
reach = []
for seconds in (1.0, 4.0, 12.0):
    pore = runout.PorePressure(ratio=0.7, decay_time=seconds)
    release = runout.Release.from_array(wet, terrain, placement="on_surface", pore_pressure=pore)
    result = runout.simulate(terrain, release, rock, basal_friction_angle=25.0, cell_size=5.0, end_time=35.0)
    along = result.maps["deposit_thickness"].max("y")
    reach.append(float(along.x[along > 0.1].max()))
    axes.plot(along.x, along, label=f"{seconds:g} s: to {reach[-1]:.0f} m")
assert reach == sorted(reach)
assert reach[0] < reach[-1]
axes.set(xlabel="x [m]", ylabel="deposit, largest across the flow [m]", title="The excess falls to 1/e within")
axes.legend()
