"""A synthetic site with the size of the published Blatten run: no survey, no data file, the same drop, path, volume and cells.

A flank falls 1000 m over 1800 m, from 40 degrees at its top to level ground, with a channel down its middle. A level floor 200 m
wide crosses its foot, and the other side of the valley rises beyond. The released mass is a cap with an elliptic outline.
"""

import numpy as np

from runout.materials.drucker_prager import DruckerPrager
from runout.model.release import Release
from runout.model.terrain import Terrain

DROP, LENGTH = 1000.0, 1800.0  # [m] of the flank, and its plan length
CROWN = 250.0  # [m] from the western edge to the top of the flank
FLOOR = 200.0  # [m], width of the valley's floor
OPPOSITE = 1500.0  # [m], radius of curvature of the other side over two
CHANNEL, CHANNEL_WIDTH = 80.0, 350.0  # [m], depth of the channel at its top, and half its width
EXTENT = (3000.0, 1800.0)  # [m], east and north
DEM_CELL = 10.0  # [m]
VOLUME = 9.3e6  # [m3]
CENTRE = 330.0  # [m] from the top of the flank to the middle of the release
HALF_AXES = (250.0, 320.0)  # [m], down the flank and across
BASAL_ANGLE, END_TIME = 15.0, 100.0  # [deg], [s]
ROCK_AND_ICE = DruckerPrager(density=2000.0, friction_angle=30.0)


def terrain(cell: float = DEM_CELL) -> Terrain:
    """Elevation of the site on cells of so many metres; elevation 0 is the valley's floor, the crown lies in the west."""
    columns, rows = (round(extent / cell) for extent in EXTENT)
    along = (np.arange(columns) + 0.5) * cell - CROWN
    across = (np.arange(rows) + 0.5) * cell - EXTENT[1] / 2
    left = np.clip(1.0 - along / LENGTH, 0.0, None)  # 1 at the top of the flank, above 1 behind it
    flank = np.where(left < 1.0, DROP * left**1.5, DROP * (1.0 + 1.5 * (left - 1.0)))
    opposite = np.clip(along - LENGTH - FLOOR, 0.0, None) ** 2 / OPPOSITE
    sides = CHANNEL * (1.0 - np.exp(-((across / CHANNEL_WIDTH) ** 2)))
    return Terrain((flank + opposite)[None, :] + sides[:, None] * np.minimum(left, 1.0), (cell, cell), source="synthetic site")


def release(ground: Terrain) -> Release:
    """The released mass below the surface: a parabolic cap of :data:`VOLUME`."""
    east, north = (np.arange(n) + 0.5 for n in ground.shape[::-1])
    x = (east * ground.cell_size[0] - CROWN - CENTRE) / HALF_AXES[0]
    y = (north * ground.cell_size[1] - EXTENT[1] / 2) / HALF_AXES[1]
    cap = np.clip(1.0 - x[None, :] ** 2 - y[:, None] ** 2, 0.0, None)
    return Release.from_array(cap * VOLUME / (cap.sum() * np.prod(ground.cell_size)), ground)


def path_length(volume: np.ndarray, ground: Terrain, share: float = 0.99) -> float:
    """Plan distance [m] down the path, from the top of the release, that so much of a deposit (rows, columns) does not exceed."""
    by_column = np.concatenate([[0.0], np.cumsum(np.nansum(volume, axis=0))])
    edges = np.arange(len(by_column)) * ground.cell_size[0]
    return float(np.interp(share * by_column[-1], by_column, edges) - (CROWN + CENTRE - HALF_AXES[0]))
