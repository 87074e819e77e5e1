"""
Exceedance probability of an ensemble
=====================================

Fraction of the members whose flow is 1 m thick or more. It is conditional on the release and on the range of the friction. In a
site: ``ensemble``, ``hazard.thickness_thresholds``.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import runout

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)
release = runout.Release.from_array(np.where(np.hypot(x - 50, y - 75) < 30, 5.0, 0.0), terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)


def thickness_of(friction):
    """Largest thickness [m] of a run with a friction angle [deg]."""
    result = runout.simulate(terrain, release, rock, basal_friction_angle=friction, cell_size=6.0, end_time=30.0)
    return result.maps["max_flow_thickness"]


angles = np.linspace(17.0, 27.0, 8)
members = xr.concat([thickness_of(angle) for angle in angles], "member")
probability = (members >= 1.0).mean("member")
assert set(np.unique(probability * 8)) <= set(range(9))

_, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
colours = {"vmin": 0, "vmax": 1, "cmap": "viridis_r", "cbar_kwargs": {"label": "probability of 1 m", "shrink": 0.7}}
probability.where(probability > 0).plot(ax=axes, **colours)
axes.contour(probability.x, probability.y, terrain.elevation, 20, colors="0.6", linewidths=0.5)
axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="8 members, friction 17° to 27°")
