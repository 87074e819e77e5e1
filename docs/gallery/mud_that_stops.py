"""
Mud that stops on a slope
=========================

A Herschel-Bulkley fluid rests where its yield stress carries the weight: thinner than
:math:`\\tau_y / (\\rho g \\sin\\theta)` it does not flow.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

slope, cell, end = np.radians(12.0), 4.0, 30.0
x, y = np.meshgrid((np.arange(50) + 0.5) * cell, (np.arange(25)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(np.tan(slope) * (200 - x), cell)
release = runout.Release.from_array(np.where(np.hypot(x - 60, y - 50) < 24, 3.0, 0.0), terrain, placement="on_surface")

_, axes = plt.subplots(layout="constrained")
fronts = []
for yield_stress in (2000.0, 8000.0):
    mud = runout.HerschelBulkley(density=1800.0, yield_stress=yield_stress, consistency=100.0, youngs_modulus=2e6)
    times = np.arange(0.0, end + 1, 3.0)
    result = runout.simulate(
        terrain, release, mud, basal_friction_angle=45.0, cell_size=4.0, end_time=end, snapshot_times=times, stop=False
    )
    maps = result.snapshot_maps()["flow_thickness"]
    front = [float(maps.x[(one > 0.2).any("y")].max()) for one in maps]
    fronts.append(front)
    depth = yield_stress / (1800.0 * 9.81 * np.sin(slope))
    axes.plot(maps.time, front, "o-", label=f"{yield_stress / 1000:g} kPa: rests up to {depth:.2f} m")
assert fronts[1][-1] == fronts[1][-3] < fronts[0][-1], "the stiffer mud has stopped"
axes.set(xlabel="time [s]", ylabel="front [m]", title="Mud of 3 m on a slope of 12°")
axes.legend()
