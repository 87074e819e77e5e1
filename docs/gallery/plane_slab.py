"""
A slab on an inclined plane
===========================

A block on a plane steeper than its friction angle gains speed at the rate
:math:`g\\,(\\sin\\theta - \\cos\\theta \\tan\\delta)`. A slab of grains does the same while it slides as a whole.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

slope, friction, cell = 30.0, 20.0, 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(20) + 0.5) * cell)
terrain = runout.Terrain.from_array(np.tan(np.radians(slope)) * (450 - x), cell)
slab = np.where((abs(x - 80) < 40) & (abs(y - 50) < 25), 5.0, 0.0)
release = runout.Release.from_array(slab, terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
result = runout.simulate(terrain, release, rock, basal_friction_angle=friction, cell_size=5.0, end_time=10.0)

ledger = result.ledger
speed = np.sqrt(2 * ledger["kinetic_energy"] / ledger["mass"])
theta = np.radians(slope)
acceleration = 9.81 * (np.sin(theta) - np.cos(theta) * np.tan(np.radians(friction)))
assert abs(float(speed[-1]) / (acceleration * 10.0) - 1) < 0.1

_, axes = plt.subplots(layout="constrained")
axes.plot(ledger["time"], speed, label="slab, root mean square")
axes.plot(ledger["time"], acceleration * ledger["time"], "k--", label="block")
axes.set(xlabel="time [s]", ylabel="speed [m/s]", title=f"Plane of {slope:g}°, friction {friction:g}°")
axes.legend()
