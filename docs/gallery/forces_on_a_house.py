"""
Forces on a house
=================

A house as a body in three dimensions: force on each facade over time. In a site: ``structures``.
"""

import tempfile
from pathlib import Path

import geopandas
import matplotlib.pyplot as plt
import numpy as np
import shapely

import runout
from runout.simulation.structure_forces import facade_series

cell = 5.0
x, y = np.meshgrid((np.arange(60) + 0.5) * cell, (np.arange(24)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (150 - x) / 10), cell, crs="EPSG:32632")
mass = np.where(np.hypot(x - 50, y - 60) < 30, 5.0, 0.0)
release = runout.Release.from_array(mass, terrain, placement="on_surface")
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder, "house.geojson")
    house = {"name": ["house"], "height": [9.0], "geometry": [shapely.box(172, 52, 188, 68)]}
    geopandas.GeoDataFrame(house, crs=terrain.crs).to_file(file)
    structures = runout.Structures.from_file(file, terrain, cell_size=4.0)
result = runout.simulate(terrain, release, rock, basal_friction_angle=14.0, structures=structures, cell_size=4.0, end_time=15.0)

series = facade_series(result.structure_forces)
_, axes = plt.subplots(layout="constrained")
for k, name in enumerate(series["facade_name"].values):
    push = np.hypot(series["facade_force_east"][:, k], series["facade_force_north"][:, k])
    axes.plot(series["record_time"], push / 1e6, label=str(name))
axes.set(xlabel="time [s]", ylabel="horizontal force [MN]", title="A house in the way")
axes.legend()
