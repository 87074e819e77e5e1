"""
Discharge through cross-sections
================================

Probes record what passes a line. In a site: ``probes``.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
release = runout.Release.from_array(np.where(np.hypot(x - 50, y - 75) < 30, 5.0, 0.0), terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
lines = {f"x = {at} m": [(at, 10.0), (at, 140.0)] for at in (110, 160, 210)}
probes = runout.Probes(cross_sections=lines, interval=0.5)
choices = {"basal_friction_angle": 18.0, "cell_size": 5.0, "end_time": 25.0}
result = runout.simulate(terrain, release, rock, probes=probes, **choices)

series = result.probes
passed = series.cross_sections["passed_volume"][:, -1]
assert passed[0] <= release.volume * 1.001

_, axes = plt.subplots(layout="constrained")
for k, name in enumerate(lines):
    label = f"{name}: {100 * passed[k] / release.volume:.0f} %"
    axes.step(series.time, series.cross_sections["discharge"][k], where="pre", label=label)
axes.set(xlabel="time [s]", ylabel="discharge [m³/s]", title=f"A release of {release.volume:.0f} m³")
axes.legend(title="share that passed")
