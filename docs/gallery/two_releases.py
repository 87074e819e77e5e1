"""
Two releases, the second set off by the first
=============================================

``starts_when`` lets a mass wait until the flow of another one arrives at it.
"""

import matplotlib.pyplot as plt
import numpy as np

import runout

cell = 5.0
x, y = np.meshgrid((np.arange(90) + 0.5) * cell, (np.arange(30)[::-1] + 0.5) * cell)
terrain = runout.Terrain.from_array(5.5 * np.logaddexp(0, (220 - x) / 10) + 0.002 * (y - 75) ** 2, cell)


def mound(name, centre, start=None):
    """A round mass of 4 m on the slope."""
    thickness = np.where(np.hypot(x - centre[0], y - centre[1]) < 25, 4.0, 0.0)
    return runout.Release.from_array(thickness, terrain, placement="on_surface", name=name, starts_when=start)


upper = mound("upper", (40, 75))
lower = mound("lower", (130, 75), runout.Arrival("upper", thickness=0.1))
rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
result = runout.simulate(terrain, [upper, lower], rock, basal_friction_angle=18.0, cell_size=5.0, end_time=25.0)
assert not result.never_started

ledger = result.ledger
_, axes = plt.subplots(layout="constrained")
axes.plot(ledger["time"], ledger["kinetic_energy"] / 1e6)
start = float(ledger["time"][ledger["waiting_mass"].values > 0][-1])
axes.axvline(start, color="k", ls=":", label=f"the lower mass starts after {start:.1f} s")
axes.set(xlabel="time [s]", ylabel="kinetic energy [MJ]", title="A release that another one sets off")
axes.legend()
