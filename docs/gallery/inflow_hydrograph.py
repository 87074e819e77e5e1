"""
Inflow by a hydrograph
======================

Mass enters at a line across a channel. In a site: ``inflow``.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

cell = 4.0
x, y = np.meshgrid((np.arange(60) + 0.5) * cell, (np.arange(20)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(0.25 * (240 - x) + 0.01 * (y - 40) ** 2, cell)
hydrograph = runout.Hydrograph([0, 8, 20, 30], [0, 150, 50, 0], [5, 7, 6, 5])
gauge = runout.Inflow(terrain, hydrograph, line=[(20.0, 52.0), (20.0, 28.0)])
mud = runout.DruckerPrager(density=1800.0, friction_angle=30.0)
probes = runout.Probes(cross_sections={"x = 100 m": [(100.0, 5.0), (100.0, 75.0)]}, interval=1.0)
result = runout.simulate(
    terrain, [], mud, inflow=gauge, basal_friction=runout.Voellmy(mu=0.15, xi=400.0), cell_size=4.0, end_time=40.0, probes=probes
)
entered = float(result.ledger["entered_mass"][-1]) / 1800.0
assert abs(entered / hydrograph.volume - 1) < 0.01

series = result.probes
_, axes = plt.subplots(layout="constrained")
axes.plot(hydrograph.time, hydrograph.discharge, "k--", label=f"at the line, {entered:.0f} m³")
passed = float(series.cross_sections["passed_volume"][0, -1])
axes.step(series.time, series.cross_sections["discharge"][0], where="pre", label=f"80 m below, {passed:.0f} m³")
axes.set(xlabel="time [s]", ylabel="discharge [m³/s]", title="A debris flow that enters by a hydrograph")
axes.legend()
