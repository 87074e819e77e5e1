"""
Frequency curve at a point
==========================

With the annual rate of each volume, the members give the rate at which a thickness is reached at a house. In a site:
``ensemble.scenarios``.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout
from runout.hazard.frequency import annual_exceedance

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
release = runout.Release.from_array(np.where(np.hypot(x - 50, y - 75) < 30, 5.0, 0.0), terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
house, periods = (55, 15), (10, 30, 100, 300)  # column and row; an event as large or larger, once in so many years
rates = -np.diff([1 / years for years in periods] + [0.0])
largest = []
for factor in (0.3, 0.6, 1.0, 1.8):
    mass = runout.Release.from_array(factor * release.thickness, terrain, placement="on_surface")
    result = runout.simulate(terrain, mass, rock, basal_friction_angle=18.0, cell_size=5.0, end_time=30.0)
    largest.append(result.maps["max_flow_thickness"].values[house[1], house[0]])

thresholds = np.linspace(0.05, max(largest), 200)
rate = [float(annual_exceedance(np.array(largest)[:, None], limit, rates)[0]) for limit in thresholds]
assert rate == sorted(rate, reverse=True)
_, axes = plt.subplots(layout="constrained")
axes.semilogy(thresholds, rate, drawstyle="steps-pre")
for years in periods:
    axes.axhline(1 / years, color="0.7", lw=0.8)
    axes.text(thresholds[-1], 1 / years, f"1 in {years} years", ha="right", va="bottom")
axes.set(
    xlabel="thickness [m]", ylabel="annual rate of this thickness or more [1/a]", title=f"At x = {house[0] * cell + cell / 2:g} m"
)
